"""A sensor for the voltage at the simulated drives, as a real robot may have one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from artemis.devices.device import Readings, Report, Work
from artemis.sim.world import World


class SupplyMeter:
    """The `Device` that gives `Sensed.battery_v` in a simulation."""

    def __init__(self, world: World) -> None:
        self._world = world

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """As of a `Device`; nothing runs beside the ticks."""
        return ()

    def sense(self, now: float) -> Readings:
        """The voltage to the millivolt."""
        return Readings(battery_v=round(self._world.supply_voltage, 3))

    def close(self) -> None:
        """Nothing is open."""
