"""How far truth and odometry disagree between one moment and the next, and what of that is noise.

The truth errs at each moment alone, the odometry from each moment to the next: a random walk along the distance driven.
So what the two say of the motion between neighbouring moments differs by noise with a block-tridiagonal covariance,
linear in five variances. Multiplied by the inverse of its Cholesky factor the differences are independent, and least
squares on them is the generalised least squares of whole trajectories with unknown start poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded  # scipy has no types

from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory

Indices: TypeAlias = NDArray[np.intp]

BIN = 0.5
"""Truth within so long is averaged [s]: in less, the jitter of counters and clocks hides what a wheel rolls."""
BEND = 0.2
"""Second derivatives by time are taken over so long to both sides [s], as long as usual filters."""
BAND = 6
"""Diagonals of the covariance at and below the main one."""
NEAR = 0.5
"""Where the truth has no headings, the odometry is laid on its places this far around each [m]."""
NOISES = ("position", "heading", "along", "across", "turn")
"""Of the truth [m, rad]; of the odometry [m/sqrt(m), m/sqrt(m), rad/sqrt(m)]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moments:
    """The truth of one run, averaged over bins of time."""

    time: Array
    """Of every pose of the truth that is used, by its clock [s], shape (m,)."""
    starts: Indices
    """Index into `time` at which each bin begins, shape (n,)."""
    poses: Array
    """Mean x, y [m], heading [rad] of the sensor in each bin, shape (n, 3); headings are nan if none is known."""

    @classmethod
    def of(cls, truth: Trajectory, begin: float, end: float, period: float = BIN) -> Moments:
        """From `begin` to `end` by the truth's clock, in bins of `period` [s]."""
        used = (truth.time >= begin) & (truth.time <= end)
        time, poses = truth.time[used], truth.poses[used]
        starts = np.flatnonzero(np.diff(np.floor((time - begin) / period), prepend=-1.0))
        return cls(time=time, starts=starts, poses=_means(poses, starts))

    def beside(self, reckoned: Array) -> Array:
        """The true poses, shape (n, 3); without headings they get those of `reckoned`, turned onto the places near."""
        if np.isfinite(self.poses[0, 2]):
            return self.poses
        true, own = (each[:, 0] + 1j * each[:, 1] for each in (self.poses, reckoned))
        distance = np.append(0.0, np.cumsum(np.abs(np.diff(own))))
        first, last = (
            np.searchsorted(distance, distance - NEAR, "left"),
            np.searchsorted(distance, distance + NEAR, "right"),
        )
        own, true = own - own.mean(), true - true.mean()
        sums = np.cumsum([own, true, own.conj() * true], axis=1)
        sums = np.column_stack([np.zeros(3), sums])
        of_own, of_true, of_both = sums[:, last] - sums[:, first]
        turn = np.unwrap(np.angle(of_both - of_own.conj() * of_true / (last - first)))
        return np.column_stack([self.poses[:, :2], reckoned[:, 2] + turn])

    def bent(self, time: Array, poses: Array) -> Array:
        """Half the second derivative of such means by time [1/s²]: what a filter changes; shape (n, 3)."""
        sooner, here, later = (self.averaged(time + step, poses) for step in (-BEND, 0.0, BEND))
        return (sooner - 2.0 * here + later) / (2.0 * BEND**2)

    def averaged(self, time: Array, poses: Array) -> Array:
        """Means in the bins of other poses of the sensor, known at `time` [s by the truth's clock]; shape (n, 3)."""
        return _means(np.column_stack([np.interp(self.time, time, column) for column in poses.T]), self.starts)


def _means(poses: Array, starts: Indices) -> Array:
    counts = np.diff(np.append(starts, len(poses)))
    return np.asarray(np.add.reduceat(poses, starts, axis=0) / counts[:, np.newaxis])


def motions(poses: Array) -> Array:
    """What happens between neighbouring poses, as seen from the first of each two: ahead, left [m], turn; (n-1, 3)."""
    change, heading = np.diff(poses, axis=0), poses[:-1, 2]
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([c * change[:, 0] + s * change[:, 1], c * change[:, 1] - s * change[:, 0], change[:, 2]])


def levers(arm: tuple[float, float]) -> Array:
    """What errors of the axle's motion along, across and in turn are at the sensor, shape (3, 3)."""
    ahead, left = arm
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-left, ahead, 1.0]])


def covariances(motion: Array, rolled: Array, arm: tuple[float, float]) -> Array:
    """Covariance of `motions` for each of `NOISES` at unit variance, lower banded; shape (5, BAND, 3 n).

    Args:
        motion: of the sensor.
        rolled: by the driven wheels in each motion [m], shape (n,).
        arm: where the sensor is, seen from the centre of the rear axle: ahead, left [m].
    """
    count = len(motion)
    blocks = np.zeros((5, count, 3, 3))
    beside = np.zeros((5, max(count - 1, 0), 3, 3))  # rows of a motion, columns of the one before
    swing = np.column_stack([motion[:, 1], -motion[:, 0], -np.ones(count)])  # by an error of the heading at its begin
    blocks[0, :, 0, 0] = blocks[0, :, 1, 1] = 2.0
    c, s = np.cos(motion[:-1, 2]), np.sin(motion[:-1, 2])
    beside[0, :, 0, 0] = beside[0, :, 1, 1] = -c
    beside[0, :, 0, 1], beside[0, :, 1, 0] = -s, s
    blocks[1] = swing[:, :, np.newaxis] * swing[:, np.newaxis, :]
    blocks[1, :, 2, 2] += 1.0
    beside[1, :, :, 2] = swing[1:]
    for place, lever in enumerate(levers(arm), 2):
        blocks[place] = rolled[:, np.newaxis, np.newaxis] * np.outer(lever, lever)
    return np.array([_banded(block, other) for block, other in zip(blocks, beside, strict=True)])


def _banded(blocks: Array, beside: Array) -> Array:
    count = len(blocks)
    band = np.zeros((BAND, 3 * count))
    for row in range(3):
        for column in range(3):
            if row >= column:
                band[row - column, column::3] = blocks[:, row, column]
            if count > 1:
                band[3 + row - column, column : 3 * (count - 1) : 3] = beside[:, row, column]
    return band


def factor(covariance: Array) -> Array:
    """Lower banded Cholesky factor. Raises numpy's LinAlgError if it is none."""
    return np.asarray(cholesky_banded(covariance, lower=True))


def whitened(root: Array, columns: Array) -> Array:
    """`columns` (3 n, k) times the inverse of the factor `root`."""
    return np.asarray(solve_banded((BAND - 1, 0), root, columns))
