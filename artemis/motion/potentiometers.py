"""What the sensors of a steered wheel's angle tell: two potentiometers, or an absolute encoder."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians

from artemis.axles import AbsoluteEncoder, Potentiometers
from artemis.motion.angles import wrap
from artemis.motion.totals import mean

RAIL = 0.02
"""Nearer than this to a rail, as a part of its supply, a potentiometer counts as open or shorted."""


def wheel_angles(volts: tuple[float, float], calibration: Potentiometers) -> tuple[float, float]:
    """The wheel's angle [rad] by each of its two potentiometers (two-point calibration, thesis 4.3.1)."""
    (zero, other_zero), (slope, other_slope) = calibration.zero_v, calibration.slope_deg_per_v
    return radians(slope * (volts[0] - zero)), radians(other_slope * (volts[1] - other_zero))


def encoder_angle(counts: int, known: AbsoluteEncoder) -> float:
    """The wheel's angle [rad] in (-pi, pi], left positive, by what its absolute encoder counts."""
    angle = wrap(radians(360.0 * counts / (1 << known.bits) - known.zero_deg))
    return -angle if known.mirrored else angle


def is_at_a_rail(volts: tuple[float, float], supply: float) -> bool:
    """Whether one of them is open or shorted; `supply` of both [V]."""
    lowest = RAIL * supply
    highest = supply - lowest
    return not (lowest <= volts[0] <= highest and lowest <= volts[1] <= highest)


def memory_numbers(calibration: Potentiometers) -> tuple[int, ...]:
    """What a drive keeps of a calibration (object 0x200C:1 to 4): zeros [uV], then slopes [millionths of deg/V]."""
    return tuple(round(value * 1e6) for value in (*calibration.zero_v, *calibration.slope_deg_per_v))


def memory_words(numbers: Sequence[int]) -> str:
    """These numbers for people."""
    if not any(numbers):
        return "nothing"
    first, second, slope, other = (number / 1e6 for number in numbers)
    return f"zero {first:.4f} and {second:.4f} V, slope {slope:.3f} and {other:.3f} deg/V"


class StepEdges:
    """Where a wheel stands, more exactly than one step of the analog inputs that read its potentiometers.

    A reading that changes passes the middle between both: so well as the wheel turned slowly meanwhile, its angle is
    known there. A reading that stays tells nothing. Both ways count alike: play, and what an input lags, cancel.
    """

    def __init__(self, calibration: Potentiometers, step: float) -> None:
        """`step` of the inputs' converter [V]; what they tell is rounded to whole units."""
        self._calibration, self._step = calibration, step
        self._last: tuple[float, tuple[float, float]] | None = None
        self._right: list[float] = []
        self._left: list[float] = []

    def take(self, position: float, volts: tuple[float, float]) -> None:
        """What the encoder says of the wheel [rad], and both potentiometers [V], at one instant."""
        exact = round(volts[0] / self._step) * self._step, round(volts[1] / self._step) * self._step
        before, shown = self._last or (position, exact)
        self._last = position, exact
        if position == before:
            return
        found = self._left if position > before else self._right
        middle = (shown[0] + exact[0]) / 2.0, (shown[1] + exact[1]) / 2.0
        for angle, old, new in zip(wheel_angles(middle, self._calibration), shown, exact, strict=True):
            if old != new:
                found.append(angle - (before + position) / 2.0)

    @property
    def error(self) -> float | None:
        """How much farther left the wheel stands than its encoder says [rad]; None: not seen in both directions."""
        return (mean(self._right) + mean(self._left)) / 2.0 if self._right and self._left else None
