"""Whether the machine can drive at a speed, and stop from it in time."""

from __future__ import annotations

import math
from collections.abc import Iterator

from artemis.vehicle import RobotFile

DETECT_AND_REACT = 0.12
"""Longest time [s] from a cause to the drives' braking that the stopping distance allows for."""


def check_speed(speed: float, robot: RobotFile, stop_distance: float, later: float = 0.0) -> Iterator[str]:
    """What is wrong with a speed of the virtual front wheel [m/s], where the robot has `stop_distance` [m] to stop.

    Its loss is noticed so much `later` [s] than that of a device on this computer.
    """
    react = DETECT_AND_REACT + later
    limits = robot.limits
    if speed > limits.speed_m_s:
        yield f"{speed:g} m/s is above the robot's limits.speed_m_s of {limits.speed_m_s:g}"
    elif speed > limits.wheel_speed_m_s:
        yield f"{speed:g} m/s is above the robot's limits.wheel_speed_m_s of {limits.wheel_speed_m_s:g}"
    needed = stopping_distance(speed, react, limits.quick_stop_deceleration_m_s2)
    if needed > stop_distance:
        yield (
            f"{speed:g} m/s cannot be stopped in time: {react:g} s to react and "
            f"{limits.quick_stop_deceleration_m_s2:g} m/s² of braking need {math.ceil(needed * 1000) / 1000:g} m, "
            f"supervision.stop_distance_m is {stop_distance:g}"
        )


def stopping_distance(speed: float, detect_and_react: float, deceleration: float) -> float:
    """Distance [m] from `speed` [m/s] to standstill: v t + v²/(2 a), t [s] until braking begins, a > 0 [m/s²]."""
    return abs(speed) * detect_and_react + speed * speed / (2.0 * deceleration)
