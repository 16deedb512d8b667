"""The judge: distances from a course by hand, figures of made-up tracks, and runs that do not end well."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pytest

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.path import Path
from artemis.plugins.contracts import Following
from artemis.testing.contracts import ROBOT
from artemis.values import DriveCommand, Snapshot, Tracking
from artemis_lab.bench.courses import five_courses
from artemis_lab.bench.driving import FollowerRefused, drive
from artemis_lab.bench.judge import ReferenceLine, RunTrack, judge
from artemis_lab.bench.plant import Conditions, bicycle

COURSES = {course.name: course for course in five_courses()}
STRAIGHT = COURSES["straight"]


def track(distance: Array, cross_track: Array, *, time: Array | None = None, steering: Array | None = None) -> RunTrack:
    """Along the straight course."""
    none = np.zeros_like(distance)
    return RunTrack(
        time=distance if time is None else time,
        x=distance,
        y=cross_track,
        distance=distance,
        arc_length=distance,
        cross_track=cross_track,
        speed=none,
        steering=none if steering is None else steering,
    )


# ---------------------------------------------------------------------------------------------- distances


def test_left_is_positive_and_ends_go_on_straight() -> None:
    reference = ReferenceLine(STRAIGHT)
    assert reference.locate(-0.2, 0.3) == pytest.approx((-0.2, 0.3))
    for x in np.arange(0.2, 15.0, 0.4).tolist():
        assert reference.locate(x, -0.1) == pytest.approx((x, -0.1))
    assert reference.locate(15.2, 0.1) == pytest.approx((15.2, 0.1))


def test_beside_the_outside_of_a_corner_the_corner_is_nearest() -> None:
    reference = ReferenceLine(COURSES["corner"])
    for x in np.arange(0.0, 4.0, 0.3).tolist():
        reference.locate(x, 0.0)
    arc, distance = reference.locate(4.3, -0.4)
    assert (arc, abs(distance)) == pytest.approx((4.0, 0.5))
    assert distance < 0  # to the right
    assert reference.locate(4.1, 0.3) == pytest.approx((4.3, -0.1))


def test_at_a_crossing_it_stays_on_its_branch() -> None:
    eight = COURSES["figure-eight"]
    reference = ReferenceLine(eight)
    arcs = []
    for x, y in eight.points[::10].tolist():
        arc, distance = reference.locate(x, y)
        arcs.append(arc)
        assert abs(distance) < 1e-6
    assert np.diff(arcs).min() > 0


# ---------------------------------------------------------------------------------------------- figures


def test_means_are_over_the_way_and_not_over_the_time() -> None:
    distance = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 2.0])
    error = np.array([0.1, 0.9, 0.9, 0.9, 0.0, 0.0])
    figures = judge(track(distance, error, time=np.arange(6.0)), STRAIGHT, 1.0)
    assert figures.rms == pytest.approx(math.sqrt(0.1**2 / 2))
    assert figures.max == 0.9
    assert figures.time == 5.0


def test_settling_overshoot_and_steady_figures() -> None:
    distance = np.linspace(0.0, 15.0, 1501)
    error = 0.5 * np.exp(-distance) * np.cos(2 * distance)
    figures = judge(track(distance, error), STRAIGHT, 1.0)
    assert figures.overshoot == pytest.approx(-error.min())
    assert (
        abs(error[distance > figures.settling_distance]).max()
        <= 0.02
        < abs(error[distance < figures.settling_distance][-1])
    )
    assert figures.steady_max == pytest.approx(abs(error[distance >= 3.0]).max())
    assert figures.residual < figures.steady_rms < figures.rms


def test_settling_counts_from_the_corner() -> None:
    distance = np.linspace(0.0, 8.0, 801)
    error = np.where((distance > 3.8) & (distance < 4.6), 0.1, 0.0)
    assert judge(track(distance, error), COURSES["corner"], 1.0).settling_distance == pytest.approx(0.6, abs=0.011)
    assert judge(track(distance, error + 0.1), COURSES["corner"], 1.0).settling_distance == math.inf


def test_beyond_the_end_nothing_counts() -> None:
    distance = np.linspace(0.0, 16.0, 1601)
    figures = judge(track(distance, np.where(distance > 15.0, 0.4, 0.001)), STRAIGHT, 1.0)
    assert figures.max == figures.steady_max == 0.001
    assert figures.residual == pytest.approx(0.001)


def test_steering_rate_is_that_of_the_commands() -> None:
    distance = np.linspace(0.0, 1.0, 5)
    steering = np.array([0.0, 0.1, 0.0, -0.2, 0.0])
    assert judge(track(distance, 0 * distance, steering=steering), STRAIGHT, 0.1).steering_rate == pytest.approx(2.0)


# ---------------------------------------------------------------------------------------------- runs


class Fixed:
    """A follower that steers so, and finishes at an arc length."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, steering: float = 0.0, speed: float = 0.7, finish: float = math.inf) -> None:
        self._command, self._finish = DriveCommand(speed=speed, steering=steering), finish

    def start(self, path: Path, snapshot: Snapshot) -> None:
        pass

    def step(self, snapshot: Snapshot) -> Following:
        finished = snapshot.odometry.distance >= self._finish
        tracking = Tracking(arc_length=0.0, length=1.0, cross_track=0.0)
        command = DriveCommand() if finished else self._command
        return Following(command=command, tracking=tracking, finished=finished)


class Refusing(Fixed):
    def start(self, path: Path, snapshot: Snapshot) -> None:
        raise ConfigError("too sharp")


@pytest.mark.parametrize(
    ("follower", "problem"),
    [
        (Fixed(steering=0.2), "lost: 2.0 m from the course after"),
        (Fixed(speed=0.0), "late: at 0.3 of 15.0 m after 95 s"),
        (Fixed(finish=5.0), "elsewhere: finished at 5."),
        (Fixed(finish=14.75), ""),
    ],
)
def test_how_runs_end(follower: Fixed, problem: str) -> None:
    driven = drive(follower, STRAIGHT, bicycle(ROBOT, 38.0), Conditions())
    assert driven.problem.startswith(problem)
    assert bool(driven.problem) == bool(problem)


def test_a_follower_may_refuse() -> None:
    with pytest.raises(FollowerRefused, match="too sharp"):
        drive(Refusing(), STRAIGHT, bicycle(ROBOT, 38.0), Conditions())


def test_offsets_of_the_start() -> None:
    driven = drive(
        Fixed(speed=0.3, finish=0.1), STRAIGHT, bicycle(ROBOT, 38.0), Conditions(start_offset=-0.4, start_heading=0.2)
    )
    assert driven.track.cross_track[0] == pytest.approx(0.1)  # 0.5 m to the left are the course's own
    assert driven.track.time[0] == driven.track.distance[0] == 0.0
    assert driven.track.y[-1] > 0.1


def test_backwards_it_drives_the_same_way_with_the_rear_ahead() -> None:
    def driven(backward: bool) -> RunTrack:
        conditions = Conditions(backward=backward, start_offset=-0.4, start_heading=0.2)
        return drive(Fixed(steering=-0.1, finish=1.0), STRAIGHT, bicycle(ROBOT, 38.0), conditions).track

    forwards, backwards = driven(False), driven(True)
    assert forwards.y.max() > 0.15
    assert backwards.cross_track == pytest.approx(forwards.cross_track)
    assert backwards.speed == pytest.approx(-forwards.speed)
