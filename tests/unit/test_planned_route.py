"""A planned route goes through a job's result and comes back as it was."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.motion.path import path_from_points
from artemis.motion.planned_route import (
    packed_poses,
    packed_route,
    planned_route,
    route_poses,
    unpacked_poses,
    unpacked_route,
)
from artemis.motion.route import Part, Route
from artemis.values import Pose
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml", RobotFile)


def line(first: float, last: float, speed: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    x = np.linspace(first, last, 21)
    return np.column_stack([x, np.zeros(21), np.full(21, speed)])


THERE_AND_BACK = np.concatenate([line(0.0, 1.0, 0.5), line(0.95, -1.0, -0.2)])


def test_poses_come_back_to_a_micrometre() -> None:
    poses = [Pose(x=1 / 3, y=-2 / 3, heading=pi / 7), Pose(x=100.0)]
    for pose, again in zip(poses, unpacked_poses(packed_poses(poses)), strict=True):
        assert (again.x, again.y, again.heading) == pytest.approx((pose.x, pose.y, pose.heading), abs=0.5e-6)


def test_a_route_comes_back_to_a_millionth() -> None:
    angle = np.linspace(0.0, 2.0 * pi, 60)
    circle = path_from_points(2.0 * np.cos(angle), 2.0 * np.sin(angle))
    assert circle.closed
    for route in (planned_route(THERE_AND_BACK, ROBOT, 0.5), Route((Part(path=circle),))):
        again = unpacked_route(packed_route(route))
        assert again.length == pytest.approx(route.length, abs=1e-6)
        for part, made in zip(route.parts, again.parts, strict=True):
            assert (made.backward, made.path.closed) == (part.backward, part.path.closed)
            for name in ("x", "y", "heading", "curvature"):
                assert np.abs(getattr(made.path, name) - getattr(part.path, name)).max() <= 0.51e-6
            assert np.abs(made.path.speeds(0.5) - part.path.speeds(0.5)).max() <= 0.51e-6
            assert (made.path.speed is None) == (part.path.speed is None)
        assert packed_route(again) == packed_route(route)


def test_direction_changes_make_parts_and_speeds_are_kept() -> None:
    route = planned_route(THERE_AND_BACK, ROBOT, 0.5)

    assert [part.backward for part in route.parts] == [False, True]
    assert route.length == pytest.approx(3.0, abs=1e-3)
    assert route.parts[1].path.speeds(0.5).max() == pytest.approx(0.2)
    assert route.parts[1].heading_at(1.0) == pytest.approx(0.0, abs=1e-6)


def test_poses_of_a_route_look_ahead_also_where_it_is_driven_backwards() -> None:
    poses = route_poses(packed_route(planned_route(THERE_AND_BACK, ROBOT, 0.5)), spacing=0.1)
    assert 30 <= len(poses) <= 40
    assert max(abs(np.sin(pose.heading)) for pose in poses) < 1e-5
    assert min(np.cos(pose.heading) for pose in poses) > 0.99
    assert max(pose.x for pose in poses) == pytest.approx(1.0, abs=1e-6)
    assert poses[-1].x == pytest.approx(-1.0, abs=1e-6)


def test_a_part_of_no_length_is_refused() -> None:
    points = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 0.0, -0.5], [1.5, 0.0, 0.5]])
    with pytest.raises(ConfigError, match="no length"):
        planned_route(points, ROBOT, 0.5)
