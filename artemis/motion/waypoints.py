"""From points to a path file: split where the direction changes, smoothed, measured against what was given."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array
from artemis.motion.path import Path, path_from_points, steering_demand
from artemis.motion.path_points import MAX_LENGTH, MIN_STEP, cusps, moving
from artemis.motion.route import Route, route_from_csv
from artemis.motion.track import Track, one_way
from artemis.values import Pose
from artemis.vehicle import RobotFile

SLOWEST = 0.1
"""Least speed in a path file [m/s]: a robot that drives as slowly as when it was stopped never gets on."""
CANDIDATES = 8
"""Samples of a line next to a point: where the line meets itself, the nearest one may be of the farther branch."""
FARTHEST = 1e8
"""Coordinates [m] beyond are no place on Earth in any frame, and have no millimetres left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """What was driven between two changes of direction."""

    kept: list[int]
    """Which of the poses are its points."""
    backward: bool
    length: float
    """Distance [m]."""


def legs_of(poses: Sequence[Pose], spacing: float) -> list[Leg]:
    """Split what was driven, densely sampled, at changes of direction; thinned to `spacing` [m], or 5 degrees.

    The ends of a leg are kept, be they ever so near to the points before.
    """
    if len(poses) < 2:
        return []
    x, y, heading = np.array([(pose.x, pose.y, pose.heading) for pose in poses]).T
    dx, dy = np.diff(x), np.diff(y)
    distance = np.append(0.0, np.cumsum(dx * np.cos(heading[:-1]) + dy * np.sin(heading[:-1])))
    return [
        Leg(
            kept=_thinned(poses, begin, end, spacing),
            backward=bool(distance[end] < distance[begin]),
            length=float(np.hypot(dx[begin:end], dy[begin:end]).sum()),
        )
        for begin, end in one_way(distance)
    ]


def _thinned(poses: Sequence[Pose], begin: int, end: int, spacing: float) -> list[int]:
    """Which of the poses to keep, from when the robot started to move."""
    start = poses[begin]
    while _apart(poses[begin + 1], start) < MIN_STEP:
        begin += 1
    track = Track(spacing=spacing)
    kept = [index for index in range(begin, end) if track.add(poses[index])]
    distant = moving(np.array([poses[index].x for index in kept]), np.array([poses[index].y for index in kept]))
    kept = [kept[index] for index in distant]
    while len(kept) > 1 and _apart(poses[kept[-1]], poses[end]) < MIN_STEP:
        kept.pop()
    return [*kept, end]


def _apart(one: Pose, other: Pose) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def check_extent(x: Array, y: Array, place: str = "") -> None:
    """Refuse a distance [m] that cannot be meant, before it fills the memory with samples; `place` begins the message.

    Raises:
        ConfigError: it is too long, too short, or far off.
    """
    if not np.abs([x, y]).max() < FARTHEST:
        raise ConfigError(f"{place}more than {FARTHEST:.0f} m off; expected coordinates in metres")
    length = float(np.hypot(np.diff(x), np.diff(y)).sum())
    if not 2 * MIN_STEP < length <= MAX_LENGTH:
        raise ConfigError(f"{place}path of {length:g} m; expected at most {MAX_LENGTH:.0f} m, coordinates in metres")


def along_lines(corners: Array, lengths: Callable[[Array], Array]) -> Array:
    """Points on the straight lines from corner to corner; both have shape (n, 2) [m].

    Args:
        corners: at least two.
        lengths: from the distance [m] of each corner from the first one, along the lines, those of the points.
    """
    distance = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
    wanted = lengths(distance)
    return np.column_stack([np.interp(wanted, distance, column) for column in corners.T])


def drawn(
    x: Array,
    y: Array,
    *,
    spacing: float,
    smoothing: float | None = None,
    closed: bool | None = None,
    speed: Array | None = None,
    between_halts: bool = False,
) -> Path:
    """The smooth curve through points at least `MIN_STEP` apart, sampled at `spacing` [m]; else as `path_from_points`.

    Raises:
        ConfigError: fewer than two points, too long a distance, or one that reverses.
    """
    if len(x) < 2:
        raise ConfigError(f"{len(x)} distinct points; expected at least 2")
    check_extent(x, y)
    apart = math.hypot(x[0] - x[-1], y[0] - y[-1]) >= MIN_STEP
    around = [0, 1] if closed and apart else [1] if closed else []
    if found := cusps(np.append(x, x[around]), np.append(y, y[around])):
        index, turn = found[0]
        where = f"x {x[index % len(x)]:.2f} m, y {y[index % len(x)]:.2f} m"
        raise ConfigError(f"reverses at {where} ({math.degrees(turn):.0f} deg); split it there")
    with np.errstate(all="ignore"):
        path = path_from_points(
            x, y, speed=speed, spacing=spacing, smoothing=smoothing, closed=closed, between_halts=between_halts
        )
    if not np.isfinite([path.x, path.y, path.curvature]).all():
        raise ConfigError("no smooth curve goes through its points; leave some out")
    return path


@dataclass(frozen=True, slots=True, kw_only=True)
class PathRows:
    """A path file but for its comments, and the route that the file is read as."""

    text: str
    route: Route

    @property
    def path(self) -> Path:
        """The first part's curve."""
        return self.route.parts[0].path


def rows_of(route: Route, source: str, *, with_speed: bool = False) -> PathRows:
    """A route as a path file: samples of its curves, with the robot's heading [rad], and the speed [m/s] if asked for.

    Args:
        route: its curves sampled as the file shall be; each begins where the one before ends.
        source: name of the file, for messages.
        with_speed: with the curves' speeds, at least `SLOWEST`.

    Raises:
        ConfigError: the file could not be read again as this route.
    """
    rows: list[str] = []
    speeds = with_speed and route.parts[0].path.speed is not None
    for part in route.parts:
        x, y = (np.round(column, 5) + 0.0 for column in (part.path.x, part.path.y))  # no -0.0
        if part.path.closed:
            x[-1], y[-1] = x[0], y[0]
        headings = [wrap(heading + math.pi * part.backward) for heading in part.path.heading.tolist()]
        cells = [[f"{value:.5f}" for value in column] for column in (x.tolist(), y.tolist(), headings)]
        if speeds and part.path.speed is not None:
            cells.append([f"{speed:.3f}" for speed in np.maximum(part.path.speed, SLOWEST).tolist()])
        rows += list(map(",".join, zip(*cells, strict=True)))[1 if rows else 0 :]
    header = "x_m,y_m,heading_rad" + (",speed_m_s" if speeds else "")
    text = "\n".join([header, *rows]) + "\n"
    again = route_from_csv(text, source)
    if route.closed and not again.closed:
        raise ConfigError(f"{source}: its ends do not meet smoothly; leave it open, or close it by hand")
    if [part.backward for part in again.parts] != [part.backward for part in route.parts]:
        raise ConfigError(f"{source}: its reversals are not found again; leave out what is shorter than a few points")
    return PathRows(text=text, route=again)


def deviation(x: Array, y: Array, path: Path) -> tuple[float, int]:
    """Largest distance [m] of points from a path, and of which point."""
    return largest_distance(np.column_stack([x, y]), np.column_stack([path.x, path.y]))


def largest_distance(points: Array, line: Array) -> tuple[float, int]:
    """Largest of `distances`, and of which point."""
    distance = distances(points, line)
    worst = int(np.argmax(distance))
    return float(distance[worst]), worst


def distances(points: Array, line: Array) -> Array:
    """Distances [m] of `points` from a densely sampled `line`, shape (n,); both have shape (n, 2)."""
    from scipy.spatial import cKDTree  # no run needs it

    candidates = cKDTree(line).query(points, k=min(CANDIDATES, len(line)))[1]
    distance = np.full(len(points), np.inf)
    for nearest in candidates.T:
        for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(line) - 2)):
            distance = np.minimum(distance, _from_segments(points, line[first], line[first + 1]))
    return distance


def _from_segments(points: Array, begins: Array, ends: Array) -> Array:
    """Distance of each point from its segment [m]."""
    along, away = ends - begins, points - begins
    square = np.sum(along * along, axis=1)
    share = np.clip(np.sum(away * along, axis=1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    return np.asarray(np.hypot(*(away - share[:, None] * along).T))


def highest_speed(path: Path, robot: RobotFile) -> tuple[float, int | None]:
    """Highest speed of the virtual front wheel [m/s] at which the steering keeps up, at most the robot's.

    Where the path has speeds of its own, these count if they are lower. And the sample of the path that bounds it;
    None: none does.
    """
    turn, own = steering_demand(path, robot)
    rate = math.radians(robot.limits.steering_rate_wheel_deg_s)
    possible = np.where(turn * np.minimum(own, robot.limits.speed_m_s) > rate, rate / np.maximum(turn, 1e-9), np.inf)
    worst = int(np.argmin(possible))
    return (float(possible[worst]), worst) if np.isfinite(possible[worst]) else (robot.limits.speed_m_s, None)
