"""What comes nearer than a laser scanner sees to a robot that stands, or nearly: nothing shows how near it is then."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import hypot, inf
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import difference
from artemis.motion.arrays import Array
from artemis.values import Pose

CAME, LEFT_AT = 150.0, 160.0
"""It was seen to come nearer by so much, and last no farther beyond the least range [mm]: who walks at 2 m/s covers
this in two periods of a scanner that turns 25 times a second. What stands, and is hidden by noise now and then, does
not come nearer by so much."""
STAYS, BEGINS = 0.1, 0.08
"""To a scanner that has moved no farther [m] what stands comes nearer by less; it begins with what it saw from places
so near to where it is [m], as at the end of braking."""
BRAKING = 30
"""The last scans that are looked at then."""
FEWEST = 5
"""So many neighbouring beams lose it together; fewer are dust, or an edge."""

_Seen = tuple[Array, NDArray[np.bool_], Pose]
_T = TypeVar("_T", np.float64, np.bool_)


class Approaches:
    """Of each beam: the farthest and the last return since the scanner is about where it is."""

    def __init__(self, least: float, lever: float) -> None:
        """Begin: nothing comes.

        Args:
            least: range below which the scanner need not report anything [mm].
            lever: how far from the rear axle it is mounted [m].
        """
        self._least, self._lever = least, lever
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._before: deque[_Seen] = deque(maxlen=BRAKING)
        self._from, self._turned = Pose(x=inf), 0
        self._begin(0)

    def _begin(self, beams: int) -> None:
        self._farthest, self._last = np.zeros(beams), np.zeros(beams)
        self._shown, self._came = np.zeros(beams, np.bool_), np.zeros(beams, np.bool_)

    def note(self, ranges: Array, near: NDArray[np.bool_], pose: Pose) -> None:
        """Keep a scan of a robot that drives, as in `take`: it counts once the robot is slow enough."""
        self._before.append((ranges, near, pose))
        self._from = Pose(x=inf)

    def take(self, ranges: Array, near: NDArray[np.bool_], pose: Pose, increment: float) -> NDArray[np.bool_]:
        """Take a new scan of a robot that stands, or nearly.

        Args:
            ranges: of all beams [mm].
            near: which of them are returns of something nearby.
            pose: of the robot, in the frame of the odometry.
            increment: from one beam to the next [rad].

        Returns:
            Beams in which something is nearer than the least range that has come there, and shows itself no more:
            where it was seen last, and from there on to all beams that it hides from what they showed before.
        """
        self._before.append((ranges, near, pose))
        if self._moved(self._from, pose) > STAYS or self._last.size != ranges.size:
            self._begin(ranges.size)
            seen = [it for it in self._before if self._moved(it[2], pose) <= BEGINS and it[0].size == ranges.size]
            self._from, self._turned = seen[0][2], 0
            for scan in seen:
                self._add(*scan, increment)
        else:
            self._add(ranges, near, pose, increment)
        self._came = self._found(ranges == 0.0)
        return self._came

    def _moved(self, begin: Pose, end: Pose) -> float:
        """How far the scanner may have, at most [m]."""
        return hypot(end.x - begin.x, end.y - begin.y) + self._lever * abs(difference(end.heading, begin.heading))

    def _add(self, ranges: Array, near: NDArray[np.bool_], pose: Pose, increment: float) -> None:
        shown = ranges >= self._least
        near = near & shown
        if (turned := round(difference(pose.heading, self._from.heading) / increment)) != self._turned:
            by, self._turned = self._turned - turned, turned
            self._farthest, self._last = _shifted(self._farthest, by), _shifted(self._last, by)
            self._shown, self._came = _shifted(self._shown, by), _shifted(self._came, by)
        self._farthest, self._shown = np.maximum(self._farthest, ranges * near), self._shown | shown
        self._last[near] = ranges[near]

    def _found(self, empty: NDArray[np.bool_]) -> NDArray[np.bool_]:
        near = (self._last > 0.0) & (self._last < self._least + LEFT_AT)
        came = empty & near & (self._farthest > self._last + CAME)
        if not (came.any() or self._came.any()):
            return came
        found = np.zeros_like(came)
        for first, end in _runs(came):
            found[first:end] = end - first >= FEWEST
        for first, end in _runs(empty & self._shown):
            found[first:end] |= self._came[max(first - FEWEST, 0) : end + FEWEST].any()
        return found


def _shifted(beams: NDArray[_T], places: int) -> NDArray[_T]:
    """To other numbers; of what comes into view nothing is known."""
    found = np.zeros_like(beams)
    if places >= 0:
        found[places:] = beams[: len(beams) - places]
    else:
        found[:places] = beams[-places:]
    return found


def _runs(some: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Of neighbouring beams: the first, and that after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], some, [False]))))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
