"""What the supervisor measures of laser scanners at every tick: whether they are heard, move, see, and keep time."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from math import degrees, inf, radians

import numpy as np
from numpy.typing import NDArray

from artemis.motion.beams import ScanPeriod, runs, seeing
from artemis.mounting import Mounting
from artemis.scan import Condition, Scan
from artemis.supervision.expected_returns import APPROACH, ExpectedReturns, MissingReturns
from artemis.supervision.measures import Reading
from artemis.values import Odometry, Sensed

BEGIN_TIME = 60.0
"""A scanner has so long from the begin of the run to its first scan [s]: a motor that changes its speed may take 30."""
IDENTICAL = 5
"""So many scans that are equal bit for bit come of no scanner that measures: its noise is many millimetres."""
TELEGRAMS = 10
"""So many of the last ones are looked at for damage and loss."""
NO_RETURN = 0.8
"""Share of the beams that returned in the scan before, or of what stood there some seconds ago; where more return
nothing the scanner is covered, or blinded. Of the first scan it is a share of all: open ground cannot be told from a
cover then, so somebody has to look. What was not doubted like this before, and is lost, is no open ground: nobody can
accept it."""
COVERED, NEAR = radians(10.0), 3000
"""So much of the view [rad] whose neighbouring beams had a return nearer than this [mm] is not lost from one scan to
the next but by a cover."""
SLOWLY = 60.0
"""So much of what stood there some seconds ago [degrees] is lost only by a cover that slides over the window: a person
at 0.5 m, or a door at 1 m, takes less."""
LOOKED = 0.1
"""What was seen some seconds ago is looked for so often [s]."""


class ScannerMeasures:
    """All scanners of a robot."""

    def __init__(self, scanners: Mapping[str, Mounting]) -> None:
        self._scanners = {name: _Watched(mounting) for name, mounting in scanners.items()}

    def read(self, sensed: Sensed, odometry: Odometry) -> list[Reading]:
        """Readings of all of them, of a robot that is there by its odometry.

        Of others, which no robot file knows, nothing is expected.
        """
        for scan in sensed.scans:
            if (watched := self._scanners.get(scan.source)) is not None:
                watched.take(scan, sensed.time, odometry)
        readings: list[Reading] = []
        for name, watched in self._scanners.items():
            for id, value, words in watched.readings(sensed.time):
                readings.append((id, name, value, words))
        return readings

    def accept(self, name: str) -> bool:
        """A person has looked at a scanner: what it sees now is right. False: that cannot be."""
        return self._scanners[name].accept()


class _Watched:
    def __init__(self, mounting: Mounting) -> None:
        self._mask, self._least = mounting.mask, round(1000.0 * mounting.least_range_m)
        self._nearest = round(1000.0 * (mounting.least_range_m + APPROACH))
        self._expected, self._lost, self._looked = ExpectedReturns(mounting), MissingReturns(0.0, 0.0), -inf
        self._view: tuple[int, float, float] = (0, 0.0, 0.0)
        self._seeing: NDArray[np.bool_] = np.zeros(0, bool)
        self._heard: float | None = None
        self._period = ScanPeriod()
        self._before = 0.0
        self._last: Scan | None = None
        self._same = 0
        self._bad: deque[bool] = deque(maxlen=TELEGRAMS)
        self._frozen = ""
        self._late = 0.0
        self._blind, self._covered = "", False
        self._uncovered: NDArray[np.uint16] | None = None

    def accept(self) -> bool:
        """Take what is seen now as right; not so of a scanner that saw, and now sees nothing, or nearly nothing."""
        if not self._covered and self._last is not None:
            self._uncovered, self._blind, self._lost = self._last.millimetres, "", MissingReturns(0.0, 0.0)
            self._expected.forget()
        return not self._covered

    def take(self, scan: Scan, now: float, odometry: Odometry) -> None:
        """One more scan, sensed at run time `now` [s] where the robot is by its odometry."""
        if self._heard is not None and now - self._heard > self._period.patience:  # a new beginning
            self._last, self._same = None, 0
            self._bad.clear()
        last, self._last, self._heard = self._last, scan, now
        self._period.take(scan)
        self._bad.extend([True] * min(scan.garbled, TELEGRAMS))
        self._frozen = ""
        if last is not None:
            lost = scan.counter - last.counter - 1
            self._bad.extend([True] * max(0, min(lost, TELEGRAMS)))
            self._same = self._same + 1 if scan.ranges == last.ranges and any(scan.ranges) else 0
            if scan.counter == last.counter:
                self._frozen = f"scan {scan.counter} came again"
            elif self._same >= IDENTICAL - 1:
                self._frozen = f"{self._same + 1} equal scans"
        self._bad.append(False)
        self._look(scan, now, odometry)
        self._late = self._before - scan.time - len(scan.ranges) // 2 * scan.beam_time

    def _look(self, scan: Scan, now: float, odometry: Odometry) -> None:
        """Whether it sees. A return from nearer than the least range is of the window, or of nothing that is known."""
        ranges, metres = scan.millimetres, scan.millimetres / 1000.0
        view = len(ranges), scan.start_angle, scan.increment
        if view != self._view:
            self._view, self._seeing, self._uncovered = view, self._unmasked(view), None
            self._expected.fit(*view, self._seeing)
        self._search(metres, now, odometry)
        none, before = (ranges < self._least) & self._seeing, self._uncovered
        returned = self._seeing if before is None else (before > self._nearest) & self._seeing
        lost = none & returned
        share = _share(lost, returned)
        self._blind, self._covered = "", self._lost.share > NO_RETURN
        if share > NO_RETURN:
            saw = before is not None and _share((before < self._least) & self._seeing, self._seeing) <= NO_RETURN
            self._covered = self._covered or saw
            self._blind = f"{100 * share:.0f} % of the beams do not return{'' if before is None else ' any more'}"
        elif before is not None and (gone := _longest(lost & (before < NEAR))) > round(COVERED / abs(scan.increment)):
            self._blind = f"{gone} neighbouring beams do not return any more"
        elif self._covered or self._lost.degrees >= SLOWLY:
            self._blind = f"{self._lost.degrees:.0f} degrees of what stood there do not return any more"
        if not self._blind:
            self._uncovered = ranges
            self._expected.keep(metres, now)

    def _search(self, metres: NDArray[np.float64], now: float, odometry: Odometry) -> None:
        """Look for what was seen some seconds ago."""
        self._expected.move(odometry.pose, uncounted=odometry.uncounted, frozen=bool(self._blind))
        self._expected.take(metres)
        if now - self._looked >= LOOKED:
            self._looked, self._lost = now, self._expected.lost(metres)

    def _unmasked(self, view: tuple[int, float, float]) -> NDArray[np.bool_]:
        beams, start, increment = view
        return seeing(np.arange(beams) * degrees(increment) + degrees(start), self._mask)

    def readings(self, now: float) -> list[tuple[str, float, str]]:
        """Rows, values and words at run time `now` [s]."""
        found: list[tuple[str, float, str]] = []
        if self._heard is None:
            found.append(("LAS-01", now - BEGIN_TIME, "no scan yet"))
        else:
            age = now - self._heard
            found.append(("LAS-01", age - self._period.patience, f"no scan for {1000 * age:.0f} ms"))
        if self._frozen:
            found.append(("LAS-02", 1.0, self._frozen))
        if bad := self._bad.count(True):
            found.append(("LAS-03", float(bad), f"{bad} of {len(self._bad)} telegrams"))
        if self._last is not None and self._last.condition is not Condition.WELL:
            words = "its window is dirty" if self._last.condition is Condition.DIRTY else "it says so itself"
            found.append(("LAS-05", float(self._last.condition), f"{words}, status {self._last.status:#06x}"))
        if self._blind:
            found.append(("LAS-06", 1.0, self._blind))
        if self._late > 0.0:
            found.append(("LAS-07", self._late, f"scans come {1000 * self._late:.0f} ms late"))
        self._before = now
        return found


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    return int(np.count_nonzero(part)) / max(1, int(np.count_nonzero(whole)))


def _longest(beams: NDArray[np.bool_]) -> int:
    """Of the runs of neighbours the longest."""
    return max([end - first for first, end in runs(beams)], default=0)
