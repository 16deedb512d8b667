"""Stanley's steering: the paper's equation by hand, its contract, and what it does on the kinematic plant."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.followers.stanley import StanleyConfig, StanleyFollower, front_axle, steering
from artemis.testing.contracts import ROBOT, FollowerContract
from artemis.values import LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis_lab.bench.courses import Course, five_courses
from artemis_lab.bench.driving import drive
from artemis_lab.bench.plant import Conditions, bicycle

CONFIG = StanleyConfig(speed_m_s=0.7, gain_1_s=2.0, softening_m_s=0.1)
COURSES = {course.name: course for course in five_courses()}


class TestStanley(FollowerContract):
    plugin = StanleyFollower
    options: Mapping[str, object] = {"speed_m_s": 0.4}


def follower(config: StanleyConfig = CONFIG) -> StanleyFollower:
    return StanleyFollower(config, PluginContext(name="stanley", robot=ROBOT, folder=TestStanley().given().folder))


def at(pose: Pose, speed: float = 0.7) -> Snapshot:
    return Snapshot(
        sensed=Sensed(index=0, time=0.0),
        dt=0.02,
        pose=LocatedPose(pose=pose),
        odometry=Odometry(speed=speed),
        standing=False,
        set_points=SetPoints(),
        verdict=Verdict(),
    )


# ---------------------------------------------------------------------------------------------- by hand


def test_the_law() -> None:
    assert steering(0.2, 0.0, 0.7, CONFIG) == 0.2
    assert steering(0.0, 0.4, 0.7, CONFIG) == pytest.approx(math.pi / 4)  # 2 * 0.4 = 0.1 + 0.7
    assert steering(-0.1, -0.4, 0.7, CONFIG) == pytest.approx(-0.1 - math.pi / 4)
    assert steering(0.0, 0.05, 0.0, CONFIG) == pytest.approx(math.pi / 4)  # at standstill only k_soft is left
    assert steering(0.0, 0.4, -0.7, CONFIG) == pytest.approx(math.pi / 4)


def test_without_softening_it_works_at_standstill() -> None:
    hard = StanleyConfig(speed_m_s=0.7, softening_m_s=0.0)
    assert steering(0.0, 0.0, 0.0, hard) == 0.0
    assert steering(0.0, 0.1, 0.0, hard) == pytest.approx(math.pi / 2)


def test_the_front_axle_is_a_wheelbase_ahead() -> None:
    assert front_axle(Pose(x=1.0, y=2.0, heading=math.pi / 2), 0.5) == pytest.approx((1.0, 2.5))


def test_the_error_is_that_of_the_front_axle() -> None:
    tried = follower()
    start = Pose(x=0.0, y=0.4)
    tried.start(COURSES["straight"].path(), at(start))
    assert tried.step(at(start)).command.steering == pytest.approx(-math.pi / 4)
    askew = Pose(x=1.0, y=0.0, heading=0.3)
    error = -0.56 * math.sin(0.3)
    expected = -0.3 + math.atan(2.0 * error / 0.8)
    answer = tried.step(at(askew))
    assert answer.command.steering == pytest.approx(expected, abs=1e-6)
    assert answer.tracking.cross_track == pytest.approx(0.0, abs=1e-9)  # the rear axle's
    assert answer.tracking.heading_error == pytest.approx(0.3)


def test_the_angle_stays_within_the_robots() -> None:
    tried = follower()
    start = Pose(x=0.0, y=0.9, heading=1.0)
    tried.start(COURSES["straight"].path(), at(start))
    assert tried.step(at(start)).command.steering == pytest.approx(-math.radians(60))


# ---------------------------------------------------------------------------------------------- what it does


def test_the_front_axles_error_falls_exponentially() -> None:
    config = StanleyConfig(speed_m_s=0.7, gain_1_s=0.5, softening_m_s=0.0)
    driven = drive(follower(config), COURSES["straight"], bicycle(ROBOT, 360), Conditions(delay=0.0, start_offset=-0.4))
    track = driven.track
    near = (track.time > 2.0) & (track.time < 6.0)
    rate = np.polyfit(track.time[near], np.log(np.abs(track.cross_track[near])), 1)[0]
    assert rate == pytest.approx(-0.5, rel=0.05)


def test_the_rear_axle_runs_inside_a_curve() -> None:
    """The front axle is on the circle of radius 2 m, the rear one on that of radius sqrt(2^2 - 0.56^2)."""
    driven = drive(follower(), COURSES["circle"], bicycle(ROBOT, 38), Conditions())
    inside = 2.0 - math.sqrt(2.0**2 - 0.56**2)
    late = driven.track.cross_track[(driven.track.arc_length > 5) & (driven.track.arc_length < 10)]
    assert late == pytest.approx(inside * np.ones_like(late), abs=0.002)


def test_it_passes_the_crossing_and_finishes() -> None:
    course: Course = COURSES["figure-eight"]
    driven = drive(follower(), course, bicycle(ROBOT, 38), Conditions())
    assert driven.problem == ""
    assert driven.track.arc_length[-1] == pytest.approx(course.length, abs=0.05)


def test_a_speed_beyond_the_robots_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"speed_m_s: 0.9; the robot's limit is 0.7"):
        follower(StanleyConfig(speed_m_s=0.9))
