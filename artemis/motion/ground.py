"""Ground that the robot drove over or saw to be free a short time ago: where it may drive backwards without looking."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from artemis.motion.poses import placed
from artemis.motion.spline import Array
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View, placed_points
from artemis.values import Pose

Indices = NDArray[np.int64]

CELL = 0.05
"""Width of a cell [m]."""
CELLS = 256
"""In each direction, a power of two; the grid goes round: what is 12.8 m away takes the place of what was here."""
MEMORY = 60.0
"""Of what was seen or driven [s]."""
STEP, TURN = 0.04, 0.05
"""The ground is marked again after so much distance [m] or rotation [rad]."""
AROUND = 0.7
"""Ground is looked at this far around the outline [m]."""
SHRUNK = 0.03
"""The outline is looked for this much smaller than it is [m]: cells at its edge are there to half."""
AHEAD = 0.3
"""Known ground is looked for this far back [m]: a robot that drives slowly stops within less."""


class Ground:
    """A grid in the frame of the odometry, with the time at which each of its cells was known to be free."""

    def __init__(self, box: Rectangle, views: Iterable[View]) -> None:
        """`box`: the outline; `views`: of the scanners."""
        self._beside = _cells(box.grown(AROUND), CELL)
        self._under = _cells(box, CELL / 2)
        self._edge = _border(box.grown(-SHRUNK))
        self._eyes = [_Eye(view, self._beside) for view in views]
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self._when = np.full(CELLS * CELLS, -inf)
        self._who = np.zeros(CELLS * CELLS, dtype=np.int64)
        self._pose: Pose | None = None

    def mark(self, pose: Pose, time: float) -> None:
        """What the robot stands on at a run time [s], and what its scanners see to be free."""
        last, self._at = self._pose, pose
        if last is not None:
            turned = abs(pose.heading - last.heading) > TURN
            if not turned and abs(pose.x - last.x) + abs(pose.y - last.y) < STEP:
                return
        self._pose = pose
        free = [self._beside.take(eye.free(), axis=1) for eye in self._eyes if eye.view.millimetres.size]
        place, who = _numbers(placed_points(pose, np.concatenate([self._under, *free], axis=1)))
        self._when[place], self._who[place] = time, who

    def known(self, curvatures: Sequence[float], now: float) -> list[float]:
        """How far back the robot may roll on each arc over ground that was known in the last `MEMORY` [m]."""
        assert self._pose is not None
        there = [_rolled(self._at, curvature, -distance) for curvature in curvatures for distance in _DISTANCES]
        x, y, c, s = np.array(there).T[:, :, np.newaxis]
        along, beside = self._edge
        place, who = _numbers(np.array([x + c * along - s * beside, y + s * along + c * beside]))
        fresh = ((self._when[place] >= now - MEMORY) & (self._who[place] == who)).all(axis=1)
        found = []
        for each in fresh.reshape(len(curvatures), -1).tolist():
            found.append(inf if all(each) else _DISTANCES[each.index(False)] - CELL)
        return found


_DISTANCES = tuple(CELL * number for number in range(1, round(AHEAD / CELL) + 1))


class _Eye:
    """Which of some places a scanner sees to be free."""

    def __init__(self, view: View, places: Array) -> None:
        self.view = view
        bearings, distances = view.directions(places)
        far = 1000.0 * distances
        self._there = np.flatnonzero(far > view.least)
        self._bearings, self._far = bearings[self._there], far[self._there] + 1000.0 * CELL
        self._shape: tuple[float, float, int] | None = None

    def free(self) -> Indices:
        """Numbers of the places."""
        if self._shape != self.view.shape:
            self._shape = self.view.shape
            beams = self.view.beams_past(self._bearings)
            looked = beams >= 0
            self._places, self._beams, self._limits = self._there[looked], beams[looked], self._far[looked]
        return self._places[self.view.millimetres[self._beams] > self._limits]


def _rolled(pose: Pose, curvature: float, distance: float) -> tuple[float, float, float, float]:
    """Where the rear axle is after so much of an arc [m], and cosine and sine of its heading."""
    turn = curvature * distance
    x = sin(turn) / curvature if abs(curvature) > 1e-9 else distance
    y = (1.0 - cos(turn)) / curvature if abs(curvature) > 1e-9 else 0.0
    there = placed(pose, Pose(x=x, y=y, heading=turn))
    return there.x, there.y, cos(there.heading), sin(there.heading)


def _cells(box: Rectangle, apart: float) -> Array:
    """Places in a rectangle in the robot's frame, so far apart [m]; shape (2, n)."""
    x = np.arange(box.rear, box.front + apart, apart)
    y = np.arange(-box.half_width, box.half_width + apart, apart)
    return np.array(np.meshgrid(x, y)).reshape(2, -1)


def _border(box: Rectangle) -> Array:
    """Points on the border of a rectangle, half a cell apart, shape (2, n)."""
    x = np.append(np.arange(box.rear, box.front, CELL / 2), box.front)
    y = np.append(np.arange(-box.half_width, box.half_width, CELL / 2), box.half_width)
    sides = [np.array([x, np.full_like(x, side)]) for side in (-box.half_width, box.half_width)]
    ends = [np.array([np.full_like(y, end), y]) for end in (box.rear, box.front)]
    return np.concatenate([*sides, *ends], axis=1)


def _numbers(places: Array) -> tuple[Indices, Indices]:
    """Where the cells of places in the frame of the odometry are in the grid, and which of those that share it."""
    cells = np.floor(places / CELL).astype(np.int64)
    there = cells & CELLS - 1
    return there[0] * CELLS + there[1], cells[0] * 1_000_003 + cells[1]
