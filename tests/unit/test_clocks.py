from __future__ import annotations

import numpy as np
import pytest
from drives import DURATION, cut, driven, integrated, tracked

from artemis.errors import ConfigError
from artemis.motion.clocks import Clock, estimate_clock
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose


@pytest.mark.parametrize("headings", [True, False])
@pytest.mark.parametrize(
    ("offset", "drift"), [(0.0, 0.0), (-17.3, 2e-4), (1234.5678, -1e-2), (1.7e9, 5e-5), (0.02, 1.5e-2)]
)
def test_offset_and_drift_are_found(offset: float, drift: float, headings: bool) -> None:
    truth = tracked(driven(1), 2, offset=offset, drift=drift, headings=headings)

    clock = estimate_clock(driven(1, scale=1.02, bend=0.02), truth)

    expected = offset + drift * (clock.middle - DURATION / 2)
    assert clock.offset == pytest.approx(expected, abs=0.005 if headings else 0.02)
    assert clock.drift == pytest.approx(drift, abs=3e-4 if headings else 1e-3)
    assert 0 < clock.offset_sigma < 0.02


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("begin", "end"), [(0.0, 60.0), (20.0, 40.0)])
def test_the_uncertainties_are_those_of_repetition(begin: float, end: float) -> None:
    """Errors of the estimate, in units of its own standard deviations."""
    errors = []
    for seed in range(8):
        truth = cut(tracked(driven(seed), 50 + seed, noise=0.005), begin, end)
        clock = estimate_clock(driven(seed, scale=0.99, bend=0.01), truth)
        errors.append((clock.offset / clock.offset_sigma, clock.drift / clock.drift_sigma))

    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (spread > 0.2).all()
    assert (spread < 2.5).all()


def test_turns_alone_tell_the_offset_of_a_tracker_somewhere_on_the_robot() -> None:
    truth = tracked(driven(7).of_point(Pose(x=0.9, y=-0.3, heading=1.0)), 8, offset=-4.2)

    clock = estimate_clock(driven(7, scale=1.02, bend=0.02), truth, one_point=False)

    assert clock.offset == pytest.approx(-4.2, abs=0.01)


def test_the_frame_of_the_truth_means_nothing() -> None:
    truth = tracked(driven(3), 4, offset=2.5)

    one = estimate_clock(driven(3, bend=0.01), truth)
    other = estimate_clock(driven(3, bend=0.01), truth.placed(Pose(x=-40.0, y=3.0, heading=-1.0)))

    assert other.offset == pytest.approx(one.offset, abs=1e-6)
    assert other.drift == pytest.approx(one.drift, abs=1e-8)


def test_a_part_with_a_gap_and_jumps_is_enough() -> None:
    truth = cut(tracked(driven(5), 6, offset=100.0), 120.0, 150.0)
    kept = np.abs(truth.time - 133.0) > 1.0
    poses = truth.poses[kept]
    poses[100:110, 0] += 1.0  # the tracker took something else for the robot
    damaged = Trajectory(time=truth.time[kept], poses=poses)

    clock = estimate_clock(driven(5, scale=1.01), damaged)

    assert clock.offset == pytest.approx(100.0, abs=0.02)


def test_a_turn_that_the_truth_has_not_seen_is_no_turn_of_its_own() -> None:
    time = np.arange(0.0, DURATION, 0.02)
    speed = 0.3 + 0.05 * np.sin(0.7 * time) + 0.05 * np.sin(0.31 * time)
    drive = integrated(time, speed, 0.8 * speed / 0.3)
    truth = tracked(drive, 3, offset=10.0)
    holey = (np.abs(truth.time - 30.0) > 3.0) & (np.abs(truth.time - 50.0) > 3.0)  # it turned by five radians meanwhile
    seen = Trajectory(time=truth.time[holey], poses=truth.poses[holey])
    assert seen.poses[-1, 2] < truth.poses[-1, 2] - 12.0

    assert estimate_clock(drive, seen).offset == pytest.approx(10.0, abs=0.02)


def test_few_poses_are_enough() -> None:
    clock = estimate_clock(driven(7), tracked(driven(7), 8, rate=2.0, offset=30.0))

    assert clock.offset == pytest.approx(30.0, abs=0.05)


def test_times_are_translated_there_and_back() -> None:
    clock, time = Clock(offset=12.0, drift=1e-3, middle=50.0), np.array([0.0, 50.0, 100.0])

    np.testing.assert_allclose(clock.shown(time), [11.95, 62.0, 112.05])
    np.testing.assert_allclose(clock.run_time(clock.shown(time)), time, atol=1e-12)


def steadily(turn_rate: float) -> Trajectory:
    time = np.arange(0.0, DURATION, 0.02)
    return integrated(time, np.full(len(time), 0.3), np.full(len(time), turn_rate))


@pytest.mark.parametrize("turn_rate", [0.0, 0.2])
def test_uniform_motion_is_refused(turn_rate: float) -> None:
    with pytest.raises(ConfigError, match=r"agree equally well; .* say so with --same-clock"):
        estimate_clock(steadily(turn_rate), tracked(steadily(turn_rate), 1))


def test_standing_is_refused() -> None:
    still = Trajectory(time=np.arange(0.0, 20.0, 0.02), poses=np.zeros((1000, 3)))

    with pytest.raises(ConfigError, match="no motion in common"):
        estimate_clock(still, still)


def test_two_places_of_equal_motion_are_refused() -> None:
    once = driven(9)
    twice = np.vstack([once.poses, once.poses + once.poses[-1]])
    both = Trajectory(time=np.linspace(0.0, 120.0, len(twice)), poses=twice)

    with pytest.raises(ConfigError, match=r"offsets of .* agree equally well"):
        estimate_clock(both, cut(once, 8.0, 50.0))


@pytest.mark.parametrize("other", [11, 13, 14])
def test_the_truth_of_another_run_is_refused(other: int) -> None:
    with pytest.raises(ConfigError, match="the motions do not agree at any offset"):
        estimate_clock(driven(10), tracked(driven(other), 1))


def test_parts_of_another_run_that_are_alike_are_refused() -> None:
    with pytest.raises(ConfigError, match="the motions do not agree: is it the truth of this run"):
        estimate_clock(driven(4), tracked(driven(2), 1))


def test_noise_is_averaged() -> None:
    clock = estimate_clock(driven(1, scale=1.01), tracked(driven(1), 10, noise=0.03, offset=3.0))

    assert clock.offset == pytest.approx(3.0, abs=0.03)
    assert clock.offset_sigma < 0.02


@pytest.mark.parametrize(
    ("time", "problem"),
    [
        (np.arange(0.0, 4.0, 0.05), "the truth spans 3.95 s"),
        (np.arange(0.0, 60e6, 5e4), "the truth spans 5.995e.07 s; expected 5 to 100000 s, times in seconds"),
        (np.arange(0.0, 60.0, 20.0), "poses 20 s apart are too few"),
    ],
)
def test_times_that_tell_nothing_are_refused(time: np.ndarray, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        estimate_clock(driven(1), Trajectory(time=time, poses=np.zeros((len(time), 3))))
