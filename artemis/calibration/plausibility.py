"""Whether runs and their truth fit the described machine at all; if not, which wrong sign or unit explains it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import degrees, inf, radians

import numpy as np

from artemis.calibration.fitted_run import Run, case_of
from artemis.calibration.kinematics import Kinematics, dead_reckoned
from artemis.calibration.wheel_log import WheelLog
from artemis.errors import CalibrationError, ConfigError

PIECE = 20.0
"""Runs are compared in pieces of so many wheelbases: longer ones diverge by small errors, too."""
UNEXPLAINED = 0.1
"""Share of the truth's variance in a piece that a described machine leaves at most, wrong by several of its bands."""
BETTER = 4.0
"""Another sign or unit explains the runs if it leaves so many times less."""
CANDIDATES = (
    ("the sign of the steering angle (or of the distance) is inverted", -1.0, 1.0),
    ("the steering angles are in degrees, but are declared as radians", radians(1.0), 1.0),
    ("the steering angles are in radians, but are declared as degrees", degrees(1.0), 1.0),
    ("the steering angles are in degrees with inverted sign, but are declared as radians", -radians(1.0), 1.0),
    ("the steering angles are in radians with inverted sign, but are declared as degrees", -degrees(1.0), 1.0),
    ("the distances are in millimetres, but are declared as metres", 1.0, 1e-3),
    ("the distances are in metres, but are declared as millimetres", 1.0, 1e3),
)
"""What may be wrong, and factors of angles and distances that correct it."""


def refuse_implausible(runs: Sequence[Run], base: Kinematics) -> None:
    """Compare the odometry of the described machine with the truth, and that of other signs and units.

    Raises:
        CalibrationError: the described machine explains nothing; names the likely sign or unit.
        ConfigError: truth and runs have no time in common.
    """
    try:
        described = unexplained(runs, base)
    except ConfigError as error:
        described, reason = inf, error
    if described < UNEXPLAINED:
        return
    shares = [(_tried(runs, base, *factors), words) for words, *factors in CANDIDATES]
    share, words = min(shares)
    if share < min(UNEXPLAINED, described / BETTER):
        raise CalibrationError(
            f"the odometry does not match the true poses as described, but does if {words}: correct that, and repeat"
        )
    if described == inf:
        raise reason


def refuse_unexplained(runs: Sequence[Run], machine: Kinematics) -> None:
    """After the fit.

    Raises:
        CalibrationError: the fitted machine does not explain the runs.
    """
    if (share := unexplained(runs, machine)) > UNEXPLAINED:
        raise CalibrationError(
            f"the fit does not explain the runs: {min(share, 1.0):.0%} of the true motion remains unexplained. Check "
            "that each truth belongs to its run, and columns, units and signs"
        )


def unexplained(runs: Sequence[Run], machine: Kinematics) -> float:
    """Share of the truth's variance that the odometry leaves, in pieces that are each aligned with the truth.

    Raises:
        ConfigError: truth and runs have no time in common.
    """
    left, variance = 0.0, 0.0
    for run in runs:
        case = case_of(run, machine)
        odometry = case.averaged(dead_reckoned(run.log, machine), (0.0, 0.0, 0.0))
        true, own = (poses[:, 0] + 1j * poses[:, 1] for poses in (case.moments.poses, odometry))
        rolled = np.append(0.0, np.cumsum(np.abs(np.diff(true))))
        for piece in np.split(np.arange(len(true)), np.flatnonzero(np.diff(rolled // (PIECE * machine.wheelbase))) + 1):
            a, b = true[piece] - true[piece].mean(), own[piece] - own[piece].mean()
            turned = b * np.exp(1j * np.angle(np.vdot(b, a)))
            left += float(np.sum(np.abs(a - turned) ** 2))
            variance += float(np.sum(np.abs(a) ** 2))
    return left / variance if variance else 0.0


def _tried(runs: Sequence[Run], base: Kinematics, steering: float, distance: float) -> float:
    try:
        return unexplained([replace(run, log=_scaled(run.log, steering, distance)) for run in runs], base)
    except ConfigError:
        return inf


def _scaled(log: WheelLog, steering: float, distance: float) -> WheelLog:
    return replace(
        log,
        distance_left=distance * log.distance_left,
        distance_right=distance * log.distance_right,
        steering_left=steering * log.steering_left,
        steering_right=steering * log.steering_right,
    )
