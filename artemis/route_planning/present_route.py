"""The route that a robot is on: where the rest of it leads, whether that is free, and whether new zones allow it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from artemis.motion.arrays import Array, wrapped
from artemis.motion.planned_route import unpacked_route
from artemis.motion.route import Route
from artemis.route_planning.floor import CELL, Floor, clearance
from artemis.route_planning.free_ground import FreeGround
from artemis.values import Pose
from artemis.vehicle import RobotFile

ON_ROUTE, ALONG_ROUTE = 0.1, math.radians(20.0)
"""A robot that is farther off its present route, or more askew, is not on it [m, rad]."""
AS_FAST = 1e-3
"""A route is so much faster than a zone allows at most [m/s]: it is kept in millionths."""


class PresentRoute:
    """What is left of it.

    Attributes:
        is_on_it: The robot is.
    """

    def __init__(self, values: Sequence[int], start: Pose, speed: float) -> None:
        """Begin where the robot first comes by.

        Args:
            values: as of `artemis.motion.planned_route.packed_route`.
            start: of the robot, on the map.
            speed: highest, of the virtual front wheel [m/s].
        """
        self._start = start
        driven, poses = places(unpacked_route(values), speed)
        away = np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)
        turned = np.abs(wrapped(poses[:, 2] - start.heading))
        here = ((away < ON_ROUTE) & (turned < ALONG_ROUTE)).nonzero()[0][:1]
        self.is_on_it = bool(here.size)
        if here.size:
            self._driven, self._poses = driven[here[0] + 1 :] - driven[here[0]], poses[here[0] + 1 :]

    def is_free(self, floor: Floor, ground: FreeGround) -> bool:
        """Whether nothing is in its way."""
        return self.is_on_it and bool(ground.are_free(floor.local_poses(self._poses), self._driven).all())

    def is_slow(self, floor: Floor, before: Floor) -> bool:
        """Whether it is as slow as zones want that are on a floor now, and were not before."""
        if not self.is_on_it:
            return False
        local = floor.local_poses(self._poses)
        rows, columns = floor.speed.shape
        row = np.clip((local[:, 1] / CELL).astype(int), 0, rows - 1)
        column = np.clip((local[:, 0] / CELL).astype(int), 0, columns - 1)
        highest = floor.speed[row, column]
        return not bool(((highest < before.speed[row, column]) & (local[:, 4] > highest + AS_FAST)).any())

    def is_allowed(self, floor: Floor, before: Floor, robot: RobotFile, margin: float) -> bool:
        """Whether zones that are on a floor now, and were not before, let the robot drive it."""
        new = floor.occupied & ~before.occupied
        ground = FreeGround(new, new, clearance(new), robot, margin, floor.local(self._start))
        return self.is_slow(floor, before) and self.is_free(floor, ground)


def places(route: Route, speed: float) -> tuple[Array, Array]:
    """How far it is to places along a route [m], a cell or less apart; and what holds there.

    That is x, y, heading, direction (1 or -1), and highest speed [m/s], at most the given one; shape (n, 5).
    """
    driven, poses, before = [], [], 0.0
    for part in route.parts:
        path = part.path
        some = np.append(np.arange(0, len(path.x) - 1, max(1, int(CELL / path.spacing))), len(path.x) - 1)
        driven.append(before + path.spacing * some)
        heading = path.heading[some] + math.pi * part.backward
        direction = np.full(len(some), 1.0 - 2.0 * part.backward)
        poses.append(np.column_stack([path.x[some], path.y[some], heading, direction, path.speeds(speed)[some]]))
        before += path.length
    return np.concatenate(driven), np.concatenate(poses)
