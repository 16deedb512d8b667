"""What moves around the robot: groups of returns that were elsewhere a short time ago, and where they will be."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import pairwise
from math import hypot

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from artemis.motion.arrays import Array

GAP = 0.2
"""Neighbouring returns farther apart belong to different things [m]."""
WIDEST = 0.9
"""What is wider is a wall, of which one sees now this part and now that [m]."""
FEWEST = 3
"""With fewer returns the position of their middle is too uncertain."""
BASE = 0.25, 0.45
"""Motion is measured over so long [s]: the nearest scan within."""
FASTEST, SLOWEST = 3.0, 0.35
"""What seems faster is another thing; what is slower may be a thing of which other sides come into view [m/s]."""
NEW = 0.1
"""More of it than this must be where nothing was. What only seems to move is a piece of a wall, which stood there
before and was seen in other pieces, or not at all."""
STRIDE, APART = 0.15, 0.05
"""Where a thing will be is looked at so far apart [m], by those of its returns that are so far apart [m]."""
KEPT, EVERY = 1.0, 0.2
"""What was found counts for so long [s], of all that was found what lies so far apart [s]."""


NOTHING: Array = np.zeros((2, 0))
Free = Callable[[Array], NDArray[np.bool_]]
"""Where nothing was by a scan, of places in the frame of the odometry, shape (2, n)."""


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
        self._seen: deque[tuple[float, list[Group], Free]] = deque()
        self._found: deque[tuple[float, Array]] = deque()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._seen.clear()
        self._found.clear()

    @property
    def busy(self) -> bool:
        """Whether something moved a short time ago."""
        return bool(self._found)

    def ahead(self, points: Array, now: float, lookahead: float, free: Free) -> Array:
        """Where what moves will be.

        Args:
            points: x, y of a scan's returns in the order of its beams [m], shape (2, n).
            now: time of the scan [s].
            lookahead: for how long [s].
            free: where nothing is by this scan.

        Returns:
            Points that it will pass, shape (2, m); for `KEPT` also what was found before: it may have come too near to
            be seen.
        """
        groups = _groups(points)
        while self._seen and now - self._seen[0][0] > BASE[1]:
            self._seen.popleft()
        before = next((it for it in reversed(self._seen) if now - it[0] >= BASE[0]), None)
        self._seen.append((now, groups, free))
        found = []
        if before is not None:
            then, seen, was_free = before
            found = _passed(points, _moving(groups, seen, now - then), was_free, lookahead)
        while self._found and now - self._found[0][0] > KEPT:
            self._found.popleft()
        kept = [each for _, each in self._found]
        if found and (not self._found or now - self._found[-1][0] >= EVERY):
            self._found.append((now, np.concatenate(found, axis=1)))
        return np.concatenate([*kept, *found], axis=1) if kept or found else NOTHING


def _moving(groups: list[Group], before: list[Group], time: float) -> list[tuple[Group, float, float]]:
    """Those that seem to, with their velocities [m/s]: each was where the nearest one before was."""
    if not (groups and before):
        return []
    (x, y), (x_then, y_then) = _middles(groups), _middles(before)
    dx, dy = x[:, np.newaxis] - x_then, y[:, np.newaxis] - y_then
    nearest = (dx * dx + dy * dy).argmin(axis=1).tolist()
    found = [(group, _velocity(group, before[old], time)) for group, old in zip(groups, nearest, strict=True)]
    return [(group, *velocity) for group, velocity in found if velocity is not None]


def _middles(groups: list[Group]) -> Array:
    return np.array([[group.x for group in groups], [group.y for group in groups]])


def _passed(points: Array, moving: list[tuple[Group, float, float]], was_free: Free, lookahead: float) -> list[Array]:
    """Places that they will pass."""
    if not moving:
        return []
    found, places = [], [points[:, group.first : group.last] for group, *_ in moving]
    new = was_free(np.concatenate(places, axis=1)).tolist()
    for here, (group, vx, vy) in zip(places, moving, strict=True):
        size = here.shape[1]
        was_elsewhere, new = new[:size].count(True), new[size:]
        if was_elsewhere <= NEW * size:
            continue
        count = int(hypot(vx, vy) * lookahead / STRIDE) + 1
        times = lookahead * np.arange(1, count + 1) / count
        thinned = max(int((group.last - group.first) * APART / max(group.width, APART)), 1)
        shifts = np.array([vx, vy])[:, None, None] * times[None, :, None]
        found.append((here[:, None, ::thinned] + shifts).reshape(2, -1))
    return found


def _groups(points: Array) -> list[Group]:
    size = points.shape[1]
    if size < FEWEST:
        return []
    steps = points[:, 1:] - points[:, :-1]
    steps *= steps
    begins = [0, *((steps[0] + steps[1] > GAP * GAP).nonzero()[0] + 1).tolist()]
    low, high = np.minimum.reduceat(points, begins, axis=1), np.maximum.reduceat(points, begins, axis=1)
    (xs, ys), (widths, heights) = ((low + high) / 2.0).tolist(), (high - low).tolist()
    return [
        Group(first=first, last=last, x=xs[number], y=ys[number], width=width)
        for number, (first, last) in enumerate(pairwise([*begins, size]))
        if last - first >= FEWEST and (width := hypot(widths[number], heights[number])) <= WIDEST
    ]


def _velocity(group: Group, old: Group, time: float) -> tuple[float, float] | None:
    """Of a group [m/s]; None: it stands, or is none that was seen before."""
    vx, vy = (group.x - old.x) / time, (group.y - old.y) / time
    moves = SLOWEST + abs(group.width - old.width) / time / 2.0 < hypot(vx, vy) < FASTEST
    return (vx, vy) if moves else None
