"""A scanner of the robot at work: its plugin is run, and run again; what it gives is checked; its errors are faults."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from math import isfinite, tau
from typing import TypeGuard

from msgspec.structs import replace

from artemis.devices.device import Readings, Report, Work
from artemis.errors import DeviceError, WrongDevice
from artemis.plugins.contracts import Scanner
from artemis.plugins.guard import GARBAGE, PLUGIN_ERRORS, RAISED, one_line, told
from artemis.scan import Condition, Scan

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 8.0
"""Before a scanner is run again [s]; doubled each time, until scans came."""
LOST, MISCONFIGURED = "LAS-01", "LAS-09"
MOST_BEAMS = 1 << 14
_TOLERANCE = 1e-6
"""Times are rounded [s]."""


class ScannerDevice:
    """The `Device` that a scanner is to the robot. Nothing that the plugin does can stop the run."""

    def __init__(self, name: str, scanner: Scanner, *, upside_down: bool = False) -> None:
        """`name` in the robot file; the angles of one that hangs `upside_down` are mirrored."""
        self._name, self._scanner, self._upside_down = name, scanner, upside_down
        self._scans: list[Scan] = []
        self._report: Report = lambda id, device, seen: None
        self._clock: Callable[[], float] = lambda: 0.0
        self._given = 0

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """As of a `Device`."""
        loop = asyncio.get_running_loop()
        self._clock, self._report = lambda: loop.time() - start, report
        return [self._run()]

    async def _run(self) -> None:
        pause = FIRST_PAUSE
        while True:
            before = self._given
            try:
                await self._scanner.run(self._clock, self._give)
                self._report(GARBAGE, self._name, "run() has ended")
                return
            except DeviceError as error:
                id = MISCONFIGURED if isinstance(error, WrongDevice) else LOST
                self._report(id, self._name, one_line(error.problem))
            except PLUGIN_ERRORS as error:
                if isinstance(error, asyncio.CancelledError | GeneratorExit) and self._is_ending():
                    raise
                self._report(RAISED, self._name, told(error))
                return
            pause = FIRST_PAUSE if self._given > before else pause
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    @staticmethod
    def _is_ending() -> bool:
        """The run, not the plugin, ends what is done here."""
        task = asyncio.current_task()
        return task is None or task.cancelling() > 0

    def _give(self, scan: object) -> None:
        """Take a scan, if it is one."""
        if not is_whole_scan(scan) or scan.source != self._name or scan.time > self._clock() + _TOLERANCE:
            self._report(GARBAGE, self._name, told(scan))
            return
        self._given += 1
        if self._upside_down:
            scan = replace(scan, start_angle=-scan.start_angle, increment=-scan.increment)
        self._scans.append(scan)

    def sense(self, now: float) -> Readings:
        """The scans since the last call."""
        if not self._scans:
            return _NOTHING
        scans, self._scans = tuple(self._scans), []
        return Readings(scans=scans)

    def close(self) -> None:
        """Close the scanner; what it raises then is of no matter any more."""
        try:
            self._scanner.close()
        except PLUGIN_ERRORS as error:
            self._report(RAISED, self._name, told(error))


_NOTHING = Readings()


def is_whole_scan(scan: object) -> TypeGuard[Scan]:
    """Whether it is a scan with the right types in it, finite numbers, and as many intensities as ranges, or none."""
    if not isinstance(scan, Scan) or not isinstance(scan.source, str) or not isinstance(scan.condition, Condition):
        return False
    numbers = (scan.time, scan.beam_time, scan.start_angle, scan.increment)
    if not all([isinstance(number, float | int) and isfinite(number) for number in numbers]):
        return False
    if not all([isinstance(number, int) for number in (scan.counter, scan.status, scan.garbled)]):
        return False
    if not isinstance(scan.ranges, bytes) or not isinstance(scan.intensities, bytes):
        return False
    beams, odd = divmod(len(scan.ranges), 2)
    return (
        0 < beams <= MOST_BEAMS
        and not odd
        and len(scan.intensities) in (0, len(scan.ranges))
        and scan.beam_time >= 0.0
        and scan.garbled >= 0
        and scan.increment != 0.0
        and abs(scan.increment) * (beams - 1) <= tau + _TOLERANCE
        and abs(scan.start_angle) <= tau
    )
