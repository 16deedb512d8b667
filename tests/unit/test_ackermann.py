from __future__ import annotations

from math import atan, cos, degrees, hypot, pi, radians, sin, tan

import pytest

from artemis.axles import Geometry
from artemis.motion.ackermann import Ackermann

FRONT = Geometry(wheelbase_m=0.560, track_m=0.436, scrub_radius_m=0.0625, driven_axle="front")
REAR = Geometry(wheelbase_m=0.560, track_m=0.436, scrub_radius_m=0.0625, driven_axle="rear")
ARTEMIS = Ackermann(FRONT)

# alpha, inner angle [deg], outer angle [deg], inner and outer speed per speed of the virtual wheel, d(inner)/d(alpha)
TABLE = [
    (20.0, 22.04, 18.29, 0.873, 1.128, 1.20),
    (40.0, 47.57, 34.24, 0.799, 1.214, 1.32),
    (60.0, 73.32, 49.47, 0.807, 1.236, 1.22),
]


def contact(
    geometry: Geometry, side: int, time: float, speed: float, steering: float, rate: float
) -> tuple[float, float]:
    """Contact point of a front wheel (side: +1 left) near time 0 of a motion through the origin, by its definition."""
    half = (geometry.track_m - 2 * geometry.scrub_radius_m) / 2
    base = geometry.wheelbase_m
    omega = speed * sin(steering) / base
    alpha = steering + rate * time
    heading = omega * time
    x, y = speed * cos(steering) * time, 0.0  # first order: enough for a derivative at 0
    curvature = tan(alpha) / base
    delta = atan(curvature * base / (1 - side * curvature * half))
    direction = heading + delta
    return (
        x + base * cos(heading) - side * half * sin(heading) - side * geometry.scrub_radius_m * sin(direction),
        y + base * sin(heading) + side * half * cos(heading) + side * geometry.scrub_radius_m * cos(direction),
    )


@pytest.mark.parametrize(("alpha", "inner", "outer", "inner_speed", "outer_speed", "gain"), TABLE)
def test_wheels_stand_and_turn_as_the_geometry_demands(
    alpha: float, inner: float, outer: float, inner_speed: float, outer_speed: float, gain: float
) -> None:
    left, right = ARTEMIS.wheel_angles(radians(alpha))
    assert (degrees(left), degrees(right)) == pytest.approx((inner, outer), abs=0.005)
    assert ARTEMIS.wheel_speeds(1.0, radians(alpha)) == pytest.approx((inner_speed, outer_speed), abs=0.0005)
    assert ARTEMIS.wheel_rates(radians(alpha), 1.0)[0] == pytest.approx(gain, abs=0.005)


@pytest.mark.parametrize("row", TABLE)
def test_right_curve_is_the_mirror_of_the_left_one(row: tuple[float, ...]) -> None:
    steering = radians(row[0])
    left, right = ARTEMIS.wheel_angles(steering)
    assert ARTEMIS.wheel_angles(-steering) == pytest.approx((-right, -left), abs=1e-15)
    left, right = ARTEMIS.wheel_speeds(0.5, steering)
    assert ARTEMIS.wheel_speeds(0.5, -steering) == pytest.approx((right, left), abs=1e-15)


def test_full_lock_turns_about_the_rear_axle_at_a_third_of_a_metre() -> None:
    assert ARTEMIS.steering_from_curvature(1 / 0.3233) == pytest.approx(radians(60), abs=1e-3)
    assert ARTEMIS.steering_from_curvature(1 / 0.5600) == pytest.approx(pi / 4)


def test_straight_ahead_both_wheels_do_as_the_virtual_one() -> None:
    assert ARTEMIS.wheel_angles(0.0) == (0.0, 0.0)
    assert ARTEMIS.wheel_speeds(-0.4, 0.0) == (-0.4, -0.4)
    assert ARTEMIS.wheel_rates(0.0, 0.3) == (0.3, 0.3)


def test_inner_wheel_may_turn_past_a_right_angle() -> None:
    left, right = ARTEMIS.wheel_angles(radians(79))
    assert degrees(left) > 90
    assert ARTEMIS.steering_from_wheel_angles(left, right) == pytest.approx(radians(79), abs=1e-12)


def test_measured_angles_are_averaged_in_curvature() -> None:
    left, right = ARTEMIS.wheel_angles(radians(30))[0], ARTEMIS.wheel_angles(radians(20))[1]
    mean = (tan(radians(30)) + tan(radians(20))) / 2
    assert tan(ARTEMIS.steering_from_wheel_angles(left, right)) == pytest.approx(mean, abs=1e-12)


@pytest.mark.parametrize("speed", [0.7, 0.0, -0.3])
@pytest.mark.parametrize("alpha", [-60.0, -10.0, 0.0, 35.0, 60.0])
@pytest.mark.parametrize("rate", [-0.5, 0.0, 0.5])
def test_rolling_speeds_are_those_of_the_contact_points(speed: float, alpha: float, rate: float) -> None:
    steering = radians(alpha)
    rates = ARTEMIS.wheel_rates(steering, rate)
    speeds = ARTEMIS.wheel_speeds(speed, steering, *rates)
    step = 1e-6
    for side, delta, expected in zip((1, -1), ARTEMIS.wheel_angles(steering), speeds, strict=True):
        after = contact(FRONT, side, step, speed, steering, rate)
        before = contact(FRONT, side, -step, speed, steering, rate)
        vx, vy = (after[0] - before[0]) / (2 * step), (after[1] - before[1]) / (2 * step)
        assert vx * cos(delta) + vy * sin(delta) == pytest.approx(expected, abs=1e-8)
        assert vy * cos(delta) - vx * sin(delta) == pytest.approx(0.0, abs=1e-8)


def test_steering_at_standstill_rolls_the_front_wheels_apart() -> None:
    steps = 1000
    rolled = [0.0, 0.0]
    for i in range(steps):
        rates = ARTEMIS.wheel_rates(radians(60) * (i + 0.5) / steps, radians(60) / steps)
        left, right = ARTEMIS.wheel_speeds(0.0, 0.3, *rates)
        rolled = [rolled[0] + left, rolled[1] + right]
    assert rolled == pytest.approx([-0.080, 0.054], abs=0.0005)


def test_driven_rear_wheels_roll_with_the_rear_axle() -> None:
    car = Ackermann(REAR)
    u = 0.5 * cos(0.4)
    curvature = tan(0.4) / 0.560
    expected = (u * (1 - curvature * 0.218), u * (1 + curvature * 0.218))
    assert car.wheel_speeds(0.5, 0.4) == pytest.approx(expected, abs=1e-15)
    assert car.wheel_speeds(0.5, 0.4, 1.0, 1.0) == car.wheel_speeds(0.5, 0.4)


def test_residual_tells_how_far_each_wheel_is_from_the_common_speed() -> None:
    assert ARTEMIS.twist_from_wheels(1.0, 0.8, 0.0) == pytest.approx((0.9, 0.1), abs=1e-15)
    assert ARTEMIS.twist_from_wheels(0.8, 1.0, 0.0) == pytest.approx((0.9, 0.1), abs=1e-15)


def test_speed_from_disagreeing_wheels_is_the_least_squares_one() -> None:
    ratios = ARTEMIS.speed_ratios(0.9)

    def error(speed: float) -> float:
        return hypot(0.4 - speed * ratios[0], 0.5 - speed * ratios[1])

    speed, residual = ARTEMIS.twist_from_wheels(0.4, 0.5, 0.9)
    assert error(speed) < min(error(speed + 1e-4), error(speed - 1e-4))
    assert residual == pytest.approx(error(speed) / 2**0.5, abs=1e-15)
