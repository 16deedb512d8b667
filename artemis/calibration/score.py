"""How far odometry with some parameters goes astray, along runs whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from artemis.calibration.fit import Fit, refitted
from artemis.calibration.fitted_run import Run, at_sensor
from artemis.calibration.increments import BIN, Moments
from artemis.calibration.kinematics import Kinematics, dead_reckoned
from artemis.motion.arrays import Array
from artemis.motion.clocks import Clock
from artemis.motion.comparison import best_origin
from artemis.motion.trajectory import Trajectory

FOLDS = 5
"""Most parts into which runs are divided to check each by a fit of the others."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScoredRun:
    """The sensor of one run: truth, and odometry aligned with it; shape (n, 3), (n,)."""

    name: str
    true: Array
    reckoned: Array
    distance: Array
    """Of the truth's sensor until then [m]."""

    @property
    def error(self) -> Array:
        """Distance of both [m], shape (n,)."""
        return np.asarray(np.hypot(*(self.reckoned - self.true)[:, :2].T))


def track(
    run: Run, machine: Kinematics, sensor: tuple[float, float, float], clock: Clock, period: float = BIN
) -> ScoredRun:
    """Odometry of a machine and truth of a run, as means over `period` [s].

    They are aligned by all positions (`best_origin`): how the sensor is turned on the robot does not matter.
    """
    begin, end = clock.shown(run.log.time[[0, -1]])
    moments = Moments.of(run.truth, float(begin), float(end), period)
    own = moments.averaged(clock.shown(run.log.time), at_sensor(dead_reckoned(run.log, machine), sensor))
    true = moments.beside(own)
    distance = np.append(0.0, np.cumsum(np.hypot(*np.diff(own, axis=0)[:, :2].T)))
    odometry = Trajectory(time=moments.time[moments.starts], poses=own)
    aligned = odometry.placed(best_origin(own[:, :2], true[:, :2])).poses
    return ScoredRun(name=run.log.name, true=true, reckoned=aligned, distance=distance)


def checked(found: Fit) -> list[tuple[Run, Kinematics]]:
    """Every run with the machine that the others show; empty for fewer than three runs."""
    if len(found.runs) < 3:
        return []
    folds = min(FOLDS, len(found.runs))
    pairs = []
    for fold in range(folds):
        rest = [run for number, run in enumerate(found.runs) if number % folds != fold]
        machine = refitted(found, rest)
        pairs += [(run, machine) for number, run in enumerate(found.runs) if number % folds == fold]
    return pairs


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Position errors of some runs [m]: mean and largest over all moments, mean at the ends; distance [m]."""

    runs: int
    mean: float
    max: float
    end: float
    distance: float


def score(tracks: Sequence[ScoredRun]) -> Score:
    """In a few numbers; at least one track."""
    errors = [each.error for each in tracks]
    return Score(
        runs=len(tracks),
        mean=float(np.mean(np.concatenate(errors))),
        max=float(max(error.max() for error in errors)),
        end=float(np.mean([error[-1] for error in errors])),
        distance=float(np.mean([each.distance[-1] for each in tracks])),
    )
