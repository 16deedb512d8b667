"""What was driven, as points: recorded by hand, to be followed afterwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.path import MIN_STEP, Path, check_drivable, path_from_points
from artemis.values import Pose
from artemis.vehicle import Robot

SPACING, ANGLE = 0.05, math.radians(5)
"""A point is kept so far from the last one [m], or turned by so much [rad]."""
ALIKE = math.radians(60)
"""Ends of a closed path may differ in direction by this much [rad]."""
SEAM = math.radians(30)
"""The way from the end of a closed path to its start may differ from the direction there by this much [rad]."""
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
        return self.by_button is not False

    def add(self, pose: Pose) -> bool:
        """The robot is at `pose` now; kept if that is far enough from the last one. Whether it was."""
        last = self.poses[-1] if self.poses else None
        far = (
            last is None
            or math.hypot(pose.x - last.x, pose.y - last.y) >= self.spacing
            or abs(wrap(pose.heading - last.heading)) >= ANGLE
        )
        if far:
            self.poses.append(pose)
        return far

    def legs(self) -> list[tuple[list[Pose], bool]]:
        """The poses between two changes of direction, and whether they were driven backwards."""
        legs: list[tuple[list[Pose], bool]] = []
        for before, pose in pairwise(self.poses):
            way = (pose.x - before.x) * math.cos(before.heading) + (pose.y - before.y) * math.sin(before.heading)
            if not legs or (way < 0) is not legs[-1][1]:
                legs.append(([before], way < 0))
            legs[-1][0].append(pose)
        return legs

    def path(self, robot: Robot, speed: float | None, close_within: float = 0.0) -> Path:
        """The path to follow, smooth, and drivable at a speed of the virtual front wheel [m/s].

        One that ends within `close_within` [m] of where it began, in about the same direction, goes on there.

        Raises:
            ConfigError: too short, driven backwards somewhere, or more than the robot can do.
        """
        legs = self.legs()
        if any(backward for _, backward in legs):
            raise ConfigError("the robot was driven backwards: record only what it shall follow forwards")
        kept = loop_end(self.poses, close_within)
        points = np.array([(pose.x, pose.y) for pose in self.poses[:kept]]).reshape(-1, 2)
        length = float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0
        if length < SHORTEST:
            raise ConfigError(f"only {length:.2f} m were recorded, at least {SHORTEST:g} m are needed")
        moved = np.append(True, np.hypot(*np.diff(points, axis=0).T) > SPACING / 10)
        closed = None if kept is None else True
        path = path_from_points(points[moved, 0], points[moved, 1], closed=closed)
        problems = check_drivable(path, robot, robot.limits.speed_m_s if speed is None else speed)
        if problems:
            raise ConfigError(problems)
        return path

    def as_csv(self) -> str:
        """As a file: x and y [m], heading [rad]."""
        rows = (f"{pose.x:.4f},{pose.y:.4f},{pose.heading:.5f}" for pose in self.poses)
        return "\n".join(["x,y,heading", *rows]) + "\n"


def loop_end(poses: Sequence[Pose], close_within: float, backward: bool = False) -> int | None:
    """How many of the poses make a closed path, which goes on from the last of them to the first; None: none do.

    The ends are at most `close_within` [m] apart, and look in about the same direction, as does the way between them:
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
