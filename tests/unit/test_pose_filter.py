"""The pose filter: odometry passes as it is, noise goes, the steering's zero comes out, a new pose holds."""

from __future__ import annotations

import math
import random

import pytest
from msgspec.structs import replace

from artemis.motion.pose_filter import JUMP, ZERO_LIMIT, PoseFilter
from artemis.values import Odometry, Pose

WHEELBASE = 0.56
WAY = 0.014


def drive(zero_deg: float, noise: float, ticks: int, seed: int = 1, steering: float = 0.0) -> tuple[PoseFilter, Pose]:
    """Drive on with a steering whose true angle is `zero_deg` more than measured: the filter, and the true pose."""
    dice = random.Random(seed)
    odometry = Odometry(steering=steering)
    filter, true = PoseFilter(WHEELBASE, Pose(), odometry), Pose()
    for tick in range(1, ticks + 1):
        turn = WAY * math.tan(steering + math.radians(zero_deg)) / WHEELBASE
        true = around(true, turn) if turn else replace(true, x=true.x + WAY)
        seen = Pose(
            x=true.x + dice.gauss(0, 0.005 * noise),
            y=true.y + dice.gauss(0, 0.005 * noise),
            heading=true.heading + dice.gauss(0, math.radians(0.25) * noise),
        )
        filter.update(seen, replace(odometry, distance=tick * WAY))
    return filter, true


def around(pose: Pose, turn: float) -> Pose:
    """After a distance along a circle."""
    radius, heading = WAY / turn, pose.heading + turn
    x = pose.x + radius * (math.sin(heading) - math.sin(pose.heading))
    y = pose.y - radius * (math.cos(heading) - math.cos(pose.heading))
    return Pose(x=x, y=y, heading=heading)


@pytest.mark.parametrize("steering", [0.0, 0.3, -0.8])
def test_what_the_wheels_say_themselves_passes(steering: float) -> None:
    filter, true = drive(0.0, 0.0, 300, steering=steering)
    assert math.dist((filter.pose.x, filter.pose.y), (true.x, true.y)) < 1e-9
    assert filter.steering_zero == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("zero_deg", [1.0, -2.0])
def test_the_zero_of_the_steering_comes_out_within_three_metres(zero_deg: float) -> None:
    errors = [math.degrees(drive(zero_deg, 1.0, 214, seed)[0].steering_zero) - zero_deg for seed in range(20)]
    assert math.sqrt(sum(error**2 for error in errors) / 20) < 0.15
    assert abs(sum(errors)) / 20 < 0.1


def test_noise_goes() -> None:
    squares = []
    for seed in range(20):
        filter, true = drive(0.0, 1.0, 214, seed)
        squares.append((filter.pose.y - true.y) ** 2)
    assert math.sqrt(sum(squares) / 20) < 0.0015  # of 5 mm


def test_standing_tells_nothing_of_the_zero() -> None:
    filter = PoseFilter(WHEELBASE, Pose(), Odometry())
    for heading in (0.01, -0.01, 0.01):
        filter.update(Pose(heading=heading), Odometry())
    assert filter.steering_zero == 0.0


def test_a_pose_set_anew_holds() -> None:
    filter, _ = drive(1.0, 0.0, 100)
    zero = filter.steering_zero
    there = Pose(x=filter.pose.x + 2 * JUMP, y=1.0, heading=2.0)
    filter.update(there, Odometry(distance=100 * WAY))
    assert filter.pose == there
    assert filter.steering_zero == zero


def test_no_zero_beyond_the_limit_is_believed() -> None:
    filter, _ = drive(12.0, 0.0, 600)
    assert filter.steering_zero == pytest.approx(ZERO_LIMIT)
