"""The reference that a calibration has to match: three parameters by plain least squares of whole trajectories."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares  # scipy has no types

from artemis.calibration.fitted_run import Run
from artemis.calibration.kinematics import Kinematics, altered, dead_reckoned
from artemis.calibration.machine_file import Machine, log_from_table
from artemis.calibration.score import score, track
from artemis.mission.loading import load_model
from artemis.motion.clocks import RUN
from artemis.motion.spline import Array

DATA = Path(__file__).parents[1] / "data" / "odometry"
BASE = load_model(DATA / "tricycle.yaml", Machine).kinematics
ALIGNED = 5
"""Rows at the start, at standstill, by which the odometry is aligned with the truth."""


def real_runs(*names: str) -> list[Run]:
    """Of the tricycle, by the names of their files without their ends."""
    return [_real_run(name) for name in names]


@cache
def _real_run(name: str) -> Run:
    file = DATA / f"{name}.csv.gz"
    machine = load_model(DATA / "tricycle.yaml", Machine)
    log, truth = log_from_table(gzip.decompress(file.read_bytes()).decode(), file.name, machine)
    assert truth is not None
    return Run(log=log, truth=truth, one_clock=True)


def plain_fit(runs: Sequence[Run]) -> Kinematics:
    """Distance, steering zero and wheelbase by which the positions of the whole runs agree best."""

    def machine(values: Array) -> Kinematics:
        return altered(BASE, dict(zip(("distance", "zero", "wheelbase"), values.tolist(), strict=True)))

    def errors(values: Array) -> Array:
        return np.concatenate([_errors(run, machine(values)) for run in runs])

    return machine(least_squares(errors, np.zeros(3), x_scale=[0.01, 0.01, 0.01]).x)


def _errors(run: Run, machine: Kinematics) -> Array:
    own, true = dead_reckoned(run.log, machine), run.truth.poses
    turn = np.mean((true - own)[:ALIGNED, 2])
    path = (own[:, 0] + 1j * own[:, 1]) * np.exp(1j * turn)
    error = path - (true[:, 0] + 1j * true[:, 1])
    error -= error[:ALIGNED].mean()
    return np.concatenate([error.real, error.imag])


def mean_error(runs: Sequence[Run], machine: Kinematics, sensor: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> float:
    """Of the odometry [m]."""
    return score([track(run, machine, sensor, RUN) for run in runs]).mean
