"""How far a place may be from where it is believed to be, seen from the newest key scan.

Along the shortest path through the graph three errors add up: a little with each metre; that of the heading, which
moves all that was driven after it to the side; and that of the odometry where no scan shows how far the robot drove,
which is the same all along and so grows with the distance.
"""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.key_scans import KeyScans
from artemis.mapping.pose_graph import PoseGraph
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings


class Drifts(NamedTuple):
    """Of places, seen from one key scan."""

    covariance: Array
    """Of x, y in the frame of the map [m²], shape (n, 2, 2)."""
    most: Array
    """Standard deviation in the worst direction [m], shape (n,)."""
    turn: Array
    """That of the heading [rad], shape (n,)."""


class Drift:
    """What is known of the way to each key scan.

    Attributes:
        share: by which the odometry is wrong, where nothing else measures how far the robot drove.
    """

    def __init__(self, settings: MapSettings, keys: KeyScans, graph: PoseGraph) -> None:
        """Take a map that grows. The steps to the key scans that it has already count as measured by scans."""
        self._settings, self._keys, self._graph = settings, keys, graph
        self._before, self._untold = array("q", [-1] * len(keys)), array("d", [0.0] * 2 * len(keys))
        self.share = 0.0

    def add(self, before: int, untold: Array) -> None:
        """Add a key scan: from which it was reached, and what only the odometry measured: x, y [m] seen from there."""
        self._before.append(before)
        self._untold.extend(untold.tolist())

    def seen_from_newest(self, count: int) -> Drifts:
        """Of the first `count` key scans."""
        return self.seen_from(len(self._keys) - 1, count)

    def seen_from(self, key: int, count: int) -> Drifts:
        """Of the first `count` key scans, seen from another one than the newest."""
        settings, poses = self._settings, self._keys.poses
        number = np.arange(len(poses))
        distance, towards = self._graph.distances_from(key, len(poses))
        there = towards >= 0
        towards = np.where(there, towards, number)
        edge = np.subtract(distance, distance[towards], where=there, out=np.zeros(len(poses)))
        x, y = (poses[:, :2] - poses[key, :2]).T
        by_turn = edge[:, None] * np.stack([y * y, -x * y, x * x], 1)
        parts = np.concatenate([by_turn, self._untold_edges(towards)], 1)
        while (towards != key).any() and (towards[towards] != towards).any():
            parts = parts + np.where((towards != number)[:, None], parts[towards], 0.0)
            towards = towards[towards]
        parts, distance = parts[:count], distance[:count]
        xx, xy, yy = (settings.drift_turn**2 * parts[:, :3] + _squared(self.share * parts[:, 3:])).T
        along = settings.drift**2 * distance
        covariance = np.stack([xx + along, xy, xy, yy + along], 1).reshape(-1, 2, 2)
        half, apart = (xx + yy) / 2 + along, np.hypot((xx - yy) / 2, xy)
        return Drifts(covariance, np.sqrt(half + apart), settings.drift_turn * np.sqrt(distance))

    def _untold_edges(self, towards: NDArray[np.int64]) -> Array:
        """Of the step from each key scan: u uᵀ / |u| of what only the odometry measured [m], as xx, xy, yy; (n, 3)."""
        poses, before = self._keys.poses, np.array(self._before)
        number = np.arange(len(poses))
        of = np.where(before[number] == towards, number, np.where(before[towards] == number, towards, -1))
        untold = np.where((of >= 0)[:, None], np.array(self._untold).reshape(-1, 2)[of], 0.0)
        heading = poses[before[of], 2]
        c, s = np.cos(heading), np.sin(heading)
        x, y = c * untold[:, 0] - s * untold[:, 1], s * untold[:, 0] + c * untold[:, 1]
        return np.asarray(np.stack([x * x, x * y, y * y], 1) / (np.hypot(x, y) + 1e-9)[:, None])


def _squared(matrices: Array) -> Array:
    """The squares of symmetric matrices, each as xx, xy, yy; shape (n, 3)."""
    xx, xy, yy = matrices.T
    return np.stack([xx * xx + xy * xy, xy * (xx + yy), yy * yy + xy * xy], 1)
