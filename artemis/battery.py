"""What a robot file says of the battery, and what is known of its charge at a tick."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from math import floor
from operator import itemgetter
from typing import Annotated, Literal, Self

from msgspec import Struct
from pydantic import Field, model_validator

from artemis.config import Config, Inconsistent, Quantity

Percent = Annotated[float, Quantity(0.0, 100.0, "%")]
Supply = Annotated[float, Quantity(5.0, 100.0, "V")]
Point = Annotated[tuple[Percent, Supply], Field(strict=False)]  # YAML knows only lists
HOUR = 3600.0
"""[s]."""
LEAST = 0.8
"""Of an empty battery's voltage without load: below it there is nothing to protect any more, under load neither."""


class VoltageInput(Config):
    """An analog input of a drive that reads the battery's voltage behind a divider."""

    drive: str
    """Its name in the robot file."""
    input: Literal[1, 2]
    """Number of the analog input of that drive."""
    divider: Annotated[float, Quantity(1.0, 100.0, "")]
    """Volts of the battery per volt at the input."""


class Battery(Config):
    """The batteries that feed the drives, as one; with what the robot takes of them."""

    capacity_ah: Annotated[float, Quantity(0.01, 1000.0, "Ah")]
    """That can be taken, from full to empty, of the batteries as they are."""
    curve_v: Annotated[tuple[Point, ...], Field(strict=False)]
    """Voltage without load: pairs of charge in percent and voltage, from 0 to 100 percent; straight between."""
    resistance_ohm: Annotated[float, Quantity(0.0, 5.0, "ohm")]
    """Of the batteries and of the wires to where the voltage is measured."""
    idle_w: Annotated[float, Quantity(0.0, 2000.0, "W")]
    """Taken all the time: computer, sensors, drives at rest."""
    newtons_per_ampere: Annotated[float, Quantity(0.5, 500.0, "N/A")]
    """Force of a driven wheel on the ground per ampere of its motor: force times speed is what the drive takes."""
    joules_per_metre: Annotated[float, Quantity(0.5, 20_000.0, "J/m")]
    """Taken altogether where the robot drives as it usually does: `artemis report` tells it of a run."""
    measured: VoltageInput | None = None
    """What reads its voltage; if left out, a drive that measures its supply itself, where there is one."""
    low_v: Supply
    """Under load (PWR-01): the robot drives slowly."""
    critical_v: Supply
    """Under load (PWR-02): the robot stops."""
    reserve_percent: Annotated[float, Quantity(0.0, 90.0, "%")] = 10.0
    """Not counted on: what `range_m` and `time_left_s` leave."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        problems = list(self._problems())
        if problems:
            raise Inconsistent(problems)
        return self

    def _problems(self) -> list[tuple[tuple[str, ...], str]]:
        curve = self.curve_v
        problems: list[tuple[tuple[str, ...], str]] = []
        if len(curve) < 2 or (curve[0][0], curve[-1][0]) != (0.0, 100.0):
            problems.append((("curve_v",), "expected pairs from 0 to 100 percent, such as [[0, 23.0], [100, 25.6]]"))
        elif any(less >= more or low >= high for (less, low), (more, high) in pairwise(curve)):
            problems.append((("curve_v",), "expected charges that rise, and voltages that rise with them"))
        else:
            empty, full = curve[0][1], curve[-1][1]
            if self.low_v >= full:
                text = f"expected less than a full battery has ({full:g} V), found {self.low_v:g} V"
                problems.append((("low_v",), text))
            if self.critical_v < (least := floor(10.0 * LEAST * empty + 1e-6) / 10.0):
                text = f"expected at least {least:g} V, {LEAST:.0%} of what an empty battery has, found "
                problems.append((("critical_v",), f"{text}{self.critical_v:g} V"))
        if self.critical_v >= self.low_v:
            problems.append(
                (("critical_v",), f"expected less than low_v ({self.low_v:g} V), found {self.critical_v:g} V")
            )
        return problems

    def voltage_at(self, charge: float) -> tuple[float, float]:
        """Voltage without load at a charge (0 to 1) [V], and how fast it rises there [V, from empty to full]."""
        (before, low), (after, high) = self._piece(100.0 * charge, 0)
        slope = 100.0 * (high - low) / (after - before)
        return low + slope * (charge - before / 100.0), slope

    def charge_at(self, voltage: float) -> float:
        """The charge (0 to 1) at a voltage without load [V]."""
        (before, low), (after, high) = self._piece(voltage, 1)
        return min(max((before + (after - before) * (voltage - low) / (high - low)) / 100.0, 0.0), 1.0)

    def _piece(self, value: float, of: int) -> tuple[Point, Point]:
        """The points of the curve around a charge [%] (0) or a voltage [V] (1); beyond its ends the last two."""
        curve = self.curve_v
        place = min(max(bisect_right(curve, value, key=itemgetter(of)), 1), len(curve) - 1)
        return curve[place - 1], curve[place]


class BatteryState(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What is known of the battery, by its voltage and by what the drives took."""

    volts: float  # under load, the mean of the last 2 s [V]
    charge: float  # of `capacity_ah`, 0 to 1
    charge_std: float
    watts: float  # taken now [W]
    joules: float = 0.0  # taken since the run began [J]
    range_m: float = 0.0  # that the robot can drive before the reserve is left [m]
    range_std_m: float = 0.0
    time_left_s: float = 0.0  # until then, as power was taken of late [s]
