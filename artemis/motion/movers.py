"""What moves around the robot: groups of returns that were elsewhere a short time ago, and where they will be."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import hypot

import numpy as np
from msgspec import Struct

from artemis.motion.spline import Array

GAP = 0.2
"""Neighbouring returns farther apart belong to different things [m]."""
WIDEST = 0.9
"""What is wider is a wall, of which one sees now this part and now that [m]."""
FEWEST = 3
"""Of fewer returns nobody can say where their middle is."""
BASE = 0.25, 0.45
"""Motion is measured over so long [s]: the nearest scan within."""
FASTEST, SLOWEST = 3.0, 0.35
"""What seems faster is another thing; what is slower may be a thing of which other sides come into view [m/s]."""
STRIDE, APART = 0.15, 0.05
"""Where a thing will be is looked at so far apart [m], by those of its returns that are so far apart [m]."""
KEPT, EVERY = 1.0, 0.2
"""What was found counts for so long [s], of all that was found what lies so far apart [s]."""


class Group(Struct, frozen=True, kw_only=True, gc=False):
    """Returns that belong together."""

    first: int
    last: int
    x: float
    y: float
    """Middle [m], in the frame of the odometry."""
    width: float


class Movers:
    """Remembers where groups of returns were. In the frame of the odometry."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, list[Group]]] = deque()
        self._found: deque[tuple[float, Array]] = deque()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._seen.clear()
        self._found.clear()

    @property
    def busy(self) -> bool:
        """Whether something moved a short time ago."""
        return bool(self._found)

    def ahead(self, points: Array, now: float, lookahead: float) -> Array:
        """Where what moves will be.

        Args:
            points: x, y of a scan's returns in the order of its beams [m], shape (2, n).
            now: time of the scan [s].
            lookahead: for how long [s].

        Returns:
            Points that it will pass, shape (2, m); for `KEPT` also what was found before: it may have come too near to
            be seen.
        """
        groups = _groups(points)
        while self._seen and now - self._seen[0][0] > BASE[1]:
            self._seen.popleft()
        before = next(((time, seen) for time, seen in reversed(self._seen) if now - time >= BASE[0]), None)
        self._seen.append((now, groups))
        found = [] if before is None else self._passed(points, groups, before[1], now - before[0], lookahead)
        while self._found and now - self._found[0][0] > KEPT:
            self._found.popleft()
        kept = [each for _, each in self._found]
        if found and (not self._found or now - self._found[-1][0] >= EVERY):
            self._found.append((now, np.concatenate(found, axis=1)))
        return np.concatenate([np.zeros((2, 0)), *kept, *found], axis=1)

    def _passed(
        self, points: Array, groups: list[Group], before: list[Group], time: float, lookahead: float
    ) -> list[Array]:
        found = []
        for group in groups:
            if (velocity := _velocity(group, before, time)) is not None:
                count = int(hypot(*velocity) * lookahead / STRIDE) + 1
                times = lookahead * np.arange(1, count + 1) / count
                thinned = max(int((group.last - group.first) * APART / max(group.width, APART)), 1)
                each = points[:, group.first : group.last : thinned]
                shifts = np.array(velocity)[:, None, None] * times[None, :, None]
                found.append((each[:, None, :] + shifts).reshape(2, -1))
        return found


def _groups(points: Array) -> list[Group]:
    x, y = points
    if x.size < FEWEST:
        return []
    dx, dy = np.diff(x), np.diff(y)
    firsts = np.concatenate([[0], np.flatnonzero(dx * dx + dy * dy > GAP * GAP) + 1, [x.size]]).tolist()
    groups = []
    for first, last in pairwise(firsts):
        if last - first < FEWEST:
            continue
        here = points[:, first:last]
        low, high = here.min(axis=1), here.max(axis=1)
        if (width := hypot(*(high - low).tolist())) <= WIDEST:
            middle = ((low + high) / 2.0).tolist()
            groups.append(Group(first=first, last=last, x=middle[0], y=middle[1], width=width))
    return groups


def _velocity(group: Group, before: list[Group], time: float) -> tuple[float, float] | None:
    """Of a group [m/s]; None: it stands, or is none that was seen before."""
    if not before:
        return None
    old = min(before, key=lambda it: hypot(it.x - group.x, it.y - group.y))
    vx, vy = (group.x - old.x) / time, (group.y - old.y) / time
    moves = SLOWEST + abs(group.width - old.width) / time / 2.0 < hypot(vx, vy) < FASTEST
    return (vx, vy) if moves else None
