"""Planned speed: every limit holds with the wheels that `Ackermann` computes, and no speed is given away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.motion.ackermann import Ackermann
from artemis.motion.path import Path, path_from_points
from artemis.motion.speed_profile import BRAKING_SHARE, CRAWL, STEERING_SHARE, speed_profile
from artemis.testing.contracts import ROBOT

LIMITS = ROBOT.limits


def slalom(amplitude: float = 0.5, period: float = 4.0) -> Path:
    x = np.arange(0.0, 12.001, 0.05)
    return path_from_points(x, amplitude * np.sin(math.tau * x / period), closed=False)


def demands(path: Path, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steering rate of the faster wheel [rad/s], speed of the faster wheel [m/s], acceleration [m/s2]."""
    car = Ackermann(ROBOT.geometry)
    steering = np.array([car.steering_from_curvature(k) for k in path.curvature])
    time = np.append(0.0, np.cumsum(path.spacing / ((speed[1:] + speed[:-1]) / 2 * np.cos(steering[1:]))))
    angles = np.array([car.wheel_angles(angle) for angle in steering])
    rates = np.gradient(angles, time, axis=0)
    rolls = np.array(
        [car.wheel_speeds(v, a, *rate) for v, a, rate in zip(speed, steering, rates.tolist(), strict=True)]
    )
    return np.abs(rates).max(axis=1), np.abs(rolls).max(axis=1), np.gradient(speed, time)


@pytest.mark.parametrize("amplitude", [0.1, 0.3, 0.5])
def test_every_limit_holds(amplitude: float) -> None:
    path = slalom(amplitude)
    speed = speed_profile(path, ROBOT, 0.7)
    rates, rolls, acceleration = demands(path, speed)
    inner = slice(5, -5)
    assert rates[inner].max() <= 1.03 * STEERING_SHARE * math.radians(LIMITS.steering_rate_wheel_deg_s)
    assert rolls[inner].max() <= 1.01 * LIMITS.wheel_speed_m_s
    assert acceleration[inner].max() <= 1.05 * BRAKING_SHARE * LIMITS.acceleration_m_s2
    assert acceleration[inner].min() >= -1.05 * BRAKING_SHARE * LIMITS.deceleration_m_s2
    assert speed.max() <= 0.7


def test_somewhere_a_limit_is_reached_at_every_place() -> None:
    path = slalom()
    speed = speed_profile(path, ROBOT, 0.7)
    rates, rolls, acceleration = demands(path, speed)
    used = np.max(
        [
            speed / 0.7,
            rates / (STEERING_SHARE * math.radians(LIMITS.steering_rate_wheel_deg_s)),
            rolls / LIMITS.wheel_speed_m_s,
            acceleration / (BRAKING_SHARE * LIMITS.acceleration_m_s2),
            -acceleration / (BRAKING_SHARE * LIMITS.deceleration_m_s2),
        ],
        axis=0,
    )
    assert np.percentile(used[5:-5], 5) > 0.9


def test_a_straight_is_driven_as_wished() -> None:
    path = path_from_points(np.array([0.0, 2.0, 4.0]), np.zeros(3))
    assert speed_profile(path, ROBOT, 0.7) == pytest.approx(np.full(len(path.x), 0.7))


def test_a_recorded_speed_is_a_limit_with_room_to_brake() -> None:
    x = np.arange(0.0, 4.001, 0.05)
    path = path_from_points(x, 0 * x, speed=np.where(x > 2.0, 0.2, 0.7))
    speed = speed_profile(path, ROBOT, 0.7)
    assert speed[-1] == pytest.approx(0.2)
    before = np.interp(1.85, path.arc_length, speed)
    distance = 2.05 - 1.85  # 0.2 is recorded from 2.05 m on
    assert before**2 == pytest.approx(0.2**2 + 2 * BRAKING_SHARE * LIMITS.deceleration_m_s2 * distance, rel=0.05)


def test_around_a_closed_path_it_fits_together() -> None:
    angle = np.linspace(0.0, math.tau, 400)
    path = path_from_points(3.0 * np.sin(angle), 1.1 * np.sin(2 * angle), closed=True)
    speed = speed_profile(path, ROBOT, 0.7)
    assert speed[0] == pytest.approx(speed[-1], abs=0.02)
    half = len(speed) // 2
    assert speed[: half - 1] == pytest.approx(speed[half : 2 * half - 1], abs=0.02)  # both halves are alike


def test_a_kink_is_passed_at_a_crawl() -> None:
    curvature = np.where(np.arange(200) < 100, 0.0, 2.0)
    heading = np.cumsum(curvature) * 0.02
    x, y = np.cumsum(np.cos(heading)) * 0.02, np.cumsum(np.sin(heading)) * 0.02
    speed = speed_profile(Path(x, y, heading, curvature, spacing=0.02), ROBOT, 0.7)
    assert speed.min() == pytest.approx(CRAWL, abs=0.03)
