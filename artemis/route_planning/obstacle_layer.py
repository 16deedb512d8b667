"""What stands on a floor beside what its map shows, by the scans of the last minute."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from math import cos, sin

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from artemis.motion.angles import wrap
from artemis.motion.beams import seeing
from artemis.motion.ground import AROUND, STEP, TURN, looks_back
from artemis.motion.points import placed_points
from artemis.motion.poses import placed
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View
from artemis.mounting import Mounting
from artemis.route_planning.floor import CELL, Array, Cells, Field, Floor
from artemis.scan import Scan
from artemis.values import Pose, Snapshot
from artemis.vehicle import RobotFile

EVERY = 0.5
"""A scan is kept so often [s]."""
STANDS, GAP = 2.0, 1.6
"""What was seen in a cell for so long, never missed for longer than the second, stands there [s]."""
KEPT = 60.0
"""It counts for so long [s]."""
RANGE = 4.0
"""Farther away nothing counts [m]."""
NEW = 0.10
"""What is seen nearer to what the map shows than this is that [m]."""
THROUGH = 0.15
"""A beam that reaches so much farther than a cell has seen through it [m]."""
KNOWN = 30.0
"""What was seen or driven over is known for so long [s]: half as long as the obstacle stop has it, for the robot has
to get there first."""
BETWEEN, BENT = 0.10, 0.25
"""A beam that measures so much more than the one beside it, and so much less than the one on its other side, has met
two things, and shows where nothing is [m]; unless it continues a wall: then the inverse distances of three beams rise
evenly, but for this share."""
BEHIND = 1.0
"""Ground behind the outline is reversed over without knowing it if the scanners look at all of it, so far [m]."""
FINE = 0.035
"""Ground is looked at so often [m]: several times in a cell, however it is turned."""
_BESIDE = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]


class PlacedScan(Struct, frozen=True):
    """A scan, and where the robot was when it came, and how it moved."""

    time: float
    """Run time [s]."""
    pose: Pose
    """In the frame of the map."""
    scan: Scan
    speed: float = 0.0
    """Of the rear axle [m/s]."""
    turn: float = 0.0
    """Of the robot [rad/s]."""

    @property
    def ages(self) -> Array:
        """How long before that each beam was measured [s]."""
        numbers = np.arange(float(len(self.scan.ranges) // 2))
        return np.asarray(self.time - self.scan.time - self.scan.beam_time * numbers)

    @property
    def middle(self) -> Pose:
        """Where the robot was in the middle of the scan."""
        age = float(self.ages.mean())
        return placed(self.pose, Pose(x=-self.speed * age, heading=-self.turn * age))


def placed_scan(snapshot: Snapshot, scan: Scan, wheelbase: float) -> PlacedScan:
    """A scan that came with a tick; the distance between the axles says how the robot turns [m]."""
    odometry, pose = snapshot.odometry, snapshot.pose.pose
    speed, turn = odometry.speed * cos(odometry.steering), odometry.speed * sin(odometry.steering) / wheelbase
    return PlacedScan(snapshot.time, pose, scan, speed, turn)


def standing(
    placed_scans: Sequence[PlacedScan], scanners: Mapping[str, Mounting], floor: Floor, clear: Field
) -> NDArray[np.int64]:
    """Rows and columns of the cells of a floor in which something stands that its map does not show, shape (2, n).

    A return counts for the cells beside its own, too: returns and poses vary. What a scanner's last scan sees through
    does not stand there any more.

    Args:
        placed_scans: the oldest first.
        scanners: by name.
        floor: in the frame of the map.
        clear: as of `clearance`, of what the floor's map shows.
    """
    if not placed_scans:
        return np.empty((2, 0), np.int64)
    columns = floor.occupied.shape[1]
    met, times = [], []
    for each in placed_scans:
        row, column = floor.cells_of(placed_returns(each, scanners[each.scan.source]))
        cells = np.unique(row * columns + column)
        met.append(cells)
        times.append(np.full(len(cells), each.time))
    found, time = np.concatenate(met), np.concatenate(times)
    around = np.concatenate([found + row * columns + column for row, column in _BESIDE])
    stood = _lasting(around, np.tile(time, len(_BESIDE)))
    cells = np.intersect1d(found, stood)
    row, column = cells // columns, cells % columns
    new = clear[row, column] > NEW
    for last in {each.scan.source: each for each in placed_scans}.values():
        new &= ~_seen_through(row, column, last, scanners[last.scan.source], floor)
    return np.array([row[new], column[new]])


def known_ground(placed_scans: Sequence[PlacedScan], robot: RobotFile, floor: Floor) -> Cells:
    """The cells over which the robot may drive backwards where no scanner looks, as `artemis.motion.ground` knows them.

    Those that it drove over, or saw to be free from nearby, in the last `KNOWN`.
    """
    outline, known = robot.outline, np.zeros(floor.occupied.shape, np.bool_)
    assert outline is not None
    x = np.arange(-outline.rear_m - AROUND, outline.front_m + AROUND, FINE)
    y = np.arange(-outline.half_width_m - AROUND, outline.half_width_m + AROUND, FINE)
    places = np.array(np.meshgrid(x, y)).reshape(2, -1)
    under = (
        (places[0] >= -outline.rear_m) & (places[0] <= outline.front_m) & (np.abs(places[1]) <= outline.half_width_m)
    )
    eyes = {name: _Directions(places, mounting) for name, mounting in robot.scanners.items()}
    used: dict[str, PlacedScan] = {}
    for each in reversed(placed_scans):
        if placed_scans[-1].time - each.time > KNOWN:
            break
        later = used.get(each.scan.source)
        if later is not None and _is_there(each.pose, later.pose):
            continue
        used[each.scan.source] = each
        free = places[:, under | eyes[each.scan.source].seen_free(each.scan)]
        row, column = floor.cells_of(placed_points(each.middle, free).T)
        known[row, column] = True
    return known


def _is_there(pose: Pose, other: Pose) -> bool:
    """Whether two poses are all but the same."""
    return math.hypot(pose.x - other.x, pose.y - other.y) < STEP and abs(wrap(pose.heading - other.heading)) < TURN


class _Directions:
    """Places in the robot's frame as one scanner sees them."""

    def __init__(self, places: Array, mounting: Mounting) -> None:
        dx, dy = places[0] - mounting.x_m, places[1] - mounting.y_m
        self._mask, self._bearing = mounting.mask, np.arctan2(dy, dx) - mounting.heading
        self._distance, self._least = np.hypot(dx, dy), mounting.least_range_m

    def seen_free(self, scan: Scan) -> NDArray[np.bool_]:
        """Which of them the beam that passes them sees to be free."""
        reached = _reached(scan, self._mask, self._bearing)
        return np.asarray((self._distance > self._least) & (reached > self._distance + CELL))


def _reached(scan: Scan, mask: Sequence[tuple[float, float]], bearings: Array) -> Array:
    """What the beams in some directions in the scanner's frame [rad] measured [m]; 0: nothing, -1: there is no beam."""
    turned = bearings - scan.start_angle
    step = abs(scan.increment)
    beams = np.rint((turned if scan.increment > 0.0 else -turned) % math.tau / step).astype(np.int64)
    beams %= round(math.tau / step)  # just before the first one is the first one
    ranges = scan.millimetres / 1000.0
    ranges[~seeing(np.degrees(scan.start_angle + scan.increment * np.arange(len(ranges))), mask)] = -1.0
    within = beams < len(ranges)
    return np.where(within, ranges[np.where(within, beams, 0)], -1.0)


def sees_behind(placed_scans: Sequence[PlacedScan], robot: RobotFile) -> bool:
    """Whether the robot's scanners look at all of the ground behind it, whatever they measure there."""
    outline, newest = robot.outline, {each.scan.source: each.scan for each in placed_scans}
    assert outline is not None
    straight_back = [
        _reached(scan, (), np.array([math.pi - robot.scanners[name].heading])) for name, scan in newest.items()
    ]
    if not any([reached[0] >= 0.0 for reached in straight_back]):
        return False  # as of most robots: this is asked before each plan
    box = Rectangle(-outline.rear_m, outline.front_m, outline.half_width_m)
    views = {name: View(mounting, box, BEHIND, 0.0) for name, mounting in robot.scanners.items()}
    for name, scan in newest.items():
        views[name].take(scan, scan.time, 0.0, 0.0, creeping=False)
    return looks_back(box, views.values(), BEHIND)


def _seen_through(
    row: NDArray[np.int64], column: NDArray[np.int64], last: PlacedScan, mounting: Mounting, floor: Floor
) -> NDArray[np.bool_]:
    """Of each cell whether its beam reaches beyond it; a beam without a return shows nothing."""
    scanner = placed(last.middle, Pose(x=mounting.x_m, y=mounting.y_m, heading=mounting.heading))
    x, y, heading = floor.local(scanner)
    dx, dy = (column + 0.5) * CELL - x, (row + 0.5) * CELL - y
    reached = _reached(last.scan, mounting.mask, np.arctan2(dy, dx) - heading)
    return np.asarray(reached > np.hypot(dx, dy) + THROUGH)


def _lasting(cells: NDArray[np.int64], times: Array) -> NDArray[np.int64]:
    """Cells that were seen for `STANDS`, without a gap."""
    if not len(cells):
        return cells
    order = np.lexsort((times, cells))
    cells, times = cells[order], times[order]
    begins = np.ones(len(cells), bool)
    begins[1:] = (cells[1:] != cells[:-1]) | (times[1:] - times[:-1] > GAP)
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(cells)) - 1
    return np.unique(cells[first[times[last] - times[first] >= STANDS]])


def _between(ranges: Array) -> NDArray[np.bool_]:
    """Which distances [m] lie between those of their neighbours; NaN: unknown, so nothing is known beside it either.

    They are mixed pixels: J. Tuley, N. Vandapel and M. Hebert, Analysis and removal of artifacts in 3-D ladar data,
    ICRA 2005, pp. 2203-2210. The distances of a wall that is seen at a grazing angle rise as fast, but the inverse ones
    rise evenly: at a distance d the wall is at d / cos(bearing). A thin pole that is seen in one beam only, right
    beside something nearer, is not told from them until the robot sees it from elsewhere.
    """
    steps, rise = np.diff(ranges, prepend=np.nan, append=np.nan), np.diff(1.0 / ranges, prepend=np.nan)
    before, after = steps[:-1], steps[1:]
    rise_before = np.concatenate([[np.nan], rise[:-1]])
    even = np.abs(rise - rise_before) <= BENT * np.abs(rise + rise_before)
    evenly = even | np.concatenate([even, [False, False]])[2:]
    return np.asarray((((before > BETWEEN) & (after > BETWEEN)) | ((before < -BETWEEN) & (after < -BETWEEN))) & ~evenly)


def placed_returns(placed: PlacedScan, mounting: Mounting) -> Array:
    """Returns that count in the frame of the map, x and y [m], shape (n, 2): each from where its beam was measured."""
    scan = placed.scan
    ranges = scan.millimetres / 1000.0
    bearings = scan.start_angle + scan.increment * np.arange(len(ranges))
    ranges[ranges == 0.0] = np.nan
    counts = (ranges >= mounting.least_range_m) & (ranges <= RANGE)
    counts &= seeing(np.degrees(bearings), mounting.mask) & ~_between(ranges)
    angle, ages = bearings[counts] + mounting.heading, placed.ages[counts]
    x = mounting.x_m + ranges[counts] * np.cos(angle)
    y = mounting.y_m + ranges[counts] * np.sin(angle)
    c, s = np.cos(placed.turn * ages), -np.sin(placed.turn * ages)
    return placed_points(placed.pose, np.array([c * x - s * y - placed.speed * ages, s * x + c * y])).T
