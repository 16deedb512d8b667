"""Calibration without a truth: runs that end where they began, or a measured bit beside (Borenstein and Feng 1996).

What the odometry says of the whole run must be what was measured at its end. Runs in both directions tell a wrong
wheelbase from a wrong steering zero. Only three numbers come of a run, so most parameters are held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from artemis.calibration.kinematics import Kinematics, Parameter, altered, dead_reckoned
from artemis.calibration.knowledge import Estimates, Mask, condition_of, covariance_of, estimates_of, hold
from artemis.calibration.wheel_log import WheelLog
from artemis.errors import CalibrationError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array

WALK = (0.004, 0.004, 0.004)
"""By which odometry errs at random: along, across [m/sqrt(m)], turn [rad/sqrt(m)]; an assumption of clean floors."""
MEASURED = (0.003, 0.003, 0.005)
"""And the person who puts the robot on its marks, or measures where it stands [m, m, rad]."""
_STEP = 1e-3
_STEPS = 8


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Closed:
    """A run, and where it truly ended as seen from where it began."""

    log: WheelLog
    end: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y [m], heading [rad] of the rear axle's centre."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClosingFit(Estimates):
    """What the ends of the runs say."""

    before: Array
    """Closing errors by the description: x, y [m], heading [rad], shape (runs, 3)."""
    after: Array


def fit_closing(runs: Sequence[Closed], base: Kinematics, parameters: Sequence[Parameter]) -> ClosingFit:
    """Fit by weighted least squares on the closing errors.

    Raises:
        CalibrationError: fewer than two runs, or they show nothing.
    """
    if len(runs) < 2:
        raise CalibrationError("one run is not enough for closing errors: drive the loop in both directions")
    bands = np.array([each.band for each in parameters])
    weights = [np.linalg.inv(_covariance(dead_reckoned(run.log, base))) for run in runs]
    free = np.ones(len(bands), dtype=bool)
    x = np.zeros(len(bands))

    def errors(values: Array) -> Array:
        names = {each.name: float(value) for each, value in zip(parameters, values, strict=True)}
        return np.array([_closing_error(run, altered(base, names)) for run in runs])

    def normal(values: Array) -> tuple[Array, Array]:
        here, shifts = errors(values), np.diag(_STEP * bands)
        slopes = np.array([errors(values + shift) - here for shift in shifts]) / (_STEP * bands)[:, None, None]
        weighted = np.einsum("pri,rij->prj", slopes, np.array(weights))
        return np.einsum("pri,qri->pq", weighted, slopes), np.einsum("pri,ri->p", weighted, here)

    def solved(values: Array, which: Mask) -> Array:
        prior = np.diag(bands[which] ** -2.0)
        for _ in range(_STEPS):
            information, slope = normal(values)
            values = values.copy()
            values[which] -= np.linalg.solve(
                information[np.ix_(which, which)] + prior, slope[which] + prior @ values[which]
            )
        return values

    x = solved(x, free)
    reasons = hold(normal(x)[0], bands, parameters, free)
    if not free.any():
        raise CalibrationError("the closing errors determine none of the parameters: drive farther, in both directions")
    x = solved(np.where(free, x, 0.0), free)
    information, after = normal(x)[0], errors(x)
    spare = max(after.size - int(free.sum()), 1)
    ratio = max(1.0, float(np.einsum("ri,rij,rj->", after, np.array(weights), after)) / spare)
    covariance = covariance_of(information / ratio, bands, free)
    return ClosingFit(
        base=base,
        machine=altered(base, {each.name: float(value) for each, value in zip(parameters, x, strict=True)}),
        estimates=estimates_of(parameters, x, covariance, free, reasons),
        covariance=covariance,
        condition=condition_of(information, free),
        before=errors(np.zeros(len(bands))),
        after=after,
    )


def _closing_error(run: Closed, machine: Kinematics) -> tuple[float, float, float]:
    x, y, heading = dead_reckoned(run.log, machine)[-1]
    return x - run.end[0], y - run.end[1], wrap(heading - run.end[2])


def _covariance(poses: Array) -> Array:
    """Of the end of a run by `WALK` and `MEASURED`, shape (3, 3)."""
    change, heading = np.diff(poses, axis=0), poses[:-1, 2]
    distance = np.hypot(change[:, 0], change[:, 1])
    c, s, zero = np.cos(heading), np.sin(heading), np.zeros(len(distance))
    rest = poses[-1] - poses[:-1]
    directions = (c, s, zero), (-s, c, zero), (-rest[:, 1], rest[:, 0], np.ones(len(distance)))
    total = np.diag(np.square(MEASURED))
    for sigma, lever in zip(WALK, directions, strict=True):
        levers = np.array(lever)
        total = total + sigma**2 * (levers * distance) @ levers.T
    return np.asarray(total)
