"""From a steering wheel and two pedals to speed and angle of the virtual front wheel (thesis 4.2, pedals separated).

The wheel has right positive, in [-1, 1]; `steering_from_wheel` negates it, once, for the rest of artemis. Gas and brake
are shares of their travels, in [0, 1]: two axes, because on a combined one both pedals together cancel out.
"""

from __future__ import annotations

HARD_BRAKE = 0.8
"""A brake pressed this far asks for a quick stop."""
FAR_OFF_CENTRE = 0.1
"""A wheel turned beyond this share of its travel is not at rest: driving by hand does not begin with turned wheels."""


def steering_from_wheel(turned: float, limit: float) -> float:
    """Wished angle of the virtual wheel [rad], left positive: the whole travel of the wheel is +-`limit`."""
    return -turned * limit


def speed_from_pedals(gas: float, brake: float, hard: float, top_speed: float) -> float:
    """Wished speed [m/s], at least 0: the gas, taken back in proportion to the brake; 0 from `hard` on."""
    return gas * max(1.0 - brake / hard, 0.0) * top_speed
