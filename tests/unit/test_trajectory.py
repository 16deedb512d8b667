from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.poses import placed
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose


def drawn(seed: int = 1, count: int = 50) -> Trajectory:
    random = np.random.default_rng(seed)
    poses = np.cumsum(random.normal(size=(count, 3)) * [0.1, 0.1, 0.4], axis=0)
    return Trajectory(time=np.cumsum(random.uniform(0.01, 0.1, count)), poses=poses)


def assert_same_pose(row: list[float], pose: Pose) -> None:
    assert row[:2] == pytest.approx([pose.x, pose.y], abs=1e-12)
    assert math.remainder(row[2] - pose.heading, math.tau) == pytest.approx(0.0, abs=1e-12)


def test_poses_between_lie_on_the_line() -> None:
    line = Trajectory(time=np.array([0.0, 1.0, 3.0]), poses=np.array([[0, 0, 0.1], [1, 2, 0.3], [5, 2, 0.1]]))

    found = line.at(np.array([2.0, 0.25, 1.0]))

    np.testing.assert_allclose(found, [[3, 2, 0.2], [0.25, 0.5, 0.15], [1, 2, 0.3]])


def test_nothing_is_known_outside_and_in_gaps() -> None:
    line = Trajectory(time=np.array([0.0, 1.0, 3.0]), poses=np.zeros((3, 3)))

    found = line.at(np.array([-0.1, 0.0, 0.9, 1.0, 1.1, 2.9, 3.0, 3.1]), longest_gap=1.5)

    assert np.isfinite(found[:, 0]).tolist() == [False, True, True, True, False, False, True, False]


def test_the_heading_goes_on_where_it_is_wrapped() -> None:
    turns = Trajectory(time=np.array([0.0, 1.0, 2.0]), poses=np.array([[0, 0, 3.0], [0, 0, -3.0], [0, 0, -2.0]]))

    assert turns.at(np.array([0.5]))[0, 2] == pytest.approx(math.pi)
    assert turns.poses[-1, 2] == pytest.approx(math.tau - 2.0)


def test_another_frame_and_another_point_are_those_of_single_poses() -> None:
    one, pose = drawn(), Pose(x=2.0, y=-3.0, heading=1.2)

    for row, moved, carried in zip(one.poses, one.placed(pose).poses, one.of_point(pose).poses, strict=True):
        own = Pose(x=row[0], y=row[1], heading=row[2])
        assert_same_pose(moved.tolist(), placed(pose, own))
        assert_same_pose(carried.tolist(), placed(own, pose))


def test_without_headings_there_are_places_only() -> None:
    places = Trajectory(time=np.array([0.0, 1.0]), poses=np.array([[0.0, 0.0, math.nan], [1.0, 0.0, math.nan]]))

    assert not places.knows_heading
    np.testing.assert_allclose(
        places.placed(Pose(x=1.0, heading=math.pi / 2)).poses[:, :2], [[1, 0], [1, 1]], atol=1e-15
    )
    with pytest.raises(ConfigError, match="needs the heading"):
        places.of_point(Pose(x=1.0))


@pytest.mark.parametrize(
    ("time", "poses", "problem"),
    [
        ([0.0, 1.0, 1.0], np.zeros((3, 3)), "row 2: time 1.0 s follows 1.0 s"),
        ([0.0, 2.0, 1.0], np.zeros((3, 3)), "row 2: time 1.0 s follows 2.0 s"),
        ([0.0, math.nan], np.zeros((2, 3)), "row 1: expected finite numbers"),
        ([0.0, 1.0], np.array([[0, 0, 0], [0, math.inf, 0]]), "row 1: expected finite numbers"),
        ([0.0, 1.0], np.array([[0, 0, 0], [0, 0, math.nan]]), "row 1: expected finite numbers"),
        ([0.0, 1.0], np.zeros((2, 2)), r"poses \(2, 2\)"),
        ([], np.zeros((0, 3)), "no poses"),
    ],
)
def test_what_is_no_trajectory_is_refused(time: list[float], poses: np.ndarray, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        Trajectory(time=np.array(time), poses=poses)
