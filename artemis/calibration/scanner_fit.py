"""Where a scanner sits on a robot, by what it did while the robot moved: hand-eye calibration in the plane.

For each piece of a drive, motion A of the robot, motion B of the scanner and mounting X hold A X = X B (Shiu and Ahmad,
IEEE Transactions on Robotics and Automation 5(1), 1989). Straight pieces tell the heading, curves x and y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from artemis.errors import CalibrationError
from artemis.mapping.se2 import Array, between, compose, effort
from artemis.motion.arrays import wrapped

PIECE = 0.5
"""Of a drive [m, a turn by 1 rad counts as half a metre]."""
BLOCK, LEAST_BLOCKS = 5, 7
"""Pieces whose errors may belong together, and how many such blocks a drive has to have."""
SYSTEMATIC = np.array([0.001, 0.0015, math.radians(0.05)])
"""What never averages out, standard deviations [m, rad]: ranges that are wrong by up to 30 mm, depending on the
distance, and wheels that are wrong differently to the left and to the right; as simulated drives showed."""
PLAUSIBLE = np.array([0.05, 0.05, math.radians(2.0)])
"""Errors of the odometry without any run: shares of its distances and its turns, and a turn for each metre [rad/m]."""
FLOOR = np.array([0.002, 0.002, math.radians(0.05)])
"""Nobody knows the motions of pieces better than so [m, rad]."""
WIDEST, WIDEST_TURN = 0.03, math.radians(1.5)
"""Of the half of a 95 % interval: beyond, the drive does not show the value [m, rad]."""
TURNED = math.radians(90.0)
"""A drive that turns less to either side has no curves to speak of."""
NORMAL = 1.96
"""Quantile of the 95 % interval."""
_NAMES = ("x", "y", "heading")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MountingFit:
    """What a drive says."""

    mounting: Array
    """Of the scanner on the robot: x, y [m], heading [rad]."""
    half_width: Array
    """Of the 95 % interval of each."""
    odometry: Array
    """Errors of the odometry that were found beside it, as of `PLAUSIBLE`."""
    pieces: int
    driven: float
    """[m]."""
    turned: tuple[float, float]
    """In all to the left, and to the right [rad]."""


def fit_mounting(odometry: Array, scanner: Array) -> MountingFit:
    """Fit the mounting, and with it how far the odometry is wrong.

    Args:
        odometry: poses of the robot by its wheels, shape (n, 3).
        scanner: poses of the scanner at the same times, in a frame of its own, shape (n, 3).

    Raises:
        CalibrationError: the drive does not show all of it; which, and what it lacks.
    """
    drive = _Drive(odometry, scanner)
    if min(drive.turned) < TURNED / 3 and sum(drive.turned) < TURNED:
        raise CalibrationError(f"x and y of the scanner are not observable on this drive: {drive.lacks()}")
    robust = least_squares(drive.residuals, drive.guess(), loss="soft_l1")
    weights = (1.0 + robust.fun**2) ** -0.25
    found = least_squares(lambda unknown: weights * drive.residuals(unknown), robust.x)
    varied = _deviations(found.fun, found.jac, len(drive.first))[:3]
    half = np.hypot(varied, SYSTEMATIC * NORMAL)
    wide = half > (WIDEST, WIDEST, WIDEST_TURN)
    if wide.any():
        names = " and ".join(name for name, each in zip(_NAMES, wide, strict=True) if each)
        raise CalibrationError(f"{names} of the scanner are not observable on this drive: {drive.lacks()}")
    x, y, heading = found.x[:3]
    return MountingFit(
        mounting=np.array([x, y, float(wrapped(heading))]),
        half_width=half,
        odometry=found.x[3:],
        pieces=len(drive.first),
        driven=drive.driven,
        turned=drive.turned,
    )


class _Drive:
    def __init__(self, odometry: Array, scanner: Array) -> None:
        self._motions = between(odometry[:-1], odometry[1:])
        driven = np.concatenate([[0.0], np.cumsum(effort(self._motions))])
        ends = np.unique(np.searchsorted(driven, np.arange(0.0, driven[-1], PIECE)))
        self.first, self._last = ends[:-1], ends[1:]
        if len(self.first) < BLOCK * LEAST_BLOCKS:
            raise CalibrationError(
                f"the drive is too short: {driven[-1]:.1f} m, turns counted by half a metre for each radian; "
                f"expected {BLOCK * LEAST_BLOCKS * PIECE:.0f} m or more"
            )
        self._seen = between(scanner[self.first], scanner[self._last])
        self.driven = float(np.abs(self._motions[:, 0]).sum())
        turns = self._motions[:, 2]
        self.turned = float(turns[turns > 0].sum()), float(-turns[turns < 0].sum())
        self._scale = FLOOR.copy()
        rough = self._off(self.guess())
        self._scale = np.maximum(FLOOR, 1.4826 * np.median(np.abs(rough), axis=0))

    def lacks(self) -> str:
        """What it would need."""
        left, right = (math.degrees(each) for each in self.turned)
        return (
            f"in {self.driven:.1f} m it turned by {left:.0f} degrees to the left and {right:.0f} to the right; drive "
            "straight pieces, and tight curves to both sides, a full circle or more each"
        )

    def guess(self) -> Array:
        """A linear solution, with odometry that is right: shape (6,)."""
        moved, seen = self._pieces(np.zeros(3)), self._seen
        c, s = np.cos(moved[:, 2]) - 1.0, np.sin(moved[:, 2])
        rows = [
            np.column_stack([c, -s, -seen[:, 0], seen[:, 1]]),
            np.column_stack([s, c, -seen[:, 1], -seen[:, 0]]),
        ]
        right = -np.concatenate([moved[:, 0], moved[:, 1]])
        x, y, a, b = np.linalg.lstsq(np.concatenate(rows), right, rcond=None)[0].tolist()
        return np.array([x, y, math.atan2(b, a), 0.0, 0.0, 0.0])

    def residuals(self, unknown: Array) -> Array:
        """In standard deviations: x, y, heading of each piece, then what is plausible of the odometry."""
        return np.concatenate([(self._off(unknown) / self._scale).reshape(-1), unknown[3:] / PLAUSIBLE])

    def _off(self, unknown: Array) -> Array:
        """Motions of the scanner as they follow from those of the robot, less those that were seen, shape (n, 3)."""
        mounting = unknown[:3]
        back = between(mounting, np.zeros(3))
        off = compose(back, compose(self._pieces(unknown[3:]), mounting)) - self._seen
        return np.column_stack([off[:, :2], wrapped(off[:, 2])])

    def _pieces(self, wrong: Array) -> Array:
        """Motions of the robot by odometry that errs so, shape (n, 3)."""
        motions = self._motions * (1.0 + wrong[[0, 0, 1]])
        motions[:, 2] += wrong[2] * self._motions[:, 0]
        heading = np.concatenate([[0.0], np.cumsum(motions[:, 2])])
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        steps = np.column_stack([c * motions[:, 0] - s * motions[:, 1], s * motions[:, 0] + c * motions[:, 1]])
        places = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        poses = np.column_stack([places, heading])
        return between(poses[self.first], poses[self._last])


def _deviations(residuals: Array, jacobian: Array, pieces: int) -> Array:
    """Halves of the 95 % intervals of the unknowns: the larger of two.

    From the assumed standard deviations, which tells what a drive does not show; and from how much the residuals vary,
    where the errors of a block of pieces count as one: they need be neither independent nor of the standard deviation
    that was assumed (Liang and Zeger, Biometrika 73(1), 1986).
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    scores = (jacobian * residuals[:, None])[: 3 * pieces]
    blocks = np.add.reduceat(scores, np.arange(0, 3 * pieces, 3 * BLOCK))
    freedom = max(len(blocks) - len(inverse), 3)
    varied = inverse @ (blocks.T @ blocks) @ inverse * (len(blocks) / freedom)
    quantile = float(student.ppf(0.975, freedom))
    return np.asarray(np.maximum(NORMAL * np.sqrt(np.diag(inverse)), quantile * np.sqrt(np.diag(varied))))
