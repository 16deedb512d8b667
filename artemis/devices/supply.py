"""The supply voltage as a drive measures it: its object fits no PDO, so it is read by SDO, beside the ticks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from math import inf

from artemis.devices.device import Readings, Report, Work
from artemis.devices.epos_jobs import fault_of
from artemis.devices.objects import ObjectAccess
from artemis.errors import DeviceError
from artemis.vehicle import SupplySource

EVERY = 0.1
"""Time between two readings [s]: a sag has to last for 0.2 s to count (PWR-03)."""
VALID = 0.5
"""A reading counts for so long [s]: the drive answers nothing else while it does a job, and storing may take 3 s."""


class SupplyMeter:
    """The `Device` that gives `Sensed.battery_v`. A drive that does not answer it any more is a fault (COM-08)."""

    def __init__(self, source: SupplySource, objects: ObjectAccess, judged: Callable[[], bool]) -> None:
        """`objects` of the drive that measures; `judged`: it is configured and in use, so it answers."""
        self._source, self._objects, self._judged = source, objects, judged
        self._volts, self._until = 0.0, -inf

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """As of a `Device`."""
        return (self._read_on(report),)

    def sense(self, now: float) -> Readings:
        """The latest reading, not older than `VALID`; none while the drives are brought up or released."""
        return Readings(battery_v=self._volts if now < self._until and self._judged() else None)

    def close(self) -> None:
        """The drive's line belongs to others."""

    async def _read_on(self, report: Report) -> None:
        while True:
            if self._judged():
                await self._read(report)
            await asyncio.sleep(EVERY)

    async def _read(self, report: Report) -> None:
        object = self._source.object
        try:
            data = await self._objects.read(object.index, object.subindex, object.type.size)
            volts = int(object.type.decode(data)) * self._source.volts_per_unit
        except DeviceError as error:
            self._until = -inf
            if self._judged():  # else the robot has stopped meanwhile, for what is wrong with the drive
                report(fault_of(error), self._source.drive, f"supply voltage: {error.problem}")
        else:
            self._volts, self._until = volts, asyncio.get_running_loop().time() + VALID
