"""What one laser scanner sees around the robot: its last scan as points, and what left its view."""

from __future__ import annotations

from functools import partial
from math import atan2, cos, degrees, hypot, inf, pi, radians, sin, tau

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import wrap
from artemis.motion.beams import ScanPeriod, seeing
from artemis.motion.movers import Movers
from artemis.motion.poses import placed, seen_from
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
THINNED, FAR = 0.025, 1_000_000
"""Remembered points lie in cells of this width [m], one in each. Farther than anything [mm]."""
NOTED, TURNED = 0.02, radians(1.0)
"""They are noted after so much distance [m] or rotation."""
MOVING_EVERY = 0.05
"""What moves is looked for so often [s]."""
FASTEST_WALK = 2.0
"""Of a person [m/s]."""
FREE_BESIDE, FREE_BEYOND = 2, 100
"""A place was free if so many beams to both sides of it showed something so much farther [mm]."""
BACK = radians(45.0)
"""A scanner whose field of view reaches this far to both sides of straight back looks there."""

Numbers = NDArray[np.int32]
Indices = NDArray[np.int64]
NOTHING: Array = np.zeros((2, 0))


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
        self._scanner, self._box, self._lookahead = scanner, box, lookahead
        self._near = box.grown(NEAR)
        self._movers = Movers()
        self._place = np.array([[scanner.x_m], [scanner.y_m]])
        self.least = round(1000.0 * scanner.least_range_m)
        self._far = round(1000.0 * (reach + FASTEST_WALK * lookahead))
        self.shape: tuple[float, float, int] | None = None
        """Bearing of the first beam, from one to the next [rad], and how many there are; None: no scan has come."""
        self._half = int(reach / THINNED) + 1
        middles = [THINNED * (place + 0.5 - self._half) for place in range(2 * self._half)]
        self._bearings, distances = self.directions(np.array(np.meshgrid(middles, middles, indexing="ij")))
        self._distance_of = 1000.0 * distances
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._time, self._pose, self.millimetres = -inf, Pose(), np.zeros(0, dtype=np.int32)
        self._period = ScanPeriod()
        self._noted = Pose(x=inf)
        self._points, self._kept, self._coming = NOTHING, NOTHING, NOTHING
        self._movers.forget()
        self._moved_at = -inf

    def age(self, now: float) -> float:
        """Of the newest scan [s]; infinite: the scanner is lost, or none has come."""
        age = now - self._time
        return age if age <= self._period.patience else inf

    def around(self) -> list[Array]:
        """Every point that counts."""
        return [points for points in (self._points, self._kept, self._coming) if points.size]

    @property
    def sees_motion(self) -> bool:
        """Whether something moved a short time ago."""
        return self._movers.busy

    @property
    def looks_back(self) -> bool:
        """Whether it sees what is behind the robot."""
        if self.shape is None:
            return False
        start, increment, count = self.shape
        low, high = sorted((start, start + increment * (count - 1)))
        back = wrap(pi - self._scanner.heading)
        return any(low + BACK <= back + turn <= high - BACK for turn in (-tau, 0.0, tau))

    def move(self, pose: Pose, *, replaced: bool) -> None:
        """Carry the points on to where the robot is by its odometry; those of a scan that is replaced need not."""
        before, self._pose = self._pose, pose
        if pose == before:
            return
        moved = seen_from(before, pose)
        if not replaced:
            self._points = _points_from(moved, self._points)
        self._kept, self._coming = _points_from(moved, self._kept), _points_from(moved, self._coming)

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
        if (shape := (scan.start_angle, scan.increment, len(ranges))) != self.shape:
            self._fit(*shape)
        known = self.millimetres.size == ranges.size
        before, self.millimetres = self.millimetres if known else np.zeros_like(ranges), ranges
        self._period.take(scan)
        self._time = scan.time + scan.beam_time * len(ranges)
        near = (ranges >= (1 if creeping else self.least)) & (ranges < self._farthest)
        if not (self._kept.size or self.sees_motion or near.any()):
            self._points = self._coming = NOTHING
            return
        counts = near & _seen_twice(ranges, before)
        if creeping:
            counts = (counts & (ranges >= self.least)) | (near & self._close(ranges))
        beams = counts.nonzero()[0]
        points = self._directions.take(beams, axis=1) * ranges[beams] + self._place
        if speed or turn:
            age = (now - scan.time) - scan.beam_time * beams
            x, y = points
            points = np.array([x + age * (turn * y - speed), y - age * turn * x])
        self._points = points
        self._remember(points, beams)
        if now - self._moved_at >= MOVING_EVERY:
            self._moved_at, pose = now, self._pose
            middle = now - scan.time - scan.beam_time * len(ranges) / 2.0
            seen = placed(pose, Pose(x=-middle * speed, heading=-middle * turn))
            free = partial(self._was_free, seen, ranges)
            coming = self._movers.ahead(placed_points(pose, points), now, self._lookahead, free)
            self._coming = _points_from(pose, coming)

    def _close(self, ranges: Numbers) -> NDArray[np.bool_]:
        """Which beams end so near the outline that they count at once."""
        (x, y), box = self._directions * ranges + self._place, self._near
        return np.asarray((x > box.rear) & (x < box.front) & (y > -box.half_width) & (y < box.half_width))

    def _fit(self, start: float, increment: float, count: int) -> None:
        """Work out the beams' directions."""
        self.shape = start, increment, count
        bearings = [start + increment * beam for beam in range(count)]
        angles = [self._scanner.heading + bearing for bearing in bearings]
        self._directions = np.array([[cos(angle) for angle in angles], [sin(angle) for angle in angles]]) / 1000.0
        low, high = sorted((bearings[0], bearings[-1]))
        self._leaving = np.array([not low + EDGE < bearing < high - EDGE for bearing in bearings])
        beams, inner = self.beams_past(self._bearings), int(EDGE / 4.0 / abs(increment))
        self._beam_of = np.where((beams >= inner) & (beams < count - inner), beams, -1)
        clear = seeing(np.arange(count) * degrees(increment) + degrees(start), self._scanner.mask)
        self._farthest = np.where(clear, self._far, 0)
        self._padded = np.full(count + 2 * BESIDE, FAR, dtype=np.int32)

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
        cells, inside = self._cells(new)
        new, cells = new[:, inside], cells[inside]
        first = np.full(4 * self._half * self._half, -1, dtype=np.int32)
        first[cells[::-1]] = np.arange(len(cells))[::-1]  # where several are, the last one is written: the first point
        first[self._cells(self._kept)[0]] = -1
        self._kept = np.concatenate([self._kept, new[:, first[cells] == np.arange(len(cells))]], axis=1)

    def _cells(self, points: Array) -> tuple[Indices, NDArray[np.bool_]]:
        """A number for the cell of each point, and whether it is one of those around the robot."""
        width = 2 * self._half
        cells = np.floor(points / THINNED).astype(np.int64) + self._half
        column, row = cells.view(np.uint64) < width  # what is negative is huge then
        return cells[0] * width + cells[1], column & row

    def _is_kept(self) -> NDArray[np.bool_]:
        """Which remembered points are near, out of view, and not seen to be gone."""
        cells, inside = self._cells(self._kept)
        beam, distance = self._beam_of.take(cells, mode="clip"), self._distance_of.take(cells, mode="clip")
        in_view = beam >= 0
        if in_view.any():
            gone = (distance >= self.least + LEAVING // 2) | (self._least_beside()[beam] > distance + BEYOND)
            inside &= ~(in_view & gone)
        return inside

    def _least_beside(self) -> Numbers:
        """The least return of each beam and `BESIDE` ones to both sides of it."""
        self._padded[BESIDE:-BESIDE] = self.millimetres
        least, width = self._padded, 1
        while 2 * width <= 2 * BESIDE + 1:
            least, width = np.minimum(least[:-width], least[width:]), 2 * width
        rest = 2 * BESIDE + 1 - width
        return np.minimum(least[:-rest], least[rest:])

    def _was_free(self, pose: Pose, ranges: Numbers, points: Array) -> NDArray[np.bool_]:
        """Where nothing was by a scan seen from a pose: places in the frame of the odometry, where something is now.

        Nearer than the least range it sees nothing, be it free or not.
        """
        bearings, distances = self.directions(_points_from(pose, points))
        beams = self.beams_past(bearings)
        beside = np.clip(beams[:, None] + np.arange(-FREE_BESIDE, FREE_BESIDE + 1), 0, len(ranges) - 1)
        seen = np.where(ranges[beside] == 0, FAR, ranges[beside]).min(axis=1)
        far = 1000.0 * distances
        looked = (beams >= 0) & (self._farthest[beams] > 0) & (far > self.least + FREE_BEYOND)
        return np.asarray(looked & (seen > far + FREE_BEYOND))

    def directions(self, places: Array) -> tuple[Array, Array]:
        """Of places as seen from the scanner: bearings [rad] and distances [m]; both of the shape of one coordinate."""
        shape, (x, y) = places.shape[1:], (places.reshape(2, -1) - self._place).tolist()
        bearings = [wrap(atan2(left, ahead) - self._scanner.heading) for ahead, left in zip(x, y, strict=True)]
        return np.array(bearings).reshape(shape), np.array(list(map(hypot, x, y))).reshape(shape)

    def beams_past(self, bearings: Array) -> Indices:
        """The beams that pass places at these bearings within (-pi, pi]; -1: it does not look there."""
        assert self.shape is not None
        start, increment, count = self.shape
        middle = start + increment * (count - 1) / 2.0
        turned = bearings - wrap(middle)
        turned = np.where(turned > pi, turned - tau, np.where(turned <= -pi, turned + tau, turned))
        beams = np.rint((middle + turned - start) / increment).astype(np.int64)
        return np.where((beams >= 0) & (beams < count), beams, -1)


def placed_points(origin: Pose, points: Array) -> Array:
    """Points that are seen from `origin`, in the frame of `origin` itself; shape (2, n), as of `poses.placed`."""
    c, s = cos(origin.heading), sin(origin.heading)
    return np.array([origin.x + c * points[0] - s * points[1], origin.y + s * points[0] + c * points[1]])


def _points_from(origin: Pose, points: Array) -> Array:
    """Points as seen from `origin`: the inverse."""
    if not points.size:
        return points
    c, s = cos(origin.heading), sin(origin.heading)
    x, y = points[0] - origin.x, points[1] - origin.y
    return np.array([c * x + s * y, c * y - s * x])


def _seen_twice(ranges: Numbers, before: Numbers) -> NDArray[np.bool_]:
    """Which beams show nearly what they, or those beside them, showed in the scan before."""
    found = np.abs(ranges - before) < SAME
    found[1:] |= np.abs(ranges[1:] - before[:-1]) < SAME
    found[:-1] |= np.abs(ranges[:-1] - before[1:]) < SAME
    return np.asarray(found)
