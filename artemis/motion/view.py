"""What one laser scanner sees around the robot: its last scan as points, and what left its view."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import wrap
from artemis.motion.movers import Movers
from artemis.motion.poses import seen_from
from artemis.motion.spline import Array
from artemis.motion.sweep import Rectangle
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Pose

SAME = 150
"""Returns of neighbouring beams in two scans are of the same thing if they differ by less [mm]; what one beam alone
showed once is dust."""
NEAR = 0.3
"""So near the outline [m] every return counts while the robot creeps."""
LEAVING, EDGE = 150, radians(4.0)
"""Returns so little beyond the least range [mm], or so near the edges of the field of view, are remembered."""
BESIDE, BEYOND = 12, 150
"""A remembered point is gone once so many beams to both sides of it show something so much farther [mm]."""
THINNED, FAR = 0.025, 1e6
"""Remembered points lie in cells of this width [m], one in each. Farther than anything [mm]."""
NOTED, TURNED = 0.02, radians(1.0)
"""They are noted after so much distance [m] or rotation."""
MOVING_EVERY = 0.05
"""What moves is looked for so often [s]."""
FASTEST_WALK = 2.0
"""Of a person [m/s]."""
BACK = radians(45.0)
"""A scanner whose field of view reaches this far to both sides of straight back looks there."""

Numbers = NDArray[np.int32]


class View:
    """Keeps points from scan to scan. In the frame of the rear axle, x ahead and y left [m], shape (2, n)."""

    def __init__(self, scanner: Mounting, box: Rectangle, reach: float, lookahead: float) -> None:
        """Begin.

        Args:
            scanner: how it is mounted.
            box: the outline.
            reach: what stands farther from the rear axle says nothing [m].
            lookahead: what moves counts where it will be for so long, too [s].
        """
        self._scanner, self._box, self._reach, self._lookahead = scanner, box, reach, lookahead
        self._movers = Movers()
        self._x, self._y = scanner.x_m, scanner.y_m
        self._heading, self.least = scanner.heading, round(1000.0 * scanner.least_range_m)
        self._shape: tuple[float, float, int] | None = None
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self.time, self._pose, self.millimetres = -inf, Pose(), np.zeros(0, dtype=np.int32)
        self._noted = Pose(x=inf)
        self._points, self._kept, self._coming = np.zeros((2, 0)), np.zeros((2, 0)), np.zeros((2, 0))
        self._movers.forget()
        self._moved_at = -inf

    def around(self) -> Array:
        """Every point that counts."""
        if not (self._kept.size or self._coming.size):
            return self._points
        return np.concatenate([self._points, self._kept, self._coming], axis=1)

    @property
    def looks_back(self) -> bool:
        """Whether it sees what is behind the robot."""
        if self._shape is None:
            return False
        start, increment, count = self._shape
        low, high = sorted((start, start + increment * (count - 1)))
        back = wrap(pi - self._heading)
        return any(low + BACK <= back + turn <= high - BACK for turn in (-2.0 * pi, 0.0, 2.0 * pi))

    def move(self, pose: Pose) -> None:
        """Carry the points on to where the robot is by its odometry."""
        before, self._pose = self._pose, pose
        if pose == before:
            return
        moved = seen_from(before, pose)
        self._points, self._kept = _points_from(moved, self._points), _points_from(moved, self._kept)
        self._coming = _points_from(moved, self._coming)

    def take(self, scan: Scan, now: float, speed: float, turn: float, *, creeping: bool) -> None:
        """Take a new scan.

        Args:
            scan: of this scanner.
            now: run time of the tick, to which the points are carried on [s].
            speed: of the rear axle [m/s].
            turn: of the robot [rad/s].
            creeping: it is so slow that a return nearby counts even if one beam shows it once.
        """
        ranges = scan.millimetres.astype(np.int32)
        if (shape := (scan.start_angle, scan.increment, len(ranges))) != self._shape:
            self._fit(*shape)
        known = self.millimetres.size == ranges.size
        before, self.millimetres = self.millimetres if known else np.zeros_like(ranges), ranges
        self.time = scan.time + scan.beam_time * len(ranges)
        near = (ranges >= (1 if creeping else self.least)) & (ranges < self._farthest)
        beams = np.flatnonzero(near)
        if not beams.size and not self._kept.size and not self._movers.busy:
            self._points = self._coming = np.zeros((2, 0))
            return
        counts = _seen_twice(ranges, before, beams)
        x, y = self._x + ranges[beams] * self._cos[beams], self._y + ranges[beams] * self._sin[beams]
        if creeping:
            box = self._box.grown(NEAR)
            close = (x > box.rear) & (x < box.front) & (y > -box.half_width) & (y < box.half_width)
            counts = close | (counts & (ranges[beams] >= self.least))
        beams, x, y = beams[counts], x[counts], y[counts]
        if speed or turn:
            age = (now - scan.time) - scan.beam_time * beams
            x, y = x + age * (turn * y - speed), y - age * turn * x
        self._points = np.array([x, y])
        self._remember(self._points, beams)
        if now - self._moved_at >= MOVING_EVERY:
            self._moved_at, pose = now, self._pose
            coming = self._movers.ahead(placed_points(pose, self._points), now, self._lookahead)
            self._coming = _points_from(pose, coming)

    def _fit(self, start: float, increment: float, count: int) -> None:
        """Work out the beams' directions."""
        self._shape = start, increment, count
        bearings = [start + increment * beam for beam in range(count)]
        angles = [self._heading + bearing for bearing in bearings]
        self._cos = np.array([cos(angle) for angle in angles]) / 1000.0
        self._sin = np.array([sin(angle) for angle in angles]) / 1000.0
        low, high = sorted((bearings[0], bearings[-1]))
        self._leaving = np.array([not low + EDGE < bearing < high - EDGE for bearing in bearings])
        self._half = int(self._reach / THINNED) + 1
        places = [THINNED * (place + 0.5 - self._half) for place in range(2 * self._half)]
        beams = [[self.beam_past(x, y) for y in places] for x in places]
        inner = int(EDGE / 4.0 / abs(increment))
        out_of_view = [[-1 if it is None or not inner <= it < count - inner else it for it in row] for row in beams]
        self._beam_of = np.array(out_of_view)
        self._distance_of = np.array([[1000.0 * self.distance_to(x, y) for y in places] for x in places])
        far = self._reach + FASTEST_WALK * self._lookahead
        masks = [(radians(first), radians(last)) for first, last in self._scanner.mask]
        masked = [any(a <= bearing <= b for a, b in masks) for bearing in bearings]
        self._farthest = np.array([0 if hidden else round(1000.0 * far) for hidden in masked])

    def _remember(self, points: Array, beams: NDArray[np.intp]) -> None:
        """Drop remembered points that nobody needs any more, add those of the scan that may leave the view."""
        if self._kept.size:
            self._kept = self._kept[:, self._is_kept()]
        pose, last = self._pose, self._noted
        if abs(pose.x - last.x) + abs(pose.y - last.y) < NOTED and abs(pose.heading - last.heading) < TURNED:
            return
        self._noted = pose
        new = points[:, self._leaving[beams] | (self.millimetres[beams] < self.least + LEAVING)]
        if not new.size:
            return
        cells = _cells(new)
        _, first = np.unique(cells, return_index=True)
        first = first[~np.isin(cells[first], _cells(self._kept))]
        self._kept = np.concatenate([self._kept, new[:, first]], axis=1)

    def _is_kept(self) -> NDArray[np.bool_]:
        """Which remembered points are near, out of view, and not seen to be gone."""
        column, row = np.floor(self._kept / THINNED).astype(np.int64) + self._half
        inside = (column >= 0) & (row >= 0) & (column < 2 * self._half) & (row < 2 * self._half)
        beam = np.full(len(column), -1)
        distance = np.full(len(column), FAR)
        beam[inside] = self._beam_of[column[inside], row[inside]]
        distance[inside] = self._distance_of[column[inside], row[inside]]
        window = np.lib.stride_tricks.sliding_window_view(np.pad(self.millimetres, BESIDE, mode="edge"), 2 * BESIDE + 1)
        gone = (distance >= self.least + LEAVING // 2) | (window.min(axis=1)[beam] > distance + BEYOND)
        return np.asarray(inside & ((beam < 0) | ~gone))

    def _bearing(self, ahead: float, left: float) -> float:
        """Of a place seen from the scanner, as it counts [rad], nearest to the middle of its field of view."""
        assert self._shape is not None
        start, increment, count = self._shape
        middle = start + increment * (count - 1) / 2.0
        return middle + wrap(wrap(atan2(left, ahead) - self._heading) - middle)

    def beam_past(self, x: float, y: float) -> int | None:
        """The beam that passes a place; None: it does not look there."""
        assert self._shape is not None
        start, increment, count = self._shape
        beam = round((self._bearing(x - self._x, y - self._y) - start) / increment)
        return beam if 0 <= beam < count else None

    def distance_to(self, x: float, y: float) -> float:
        """Of a place, from the scanner [m]."""
        return hypot(x - self._x, y - self._y)


def placed_points(origin: Pose, points: Array) -> Array:
    """Points that are seen from `origin`, in the frame of `origin` itself; shape (2, n), as of `poses.placed`."""
    c, s = cos(origin.heading), sin(origin.heading)
    return np.array([origin.x + c * points[0] - s * points[1], origin.y + s * points[0] + c * points[1]])


def _cells(points: Array) -> NDArray[np.int64]:
    """A number for the cell of each point."""
    column, row = np.floor(points / THINNED).astype(np.int64)
    return np.asarray(column * 100_003 + row)


def _points_from(origin: Pose, points: Array) -> Array:
    """Points as seen from `origin`: the inverse."""
    if not points.size:
        return points
    c, s = cos(origin.heading), sin(origin.heading)
    x, y = points[0] - origin.x, points[1] - origin.y
    return np.array([c * x + s * y, c * y - s * x])


def _seen_twice(ranges: Numbers, before: Numbers, beams: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of some beams show nearly what they, or those beside them, showed in the scan before."""
    padded = np.concatenate([before[:1], before, before[-1:]])
    beside = padded[beams[:, np.newaxis] + np.arange(3)]
    return np.asarray((np.abs(beside - ranges[beams][:, np.newaxis]) < SAME).any(axis=1))
