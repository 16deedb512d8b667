"""What the supervisor measures of the battery at every tick: its voltage under load."""

from __future__ import annotations

from artemis.battery import Battery
from artemis.motion.charge import UNDER_LOAD
from artemis.motion.totals import smoothed
from artemis.supervision.measures import Reading
from artemis.values import Sensed

SAG = "PWR-03"
"""The gate halves the acceleration."""
BEFORE = 10.0
"""A sag is a drop below the mean of so long [s]."""


class SupplyMeasures:
    """Against the limits of the robot file."""

    def __init__(self, battery: Battery) -> None:
        self._battery = battery
        self._time: float | None = None
        self._smooth = self._before = 0.0

    def read(self, sensed: Sensed) -> list[Reading]:
        """Readings of the voltage, where somebody measures it."""
        volts = sensed.battery_v
        if volts is None:
            return []
        if self._time is None:
            self._smooth = self._before = volts
        elapsed, self._time = sensed.time - (self._time or sensed.time), sensed.time
        self._smooth = smoothed(self._smooth, volts, elapsed, UNDER_LOAD)
        self._before = smoothed(self._before, volts, elapsed, BEFORE)
        readings: list[Reading] = []
        if (low := self._battery.low_v - self._smooth) > 0.0:
            readings.append(("PWR-01", "", low, f"{self._smooth:.1f} V under load"))
        if (critical := self._battery.critical_v - volts) > 0.0:
            readings.append(("PWR-02", "", critical, f"{volts:.1f} V under load"))
        if volts < self._before:
            readings.append((SAG, "", 1.0 - volts / self._before, f"{volts:.1f} V after {self._before:.1f} V"))
        return readings
