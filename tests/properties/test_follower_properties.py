"""What holds for every built-in follower, whatever the path: limits, mirror images, and no hidden state."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from artemis.motion.angles import wrap
from artemis.motion.path import Path
from artemis.plugins.contracts import Follower, PluginContext
from artemis.plugins.registry import FOLLOWERS, load
from artemis.testing.contracts import ROBOT, FollowerContract
from artemis.values import DriveCommand, LocatedPose, Pose, Snapshot
from artemis_lab.bench.courses import random_course
from artemis_lab.bench.plant import Conditions, Plant

NAMES = ("frenet", "indiveri", "pure_pursuit", "stanley")
LIMIT = math.radians(ROBOT.limits.steering_deg)
TICKS = 90


def made(name: str) -> Follower:
    plugin = load(FOLLOWERS, name)
    follower: Follower = plugin(
        plugin.Config(speed_m_s=0.6), PluginContext(name=name, robot=ROBOT, folder=FollowerContract().given().folder)
    )
    return follower


def snapshots(name: str, seed: int, offset: float, heading: float) -> tuple[Path, list[Snapshot], list[DriveCommand]]:
    """What the follower saw and commanded on the first metres of a random course."""
    course = random_course(seed, ROBOT)
    conditions = Conditions(start_speed=0.0, position_noise=0.002)
    plant = Plant(ROBOT, conditions, course.start(offset, heading), seed)
    follower, path = made(name), course.path()
    seen, told = [plant.snapshot()], []
    follower.start(path, seen[0])
    for _ in range(TICKS):
        told.append(follower.step(seen[-1]).command)
        plant.step(told[-1])
        seen.append(plant.snapshot())
    return path, seen, told


def mirrored(path: Path) -> Path:
    return Path(path.x, -path.y, -path.heading, -path.curvature, spacing=path.spacing, closed=path.closed)


def turned(path: Path, by: float) -> Path:
    c, s = math.cos(by), math.sin(by)
    x, y = c * path.x - s * path.y, s * path.x + c * path.y
    return Path(x, y, path.heading + by, path.curvature, spacing=path.spacing, closed=path.closed)


def placed(snapshot: Snapshot, pose: Pose, sign: float = 1.0) -> Snapshot:
    """The same snapshot at another pose; `sign` -1: with its steering to the other side."""
    odometry = replace(snapshot.odometry, steering=sign * snapshot.odometry.steering)
    points = replace(snapshot.set_points, steering=sign * snapshot.set_points.steering)
    return replace(snapshot, pose=LocatedPose(pose=pose), odometry=odometry, set_points=points)


def again(name: str, path: Path, seen: list[Snapshot]) -> list[DriveCommand]:
    follower = made(name)
    follower.start(path, seen[0])
    return [follower.step(snapshot).command for snapshot in seen[:-1]]


SEEDS, OFFSETS, HEADINGS = st.integers(0, 999), st.floats(-0.8, 0.8), st.floats(-1.0, 1.0)
"""Which random course; where the robot starts beside it [m], and how askew [rad]."""


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=6, deadline=None)
@given(seed=SEEDS, offset=OFFSETS, heading=HEADINGS)
def test_commands_stay_within_the_robots_limits(name: str, seed: int, offset: float, heading: float) -> None:
    _, _, told = snapshots(name, seed, offset, heading)
    assert all(abs(command.steering) <= LIMIT + 1e-9 for command in told)
    assert all(0.0 <= command.speed <= 0.6 for command in told)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS, offset=OFFSETS, heading=HEADINGS)
def test_a_mirrored_path_gives_mirrored_commands(name: str, seed: int, offset: float, heading: float) -> None:
    path, seen, told = snapshots(name, seed, offset, heading)
    images = []
    for snapshot in seen:
        pose = snapshot.pose.pose
        images.append(placed(snapshot, Pose(x=pose.x, y=-pose.y, heading=-pose.heading), -1.0))
    for command, image in zip(told, again(name, mirrored(path), images), strict=True):
        assert image.steering == pytest.approx(-command.steering, abs=1e-6)
        assert image.speed == pytest.approx(command.speed, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS, offset=OFFSETS, heading=HEADINGS, by=st.floats(-3.0, 3.0))
def test_where_the_origin_is_does_not_matter(name: str, seed: int, offset: float, heading: float, by: float) -> None:
    path, seen, told = snapshots(name, seed, offset, heading)
    c, s = math.cos(by), math.sin(by)
    images = []
    for snapshot in seen:
        pose = snapshot.pose.pose
        there = Pose(x=c * pose.x - s * pose.y, y=s * pose.x + c * pose.y, heading=wrap(pose.heading + by))
        images.append(placed(snapshot, there))
    for command, image in zip(told, again(name, turned(path, by), images), strict=True):
        assert image.steering == pytest.approx(command.steering, abs=1e-6)
        assert image.speed == pytest.approx(command.speed, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=4, deadline=None)
@given(seed=SEEDS, offset=OFFSETS, heading=HEADINGS, later=st.floats(0.0, 1e5))
def test_the_time_of_day_and_earlier_drives_do_not_matter(
    name: str, seed: int, offset: float, heading: float, later: float
) -> None:
    path, seen, told = snapshots(name, seed, offset, heading)
    shifted = [replace(s, sensed=replace(s.sensed, time=s.time + later)) for s in seen]
    used = made(name)
    used.start(path, shifted[5])
    for snapshot in shifted[5:20]:
        used.step(snapshot)
    used.start(path, shifted[0])
    assert [used.step(snapshot).command for snapshot in shifted[:-1]] == told
