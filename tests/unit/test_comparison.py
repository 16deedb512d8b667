"""The peers here are written differently: Kabsch's singular values, homogeneous matrices, a numerical minimum."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drives import cut, driven, integrated, tracked
from scipy.optimize import minimize

from artemis.errors import ConfigError
from artemis.motion.comparison import ALIGNMENTS, Alignment, Comparison, best_origin, compare, statistics
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose

HERE = Pose()


def compared(
    estimated: Trajectory,
    truth: Trajectory,
    *,
    alignment: Alignment = "best",
    sensor: Pose = HERE,
    same_clock: bool = True,
) -> Comparison:
    return compare(estimated, truth, alignment=alignment, sensor=sensor, same_clock=same_clock)


def wandering(seed: int, count: int = 200) -> tuple[Trajectory, Trajectory]:
    """A random walk as the truth, and an odometry that goes astray from it, in another frame; the same times."""
    random = np.random.default_rng(seed)
    true = np.cumsum(random.normal(size=(count, 3)) * [0.2, 0.2, 0.3], axis=0)
    believed = true + np.cumsum(random.normal(size=(count, 3)) * 0.03, axis=0)
    time = np.linspace(0.0, 0.1 * (count - 1), count)
    truth = Trajectory(time=time, poses=true).placed(Pose(x=3.0, y=-4.0, heading=random.uniform(-3, 3)))
    return Trajectory(time=time, poses=believed), truth


def matrix(row: np.ndarray) -> np.ndarray:
    x, y, heading = row
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("alignment", ALIGNMENTS)
def test_what_is_equal_has_no_error(alignment: Alignment) -> None:
    drive = driven(1)

    found = compared(drive, drive, alignment=alignment)

    assert found.error.max() < 1e-9
    assert np.abs(found.heading_error).max() < 1e-9
    assert max(each.translation.max() for each in found.relative) < 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_the_best_fit_is_that_of_singular_values(seed: int) -> None:
    estimated, truth = wandering(seed)
    places, true = estimated.poses[:, :2], truth.poses[:, :2]
    u, _, vt = np.linalg.svd((true - true.mean(axis=0)).T @ (places - places.mean(axis=0)))
    rotation = u @ np.diag([1.0, np.linalg.det(u @ vt)]) @ vt
    translation = true.mean(axis=0) - rotation @ places.mean(axis=0)

    found = best_origin(places, true)

    assert [found.x, found.y] == pytest.approx(translation.tolist(), abs=1e-12)
    assert math.remainder(found.heading - math.atan2(rotation[1, 0], rotation[0, 0]), math.tau) == pytest.approx(0.0)


def test_no_other_place_fits_better_than_the_best_fit() -> None:
    estimated, truth = wandering(7)

    def rms(origin: np.ndarray) -> float:
        c, s = np.cos(origin[2]), np.sin(origin[2])
        moved = estimated.poses[:, :2] @ np.array([[c, s], [-s, c]]) + origin[:2]
        return float(np.sqrt(np.mean(np.sum((moved - truth.poses[:, :2]) ** 2, axis=1))))

    found = compared(estimated, truth)
    by_search = minimize(rms, np.array([3.0, -4.0, found.origin.heading + 0.3]), method="Nelder-Mead", tol=1e-12)

    assert statistics(found.error).rms == pytest.approx(by_search.fun, rel=1e-6)
    assert statistics(found.error).rms == pytest.approx(
        rms(np.array([found.origin.x, found.origin.y, found.origin.heading]))
    )


@pytest.mark.parametrize("seed", range(3))
def test_relative_errors_are_those_of_matrices(seed: int) -> None:
    estimated, truth = wandering(seed)
    found = compared(estimated, truth, alignment="start")
    steps = np.hypot(*np.diff(estimated.poses[:, :2], axis=0).T)
    distance = np.append(0.0, np.cumsum(steps))

    for each in found.relative:
        begins = sorted({int(np.argmax(distance >= s)) for s in np.linspace(0.0, distance[-1] - each.length, 1000)})
        translation, rotation = [], []
        for begin in begins:
            far = np.flatnonzero(distance - distance[begin] >= each.length)
            if not len(far):
                continue
            end = int(far[0])
            own = np.linalg.inv(matrix(estimated.poses[begin])) @ matrix(estimated.poses[end])
            true = np.linalg.inv(matrix(truth.poses[begin])) @ matrix(truth.poses[end])
            error = np.linalg.inv(true) @ own
            translation.append(math.hypot(error[0, 2], error[1, 2]) / (distance[end] - distance[begin]))
            rotation.append(abs(math.atan2(error[1, 0], error[0, 0])) / (distance[end] - distance[begin]))
        np.testing.assert_allclose(each.translation, translation, atol=1e-12)
        np.testing.assert_allclose(each.rotation, rotation, atol=1e-12)
    assert [each.length for each in found.relative][:3] == [0.5, 1.0, 2.0]


def test_by_the_start_the_first_poses_become_equal() -> None:
    estimated, truth = wandering(3)

    found = compared(estimated, truth, alignment="start")

    np.testing.assert_allclose(found.estimated[0, :2], truth.poses[0, :2], atol=1e-12)
    assert found.heading_error[0] == pytest.approx(0.0, abs=1e-12)
    assert found.error[-1] > 0.1


def test_without_alignment_nothing_is_moved() -> None:
    estimated, truth = wandering(4)

    np.testing.assert_array_equal(compared(estimated, truth, alignment="none").estimated, estimated.poses)


def test_a_scale_of_the_way_is_found_as_it_is() -> None:
    time = np.arange(0.0, 40.0, 0.02)
    true = integrated(time, np.full(len(time), 0.3), np.zeros(len(time)))
    believed = integrated(time, np.full(len(time), 0.306), np.full(len(time), 0.003))

    found = compared(believed, true, alignment="none")

    assert [each.length for each in found.relative] == [0.5, 1.0, 2.0, 5.0, 10.0]
    assert found.relative[1].translation.mean() == pytest.approx(0.02 / 1.02, rel=0.05)
    for each in found.relative:
        assert each.rotation == pytest.approx(0.01 / 1.02, rel=1e-6)


def test_the_tracker_may_be_anywhere_on_the_robot() -> None:
    drive, sensor = driven(5), Pose(x=0.4, y=-0.15, heading=0.7)
    truth = drive.of_point(sensor).placed(Pose(x=1.0, y=2.0, heading=-2.0))

    assert compared(drive, truth, sensor=sensor).error.max() < 1e-9
    assert np.abs(compared(drive, truth, sensor=sensor).heading_error).max() < 1e-9
    assert compared(drive, truth).error.max() > 0.05


def test_an_unknown_clock_costs_little() -> None:
    truth = tracked(driven(6), 1, offset=-300.0, drift=3e-3, noise=0.0005)

    found = compared(driven(6), truth, same_clock=False)

    assert statistics(found.error).rms < 0.003
    assert (found.time[0], found.time[-1]) == pytest.approx((0.0, 60.0), abs=0.2)


def test_poses_are_compared_where_both_are_known() -> None:
    drive = driven(6)
    holey = Trajectory(
        time=np.delete(drive.time, slice(1000, 1100)), poses=np.delete(drive.poses, slice(1000, 1100), 0)
    )

    found = compared(holey, tracked(cut(drive, 10.0, 30.0), 1))

    gap = (found.time > holey.time[999]) & (found.time < holey.time[1000])
    assert not gap.any()
    assert 10.0 <= found.time[0] < 10.1
    assert 29.8 < found.time[-1] <= 30.0
    assert found.distance[0] == 0.0
    assert found.distance[-1] == pytest.approx(5.8, abs=1.0)


def test_what_the_truth_saw_before_the_run_counts_for_nothing() -> None:
    found = compared(cut(driven(6), 20.0, 40.0), driven(6), alignment="none")

    assert (found.time[0], found.time[-1]) == (20.0, 40.0)
    assert found.error.max() < 1e-9


def test_without_true_headings_there_are_places_only() -> None:
    truth = tracked(driven(2), 1, headings=False)

    found = compared(driven(2), truth)

    assert statistics(found.error).rms < 0.005
    assert np.isnan(found.heading_error).all()
    assert found.relative == ()
    with pytest.raises(ConfigError, match="by the start needs the true heading"):
        compared(driven(2), truth, alignment="start")


def test_half_a_turn_that_the_truth_has_not_seen_is_no_error() -> None:
    time = np.arange(0.0, 30.0, 0.02)
    speed, kept = np.full(len(time), 0.3), np.abs(time - 15.0) > 3.0
    drive = integrated(time, speed, np.full(len(time), 0.521))  # a little more than half a turn meanwhile
    believed = integrated(time, speed, np.full(len(time), 0.519))  # and a little less
    seen = Trajectory(time=time[kept], poses=drive.poses[kept])
    assert seen.poses[-1, 2] < believed.poses[-1, 2] - 6.0

    found = compared(believed, seen, alignment="start")

    assert np.abs(found.heading_error).max() == pytest.approx(0.06, abs=0.001)
    for each in found.relative:
        assert each.rotation == pytest.approx(0.002 / 0.3, rel=1e-3)


def test_nothing_in_common_is_refused_with_both_times() -> None:
    later = Trajectory(time=driven(1).time + 100.0, poses=driven(1).poses)

    with pytest.raises(
        ConfigError, match=r"truth spans 100.00 to 159.98 s by the run's clock, the run 0.00 to 59.98 s"
    ):
        compared(driven(1), later)


def test_errors_in_a_few_numbers() -> None:
    found = statistics(np.array([3.0, 0.0, 1.0, 2.0]))

    assert (found.mean, found.median, found.max, found.end) == (1.5, 1.5, 3.0, 2.0)
    assert found.rms == pytest.approx(math.sqrt(3.5))


def test_headings_are_apart_by_less_than_half_a_turn() -> None:
    time = np.arange(0.0, 10.0, 0.1)
    one = Trajectory(time=time, poses=np.column_stack([time, time, np.full(100, 3.0)]))
    other = Trajectory(time=time, poses=np.column_stack([time, time, np.full(100, -3.0)]))

    assert compared(one, other, alignment="none").heading_error == pytest.approx(6.0 - math.tau)
