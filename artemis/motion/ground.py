"""Ground that the robot drove over or saw to be free a short time ago: where it may drive without looking."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import ceil, cos, hypot, inf, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

from artemis.motion.arrays import Array, Indices
from artemis.motion.points import placed_points
from artemis.motion.poses import placed
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View
from artemis.values import Pose

CELL = 0.05
"""Width of a cell [m]."""
CELLS = 256
"""In each direction, a power of two; the grid goes round: what is 12.8 m away takes the place of what was here."""
MEMORY = 60.0
"""Of what was seen or driven [s]."""
STEP, TURN, EVERY = 0.04, 0.05, 1.0
"""The ground is marked again after so much distance [m] or rotation [rad], or so long [s]."""
AROUND, BEFORE_MASK = 0.7, 2.0
"""Ground is looked at this far around the outline [m]; where a scanner has a mask, so far ahead and behind: what
will be hidden is seen before."""
SHRUNK = 0.03
"""The outline is looked for this much smaller than it is [m]: cells at its edge are there to half."""
AHEAD = 0.3
"""Where no scanner looks, known ground is looked for this far [m]: a robot that drives slowly stops within less."""
ASIDE = radians(45.0)
"""Scanners look ahead, or back, if their fields of view reach this far to both sides of there; whatever is masked."""


class Ground:
    """A grid in the frame of the odometry, with the time at which each of its cells was known to be free."""

    def __init__(self, box: Rectangle, views: Collection[View], reach: float) -> None:
        """Begin.

        Args:
            box: the outline.
            views: of the scanners.
            reach: the robot stops within less [m].
        """
        around = box.grown(AROUND)
        if any([view.has_mask for view in views]):
            around = Rectangle(box.rear - BEFORE_MASK, box.front + BEFORE_MASK, around.half_width)
        self._beside = _cells(around, CELL)
        self._under = _cells(box, CELL / 2)
        self._edge = _border(box.grown(-SHRUNK))
        self._eyes = [_Eye(view, self._beside) for view in views]
        self._views = tuple(views)
        self._ends = {forward: _End(box, views, reach, forward=forward) for forward in (True, False)}
        self._fit()
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self._when = np.full(CELLS * CELLS, -inf)
        self._who = np.zeros(CELLS * CELLS, dtype=np.int64)
        self._pose: Pose | None = None
        self._marked, self._began = -inf, Pose()

    def mark(self, pose: Pose, time: float) -> None:
        """What the robot stands on at a run time [s], and what its scanners see to be free."""
        for view, shape in zip(self._views, self._shapes, strict=True):
            if view.shape != shape:
                self._fit()
        last, self._at = self._pose, pose
        if last is not None:
            stands = abs(pose.x - last.x) + abs(pose.y - last.y) < STEP and abs(pose.heading - last.heading) <= TURN
            if stands and time - self._marked < EVERY:
                return
        else:
            self._began = pose
        self._pose, self._marked = pose, time
        free = [self._beside.take(eye.free(), axis=1) for eye in self._eyes if eye.view.millimetres.size]
        place, who = _numbers(placed_points(pose, np.concatenate([self._under, *free], axis=1)))
        self._when[place], self._who[place] = time, who

    def _fit(self) -> None:
        """Look again at what the scanners look at: one of them measures otherwise than before."""
        self._shapes = [view.shape for view in self._views]
        for end in self._ends.values():
            end.fit()
        self.faced = {forward: end.faced for forward, end in self._ends.items()}
        """Whether scanners look where the robot drives to, forwards (True) and backwards, whatever is masked."""

    def known(self, curvatures: Sequence[float], now: float, *, forward: bool) -> list[float] | None:
        """How far the robot may roll on each arc over ground that was known in the last `MEMORY` [m].

        Where the scanners look, only what their masks hide has to be known. None: they look at all of it.
        """
        assert self._pose is not None
        end = self._ends[forward]
        hidden = end.hidden if end.faced else None
        if end.faced and hidden is None:
            return None
        distances, sign = _DISTANCES if hidden is None else end.distances, 1.0 if forward else -1.0
        at = self._at if hidden is None else Pose()
        rolled = [_rolled(at, curvature, sign * distance) for curvature in curvatures for distance in distances]
        x, y, c, s = np.array(rolled).T[:, :, np.newaxis]
        along, beside = self._edge
        points = np.array([x + c * along - s * beside, y + s * along + c * beside])
        if hidden is None:
            known = self._is_known(points, now)
        else:
            there = placed_points(self._at, points)
            known = ~end.among(hidden, points) | self._is_known(there, now) | self._was_near(there)
        found = []
        for each in known.all(axis=1).reshape(len(curvatures), -1).tolist():
            found.append(inf if all(each) else distances[each.index(False)] - CELL)
        return found

    def _is_known(self, points: Array, now: float) -> NDArray[np.bool_]:
        """Of points in the frame of the odometry."""
        place, who = _numbers(points)
        return np.asarray((self._when[place] >= now - MEMORY) & (self._who[place] == who))

    def _was_near(self, points: Array) -> NDArray[np.bool_]:
        """Of points in the frame of the odometry, shape (2, n, m): nearer to a scanner than it sees as all this began.

        Nobody knows of them, masked or not: the robot drives slowly until they are behind it.
        """
        found = np.zeros(points.shape[1:], np.bool_)
        for eye in self._eyes:
            x, y = points - placed_points(self._began, eye.view.place)[:, :, np.newaxis]
            near = eye.view.least / 1000.0 + 1.5 * CELL
            found |= x * x + y * y < near * near
        return found


_DISTANCES = tuple(CELL * number for number in range(1, round(AHEAD / CELL) + 1))


class _End:
    """One end of the robot: whether the scanners look away from it, and what their masks hide there.

    Cells before the end in the robot's frame, row 0 at the end itself.
    """

    def __init__(self, box: Rectangle, views: Collection[View], reach: float, *, forward: bool) -> None:
        self._views = tuple(views)
        self._heading, self._sign = (0.0, 1.0) if forward else (pi, -1.0)
        self._edge = box.front if forward else box.rear
        self.distances = tuple(CELL * number for number in range(1, ceil(reach / CELL) + 1))
        rows = len(self.distances)
        self._half = ceil((hypot(max(box.front, -box.rear), box.half_width) + reach) / CELL)
        x = self._edge + self._sign * CELL * (np.arange(rows) + 0.5)
        y = CELL * (np.arange(-self._half, self._half) + 0.5)
        self._middles = np.array(np.meshgrid(x, y, indexing="ij"))

    def fit(self) -> None:
        """Look again at what the scanners look at."""
        views = [view for view in self._views if view.shape is not None]
        around = self._heading + np.linspace(-ASIDE, ASIDE, 91)
        seen, hidden = np.zeros(around.shape, np.bool_), np.ones(self._middles.shape[1:], np.bool_)
        for view in views:
            seen |= view.has_beams(around)
            hidden &= ~view.looks_at_all_of(self._middles, CELL)
        self.faced = bool(seen.all())
        self.hidden = hidden if hidden.any() else None
        """The cells that no scanner looks at all of; None: there are none."""

    def among(self, hidden: NDArray[np.bool_], points: Array) -> NDArray[np.bool_]:
        """Which points in the robot's frame lie in such cells."""
        row = np.floor(self._sign * (points[0] - self._edge) / CELL).astype(np.int64)
        column = np.floor(points[1] / CELL).astype(np.int64) + self._half
        rows, columns = hidden.shape
        within = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.asarray(within & hidden[np.where(within, row, 0), np.where(within, column, 0)])


def looks_back(box: Rectangle, views: Collection[View], reach: float) -> bool:
    """Whether scanners look at all of the ground behind the outline, so far [m]: none of it has to be known."""
    end = _End(box, views, reach, forward=False)
    end.fit()
    return end.faced and end.hidden is None


class _Eye:
    """Which of some places a scanner sees to be free."""

    def __init__(self, view: View, places: Array) -> None:
        self.view = view
        bearings, distances = view.directions(places)
        far = 1000.0 * distances
        self._there = np.flatnonzero(far > view.least)
        self._places_there = places.take(self._there, 1)
        self._bearings, self._far = bearings[self._there], far[self._there] + 1000.0 * CELL
        self._shape: tuple[float, float, int] | None = None

    def free(self) -> Indices:
        """Numbers of the places."""
        if self._shape != self.view.shape:
            self._shape = self.view.shape
            beams = self.view.beams_past(self._bearings)
            looked = beams >= 0
            if not self.view.unmasked.all():
                looked &= self.view.looks_at_all_of(self._places_there, CELL)
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
