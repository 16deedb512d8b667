"""What one laser scanner sees around the robot: its last scan as points, and what left its view."""

from __future__ import annotations

from collections import deque
from functools import partial
from math import atan2, ceil, cos, degrees, hypot, inf, pi, radians, sin, tau

import numpy as np
from numpy.typing import NDArray

from artemis.motion.angles import wrap
from artemis.motion.approaches import Approaches, NotedScan
from artemis.motion.arrays import Array, Indices
from artemis.motion.beams import FEW, ScanPeriod, least_beside, least_within, seeing, seen_twice, widened
from artemis.motion.held import Held
from artemis.motion.movers import NOTHING, Movers
from artemis.motion.points import placed_points, points_from
from artemis.motion.poses import placed, seen_from
from artemis.motion.surfaces import beyond_edges
from artemis.motion.sweep import Rectangle
from artemis.mounting import Mounting
from artemis.scan import USUAL, Scan
from artemis.values import Pose

NEAR = 0.3
"""So near the outline [m] every return counts while the robot creeps."""
LEAVING, EDGE = 150, radians(4.0)
"""Returns so little beyond the least range [mm], or so near the edges of the field of view, are remembered."""
BESIDE, BEYOND = 12, 150
"""A remembered point is gone once so many beams to both sides of it show something so much farther [mm]; see
`least_beside`."""
THINNED: Array = np.array(0.025)
"""Remembered points lie in cells of this width [m], one in each."""
RECENT = 2
"""A return is compared with the scan before and, where its beam returned nothing then, with so many before that."""
FAR = 1_000_000.0
"""Farther than anything [mm]."""
NOTED, TURNED = 0.02, radians(1.0)
"""They are noted after so much distance [m] or rotation."""
UP_TO = 0.02
"""What has come nearer than the least range may stand as near to the outline as its margin, and this [m]: nearer, and
beside it, it would keep the robot from moving at all."""
SORTED_EVERY = 0.05
"""What moves is looked for, and what need not be remembered any more, so often [s]."""
FASTEST_WALK = 2.0
"""Of a person [m/s]."""
FREE_BESIDE, FREE_BEYOND = 2, 100
"""A place was free if so many beams to both sides of it showed something so much farther [mm]."""


class View:
    """Keeps points from scan to scan. In the frame of the rear axle, x ahead and y left [m], shape (2, n)."""

    def __init__(
        self, scanner: Mounting, box: Rectangle, reach: float, lookahead: float, margin: float = USUAL.margin
    ) -> None:
        """Begin.

        Args:
            scanner: how it is mounted.
            box: the outline.
            reach: what stands farther from the rear axle says nothing [m].
            lookahead: what moves counts where it will be for so long, too [s].
            margin: by which the outline is enlarged at most [m].
        """
        self._scanner, self._box, self._lookahead = scanner, box, lookahead
        self._near = box.grown(NEAR)
        self._movers, self._held = Movers(), Held()
        self._close = box.grown(margin + UP_TO)
        self._x, self._y = np.array(float(scanner.x_m)), np.array(float(scanner.y_m))
        self.place: Array = np.array([[scanner.x_m], [scanner.y_m]])
        """Of the scanner [m]."""
        self.least = round(1000.0 * scanner.least_range_m)
        self._least: Array = np.array(float(self.least))
        self._approaches = Approaches(float(self.least), self.place, self._was_clear, self._hiding)
        self._far = round(1000.0 * (reach + FASTEST_WALK * lookahead))
        self.shape: tuple[float, float, int] | None = None
        """Bearing of the first beam, from one to the next [rad], and how many there are; None: no scan has come."""
        self.unmasked = np.zeros(0, dtype=np.bool_)
        """The beams that nothing of the robot is in the way of."""
        half = int(reach / THINNED) + 1
        middles = [THINNED * (place + 0.5) for place in range(-half - 1, half + 1)]
        self._bearings, distances = self.directions(np.array(np.meshgrid(middles, middles, indexing="ij")))
        self._distance_of = 1000.0 * distances
        self._around = np.zeros(distances.shape, dtype=np.bool_)
        self._around[1:-1, 1:-1] = True
        self._middle: Indices = np.array(half + 1)
        self._first = np.zeros(distances.size, dtype=np.int64)
        self._beam_time = 0.0
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self._time, self._pose, self._points_at = -inf, Pose(), Pose()
        self._begin(0)
        self._period = ScanPeriod()
        self._noted, self._continued = Pose(x=inf), False
        self._points, self._kept, self._coming = NOTHING, NOTHING, NOTHING
        self._held.forget()
        self._sorted_at = -inf

    def _begin(self, beams: int) -> None:
        """Compare with no scan before: none has come, or it had other beams."""
        self.millimetres, self._twice = np.zeros(beams), np.zeros(beams, np.bool_)
        self._beams, self._empty = np.zeros(0, np.intp), np.zeros(0, np.intp)
        self._recent: deque[Array] = deque(maxlen=RECENT)
        self._approaches.forget()
        self._movers.forget()

    def age(self, now: float) -> float:
        """Of the newest scan [s]; infinite: the scanner is lost, or none has come."""
        age = now - self._time
        return age if age <= self._period.patience else inf

    def around(self) -> tuple[Array, Array, Array, Array]:
        """Every point that counts: seen by the newest scan, held, remembered, and where something will be."""
        return self._points, self._held.points, self._kept, self._coming

    @property
    def sees_motion(self) -> bool:
        """Whether something moved a short time ago."""
        return self._movers.busy

    @property
    def has_mask(self) -> bool:
        """Whether it sees the robot itself somewhere."""
        return bool(self._scanner.mask)

    def has_beams(self, bearings: Array) -> NDArray[np.bool_]:
        """In which directions in the robot's frame [rad] its beams go, whether they are masked or not."""
        turned = np.array([wrap(bearing - self._scanner.heading) for bearing in bearings.tolist()])
        return self.beams_past(turned) >= 0

    def looks_at_all_of(self, middles: Array, width: float) -> NDArray[np.bool_]:
        """Which squares it looks at, whether something stands there or not: all beams that pass them, unmasked.

        Args:
            middles: x and y in the robot's frame [m], shape (2, ...).
            width: of each square, along the axes of that frame [m].
        """
        half = width / 2.0
        offsets = np.array([[half, half, -half, -half], [half, -half, half, -half]]).reshape(
            2, 4, *[1] * (middles.ndim - 1)
        )
        beams = self.beams_past(self.directions(middles[:, np.newaxis] + offsets)[0])
        first, last = beams.min(axis=0), beams.max(axis=0)
        masked = np.concatenate(([0], np.cumsum(~self.unmasked)))
        return np.asarray((first >= 0) & (masked[last + 1] == masked[np.maximum(first, 0)]))

    def move(self, pose: Pose, *, replaced: bool) -> None:
        """Carry the points on to where the robot is by its odometry; those of a scan that is replaced need not."""
        before, self._pose = self._pose, pose
        if pose == before:
            return
        moved = seen_from(before, pose)
        if not replaced:
            self._points, self._points_at = points_from(moved, self._points), pose
        self._kept, self._coming = points_from(moved, self._kept), points_from(moved, self._coming)
        if self._held.points.size:
            self._held.move(moved)

    def take(self, scan: Scan, now: float, speed: float, turn: float, *, creeping: bool) -> None:
        """Take a new scan.

        Args:
            scan: of this scanner.
            now: run time of the tick, to which the points are carried on [s].
            speed: of the rear axle [m/s].
            turn: of the robot [rad/s].
            creeping: it is so slow that a return nearby counts even if one beam shows it once.
        """
        ranges = scan.millimetres.astype(np.float64)
        if (shape := (scan.start_angle, scan.increment, len(ranges))) != self.shape:
            self._fit(*shape)
            self._begin(len(ranges))
        elif self.millimetres.size != ranges.size:
            self._begin(len(ranges))
        before, self.millimetres, known = self.millimetres, ranges, bool(self._recent)
        self._period.take(scan)
        self._time = scan.time + scan.beam_time * len(ranges)
        near = (ranges > 0.0) & (ranges < self._farthest)
        seen = NotedScan(ranges, self.unmasked & (ranges >= self._least), self._pose, scan.time)
        self._look_for_approaches(seen, slow=creeping)
        twice = seen_twice(near, ranges, self._returned(before) if self._empty.size else before)
        self._recent.appendleft(before)
        self._empty = (ranges == 0.0).nonzero()[0]
        if self._empty.size or self._held.points.size:
            self._hold(twice, now)
        self._twice = twice
        if not (self._kept.size or self._held.points.size or self.sees_motion or near.any()):
            self._points, self._beams, self._coming = NOTHING, self._empty[:0], NOTHING
            return
        points = self._seen(ranges, now - scan.time, scan.beam_time, speed, turn)
        counts = twice if known else near
        if creeping:
            counts = counts | near & self._is_close(ranges)
        self._beams = beams = counts.nonzero()[0]
        if len(beams) < len(ranges):
            points = points.take(beams, 1)
        self._points, self._points_at = points, self._pose
        if known and not self._continued:
            self._continued = True
            self._continue_surfaces(seen_twice(seen.shown, ranges, before))
        if now - self._sorted_at >= SORTED_EVERY:
            self._sorted_at = now
            self._forget_some()
            self._find_moving(scan, now, speed, turn)
        self._remember(points, beams)

    def _hold(self, twice: NDArray[np.bool_], now: float) -> None:
        """Hold what was seen twice in the scan before and is lost now."""
        lost = (self._twice.take(self._beams) & (self.millimetres.take(self._beams) == 0.0)).nonzero()[0]
        if lost.size:
            moved = seen_from(self._points_at, self._pose)
            self._held.add(points_from(moved, self._points.take(lost, 1)), now)
        if self._held.points.size:
            beams, looks, far = self._looks_at(self._held.points)
            there, beside = self.millimetres.take(beams) * looks, least_within(self.millimetres, FEW).take(beams)
            self._held.judge(there, far, twice.take(beams), beside * looks, now)

    def _looks_at(self, points: Array) -> tuple[Indices, NDArray[np.bool_], Array]:
        """The beams past points, whether there are any that are not masked, and how far away the points are [mm]."""
        bearings, distances = self.directions(points)
        beams = self.beams_past(bearings)
        return beams, (beams >= 0) & self.unmasked.take(beams), 1000.0 * distances

    def _returned(self, before: Array) -> Array:
        """Of each beam in the scan before, or in the newest of the last ones before it that shows any [mm]."""
        for older in self._recent:
            before = np.where(before, before, older)
        return before

    def _find_moving(self, scan: Scan, now: float, speed: float, turn: float) -> None:
        """Look where what moves will be, by the newest scan."""
        pose, ranges = self._pose, self.millimetres
        middle = now - scan.time - scan.beam_time * len(ranges) / 2.0
        seen = placed(pose, Pose(x=-middle * speed, heading=-middle * turn))
        free = partial(self._was_free, seen, ranges)
        coming = self._movers.ahead(placed_points(pose, self._points), now, self._lookahead, free)
        self._coming = points_from(pose, coming)

    def _seen(self, ranges: Array, age: float, beam_time: float, speed: float, turn: float) -> Array:
        """Where all beams end [m], of a scan whose first beam is so old [s], by how the robot moves."""
        points = self._directions * ranges
        x, y = points[0], points[1]
        x += self._x
        y += self._y
        if speed or turn:
            if beam_time != self._beam_time:
                self._beam_time, self._delays = beam_time, beam_time * self._numbers
            ages = age - self._delays
            aside = ages * turn
            aside *= x
            ages *= turn * y - speed
            x += ages
            y -= aside
        return points

    def _is_close(self, ranges: Array) -> NDArray[np.bool_]:
        """Which beams end so near the outline that they count at once."""
        return self._near.holds(self._seen(ranges, 0.0, 0.0, 0.0, 0.0))

    def _fit(self, start: float, increment: float, count: int) -> None:
        """Work out the beams' directions."""
        self.shape = start, increment, count
        bearings = [start + increment * beam for beam in range(count)]
        angles = [self._scanner.heading + bearing for bearing in bearings]
        self._directions = np.array([[cos(angle) for angle in angles], [sin(angle) for angle in angles]]) / 1000.0
        self._numbers = np.arange(float(count))
        self._delays = self._beam_time * self._numbers
        low, high = sorted((bearings[0], bearings[-1]))
        leaving = float(self.least + LEAVING)
        self.unmasked = seeing(np.arange(count) * degrees(increment) + degrees(start), self._scanner.mask)
        beside_mask = widened(~self.unmasked, ceil(EDGE / abs(increment)))
        self._leaving = np.array([leaving if low + EDGE < each < high - EDGE else inf for each in bearings])
        self._leaving[beside_mask] = inf
        beams, inner = self.beams_past(self._bearings), int(EDGE / 4.0 / abs(increment))
        in_view = (beams >= inner) & (beams < count - inner) & ~widened(~self.unmasked, inner)[beams]
        self._beam_of = np.where(in_view, beams, 0)
        gone = ~self._around | in_view & (self._distance_of >= self.least + LEAVING // 2)
        self._hides = np.where(gone, -1.0, np.where(in_view, self._distance_of + BEYOND, inf))
        self._farthest = np.where(self.unmasked, float(self._far), 0.0)

    def _continue_surfaces(self, shown: NDArray[np.bool_]) -> None:
        """A surface that goes out of sight because it is too near goes on straight, as long as no beam would show it.

        Asked once, of what stood there when nothing had been seen yet: later it is remembered.
        """
        ranges = np.where(shown, self.millimetres, 0.0)
        ends = self._seen(ranges, 0.0, 0.0, 0.0, 0.0)
        for line in beyond_edges(ends, ranges, self.least + LEAVING, float(THINNED)):
            beams, looks, far = self._looks_at(line)
            seen = (far >= self.least + LEAVING) | (ranges[beams] > far + BEYOND)  # it, or what lies beyond it
            past = (looks & seen | self._box.holds(line)).nonzero()[0]
            self._kept = np.concatenate((self._kept, line[:, : past[0] if past.size else None]), 1)

    def _look_for_approaches(self, seen: NotedScan, *, slow: bool) -> None:
        """Remember what has come too near to be seen, wherever it may stand now."""
        assert self.shape is not None
        came = self._approaches.take(seen, self.shape[1], slow=slow).nonzero()[0]
        if came.size:
            steps = np.arange(0.0, float(self.least), 1000.0 * float(THINNED))
            places = (self._directions[:, came, np.newaxis] * steps).reshape(2, -1) + self.place
            self._keep(places.take((~self._close.holds(places)).nonzero()[0], 1))

    def _hiding(self) -> NDArray[np.bool_]:
        """The beams towards what is remembered nearer than the least range."""
        found = np.zeros(self.millimetres.size, np.bool_)
        if self._kept.size:
            cells = self._cells(self._kept)
            farthest = self._hides.take(cells)
            found[self._beam_of.take(cells)[(farthest >= 0.0) & (farthest < inf)]] = True
        return found

    def _remember(self, points: Array, beams: NDArray[np.intp]) -> None:
        """Add those points of the scan that may leave the view."""
        pose, last = self._pose, self._noted
        if abs(pose.x - last.x) + abs(pose.y - last.y) < NOTED and abs(pose.heading - last.heading) < TURNED:
            return
        self._noted = pose
        leaves = self.millimetres < self._leaving
        self._keep(points.take(leaves.take(beams).nonzero()[0][::-1], 1))
        if self._held.points.size:
            past, looks, far = self._looks_at(self._held.points)
            self._keep(self._held.points.take((~looks | (far < self._leaving.take(past))).nonzero()[0], 1))

    def _keep(self, new: Array) -> None:
        """Remember points, in each cell one."""
        if not new.size:
            return
        points = np.concatenate((new, self._kept), 1)
        cells, order = self._cells(points), np.arange(points.shape[1])
        self._first[cells] = order  # where several are, the last one is written, which is the oldest
        stays = (self._first.take(cells) == order) & self._around.take(cells)
        stays[new.shape[1] :] = True
        self._kept = points.take(stays.nonzero()[0], 1)

    def _cells(self, points: Array) -> Indices:
        """A number for the cell of each point; all that are not around the robot are in the cells at the edge."""
        column, row = np.floor(points / THINNED).astype(np.int64) + self._middle
        cells: Indices = np.ravel_multi_index((column, row), self._around.shape, mode="clip")
        return cells

    def _forget_some(self) -> None:
        """Drop remembered points that are far, in view, or seen to be gone.

        `_hides` says of a cell how far the beams past it may see if something still stands there [mm]; negative: what
        stands there is seen itself, or far; infinite: no beam passes it.
        """
        if not self._kept.size:
            return
        cells = self._cells(self._kept)
        farthest = self._hides.take(cells)
        kept = farthest >= 0.0
        if (farthest < inf).nonzero()[0].size:
            kept &= least_beside(self.millimetres, BESIDE).take(self._beam_of.take(cells)) <= farthest
        self._kept = self._kept.take(kept.nonzero()[0], 1)

    def _was_clear(self, before: NotedScan, beams: Indices, ranges: Array, places: Array) -> NDArray[np.bool_]:
        """Whether nothing was by a scan where beams of these ranges [mm] ended with the scanner at these places."""
        there = placed_points(Pose(heading=self._pose.heading), self._directions[:, beams] * ranges) + places
        return self._was_free(before.pose, before.ranges, there, before.shown)

    def _was_free(
        self, pose: Pose, ranges: Array, points: Array, shown: NDArray[np.bool_] | None = None
    ) -> NDArray[np.bool_]:
        """Where nothing was by a scan seen from a pose: places in the frame of the odometry, where something is now.

        Nearer than the least range, and `FREE_BEYOND`, it sees nothing, be it free or not; between the two only beams
        say so that are `shown` to end farther away.
        """
        beams, looks, far = self._looks_at(points_from(pose, points))
        beside = np.clip(beams[:, None] + np.arange(-FREE_BESIDE, FREE_BESIDE + 1), 0, len(ranges) - 1)
        seen, beyond = ranges[beside], far > self.least + FREE_BEYOND
        seen = np.where(seen == 0, FAR, seen)
        if shown is not None:
            seen, beyond = np.where(beyond[:, None] | shown[beside], seen, 0.0), far > self.least
        return np.asarray(looks & beyond & (seen.min(axis=1) > far + FREE_BEYOND))

    def directions(self, places: Array) -> tuple[Array, Array]:
        """Of places as seen from the scanner: bearings [rad] and distances [m]; both of the shape of one coordinate."""
        shape, (x, y) = places.shape[1:], (places.reshape(2, -1) - np.array([[self._x], [self._y]])).tolist()
        bearings = _turned(np.array(list(map(atan2, y, x))), self._scanner.heading)
        return bearings.reshape(shape), np.array(list(map(hypot, x, y))).reshape(shape)

    def beams_past(self, bearings: Array) -> Indices:
        """The beams that pass places at these bearings within (-pi, pi]; -1: it does not look there."""
        assert self.shape is not None
        start, increment, count = self.shape
        middle = start + increment * (count - 1) / 2.0
        beams = np.rint((middle + _turned(bearings, wrap(middle)) - start) / increment).astype(np.int64)
        return np.where((beams >= 0) & (beams < count), beams, -1)


def _turned(bearings: Array, by: float) -> Array:
    """Bearings from another direction; all of it within (-pi, pi] [rad]."""
    turned = bearings - by
    return np.where(turned > pi, turned - tau, np.where(turned <= -pi, turned + tau, turned))
