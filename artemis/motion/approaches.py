"""What comes nearer than a laser scanner sees: nothing shows how near it is then."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import ceil, hypot, inf, radians
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import difference
from artemis.motion.arrays import Array, Indices
from artemis.motion.beams import SAME, runs, wide, widened
from artemis.motion.points import placed_points
from artemis.values import Pose

CAME = 150.0
"""A thing has come nearer once a beam shows it nearer than it showed anything before by so much [mm]; else, if nothing
was there in the first of the last scans."""
WALK, GAPS, LEAST_GAP, MOST_GAP = 2000.0, 2.0, 0.04, 0.5
"""It was seen last no farther beyond the least range than somebody walks at this speed [mm/s] in so many periods of the
scanner; a period counts as at least and at most so long [s]."""
STANDS, STAYS = 0.01, 0.1
"""While the scanner has moved no farther than the first [m] another thing in a beam is there because it moved; up to
the second it is only where nothing was before: edges of what stands go through the beams of a robot that moves."""
KEPT = 50
"""The last scans that are kept."""
FEWEST, WIDTH = 5, radians(2.5)
"""So many neighbouring beams lose it together, and together they are so wide; fewer are dust, or an edge."""
SUDDEN = 2
"""While the scanner stands, what is put down before it, or steps up from where it does not look, hides so many times as
many beams at once, and more than anybody uncovers who walks away; they stay lost in the next scan."""
BEHIND = 2.0
"""What was seen so many times farther than the least range is not what came too near, but stands behind it."""


class NotedScan(NamedTuple):
    """A scan."""

    ranges: Array
    """Of all beams [mm]; 0: no return."""
    shown: NDArray[np.bool_]
    """Which are returns of something that is no part of the robot, and no nearer than the least range."""
    pose: Pose
    """Of the robot, in the frame of the odometry."""
    time: float
    """Of the first beam [s]."""


WasFree = Callable[[NotedScan, Indices, Array, Array], NDArray[np.bool_]]
"""Whether nothing was by a scan where some beams ended since: numbers of the beams, their ranges [mm], and where the
scanner was, shape (2, n) in the frame of the odometry [m]."""
Remembered = Callable[[], NDArray[np.bool_]]
"""The beams towards what is remembered nearer than the least range."""
_T = TypeVar("_T", np.float64, np.bool_)


class Approaches:
    """Of each beam: the last return, and the farthest one while the scanner stands."""

    def __init__(self, least: float, place: Array, was_free: WasFree, remembered: Remembered) -> None:
        """Begin: nothing comes.

        Args:
            least: range below which the scanner need not report anything [mm].
            place: where it is mounted, in the frame of the rear axle, shape (2, 1) [m].
            was_free: compares two scans, by the odometry.
            remembered: asked where something stands nearer than the least range.
        """
        self._least, self._place, self._was_free, self._remembered = least, place, was_free, remembered
        self._lever = hypot(*place.ravel().tolist())
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._begin(0)

    def _begin(self, beams: int) -> None:
        self._before: deque[NotedScan] = deque(maxlen=KEPT)
        self._from = self._stood = Pose(x=inf)
        self._aligned, self._time = 0.0, inf
        self._standing, self._last, self._places = np.zeros(beams), np.zeros(beams), np.zeros((2, beams))
        self._ranges = np.zeros(beams)
        self._empty = self._came = self._aside = self._hidden = self._near = self._sudden = np.zeros(beams, np.bool_)

    def take(self, seen: NotedScan, increment: float, *, slow: bool) -> NDArray[np.bool_]:
        """Take a new scan; beams lie `increment` apart [rad].

        Args:
            seen: the scan.
            increment: see above.
            slow: the robot stands, or nearly. Else there is nothing to do where nothing is as near as somebody who is
                about to come too near.

        Returns:
            Beams in which something is nearer than the least range that has come there, and shows itself no more:
            where it was seen last, and from there on all beams that it hides from what they showed before.
        """
        if self._last.size != seen.ranges.size:
            self._begin(seen.ranges.size)
        self._before.append(seen)
        self._walked, self._time = WALK * min(max(seen.time - self._time, LEAST_GAP), MOST_GAP), seen.time
        self._reach = self._least + GAPS * self._walked
        near = seen.shown & (seen.ranges < self._reach)
        if slow or near.any() or (self._last > 0.0).any():
            self._add(seen, increment)
            self._hidden = self._found(seen.ranges == 0.0, seen.pose, increment)
            close = self._hidden | self._sudden | (self._last > 0.0) & (self._last < self._reach)
            if not (slow or close.any()):
                self._last = np.zeros(self._last.size)  # it is not followed while nothing is near
        self._ranges, self._near = seen.ranges, near
        return self._hidden

    def _moved(self, begin: Pose, end: Pose) -> float:
        """How far the scanner may have, at most [m]."""
        return hypot(end.x - begin.x, end.y - begin.y) + self._lever * abs(difference(end.heading, begin.heading))

    def _add(self, seen: NotedScan, increment: float) -> None:
        ranges, shown, pose = seen.ranges, seen.shown, seen.pose
        if by := -round(difference(pose.heading, self._aligned) / increment):
            self._aligned -= by * increment
            self._standing, self._empty = _shifted(self._standing, by), _shifted(self._empty, by)
            self._last, self._places = _shifted(self._last, by), _shifted(self._places, by)
            self._came, self._hidden = _shifted(self._came, by), _shifted(self._hidden, by)
            self._aside, self._sudden = _shifted(self._aside, by), _shifted(self._sudden, by)
            self._near, self._ranges = _shifted(self._near, by), _shifted(self._ranges, by)
        if self._moved(self._from, pose) > STAYS:
            self._from, self._came = pose, np.zeros(ranges.size, np.bool_)
            self._hidden = self._came
        if self._moved(self._stood, pose) > STANDS:
            self._stood, self._standing, self._aside = pose, np.zeros(ranges.size), np.zeros(ranges.size, np.bool_)
        told = ranges * shown
        self._standing = np.maximum(self._standing, told)
        self._last = np.where(shown, told, self._last)
        self._places = np.where(shown, placed_points(pose, self._place), self._places)

    def _found(self, empty: NDArray[np.bool_], pose: Pose, increment: float) -> NDArray[np.bool_]:
        dx, dy = self._places - placed_points(pose, self._place)
        known = empty & (self._last > 0.0) & (dx * dx + dy * dy < STAYS * STAYS)
        newly = known & ~self._empty
        near = newly & (self._last < self._reach)
        farther = newly & ~near
        while_standing = farther & (self._standing > 0.0)
        self._aside = (self._aside | while_standing) & empty
        self._empty, self._came, lost = empty, self._came & empty, near.nonzero()[0]
        if lost.size:
            came = self._standing[lost] > self._last[lost] + CAME
            if not came.all():
                came |= self._was_free(self._before[0], lost, self._last[lost], self._places[:, lost])
            self._came[lost] = came
        fewest = max(FEWEST, ceil(WIDTH / abs(increment)))
        self._came |= self._sudden & empty
        self._sudden = np.zeros(empty.size, np.bool_)
        if farther.any():
            self._came |= self._gone_on(farther, while_standing, fewest)
            for first, end in runs(wide(while_standing, SUDDEN * fewest)):
                covers = (end - first) * abs(increment) * self._last[first:end].min()
                self._sudden[first:end] = covers > self._walked
        if not (self._came.any() or self._hidden.any() or self._aside.any()):
            return self._came
        found, aside = wide(self._came, fewest), wide(self._aside, fewest)
        if aside.any():  # who is remembered nearer than the least range steps aside, and hides what was seen beyond
            stands = self._remembered()
            for first, end in runs(empty):
                found[first:end] |= aside[first:end] & stands[first:end].any()
        if self._hidden.any():
            for first, end in runs(wide(known, fewest)):
                found[first:end] |= self._hidden[max(first - fewest, 0) : end + fewest].any()
        return found

    def _gone_on(self, farther: NDArray[np.bool_], while_standing: NDArray[np.bool_], fewest: int) -> NDArray[np.bool_]:
        """Of the beams that are lost now: those of a surface far behind what is too near beside them.

        A thin thing goes on from there: it leaves its own beams, and hides what others showed.
        """
        lost = farther & widened(self._came, fewest) | while_standing & widened(self._near, fewest)
        lost &= self._last > BEHIND * self._least
        if lost.any():
            same = np.zeros(lost.size, np.bool_)
            same[1:] = (np.abs(self._ranges[1:] - self._ranges[:-1]) < SAME) & (self._ranges[1:] > 0.0)
            lost &= widened(wide(same, SUDDEN * fewest), 1)
        return lost


def _shifted(beams: NDArray[_T], places: int) -> NDArray[_T]:
    """To other numbers; of what comes into view nothing is known."""
    found = np.zeros_like(beams)
    count = beams.shape[-1]
    if abs(places) < count:
        found[..., max(places, 0) : count + places] = beams[..., max(-places, 0) : count - places]
    return found
