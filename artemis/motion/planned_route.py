"""A route in whole numbers, as a job's result: a recording holds it, and a tick that drives it fits nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array
from artemis.motion.fitting import fitted
from artemis.motion.path import Path, path_from_points
from artemis.motion.path_points import moving
from artemis.motion.route import Part, Route
from artemis.values import Pose
from artemis.vehicle import RobotFile

PLANNER = "a route"
"""Who does jobs of the kind PLAN, as their `drive`."""
FITTER = "a path"
"""Likewise of the kind FIT."""
NOT_KEPT = 0
"""In the values of a job PLAN before a present route that is to be another one although it is free: none begins so."""
ONLY_CHECKED = -1
"""Likewise before one of which only is asked whether a new zone is in its way: no other one is sought."""
ROUND_CORNERS = 0.10
"""A planned route may leave its points at a corner by so much [m]."""
_MICRO = 1e6
_HEADER, _COLUMNS = 4, 5
"""Numbers before the samples of a part: how many samples, whether it is driven backwards, whether it is closed, and its
length. Numbers of each: x, y, heading, curvature, and its own speed, negative where it has none."""


def packed_poses(poses: Sequence[Pose]) -> tuple[int, ...]:
    """Poses in micrometres and microradians, one after the other."""
    return tuple([round(part * _MICRO) for pose in poses for part in (pose.x, pose.y, pose.heading)])


def unpacked_poses(values: Sequence[int]) -> list[Pose]:
    """What was `packed_poses`."""
    rows = (np.asarray(values, float).reshape(-1, 3) / _MICRO).tolist()
    return [Pose(x=x, y=y, heading=heading) for x, y, heading in rows]


def packed_route(route: Route) -> tuple[int, ...]:
    """The samples of a route of one lap, in micrometres, microradians and so on."""
    values: list[int] = []
    for part in route.parts:
        path = part.path
        speed = np.full_like(path.x, -1.0) if path.speed is None else path.speed
        columns = np.column_stack([path.x, path.y, path.heading, path.curvature, speed])
        values += [len(path.x), int(part.backward), int(path.closed), round(float(path.arc_length[-1]) * _MICRO)]
        values += np.rint(columns * _MICRO).astype(np.int64).reshape(-1).tolist()
    return tuple(values)


def unpacked_route(values: Sequence[int]) -> Route:
    """What was `packed_route`, to a millionth."""
    return Route(tuple(_parts(values)))


def _parts(values: Sequence[int]) -> Iterator[Part]:
    numbers, at = np.asarray(values, float), 0
    while at < len(numbers):
        count, backward, closed, length = map(int, numbers[at : at + _HEADER])
        at += _HEADER
        x, y, heading, curvature, speed = numbers[at : at + _COLUMNS * count].reshape(-1, _COLUMNS).T / _MICRO
        at += _COLUMNS * count
        path = Path(
            x, y, heading, curvature,
            spacing=length / _MICRO / (count - 1), closed=bool(closed), speed=None if speed[0] < 0.0 else speed,
        )  # fmt: skip
        yield Part(path=path, backward=bool(backward))


def route_poses(values: Sequence[int], spacing: float = 0.05) -> list[Pose]:
    """Where the robot is along a `packed_route`, about every `spacing` [m], and where each of its parts ends."""
    poses = []
    for part in _parts(values):
        path = part.path
        some = np.append(np.arange(0, len(path.x) - 1, max(1, round(spacing / path.spacing))), len(path.x) - 1)
        heading = path.heading[some] + math.pi * part.backward
        rows = np.column_stack([path.x[some], path.y[some], heading]).tolist()
        poses += [Pose(x=x, y=y, heading=wrap(turn)) for x, y, turn in rows]
    return poses


def planned_route(points: Array, robot: RobotFile, speed: float) -> Route:
    """The route through planned points, as the robot drives it.

    Args:
        points: x, y [m], highest speed of the virtual front wheel [m/s], negative where the robot comes there
            backwards; shape (n, 3).
        robot: that drives it.
        speed: highest wish for the virtual front wheel [m/s].

    Raises:
        ConfigError: it is more than the robot can do.
    """
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
