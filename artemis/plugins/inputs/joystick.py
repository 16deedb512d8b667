"""From a stick to speed and angle of the virtual front wheel: the thesis' mapping (section 4.2), step by step.

A stick has x positive to the right and y positive forward, both in [-1, 1]. The thesis' angles are positive to the
right; `steering_from_stick` negates them, once, for the rest of artemis.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

Gate: TypeAlias = Literal["square", "round"]
"""What the stick's travel ends at: a square lets both axes reach 1 together, a circle does not."""

STANDSTILL = 0.05
"""Below this speed [m/s] the direction of travel may change."""
RANGE_STEP = 0.1
SLOWEST_RANGE = 0.2


def deflection_from_stick(x: float, y: float, gate: Gate, deadzone: float) -> float:
    """How far a stick is pushed: 0 within the radial deadzone, rising from 0 at its edge to 1 at every stop."""
    radius = max(abs(x), abs(y)) if gate == "square" else math.hypot(x, y)
    return min(max(radius - deadzone, 0.0) / (1.0 - deadzone), 1.0)


def steering_from_stick(x: float, y: float, limit: float) -> float:
    """Wished angle of the virtual wheel [rad], left positive, within +-`limit`; the same forward and backward.

    Only the direction of the stick counts. Not for a released stick, which has none: the origin would be a full curve.
    """
    angle = math.pi / 2 - math.atan2(y, x)  # straight ahead is zero, right positive
    if angle > math.pi:
        angle -= math.tau
    if angle > math.pi / 2:
        angle = math.pi - angle
    if angle < -math.pi / 2:
        angle = -math.pi - angle
    angle = min(angle, limit)
    angle = max(angle, -limit)
    return -angle


def speed_from_stick(y: float, deflection: float, top_speed: float) -> float:
    """Wished speed [m/s]: forward for y >= 0, so that a stick held exactly sideways still moves the robot."""
    return math.copysign(deflection * top_speed, -1.0 if y < 0 else 1.0)


def trail(angle: float, in_force: float, band: float, limit: float) -> float:
    """Angle to take [rad]: the one in force follows the wished one at a travel of at most `band`, like a slack rope.

    The thesis' hysteresis, without what a plain threshold leaves behind: straight ahead and the limit are reached.
    """
    if angle == 0.0 or abs(angle) >= limit:
        return angle
    return min(max(in_force, angle - band), angle + band)


class Momentum:
    """How fast the robot may still be: a device does not hear it, but knows what was wished, and how it brakes."""

    def __init__(self, deceleration: float) -> None:
        """`deceleration` of a robot that shall stand [m/s²]."""
        self._deceleration, self._speed = deceleration, 0.0

    def brake(self, passed: float) -> float:
        """The highest speed [m/s], signed, that is left after `passed` [s] of braking."""
        self._speed = math.copysign(max(abs(self._speed) - self._deceleration * passed, 0.0), self._speed)
        return self._speed

    def follow(self, wished: float) -> float:
        """The wished speed [m/s], 0 where it is the other way and the robot may not stand yet."""
        speed = reverse_at_standstill(wished, self._speed)
        self._speed = max(speed, self._speed, key=abs)
        return speed


def reverse_at_standstill(wished: float, speed: float) -> float:
    """The wished speed [m/s], but 0 while the robot still moves the other way faster than `STANDSTILL`."""
    return 0.0 if wished * speed < 0 and abs(speed) > STANDSTILL else wished


def step_range(speed_range: float, faster: bool, slower: bool) -> float:
    """Share of the top speed after a press of the range buttons: steps of 10 % between 20 % and 100 %."""
    stepped = speed_range + RANGE_STEP * (faster - slower)
    return round(min(max(stepped, SLOWEST_RANGE), 1.0), 3)
