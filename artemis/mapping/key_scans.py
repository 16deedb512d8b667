"""The scans that a map is made of, and their poses."""

from __future__ import annotations

import numpy as np

from artemis.mapping.se2 import Array, between


class KeyScans:
    """In the order in which they were taken."""

    def __init__(self) -> None:
        self.points: list[Array] = []
        """Of each key scan, seen from the robot, shape (n, 4)."""
        self._poses, self._places = np.zeros((64, 3)), np.zeros((64, 2))

    def __len__(self) -> int:
        return len(self.points)

    @property
    def poses(self) -> Array:
        """Of all, a view, shape (n, 3)."""
        return self._poses[: len(self.points)]

    @poses.setter
    def poses(self, poses: Array) -> None:
        self._poses[: len(self.points)] = poses

    @property
    def places(self) -> Array:
        """Of each, where the scanner was on the robot: x, y [m], a view, shape (n, 2)."""
        return self._places[: len(self.points)]

    def append(self, points: Array, pose: Array, place: Array) -> None:
        """Add the newest; `place` of the scanner on the robot: x, y [m], shape (2,)."""
        if len(self.points) == len(self._poses):
            self._poses = np.concatenate([self._poses, np.zeros_like(self._poses)])
            self._places = np.concatenate([self._places, np.zeros_like(self._places)])
        self._poses[len(self.points)], self._places[len(self.points)] = pose, place
        self.points.append(points)

    def neighbours(self, key: int, most: int, radius: float) -> list[int]:
        """Key scans near `key`, of as many visits of the place as there are.

        Args:
            key: its number.
            most: of them.
            radius: how far away they may be [m]; a turn by 2 rad counts as 1 m.
        """
        motion = between(self.poses[key], self.poses)
        away = np.hypot(motion[:, 0], motion[:, 1]) + 0.5 * np.abs(motion[:, 2])
        away[key] = np.inf
        found: list[int] = []
        while len(found) < most and away.min() < radius:
            nearest = int(away.argmin())
            found.append(nearest)
            away[max(0, nearest - 2) : nearest + 3] += 0.75  # of the same visit: others come first
            away[nearest] = np.inf
        return found
