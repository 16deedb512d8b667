"""A laser scanner without a laser: a device that is no drive, as a run meets it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import radians

import numpy as np

from artemis.devices.device import Readings, Report, Work
from artemis.scan import Scan

BEAMS, TURN = 1081, 0.0251
PROBLEM = ("SYS-02", "front", "dazzled")


class FakeScanner:
    """Some forty turns a second, never together with a tick; in turn number `fail` or `dazzle` that happens."""

    def __init__(self, fail: int | None = None, dazzle: int | None = None) -> None:
        self.made: list[Scan] = []
        self.work = ""
        self.closed = 0
        self._new: list[Scan] = []
        self._fail, self._dazzle = fail, dazzle
        self._random = np.random.default_rng(1)

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> list[Work]:
        self.work = "begun"
        return [self._turn(start, wake, report)]

    async def _turn(self, start: float, wake: Callable[[], None], report: Report) -> None:
        loop = asyncio.get_running_loop()
        try:
            while True:
                begun = loop.time() - start
                await asyncio.sleep(TURN)
                if self._fail == len(self.made):
                    raise ZeroDivisionError("our own bug")
                if self._dazzle == len(self.made):
                    report(*PROBLEM)
                    report(*PROBLEM)
                    wake()
                self._new.append(self._scan(begun))
                self.made.append(self._new[-1])
        finally:
            self.work = "ended"

    def _scan(self, begun: float) -> Scan:
        ranges, strengths = (self._random.integers(0, 20_000, BEAMS).astype("<u2").tobytes() for _ in range(2))
        increment = radians(270) / (BEAMS - 1)
        return Scan(
            source="front",
            time=begun,
            beam_time=TURN / 1440,
            start_angle=-radians(135),
            increment=increment,
            ranges=ranges,
            intensities=strengths,
            counter=len(self.made),
        )

    def sense(self, now: float) -> Readings:
        scans, self._new = tuple(self._new), []
        return Readings(scans=scans)

    def close(self) -> None:
        self.closed += 1
