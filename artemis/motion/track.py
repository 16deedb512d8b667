"""What was driven, as points: recorded by hand, to be followed afterwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array
from artemis.motion.fitting import fitted
from artemis.motion.path import path_from_points
from artemis.motion.path_points import MIN_STEP, distinct
from artemis.motion.poses import seen_from
from artemis.motion.route import Part, Route
from artemis.motion.totals import total
from artemis.values import Pose
from artemis.vehicle import RobotFile

SPACING, ANGLE = 0.05, math.radians(5)
"""A point is kept so far from the last one [m], or turned by so much [rad]."""
ALIKE = math.radians(60)
"""Ends of a closed path may differ in direction by this much [rad]."""
SEAM = math.radians(30)
"""The line from the end of a closed path to its start may differ from the direction there by this much [rad]."""
TURNING = 0.01
"""So far back [m] is a change of direction; less is noise of a robot that stands."""
SHORTEST = 0.3
"""Least length of a path [m]."""


@dataclass(slots=True)
class Track:
    """Poses of the robot (centre of the rear axle, in the frame of the odometry), as they were driven."""

    poses: list[Pose] = field(default_factory=list)
    spacing: float = SPACING
    """A pose is kept so far from the last one [m], or turned by `ANGLE`."""
    by_button: bool | None = None
    """Whether it is being recorded since the button for it was pressed; None: it never was."""
    tip: Pose | None = None
    """Where the robot got farthest beyond the last pose kept."""

    def see(self, pose: Pose, *, pressed: bool) -> None:
        """The robot is at `pose`, and the button was just `pressed` or not."""
        if self.records(pressed=pressed):
            self.add(pose)

    def records(self, *, pressed: bool) -> bool:
        """Whether the present place counts: all do; once the button was pressed, those between two presses only."""
        if pressed:
            self.by_button = not self.by_button
            if self.by_button:
                self.poses.clear()
                self.tip = None
        return self.by_button is not False

    def add(self, pose: Pose) -> bool:
        """The robot is at `pose` now; kept if that is far enough from the last one. Whether it was.

        Where the robot turns back, the place that it reached is kept, too.
        """
        if self.tip is not None and self._reach(self.tip) - self._reach(pose) > TURNING:
            self.poses.append(self.tip)
            self.tip = None
        last = self.poses[-1] if self.poses else None
        far = (
            last is None
            or math.hypot(pose.x - last.x, pose.y - last.y) >= self.spacing
            or abs(wrap(pose.heading - last.heading)) >= ANGLE
        )
        if far:
            self.poses.append(pose)
            self.tip = None
        elif len(self.poses) > 1 and self._reach(pose) > (SPACING / 10 if self.tip is None else self._reach(self.tip)):
            self.tip = pose
        return far

    def _reach(self, pose: Pose) -> float:
        """How far a pose is from the last one kept [m], in the direction in which that was reached."""
        before, last = self.poses[-2:]
        return math.copysign(1.0, _ahead(before, last)) * _ahead(last, pose)

    def legs(self) -> list[tuple[list[Pose], bool]]:
        """The poses between two changes of direction, and whether they were driven backwards."""
        distance = np.cumsum([0.0, *(_ahead(before, pose) for before, pose in pairwise(self.poses))])
        return [
            (self.poses[begin : end + 1], bool(distance[end] < distance[begin])) for begin, end in one_way(distance)
        ]

    def route(
        self,
        robot: RobotFile,
        speed: float | None,
        close_within: float = 0.0,
        round_corners: float = 0.0,
        allow_slowdown: bool = False,
    ) -> Route:
        """What was driven, as a route to follow: smooth, and drivable at a speed of the virtual front wheel [m/s].

        One without reversals that ends within `close_within` [m] of where it began, in about the same direction, goes
        on there. The last two: as of `fitted`.

        Raises:
            ConfigError: too short, or more than the robot can do.
        """
        legs, closed = self.legs(), None
        whole = len(legs) == 1
        if whole:
            poses, backward = legs[0]
            if (count := loop_end(poses, close_within, backward)) is not None:
                legs, closed = [(poses[:count], backward)], True
        length = total(math.hypot(b.x - a.x, b.y - a.y) for poses, _ in legs for a, b in pairwise(poses))
        if length < SHORTEST:
            raise ConfigError(f"only {length:.2f} m were recorded, at least {SHORTEST:g} m are needed")
        parts = []
        for poses, backward in legs:
            x, y = np.array([(pose.x, pose.y) for pose in poses]).T
            x, y, _ = distinct(x, y)
            path = path_from_points(x, y, closed=closed, between_halts=not whole)
            parts.append(Part(path=path, backward=backward))
        speed = robot.limits.speed_m_s if speed is None else speed
        route = Route(tuple(parts))
        route, _ = fitted(route, robot, speed, round_corners=round_corners, allow_slowdown=allow_slowdown)
        problems = route.problems(robot, speed)
        if problems:
            raise ConfigError(problems)
        return route

    def as_csv(self) -> str:
        """As a file: x and y [m], heading [rad]."""
        rows = (f"{pose.x:.4f},{pose.y:.4f},{pose.heading:.5f}" for pose in self.poses)
        return "\n".join(["x,y,heading", *rows]) + "\n"


def loop_end(poses: Sequence[Pose], close_within: float, backward: bool = False) -> int | None:
    """How many of the poses make a closed path, which goes on from the last of them to the first; None: none do.

    The ends are at most `close_within` [m] apart, and look in about the same direction, as does the line between them:
    what was driven beyond the start is left out.
    """
    if not poses:
        return None
    first = poses[0]
    ahead = first.heading + (math.pi if backward else 0.0)
    for count in range(len(poses), 3, -1):
        last = poses[count - 1]
        gap = math.hypot(first.x - last.x, first.y - last.y)
        if gap > close_within:
            return None
        seam = ahead if gap < MIN_STEP else math.atan2(first.y - last.y, first.x - last.x)
        if abs(wrap(last.heading - first.heading)) <= ALIKE and abs(wrap(seam - ahead)) <= SEAM:
            return count
    return None


def one_way(distance: Array) -> list[tuple[int, int]]:
    """Stretches in which a signed distance [m] only rises or only falls, but for `TURNING`."""
    stretches: list[tuple[int, int]] = []
    begin = furthest = 0
    sign = 0.0
    for index, value in enumerate(distance.tolist()):
        if sign == 0.0:
            if abs(value - distance[begin]) > TURNING:
                sign, furthest = math.copysign(1.0, value - distance[begin]), index
        elif (value - distance[furthest]) * sign > 0:
            furthest = index
        elif (distance[furthest] - value) * sign > TURNING:
            stretches.append((begin, furthest))
            begin, furthest, sign = furthest, index, -sign
    return [*stretches, (begin, furthest)] if sign else stretches


def _ahead(pose: Pose, other: Pose) -> float:
    """How far ahead of a pose another one is [m]."""
    return seen_from(pose, other).x
