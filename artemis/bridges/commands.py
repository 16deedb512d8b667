"""From velocity commands of other programs to the virtual front wheel.

With L the wheelbase, v the speed of the rear axle's centre and omega the yaw rate, the virtual front wheel's angle is
atan(omega L / v), and its speed v / cos(angle): the inverse of `Ackermann`'s relations.
"""

from __future__ import annotations

from math import atan, cos, isfinite
from typing import NamedTuple

LEAST_SPEED = 1e-3
"""A slower command is one to stand [m/s]."""


class Command(NamedTuple):
    """A command, understood."""

    speed: float = 0.0
    """Of the virtual front wheel [m/s]."""
    steering: float = 0.0
    """Its angle [rad]."""
    moves: bool = False
    """It asks for a motion, be it of the wheels alone."""
    rests: bool = True
    """It asks for nothing: all of its numbers are 0."""
    raw: tuple[float, ...] = ()
    """As it came."""


def twist_command(speed: float, angular: float, wheelbase: float, limit: float, *, as_angle: bool = False) -> Command:
    """A Twist: `speed` of the rear axle's centre [m/s], `angular` its yaw rate [rad/s], or the angle (`as_angle`).

    A yaw rate that is out of reach at that speed is commanded with the angle at its `limit` [rad]. A yaw rate at
    speed 0 moves nothing.

    Raises:
        ValueError: a number is not finite.
    """
    if as_angle:
        return steered_command(speed, angular, limit)
    raw = _finite(speed, angular)
    if abs(speed) < LEAST_SPEED:
        return Command(rests=raw == (0.0, 0.0), raw=raw)
    steering = _within(atan(angular * wheelbase / speed), limit)
    return Command(speed / cos(steering), steering, moves=True, rests=False, raw=raw)


def steered_command(speed: float, steering: float, limit: float) -> Command:
    """A speed of the rear axle's centre [m/s] and an angle of the virtual front wheel [rad], at most its `limit`.

    Raises:
        ValueError: a number is not finite.
    """
    raw = _finite(speed, steering)
    angle = _within(steering, limit)
    rests = raw == (0.0, 0.0)
    return Command(speed / cos(angle), angle, moves=not rests, rests=rests, raw=raw)


def _finite(speed: float, angular: float) -> tuple[float, float]:
    raw = float(speed), float(angular)
    if not all(map(isfinite, raw)):
        raise ValueError(f"a command that is no number: {raw}")
    return raw


def _within(angle: float, limit: float) -> float:
    return max(min(angle, limit), -limit)
