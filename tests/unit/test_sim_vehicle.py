from __future__ import annotations

import math
import random
from itertools import pairwise

import numpy as np
import pytest

from artemis.sim.vehicle import Chassis, Vehicle, fit_front_driven, fit_rear_driven

FRONT = Chassis(wheelbase=0.56, track=0.436, scrub_radius=0.0625, front_driven=True)
REAR = Chassis(wheelbase=0.56, track=0.436, scrub_radius=0.0625, front_driven=False)


def ackermann(chassis: Chassis, steering: float) -> tuple[float, float]:
    """Wheel angles of the virtual front wheel's angle: atan2(kappa L, 1 -+ kappa B/2)."""
    curve = math.tan(steering)
    half = (chassis.track / 2 - chassis.scrub_radius) * curve / chassis.wheelbase
    return math.atan2(curve, 1 - half), math.atan2(curve, 1 + half)


def front_contacts(chassis: Chassis, pose: tuple[float, float, float], steering: float) -> list[complex]:
    """Where the front wheels touch the ground."""
    x, y, heading = pose
    left, right = ackermann(chassis, steering)
    half, scrub = chassis.track / 2 - chassis.scrub_radius, chassis.scrub_radius
    body = [
        complex(chassis.wheelbase, half) + 1j * scrub * np.exp(1j * left),
        complex(chassis.wheelbase, -half) - 1j * scrub * np.exp(1j * right),
    ]
    return [complex(x, y) + point * np.exp(1j * heading) for point in body]


def driven(chassis: Chassis, steering: float) -> Vehicle:
    return Vehicle(chassis, steering=ackermann(chassis, steering), dice=random.Random(1))


@pytest.mark.parametrize("steering_deg", [-60, -20, 0, 35, 60])
@pytest.mark.parametrize("distance", [0.4, -0.4])
def test_front_wheels_rolling_along_their_true_tracks_give_the_true_pose(steering_deg: float, distance: float) -> None:
    # Ground truth from geometry alone: place the body along an arc while the steering turns, measure how far each
    # contact point moves, and let the vehicle find the way back from those lengths.
    steps, start, end = 400, math.radians(steering_deg), math.radians(steering_deg * 0.5)
    pose, poses, angles = (0.0, 0.0, 0.0), [(0.0, 0.0, 0.0)], [start]
    for step in range(steps):
        middle = start + (end - start) * (step + 0.5) / steps
        turn = distance / steps * math.tan(middle) / FRONT.wheelbase
        x, y, heading = pose
        pose = (
            x + distance / steps * math.cos(heading + turn / 2),
            y + distance / steps * math.sin(heading + turn / 2),
            heading + turn,
        )
        poses.append(pose)
        angles.append(start + (end - start) * (step + 1) / steps)
    vehicle = driven(FRONT, start)
    for (before, angle_before), (after, angle_after) in pairwise(zip(poses, angles, strict=True)):
        old, new = front_contacts(FRONT, before, angle_before), front_contacts(FRONT, after, angle_after)
        left, right = ackermann(FRONT, angle_after)
        directions = np.array(ackermann(FRONT, (angle_before + angle_after) / 2)) + (before[2] + after[2]) / 2
        rolled = [
            ((b - a) * np.exp(-1j * direction)).real for a, b, direction in zip(old, new, directions, strict=True)
        ]
        vehicle.move(left, right, rolled[0], rolled[1])
    assert (vehicle.x, vehicle.y, vehicle.heading) == pytest.approx(pose, abs=2e-5)


def test_rear_wheels_drive_a_full_circle_back_to_the_start() -> None:
    steering = math.radians(30)
    radius = REAR.wheelbase / math.tan(steering)
    vehicle = driven(REAR, steering)
    left, right = ackermann(REAR, steering)
    steps = 100
    for _ in range(steps):
        share = math.tau / steps
        vehicle.move(left, right, share * (radius - REAR.track / 2), share * (radius + REAR.track / 2))
    assert (vehicle.x, vehicle.y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert vehicle.heading == pytest.approx(math.tau)


def test_arc_is_exact_however_long_the_step() -> None:
    steering = math.radians(30)
    radius = REAR.wheelbase / math.tan(steering)
    vehicle = driven(REAR, steering)
    left, right = ackermann(REAR, steering)
    quarter = math.tau / 4
    vehicle.move(left, right, quarter * (radius - REAR.track / 2), quarter * (radius + REAR.track / 2))
    assert (vehicle.x, vehicle.y) == pytest.approx((radius, radius))


def test_straight_wheels_go_straight() -> None:
    vehicle = Vehicle(FRONT, steering=(0.0, 0.0), pose=(1.0, 2.0, math.pi / 2), dice=random.Random(1))
    vehicle.move(0.0, 0.0, 0.5, 0.5)
    assert (vehicle.x, vehicle.y, vehicle.heading) == pytest.approx((1.0, 2.5, math.pi / 2))


@pytest.mark.parametrize("seed", range(5))
def test_fits_are_the_least_squares_of_the_wheels_own_equations(seed: int) -> None:
    dice = np.random.default_rng(seed)
    left, right = dice.uniform(-1.2, 1.2, 2)
    roll_left, roll_right = dice.uniform(-0.1, 0.1, 2)
    length, scrub, half = 0.56, 0.0625, 0.436 / 2 - 0.0625
    grip = [
        [-math.sin(left), length * math.cos(left) + half * math.sin(left)],
        [-math.sin(right), length * math.cos(right) - half * math.sin(right)],
    ]
    front = [
        [math.cos(left), length * math.sin(left) - half * math.cos(left) - scrub],
        [math.cos(right), length * math.sin(right) + half * math.cos(right) + scrub],
    ]
    rear = [[1.0, -0.436 / 2], [1.0, 0.436 / 2]]
    wanted = [roll_left, roll_right, 0.0, 0.0]
    expected_front = np.linalg.lstsq(np.array(front + grip), wanted)[0]
    expected_rear = np.linalg.lstsq(np.array(rear + grip), wanted)[0]
    assert fit_front_driven(FRONT, left, right, roll_left, roll_right) == pytest.approx(tuple(expected_front))
    assert fit_rear_driven(REAR, left, right, roll_left, roll_right) == pytest.approx(tuple(expected_rear))


def test_steering_front_wheels_freely_at_standstill_does_not_move_the_vehicle() -> None:
    # Turning about an offset kingpin rolls a wheel: the left one back, the right one forward, by scrub radius x angle.
    vehicle = driven(FRONT, 0.0)
    angles = 0.0, 0.0
    for step in range(1, 51):
        left, right = ackermann(FRONT, math.radians(step))
        vehicle.move(left, right, -0.0625 * (left - angles[0]), 0.0625 * (right - angles[1]))
        angles = left, right
    assert (vehicle.x, vehicle.y, vehicle.heading) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_steering_with_held_front_wheels_scrubs_the_vehicle_a_little() -> None:
    vehicle = driven(FRONT, 0.0)
    vehicle.move(*ackermann(FRONT, math.radians(20)), 0.0, 0.0)
    assert -0.03 < vehicle.heading < -0.005


def test_slip_loses_its_share_on_average_and_repeats_with_its_seed() -> None:
    def distance(seed: int) -> float:
        vehicle = Vehicle(FRONT, steering=(0.0, 0.0), slip=0.1, dice=random.Random(seed))
        for _ in range(2000):
            vehicle.move(0.0, 0.0, 1e-3, 1e-3)
        return vehicle.x

    assert distance(1) == pytest.approx(1.8, rel=0.01)
    assert distance(1) == distance(1)
    assert distance(1) != distance(2)


def test_last_step_is_told_and_forgotten_at_standstill() -> None:
    vehicle = driven(FRONT, 0.0)
    vehicle.move(0.0, 0.0, 0.01, 0.01)
    assert (vehicle.distance, vehicle.turn) == pytest.approx((0.01, 0.0))
    vehicle.move(0.0, 0.0, 0.0, 0.0)
    assert (vehicle.distance, vehicle.turn) == (0.0, 0.0)
