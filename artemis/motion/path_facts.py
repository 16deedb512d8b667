"""What is true of the points of a path file, also of those that mode follow would refuse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from artemis.motion.path import Path, check_drivable, steering_demand
from artemis.motion.path_points import path_table, points_of
from artemis.motion.route import part_of, stretches
from artemis.motion.waypoints import check_extent, deviation, highest_speed
from artemis.vehicle import RobotFile


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFacts:
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

    parts: list[PartFacts]
    reversals: list[tuple[int, float, float]]
    """Line in the file, x and y [m]."""


def facts_of(text: str, source: str) -> Facts:
    """Read a path file as `route_from_csv` does, but with whatever makes mode follow refuse it.

    Raises:
        ConfigError: what cannot be read, with file:line:column.
    """
    table = path_table(text, source)
    table.raise_problems()
    points = points_of(table)
    x, y = points.x, points.y
    check_extent(x, y, f"{source}:1:1: ")
    found = stretches(x, y, points.heading)
    parts = []
    for first, last, backward in found:
        px, py = x[first : last + 1], y[first : last + 1]
        path = part_of(points, (first, last, backward), whole=len(found) == 1).path
        off, _ = deviation(px, py, path)
        gap = float(np.hypot(np.diff(px), np.diff(py)).max())
        parts.append(PartFacts(path=path, points=len(px), gap=gap, off=off, backward=backward))
    reversals = [(table.lines[points.kept[first]], float(x[first]), float(y[first])) for first, *_ in found[1:]]
    return Facts(parts=parts, reversals=reversals)


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


def demand_of(path: Path, robot: RobotFile, speed: float | None) -> Demand:
    """What a path asks of a robot at a speed [m/s]; None: at the highest that is possible."""
    highest, bounded_at = highest_speed(path, robot)
    speed = highest if speed is None else speed
    turn, own = steering_demand(path, robot)
    rate = turn * np.minimum(own, speed)
    return Demand(
        steering=math.atan(robot.geometry.wheelbase_m * float(np.abs(path.curvature).max())),
        rate=float(rate.max()),
        speed=speed,
        highest=highest,
        bounded_at=bounded_at,
        problems=check_drivable(path, robot, speed * (1 - 1e-9)),
    )
