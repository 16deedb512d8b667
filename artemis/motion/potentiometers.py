"""What the two potentiometers of a steered wheel tell."""

from __future__ import annotations

from math import radians

from artemis.vehicle import Potentiometers

SUPPLY_V = 5.0
RAIL = 0.02
"""Within this part of the supply from a rail a potentiometer counts as open or shorted."""


def wheel_angles(volts: tuple[float, float], calibration: Potentiometers) -> tuple[float, float]:
    """The wheel's angle [rad] by each of its two potentiometers (two-point calibration, thesis 4.3.1)."""
    first, second = (
        radians(slope * (volt - zero))
        for volt, zero, slope in zip(volts, calibration.zero_v, calibration.slope_deg_per_v, strict=True)
    )
    return first, second


def is_at_a_rail(volts: tuple[float, float]) -> bool:
    """Whether one of them is open or shorted."""
    margin = RAIL * SUPPLY_V
    return not (margin <= volts[0] <= SUPPLY_V - margin and margin <= volts[1] <= SUPPLY_V - margin)
