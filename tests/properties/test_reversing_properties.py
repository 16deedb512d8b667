"""Driving backwards is driving forwards, seen from the other end."""

from __future__ import annotations

import math
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

sys.path.append(str(FilePath(__file__).parents[1] / "unit"))
from core_builders import ROBOT, snapshot
from reversing_car import Car, drive, follower

from artemis.motion.odometry import move
from artemis.motion.path import path_from_points
from artemis.motion.route import Part, Route
from artemis.states.parts import PartByPart, flipped, flipped_command
from artemis.values import DriveCommand, Odometry, Pose, SetPoints

number = st.floats(-3.0, 3.0)
angle = st.floats(-math.pi, math.pi)
poses = st.builds(Pose, x=number, y=number, heading=angle)
odometries = st.builds(Odometry, pose=poses, speed=number, steering=number, distance=number)
points = st.builds(
    SetPoints,
    speed=number,
    steering=number,
    speed_left=number,
    speed_right=number,
    steering_left=number,
    steering_right=number,
)


@given(odometry=odometries, set_points=points)
def test_the_flip_is_its_own_inverse(odometry: Odometry, set_points: SetPoints) -> None:
    seen = snapshot(odometry=odometry, set_points=set_points)
    twice = flipped(flipped(seen))
    assert twice.set_points == seen.set_points
    assert twice.pose.pose == twice.odometry.pose
    assert twice.odometry.pose.x == seen.odometry.pose.x
    assert math.remainder(twice.odometry.pose.heading - odometry.pose.heading, math.tau) == pytest.approx(0, abs=1e-9)
    for name in ("speed", "steering", "distance"):
        assert getattr(twice.odometry, name) == getattr(odometry, name)
    command = DriveCommand(speed=odometry.speed, steering=odometry.steering)
    assert flipped_command(flipped_command(command)) == command


@given(pose=poses, distance=st.floats(-0.5, 0.5), steering=st.floats(-1.0, 1.0))
def test_a_car_that_reverses_moves_as_its_flipped_twin_drives_ahead(
    pose: Pose, distance: float, steering: float
) -> None:
    def driven(begin: Pose, distance: float, steering: float) -> Pose:
        return move(begin, distance * math.cos(steering), distance * math.sin(steering) / ROBOT.geometry.wheelbase_m)

    seen = flipped(snapshot(odometry=Odometry(pose=pose)))
    one, twin = driven(pose, distance, steering), driven(seen.odometry.pose, -distance, -steering)
    assert (twin.x, twin.y) == pytest.approx((one.x, one.y), abs=1e-9)
    assert math.cos(twin.heading - one.heading) == pytest.approx(-1.0)


def random_route(dice: np.random.Generator) -> Route:
    """Bends, driven forwards and backwards in turn, from a pose anywhere."""
    pose = Pose(x=dice.uniform(-3, 3), y=dice.uniform(-3, 3), heading=dice.uniform(-math.pi, math.pi))
    backward, parts = bool(dice.integers(2)), []
    for _ in range(dice.integers(1, 4)):
        curvature, length = dice.uniform(-1.2, 1.2), dice.uniform(0.6, 1.5)
        distance = (-1 if backward else 1) * length / 40
        line = [pose]
        for _ in range(40):
            line.append(move(line[-1], distance, distance * curvature))
        pose = line[-1]
        x, y = np.array([(p.x, p.y) for p in line]).T
        parts.append(Part(path=path_from_points(x, y, between_halts=True), backward=backward))
        backward = not backward
    return Route(tuple(parts))


@pytest.mark.parametrize("name", ["frenet", "indiveri"])
@pytest.mark.parametrize("seed", range(10))
def test_any_route_is_driven_to_its_end_and_the_car_stays_on_it(seed: int, name: str) -> None:
    dice = np.random.default_rng(seed)
    route = random_route(dice)
    first = route.parts[0]
    start, off = first.path.at(0.0), dice.uniform(-0.05, 0.05)
    pose = Pose(
        x=start.x - off * math.sin(start.heading),
        y=start.y + off * math.cos(start.heading),
        heading=first.heading_at(0.0) + dice.uniform(-0.1, 0.1),
    )
    steps = drive(PartByPart(follower(name), route, 0.0, ROBOT), Car(pose=pose))
    assert max(abs(step.tracking.cross_track) for _, step in steps) < 0.1
    assert steps[-1][1].tracking.arc_length == pytest.approx(route.length, abs=0.03)
    for seen, step in steps:
        assert abs(step.command.speed) < 0.3001
        part = sum(begin <= step.tracking.arc_length for begin in route.begins[1:])
        if abs(seen.odometry.speed) > 0.05 and step.tracking.arc_length - route.begins[part] > 0.05:
            assert (seen.odometry.speed < 0) is route.parts[part].backward
