"""From what a device reports to what a hand means, stage by stage: raw -> calibrated -> centred -> shaped.

Counts become shares of the way in [-1, 1] (a pedal: [0, 1]); then what counts as released is cut out and the rest
stretched, so that it begins at 0 (a stick's by `joystick.deflection_from_stick`); then a curve makes small ones finer.
The command comes after, in `joystick` and `wheel`.
"""

from __future__ import annotations

import math

from artemis.plugins.inputs.joystick import Gate


def calibrate(raw: float, minimum: float, centre: float, maximum: float, inverted: bool) -> float:
    """Share of an axis' way to either side of its `centre`, in [-1, 1]: 1 at `maximum`, or at `minimum` if inverted."""
    travel = maximum - centre if raw >= centre else centre - minimum
    share = min(max((raw - centre) / travel, -1.0), 1.0)
    return -share if inverted else share


def calibrate_pedal(raw: float, minimum: float, maximum: float, inverted: bool) -> float:
    """Share of a pedal's travel, in [0, 1]: 1 at `maximum`, or at `minimum` if inverted (most rest at the maximum)."""
    share = min(max((raw - minimum) / (maximum - minimum), 0.0), 1.0)
    return 1.0 - share if inverted else share


def centre_pedal(pressed: float, deadzone: float) -> float:
    """How far a pedal is pressed beyond its deadzone: 0 within, rising from 0 at its edge to 1."""
    return max(pressed - deadzone, 0.0) / (1.0 - deadzone)


def centre_lever(share: float, deadzone: float) -> float:
    """How far an axis with a centre is moved beyond its deadzone, in [-1, 1]: 0 within, from there to +-1."""
    return math.copysign(centre_pedal(abs(share), deadzone), share)


def curve(travel: float, expo: float) -> float:
    """Travel in [-1, 1], finer around 0: `expo * travel^3 + (1 - expo) * travel`. Monotone and odd; 0 and +-1 stay."""
    return expo * travel**3 + (1.0 - expo) * travel


def push(x: float, y: float, gate: Gate, deflection: float) -> tuple[float, float]:
    """A stick in the direction of (x, y), pushed as far as `deflection`: centred or shaped. At rest it has none."""
    radius = max(abs(x), abs(y)) if gate == "square" else math.hypot(x, y)
    return (x / radius * deflection, y / radius * deflection) if deflection > 0.0 else (0.0, 0.0)
