"""The floor on which routes are planned: a map and its zones in cells of 5 cm, the frame turned along the cells."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from artemis.errors import ConfigError
from artemis.mapping.map_file import FREE_UP_TO
from artemis.mapping.occupancy import MOST_CELLS, OccupancyMap
from artemis.motion.poses import seen_from
from artemis.route_planning.zones import MapZone, MapZones
from artemis.values import Pose
from artemis.vehicle import RobotFile

CELL = 0.05
"""Side of a cell [m]."""
PREFERRED = 0.5
"""A metre in a zone of the kind `prefer` costs so much."""
BESIDE, NEARNESS = 0.8, 1.0
"""A metre nearer to an obstacle than the first [m] costs up to so much more."""
MARGIN = 0.05
"""A route is free by the robot's outline and so much on every side [m]."""
NOT_FREE = "a wall, a keep-out zone, or unknown ground"
SPARE = 0.02
"""It is sought with so much more [m]: to fit it to the robot may move it."""
Array = NDArray[np.float64]
Cells = NDArray[np.bool_]
Field = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """Cells, row 0 and column 0 at the origin."""

    occupied: Cells
    """Walls, keep-out zones, and what is unknown on the map."""
    factor: Field
    """What a metre costs, by the zones."""
    speed: Field
    """Highest speed of the virtual front wheel [m/s], by the zones; infinite elsewhere."""
    origin: Pose
    """Of cell 0, 0 in the frame of the map."""

    def local(self, pose: Pose) -> Array:
        """A pose of the map seen from the origin: x, y, heading."""
        seen = seen_from(self.origin, pose)
        return np.array([seen.x, seen.y, seen.heading])

    def local_poses(self, poses: Array) -> Array:
        """The same of many: x, y, heading, and columns that stay as they are, (n, 3 or more); headings not wrapped."""
        c, s = math.cos(self.origin.heading), math.sin(self.origin.heading)
        dx, dy = poses[:, 0] - self.origin.x, poses[:, 1] - self.origin.y
        return np.column_stack([c * dx + s * dy, c * dy - s * dx, poses[:, 2] - self.origin.heading, poses[:, 3:]])

    def contains(self, local: Array) -> bool:
        """Whether a pose that is seen from the origin lies on the map."""
        rows, columns = self.occupied.shape
        return bool(0 <= local[0] < columns * CELL and 0 <= local[1] < rows * CELL)

    def cells_of(self, points: Array) -> NDArray[np.int64]:
        """Rows and columns of points of the map, shape (n, 2), of those that lie within; shape (2, m)."""
        c, s = math.cos(self.origin.heading), math.sin(self.origin.heading)
        x, y = points[:, 0] - self.origin.x, points[:, 1] - self.origin.y
        cells = np.floor(np.array([c * y - s * x, c * x + s * y]) / CELL).astype(np.int64)
        rows, columns = self.occupied.shape
        within = (cells[0] >= 0) & (cells[0] < rows) & (cells[1] >= 0) & (cells[1] < columns)
        return np.asarray(cells[:, within])


def floor_from(content: OccupancyMap, zones: Sequence[MapZone] = ()) -> Floor:
    """The floor that a map and its zones describe.

    Raises:
        ConfigError: the map is too large for it.
    """
    rows, columns = content.cells.shape
    high, wide = rows * content.resolution, columns * content.resolution
    if high * wide > MOST_CELLS * CELL * CELL:
        size = f"{columns} x {rows} cells of {content.resolution:g} m are {wide:.0f} x {high:.0f} m"
        most = f"{math.sqrt(MOST_CELLS) * CELL:.0f}"
        raise ConfigError(f"{size}: routes are planned on {most} x {most} m at most; is the `resolution` in metres?")

    def in_cells(mask: Cells) -> Cells:
        return resampled(mask, content.resolution)

    blocked = (content.cells < 0) | (content.cells > FREE_UP_TO)
    masks = [(zone, content.inside(zone.corners, touched=zone.kind != "prefer")) for zone in zones]
    for zone, mask in masks:
        if zone.kind == "keep-out":
            blocked = blocked | mask
    occupied = in_cells(blocked)
    factor, speed = np.ones(occupied.shape, np.float32), np.full(occupied.shape, np.inf, np.float32)
    for zone, mask in masks:
        if zone.kind == "prefer":
            factor[in_cells(mask)] = PREFERRED
        elif zone.speed_m_s is not None:
            cells = in_cells(mask)
            speed[cells] = np.minimum(speed[cells], zone.speed_m_s)
    x, y, heading = content.origin
    return Floor(occupied, factor, speed, Pose(x=x, y=y, heading=heading))


def outside(content: OccupancyMap, known: MapZones) -> list[str]:
    """A line for each zone and each place that lies outside of a map."""
    zones = [
        f"zone {zone.name or number} lies outside of the map: it has no effect"
        for number, zone in enumerate(known.zones, 1)
        if not content.inside(zone.corners, touched=True).any()
    ]
    places = [name for name, place in known.places.items() if not content.contains(place.x_m, place.y_m)]
    return [*zones, *(f"place {name} lies outside of the map" for name in places)]


def resampled(mask: Cells, resolution: float) -> Cells:
    """A mask over cells of another size [m], over cells of `CELL`: true where any of those that lie there is."""
    for axis in (0, 1):
        ends = np.arange(math.ceil(round(mask.shape[axis] * resolution / CELL, 6)) + 1) * (CELL / resolution)
        first = np.floor(ends[:-1] + 1e-6).astype(int)
        last = np.minimum(np.ceil(ends[1:] - 1e-6).astype(int), mask.shape[axis]) - 1
        last = np.maximum(last, first)
        made = mask.take(first, axis)
        for step in range(1, int((last - first).max()) + 1):
            made = made | mask.take(np.minimum(first + step, last), axis)
        mask = made
    return mask


def clearance(occupied: Cells) -> Field:
    """Distance from each cell's middle to the nearest occupied cell's edge [m], at most the true one.

    The edge of the grid counts as occupied.
    """
    from scipy.ndimage import distance_transform_edt

    free, clear = ~occupied, np.zeros(occupied.shape, np.float32)
    if free.any():  # only around that there is anything to compute: of known ground there is often little
        rows, columns = (np.flatnonzero(free.any(axis)) for axis in (1, 0))
        some = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        framed = distance_transform_edt(np.pad(free[some], 1))[1:-1, 1:-1]
        clear[some] = np.maximum(CELL * framed - CELL * math.sqrt(0.5), 0.0)
    return clear


class PackedMap(Struct, frozen=True):
    """A map, compressed: small enough to go to the process that plans with each order."""

    cells: bytes
    shape: tuple[int, int]
    resolution: float
    origin: tuple[float, float, float]

    @property
    def content(self) -> OccupancyMap:
        """What was packed."""
        cells = np.frombuffer(zlib.decompress(self.cells), np.int8).reshape(self.shape)
        return OccupancyMap(cells=cells, resolution=self.resolution, origin=self.origin)


def packed_map(content: OccupancyMap) -> PackedMap:
    """A map as a `PackedMap`."""
    rows, columns = content.cells.shape
    cells = zlib.compress(np.ascontiguousarray(content.cells, np.int8).tobytes(), 1)
    return PackedMap(cells, (rows, columns), content.resolution, content.origin)


class ZonedMap(Struct, frozen=True):
    """A map, and the file of its zones as it was read: what a floor is made of."""

    content: PackedMap
    beside: Path
    raw: bytes
    """Empty: there was no file."""


class Destination(Struct, frozen=True, kw_only=True):
    """What a step of a mission wants routes for."""

    made_of: ZonedMap
    """As of before the run; whoever plans reads the zones again."""
    goal: Pose | None
    """In the frame of the map; None: each job has its own."""
    speed: float
    """Highest, of the virtual front wheel [m/s]."""
    margin: float
    """Around the outline [m]."""
    known_behind: float | None
    """As of `RouteRequest`."""


def goal_problem(floor: Floor, robot: RobotFile, goal: Pose, margin: float) -> str | None:
    """Why a robot cannot stand at a pose of the map; None: it can."""
    pose = floor.local(goal)
    if not floor.contains(pose):
        return "it lies outside of the map"
    if covered(floor.occupied, pose, outline_box(robot, margin + SPARE)).any():
        return f"the robot cannot stand there: within its outline and {100 * margin:.0f} cm is {NOT_FREE}"
    beyond = beyond_edge(floor, robot, pose, margin)
    return beyond and f"the robot cannot stand there: {beyond}"


def beyond_edge(floor: Floor, robot: RobotFile, pose: Array, margin: float) -> str | None:
    """That the outline at a pose of the floor, with a margin [m], reaches beyond the map, in words; None: it does not.

    What lies beyond the edge counts as occupied, as of `clearance`.
    """
    edge = np.pad(np.zeros(floor.occupied.shape, bool), 1, constant_values=True)
    if not covered(edge, pose + np.array([CELL, CELL, 0.0]), outline_box(robot, margin + SPARE)).any():
        return None
    return f"its outline and {100 * margin:.0f} cm around it reach beyond the edge of the map"


def outline_box(robot: RobotFile, margin: float) -> Array:
    """Front, rear (negative behind the axle) and half width of the robot's outline with a margin [m]."""
    assert robot.outline is not None
    outline = robot.outline
    return np.array([outline.front_m + margin, -outline.rear_m - margin, outline.half_width_m + margin])


def covered(occupied: Cells, pose: Array, box: Array, reach: float = CELL * math.sqrt(0.5)) -> Cells:
    """Occupied cells that an outline at a pose of the floor touches, or all but touches; or with middles within."""
    row, column = np.nonzero(occupied)
    x, y = (column + 0.5) * CELL - pose[0], (row + 0.5) * CELL - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    u, v = c * x + s * y, c * y - s * x
    within = (u < box[0] + reach) & (u > box[1] - reach) & (np.abs(v) < box[2] + reach)
    found = np.zeros(occupied.shape, bool)
    found[row[within], column[within]] = True
    return found
