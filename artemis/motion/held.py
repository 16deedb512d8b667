"""What a laser scanner has seen twice and shows no more: thin things return a beam in few of the scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from artemis.motion.arrays import Array
from artemis.motion.beams import SAME
from artemis.motion.movers import NOTHING
from artemis.motion.points import points_from
from artemis.values import Pose

HELD = 0.5
"""It is held for so long since it was lost, or one beam showed it last [s]."""


class Held:
    """Points in the frame of the rear axle, x ahead and y left [m], shape (2, n)."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """As if nothing had been seen."""
        self.points, self._until = NOTHING, np.zeros(0)

    def move(self, moved: Pose) -> None:
        """The robot has moved, from where it was [m, rad]."""
        self.points = points_from(moved, self.points)

    def add(self, points: Array, now: float) -> None:
        """Hold what the newest scan has lost, at a time [s]."""
        self.points = np.concatenate((self.points, points), 1)
        self._until = np.concatenate((self._until, np.full(points.shape[1], now + HELD)))

    def judge(self, ranges: Array, far: Array, twice: NDArray[np.bool_], beside: Array, now: float) -> None:
        """Let go what is too old, is seen twice again, or has made way for something farther.

        Args:
            ranges: what the beam through each point shows [mm]; 0: nothing, or there is no beam.
            far: distance of each from the scanner [mm].
            twice: whether that beam shows it, or another thing, for the second time.
            beside: the least that this beam and those next to it show [mm]; 0: one of them shows nothing.
            now: time of the tick [s].
        """
        same = (ranges > 0.0) & (np.abs(ranges - far) < SAME)
        self._until[same] = now + HELD
        stays = ((self._until > now) & ~(twice & same) & (beside < far + SAME)).nonzero()[0]
        self.points, self._until = self.points.take(stays, 1), self._until.take(stays)
