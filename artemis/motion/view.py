"""What one laser scanner sees around the robot: its last scan as points, and what left its view."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import wrap
from artemis.motion.movers import Movers
from artemis.motion.spline import Array
from artemis.motion.sweep import Box
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
PASSING, BEYOND = 0.05, 150
"""A remembered point is gone once all beams that pass it so near [m] show something so much farther [mm]."""
THINNED = 0.015
"""Remembered points lie in cells of this width [m], one in each."""
FASTEST_WALK = 2.0
"""Of a person [m/s]."""
BACK = radians(45.0)
"""A scanner whose field of view reaches this far to both sides of straight back looks there."""

Numbers = NDArray[np.int32]


class View:
    """Keeps points from scan to scan. In the frame of the rear axle, x ahead and y left [m], shape (2, n)."""

    def __init__(self, scanner: Mounting, box: Box, reach: float, lookahead: float) -> None:
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
        self._points, self._kept, self._coming = np.zeros((2, 0)), np.zeros((2, 0)), np.zeros((2, 0))
        self._movers.forget()

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
        dx, dy, turn = pose.x - before.x, pose.y - before.y, pose.heading - before.heading
        c, s = cos(before.heading), sin(before.heading)
        ahead, left = c * dx + s * dy, c * dy - s * dx
        c, s = cos(turn), sin(turn)
        self._points, self._kept = _moved(self._points, ahead, left, c, s), _moved(self._kept, ahead, left, c, s)
        self._coming = _moved(self._coming, ahead, left, c, s)

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
            self.millimetres = np.zeros_like(ranges)
        ranges[self._masked] = 0
        counts = (ranges >= self.least) & _seen_twice(ranges, self.millimetres)
        x, y = self._x + ranges * self._cos, self._y + ranges * self._sin
        far = self._reach + FASTEST_WALK * self._lookahead
        near = x * x + y * y < far * far
        if creeping:
            box = self._box.grown(NEAR)
            close = (x > box.rear) & (x < box.front) & (y > -box.half_width) & (y < box.half_width)
            counts |= close & (ranges > 0)
        self.millimetres, self.time = ranges, scan.time + scan.beam_time * len(ranges)
        taken = np.flatnonzero(counts & near)
        x, y, age = x[taken], y[taken], now - scan.time - scan.beam_time * taken
        points = np.array([x + age * (turn * y - speed), y - age * turn * x])
        self._remember(points, self._leaving[taken] | (ranges[taken] < self.least + LEAVING))
        self._points, pose = points, self._pose
        c, s = cos(pose.heading), sin(pose.heading)
        there = np.array([pose.x + c * points[0] - s * points[1], pose.y + s * points[0] + c * points[1]])
        coming = self._movers.ahead(there, now, self._lookahead)
        self._coming = _moved(coming - np.array([[pose.x], [pose.y]]), 0.0, 0.0, c, s)

    def _fit(self, start: float, increment: float, count: int) -> None:
        """Work out the beams' directions."""
        self._shape = start, increment, count
        bearings = [start + increment * beam for beam in range(count)]
        angles = [self._heading + bearing for bearing in bearings]
        self._cos = np.array([cos(angle) for angle in angles]) / 1000.0
        self._sin = np.array([sin(angle) for angle in angles]) / 1000.0
        low, high = sorted((bearings[0], bearings[-1]))
        self._leaving = np.array([not low + EDGE < bearing < high - EDGE for bearing in bearings])
        masks = [(radians(first), radians(last)) for first, last in self._scanner.mask]
        self._masked = np.array([any(a <= bearing <= b for a, b in masks) for bearing in bearings], dtype=bool)

    def _remember(self, points: Array, leaving: NDArray[np.bool_]) -> None:
        """Add those that may leave the view, drop those that nobody needs any more."""
        if self._kept.size:
            self._kept = self._kept[:, [self._is_kept(x, y) for x, y in self._kept.T.tolist()]]
        if not leaving.any():
            return
        cells = {(round(x / THINNED), round(y / THINNED)) for x, y in self._kept.T.tolist()}
        new = []
        for x, y in points[:, leaving].T.tolist():
            if (cell := (round(x / THINNED), round(y / THINNED))) not in cells:
                cells.add(cell)
                new.append((x, y))
        if new:
            self._kept = np.concatenate([self._kept, np.array(new).T], axis=1)

    def _is_kept(self, x: float, y: float) -> bool:
        """Whether a remembered point is near, out of view, and not seen to be gone."""
        if x * x + y * y >= self._reach * self._reach:
            return False
        assert self._shape is not None
        start, increment, count = self._shape
        ahead, left = x - self._x, y - self._y
        distance = hypot(ahead, left)
        bearing = self._bearing(ahead, left)
        beam = round((bearing - start) / increment)
        inner = EDGE / 4.0 / abs(increment)
        if not inner <= beam < count - inner:
            return True
        if 1000.0 * distance >= self.least + LEAVING / 2:
            return False
        beside = int(PASSING / max(distance, PASSING) / abs(increment)) + 1
        passing = self.millimetres[max(beam - beside, 0) : beam + beside + 1]
        return bool(passing.min() < 1000.0 * distance + BEYOND)

    def _bearing(self, ahead: float, left: float) -> float:
        """Of a place seen from the scanner, as it counts [rad], nearest to the middle of its field of view."""
        assert self._shape is not None
        start, increment, count = self._shape
        middle = start + increment * (count - 1) / 2.0
        bearing = wrap(atan2(left, ahead) - self._heading)
        return middle + wrap(bearing - middle)

    def beam_past(self, x: float, y: float) -> int | None:
        """The beam that passes a place; None: it does not look there."""
        assert self._shape is not None
        start, increment, count = self._shape
        beam = round((self._bearing(x - self._x, y - self._y) - start) / increment)
        return beam if 0 <= beam < count else None

    def distance_to(self, x: float, y: float) -> float:
        """Of a place, from the scanner [m]."""
        return hypot(x - self._x, y - self._y)


def _moved(points: Array, ahead: float, left: float, c: float, s: float) -> Array:
    """Points seen from a robot that moved, and turned by an angle with cosine `c` and sine `s`."""
    if not points.size:
        return points
    x, y = points[0] - ahead, points[1] - left
    return np.array([c * x + s * y, c * y - s * x])


def _seen_twice(ranges: Numbers, before: Numbers) -> NDArray[np.bool_]:
    """Which beams show nearly what they, or their neighbours, showed in the scan before."""
    same: NDArray[np.bool_] = np.abs(ranges - before) < SAME
    same[1:] |= np.abs(ranges[1:] - before[:-1]) < SAME
    same[:-1] |= np.abs(ranges[:-1] - before[1:]) < SAME
    return same
