"""Regulated pure pursuit: the papers' formulas by hand, its contract, and what it does on the kinematic plant."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from pydantic import ValidationError

from artemis.errors import ConfigError
from artemis.motion.path import path_from_points
from artemis.plugins.contracts import PluginContext
from artemis.plugins.followers.pure_pursuit import (
    PurePursuitConfig,
    PurePursuitFollower,
    curvature_through,
    lookahead_distance,
    regulated,
)
from artemis.testing.contracts import ROBOT, FollowerContract
from artemis.values import LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis_lab.bench.courses import Course
from artemis_lab.bench.driving import drive
from artemis_lab.bench.plant import Conditions, bicycle

CONFIG = PurePursuitConfig(speed_m_s=0.7)


class TestPurePursuit(FollowerContract):
    plugin = PurePursuitFollower
    options: Mapping[str, object] = {"speed_m_s": 0.4}


def follower(**keys: float) -> PurePursuitFollower:
    context = PluginContext(name="pure_pursuit", robot=ROBOT, folder=TestPurePursuit().given().folder)
    return PurePursuitFollower(PurePursuitConfig(speed_m_s=0.7).model_copy(update=keys), context)


def at(x: float, y: float, heading: float = 0.0, speed: float = 0.7) -> Snapshot:
    return Snapshot(
        sensed=Sensed(index=0, time=0.0),
        dt=0.02,
        pose=LocatedPose(pose=Pose(x=x, y=y, heading=heading)),
        odometry=Odometry(speed=speed),
        standing=False,
        set_points=SetPoints(),
        verdict=Verdict(),
    )


def straight(length: float = 5.0) -> Course:
    x = np.arange(0.0, length + 0.001, 0.005)
    return Course(name="straight", points=np.column_stack([x, 0 * x]))


# ---------------------------------------------------------------------------------------------- by hand


def test_curvature_is_that_of_the_circle_through_the_point() -> None:
    assert curvature_through(Pose(), 1.0, 1.0) == pytest.approx(1.0)  # a quarter of the unit circle
    assert curvature_through(Pose(), 0.0, -2.0) == pytest.approx(-1.0)  # half of it, to the right
    assert curvature_through(Pose(x=1.0, y=2.0, heading=math.pi / 2), 0.0, 3.0) == pytest.approx(1.0)
    assert curvature_through(Pose(), 3.0, 0.0) == 0.0


def test_lookahead_is_a_times_way_within_its_bounds() -> None:
    assert lookahead_distance(0.5, CONFIG) == pytest.approx(0.75)  # 1.5 s
    assert lookahead_distance(0.0, CONFIG) == 0.7
    assert lookahead_distance(0.7, CONFIG) == 0.9
    assert lookahead_distance(-0.5, CONFIG) == pytest.approx(0.75)


def test_speed_falls_with_the_radius_below_the_smallest() -> None:
    assert regulated(0.7, 1.0, 9.0, CONFIG) == 0.7  # radius 1 m, 0.9 is the smallest that is not slowed down
    assert regulated(0.7, -1 / 0.6, 9.0, CONFIG) == pytest.approx(0.7 * 0.6 / 0.9)
    assert regulated(0.7, 10.0, 9.0, CONFIG) == 0.25
    assert regulated(0.1, 10.0, 9.0, CONFIG) == 0.1  # what is slower already does not become faster


def test_speed_falls_with_the_way_that_is_left() -> None:
    assert regulated(0.6, 0.0, 0.3, CONFIG) == pytest.approx(0.3)
    assert regulated(0.6, 0.0, 0.01, CONFIG) == 0.05
    assert regulated(0.03, 0.0, 0.01, CONFIG) == 0.03


def test_it_aims_at_the_point_of_the_path_at_the_lookahead() -> None:
    tried = follower(min_lookahead_m=0.5, max_lookahead_m=0.5)
    tried.start(straight().path(), at(0.0, 0.3))
    command = tried.step(at(0.0, 0.3)).command
    assert math.tan(command.steering) / 0.56 == pytest.approx(2 * -0.3 / 0.5**2, rel=1e-3)


def test_farther_away_than_the_lookahead_it_aims_at_the_nearest_point() -> None:
    tried = follower(min_lookahead_m=0.5, max_lookahead_m=0.5)
    tried.start(straight().path(), at(1.0, -0.8))
    tried.step(at(0.3, -0.8))
    command = tried.step(at(0.5, -0.8)).command
    assert math.tan(command.steering) / 0.56 == pytest.approx(2 * 0.8 / 0.8**2, rel=1e-3)


# ---------------------------------------------------------------------------------------------- what it does


def test_a_fixed_lookahead_cuts_curves_as_the_geometry_says() -> None:
    """On a circle it settles where the circle through the point ahead is its own: inside, by second order nothing."""
    angle = np.linspace(0.0, 1.5 * math.pi, 2000)
    circle = Course(name="circle", points=2.0 * np.column_stack([np.sin(angle), 1 - np.cos(angle)]))
    tried = follower(min_lookahead_m=0.7, max_lookahead_m=0.7)
    driven = drive(tried, circle, bicycle(ROBOT, 38), Conditions())
    late = driven.track.cross_track[(driven.track.arc_length > 3) & (driven.track.arc_length < 7)]
    assert driven.problem == ""
    assert np.abs(late).max() < 0.004


def test_it_follows_the_laps_of_a_closed_path_across_the_seam() -> None:
    angle = np.linspace(0.0, math.tau, 1000)
    path = path_from_points(np.sin(angle), 1 - np.cos(angle)).with_laps(2)
    tried = follower()
    tried.start(path, at(0.0, 0.0))
    for place in np.linspace(0.0, 4 * math.pi - 0.1, 400):
        answer = tried.step(at(math.sin(place), 1 - math.cos(place), place))
        assert not answer.finished
        assert answer.command.steering > 0.3
    assert tried.step(at(0.0, 0.0)).finished


def test_a_recorded_speed_is_the_upper_limit() -> None:
    x = np.linspace(0.0, 5.0, 51)
    tried = follower()
    tried.start(path_from_points(x, 0 * x, speed=np.full(51, 0.2)), at(0.0, 0.0))
    assert tried.step(at(0.0, 0.0)).command.speed == pytest.approx(0.2)


# ---------------------------------------------------------------------------------------------- refusals


def test_a_speed_beyond_the_robots_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"speed_m_s: 0.9; the robot's limit is 0.7"):
        follower(speed_m_s=0.9)


def test_bounds_of_the_lookahead_out_of_order_are_refused() -> None:
    with pytest.raises(ValidationError, match="min_lookahead_m 1 is more than max_lookahead_m"):
        PurePursuitConfig(speed_m_s=0.3, min_lookahead_m=1.0)
