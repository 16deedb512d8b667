"""Which beams of a laser scanner see something else than the robot, and how often it scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from artemis.motion.arrays import Array
from artemis.scan import Scan

SAME: Array = np.array(150.0)
"""Returns of neighbouring beams in two scans are of the same thing if they differ by less [mm]; what one beam alone
showed once is dust. An array of no dimension: numpy takes half as long for it as for a number."""
FEW = 2
"""So many neighbouring beams without a return are an accident."""
LOST = 0.17
"""A scanner is lost (LAS-01) after so long without a scan [s]."""
PERIODS, SLOWEST = 2.5, 0.2
"""Or after so many of its own periods, if that is longer; none may be longer than `SLOWEST` [s], as it is before two
scans have come."""
GAPS = 5
"""The period is the middle one of so many."""


def seeing(degrees: NDArray[np.floating[Any]], mask: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """The beams that no part of the robot is in the way of.

    Args:
        degrees: where they point to in the scanner's frame, left positive, of any turn; shape (n,).
        mask: sectors [from, to] in which the robot itself is seen [degrees], from right to left, within -180 to 180.

    Returns:
        True for each of them, shape (n,).
    """
    wrapped = (degrees + 180.0) % 360.0 - 180.0
    clear = np.ones(len(wrapped), bool)
    for first, last in mask:
        clear &= ~((wrapped >= first) & (wrapped <= last))
    return clear


def widened(some: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Some beams, and so many to both sides of each."""
    return np.asarray(np.convolve(some, np.ones(2 * count + 1))[count : count + len(some)] > 0.5)


def runs(some: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Of neighbouring beams: the first, and that after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], some, [False]))))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def wide(some: NDArray[np.bool_], fewest: int) -> NDArray[np.bool_]:
    """Those of some beams that have so many neighbours among them, themselves included."""
    found = np.zeros_like(some)
    if some.nonzero()[0].size >= fewest:
        for first, end in runs(some):
            found[first:end] = end - first >= fewest
    return found


def least_beside(ranges: Array, beside: int) -> Array:
    """The least return of each beam and of so many to both sides of it [mm]; 0: something may stand there unseen.

    `FEW` neighbouring beams without a return say nothing, unless they are among the `FEW` next to it: a pole of 2 cm
    within the least range hides four beams of half a degree, or two of a degree, and the end of a plate fewer.
    """
    empty = ranges == 0.0
    together = empty[:-2] & empty[1:-1] & empty[2:]
    few = empty.copy()
    for part in (slice(None, -2), slice(1, -1), slice(2, None)):
        few[part] &= ~together
    return np.asarray(np.minimum(least_within(np.where(few, inf, ranges), beside), least_within(ranges, FEW)))


def least_within(ranges: Array, beside: int) -> Array:
    """The least range of each beam and of so many, at least one, to both sides of it."""
    least, width, count = np.empty(len(ranges) + 2 * beside), 1, 2 * beside + 1
    least.fill(inf)
    least[beside:-beside] = ranges
    while 2 * width <= count:
        least, width = np.minimum(least[:-width], least[width:]), 2 * width
    return np.asarray(np.minimum(least[: width - count], least[count - width :]))


def seen_twice(some: NDArray[np.bool_], ranges: Array, before: Array) -> NDArray[np.bool_]:
    """Which of some beams show nearly what they, or those beside them, showed in the scan before."""
    found, alone = some.copy(), ((np.abs(ranges - before) >= SAME) & some).nonzero()[0]
    if alone.size:
        there = ranges.take(alone)
        found[alone] = (np.abs(there - before.take(alone - 1, mode="clip")) < SAME) | (
            np.abs(there - before.take(alone + 1, mode="clip")) < SAME
        )
    return found


class ScanPeriod:
    """Measures the period of a scanner by the times of its own scans."""

    def __init__(self) -> None:
        self._last: Scan | None = None
        self._gaps: deque[float] = deque(maxlen=GAPS)
        self.patience = PERIODS * SLOWEST
        """After so long without a scan it is lost [s]."""

    def take(self, scan: Scan) -> None:
        """One more scan."""
        last, self._last = self._last, scan
        if last is None or scan.time <= last.time:
            return
        self._gaps.append((scan.time - last.time) / max(1, scan.counter - last.counter))
        period = sorted(self._gaps)[len(self._gaps) // 2]
        self.patience = max(LOST, PERIODS * min(period, SLOWEST))
