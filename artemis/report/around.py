"""What a robot saw where obstacles slowed it down, and the routes that were planned for it."""

from __future__ import annotations

from math import inf

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.planned_route import route_poses
from artemis.route_planning.obstacle_layer import placed_returns, placed_scan
from artemis.scan import Scan
from artemis.values import JobKind, Tick
from artemis.vehicle import RobotFile

EVERY, NEAR = 0.5, 2.5
"""A scan is kept so often while the robot is slowed down [s], of it what is so near [m]."""
MOST = 200
"""Scans that are kept."""


class DrivenAround:
    """Sees every tick of a recording once.

    Attributes:
        seen: x, y of returns in the frame of the pose [m], of one scan each, shape (n, 2).
        routes: x, y of planned routes [m], shape (n, 2).
    """

    def __init__(self, robot: RobotFile) -> None:
        self.seen: list[Array] = []
        self.routes: list[Array] = []
        self._scanners, self._wheelbase = robot.scanners, robot.geometry.wheelbase_m
        self._scans: dict[str, Scan] = {}
        self._last = -inf

    def see(self, tick: Tick, *, slowed: bool) -> None:
        """The next tick, and whether an obstacle slowed the robot down."""
        sensed, pose = tick.snapshot.sensed, tick.snapshot.pose
        for scan in sensed.scans:
            if scan.source in self._scanners:
                self._scans[scan.source] = scan
        for done in sensed.results:
            if done.kind is JobKind.PLAN and done.values:
                self.routes.append(np.array([(pose.x, pose.y) for pose in route_poses(done.values)]))
        if not slowed or pose.lost or sensed.time - self._last < EVERY or len(self.seen) >= MOST:
            return
        self._last = sensed.time
        for name, scan in self._scans.items():
            points = placed_returns(placed_scan(tick.snapshot, scan, self._wheelbase), self._scanners[name])
            near = np.hypot(points[:, 0] - pose.pose.x, points[:, 1] - pose.pose.y) < NEAR
            self.seen.append(points[near])
