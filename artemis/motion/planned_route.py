"""A planned route as whole numbers in a job's result: a recording holds it, so a replay needs no planner."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.fitting import fitted
from artemis.motion.path import path_from_points
from artemis.motion.path_points import moving
from artemis.motion.route import Part, Route
from artemis.motion.spline import Array
from artemis.values import Pose
from artemis.vehicle import RobotFile

PLANNER = "a route"
"""Who does jobs of the kind PLAN, as their `drive`."""
ROUND_CORNERS = 0.10
"""A route may leave its points at a corner by so much [m]."""
_MICRO = 1e6


def packed_goal(goal: Pose) -> tuple[int, ...]:
    """A goal in the frame of the map, in micrometres and microradians: of a job before the route that is known."""
    return tuple(round(part * _MICRO) for part in (goal.x, goal.y, goal.heading))


def unpacked_goal(values: Sequence[int]) -> Pose:
    """What was `packed_goal`."""
    x, y, heading = (value / _MICRO for value in values)
    return Pose(x=x, y=y, heading=heading)


def packed(points: Array) -> tuple[int, ...]:
    """Points of a route in micrometres and micrometres per second, one after the other.

    Args:
        points: x, y [m], highest speed of the virtual front wheel [m/s], negative where the robot comes there
            backwards; shape (n, 3).
    """
    return tuple(np.rint(points * _MICRO).astype(np.int64).reshape(-1).tolist())


def unpacked(values: Sequence[int]) -> Array:
    """What was `packed`."""
    return np.asarray(values, float).reshape(-1, 3) / _MICRO


def route_poses(values: Sequence[int]) -> list[Pose]:
    """Where the robot is at the `packed` points of a route, two or more, before it is fitted to the robot."""
    points = unpacked(values)
    x, y, forwards = points[:, 0], points[:, 1], points[1:, 2] > 0.0
    heading = np.arctan2(np.diff(y), np.diff(x)) + np.where(forwards, 0.0, np.pi)
    heading = np.append(heading, heading[-1])
    return [Pose(x=a, y=b, heading=c) for a, b, c in zip(x.tolist(), y.tolist(), heading.tolist(), strict=True)]


def planned_route(values: Sequence[int], robot: RobotFile, speed: float) -> Route:
    """The route of `packed` points, as the robot drives it.

    Args:
        values: as of `packed`.
        robot: that drives it.
        speed: highest wish for the virtual front wheel [m/s].

    Raises:
        ConfigError: it is more than the robot can do.
    """
    points = unpacked(values)
    changes = np.flatnonzero(points[2:, 2] * points[1:-1, 2] < 0) + 1
    parts = []
    for first, last in pairwise([0, *changes.tolist(), len(points) - 1]):
        piece = points[first : last + 1]
        kept = moving(piece[:, 0], piece[:, 1])
        x, y = piece[kept, 0], piece[kept, 1]
        if len(x) < 2:
            raise ConfigError("the route has a part of no length")
        limit = np.minimum(np.abs(piece[kept, 2]), speed)
        limit[0] = limit[1]
        own = limit if float(limit.min()) < speed else None
        path = path_from_points(x, y, speed=own, closed=False, between_halts=True)
        parts.append(Part(path=path, backward=bool(piece[-1, 2] < 0)))
    return fitted(Route(tuple(parts)), robot, speed, round_corners=ROUND_CORNERS, allow_slowdown=True)[0]
