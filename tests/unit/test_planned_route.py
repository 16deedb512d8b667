"""A planned route goes through a job's result and comes back as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.motion.planned_route import packed, planned_route, route_poses, unpacked
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml", RobotFile)


def line(first: float, last: float, speed: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    x = np.linspace(first, last, 21)
    return np.column_stack([x, np.zeros(21), np.full(21, speed)])


def test_numbers_come_back_to_a_micrometre() -> None:
    points = line(0.0, 1.0 / 3.0, 0.5)
    assert np.abs(unpacked(packed(points)) - points).max() <= 0.5e-6


def test_direction_changes_make_parts_and_speeds_are_kept() -> None:
    points = np.concatenate([line(0.0, 1.0, 0.5), line(0.95, -1.0, -0.2)])

    route = planned_route(packed(points), ROBOT, 0.5)

    assert [part.backward for part in route.parts] == [False, True]
    assert route.length == pytest.approx(3.0, abs=1e-3)
    assert route.parts[1].path.speeds(0.5).max() == pytest.approx(0.2)
    assert route.parts[1].heading_at(1.0) == pytest.approx(0.0, abs=1e-6)


def test_poses_of_a_route_look_ahead_also_where_it_is_driven_backwards() -> None:
    points = np.concatenate([line(0.0, 1.0, 0.5), line(0.95, -1.0, -0.2)])
    poses = route_poses(packed(points))
    assert len(poses) == 42
    assert max(abs(np.sin(pose.heading)) for pose in poses) < 1e-9
    assert min(np.cos(pose.heading) for pose in poses) > 0.99
    assert (poses[20].x, poses[-1].x) == (1.0, -1.0)


def test_a_part_of_no_length_is_refused() -> None:
    points = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 0.0, -0.5], [1.5, 0.0, 0.5]])
    with pytest.raises(ConfigError, match="no length"):
        planned_route(packed(points), ROBOT, 0.5)
