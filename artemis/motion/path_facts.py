"""What is true of the points of a path file, also of those that mode follow would refuse."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.demand import steering_per_way
from artemis.motion.path import COLUMNS, Path, check_drivable, moving, path_from_points
from artemis.motion.spline import Array
from artemis.motion.table import Table
from artemis.motion.waypoints import check_extent, cusps, deviation, highest_speed
from artemis.vehicle import Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """The points between two changes of direction, and the curve through them."""

    path: Path
    points: int
    gap: float
    """Largest distance between two points [m]."""
    off: float
    """Largest distance of a point from the curve [m]."""
    backward: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """A path file, part by part."""

    parts: list[Part]
    reversals: list[tuple[int, float, float]]
    """Line in the file, x and y [m]."""


def facts_of(text: str, source: str) -> Facts:
    """Read a path file as `path_from_csv` does, but split it where the direction changes.

    Raises:
        ConfigError: what cannot be read, with file:line:column.
    """
    table = Table(text, source, COLUMNS, required=("x", "y"))
    table.raise_problems()
    columns = {name: np.array(values) for name, values in table.columns.items()}
    kept = moving(columns["x"], columns["y"])
    if len(kept) < 2:
        raise ConfigError(f"{source}:1:1: {len(kept)} distinct points; expected at least 2")
    x, y = columns["x"][kept], columns["y"][kept]
    check_extent(x, y, f"{source}:1:1: ")
    backward, ends = _directions(x, y, columns["heading"][kept] if "heading" in columns else None)
    parts = []
    for first, last in pairwise(ends):
        px, py = x[first : last + 1], y[first : last + 1]
        speed = columns["speed"][kept][first : last + 1] if "speed" in columns else None
        path = path_from_points(px, py, speed=speed)
        off, _ = deviation(px, py, path)
        gap = float(np.hypot(np.diff(px), np.diff(py)).max())
        parts.append(Part(path=path, points=len(px), gap=gap, off=off, backward=backward[first]))
    lines = [table.lines[index] for index in kept]
    reversals = [(lines[index], float(x[index]), float(y[index])) for index in ends[1:-1]]
    return Facts(parts=parts, reversals=reversals)


def _directions(x: Array, y: Array, heading: Array | None) -> tuple[list[bool], list[int]]:
    """Of each way from a point to the next whether it is driven backwards; and the points where parts begin or end.

    Without headings the path begins forwards, and each cusp changes the direction.
    """
    turned = np.zeros(len(x) - 1, dtype=int)
    turned[[index for index, _ in cusps(x, y)]] = 1
    if heading is None:
        backward = np.cumsum(turned) % 2
    else:
        backward = (np.cos(heading[:-1] - np.arctan2(np.diff(y), np.diff(x))) < 0).astype(int)
    changes = np.flatnonzero((np.diff(backward) != 0) | (turned[1:] != 0)) + 1
    return backward.astype(bool).tolist(), [0, *changes.tolist(), len(x) - 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """What a path asks of a robot."""

    steering: float
    """Largest angle of the virtual front wheel [rad]."""
    rate: float
    """Fastest steering of a wheel at `speed` [rad/s]."""
    speed: float
    """Of the virtual front wheel [m/s]; the path's own where that is lower."""
    highest: float
    """Highest speed at which the steering keeps up [m/s]."""
    bounded_at: int | None
    """By this sample of the path."""
    problems: list[str]
    """Why the robot cannot follow the path at `speed`."""


def demand_of(path: Path, robot: Robot, speed: float | None) -> Demand:
    """What a path asks of a robot at a speed [m/s]; None: at the highest that is possible."""
    highest, bounded_at = highest_speed(path, robot)
    speed = highest if speed is None else speed
    own = np.inf if path.speed is None else path.speed
    rate = steering_per_way(path.curvature, path.spacing, robot.geometry) * np.minimum(own, speed)
    return Demand(
        steering=math.atan(robot.geometry.wheelbase_m * float(np.abs(path.curvature).max())),
        rate=float(rate.max()),
        speed=speed,
        highest=highest,
        bounded_at=bounded_at,
        problems=check_drivable(path, robot, speed * (1 - 1e-9)),
    )
