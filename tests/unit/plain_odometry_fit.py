"""The reference that a calibration has to match: three parameters by plain least squares of whole trajectories.

Run with `.venv/bin/python tests/unit/plain_odometry_fit.py`: what docs/calibration.md says of real runs (10 minutes).
With the folder `data/tricyc` of the published runs (github.com/sousarbarb/optiodom), how both do on all other shapes.
"""

from __future__ import annotations

import csv
import gzip
import sys
from collections.abc import Sequence
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d  # scipy has no types
from scipy.optimize import least_squares

from artemis.calibration.fit import Fit, fit
from artemis.calibration.fitted_run import Run
from artemis.calibration.kinematics import ONE_WHEEL, Kinematics, altered, dead_reckoned
from artemis.calibration.machine_file import Machine, log_from_table
from artemis.calibration.score import score, track
from artemis.mission.loading import load_model
from artemis.motion.arrays import Array
from artemis.motion.clocks import RUN, Clock, estimate_clock
from artemis.motion.trajectory import Trajectory

DATA = Path(__file__).parents[1] / "data" / "odometry"
MACHINE = load_model(DATA / "tricycle.yaml", Machine)
BASE = MACHINE.kinematics
CIRCLES = tuple(f"1401202114{number}_run-0{run}" for number in (15, 40, 54) for run in (1, 2))
FREE = ("free/140120211525_run-01", "free/140120211611_run-01")
SPLITS = [fitted for count in range(2, 6) for fitted in combinations(CIRCLES, count)]
ALIGNED = 5
"""Rows at the start, at standstill, by which the odometry is aligned with the truth."""
RATE = 1.264
"""So many times as fast as the odometry's is the clock of the motion capture, in each run where both can be told."""
ON_AXLE = (0.0, 0.0, 0.0)


def real_runs(*names: str) -> list[Run]:
    """Of the tricycle, by the names of their files without their ends."""
    return [_real_run(name) for name in names]


@cache
def _real_run(name: str) -> Run:
    file = DATA / f"{name}.csv.gz"
    return _run(gzip.decompress(file.read_bytes()).decode(), file.name)


def _run(text: str, name: str) -> Run:
    log, truth = log_from_table(text, name, MACHINE)
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


def mean_error(runs: Sequence[Run], machine: Kinematics, sensor: tuple[float, float, float] = ON_AXLE) -> float:
    """Of the odometry [m], by the truth's clock and aligned as `artemis report --truth` does, whatever was fitted."""
    return score([track(corrected(run), machine, sensor, RUN) for run in runs]).mean


@cache
def corrected(run: Run) -> Run:
    """With the truth at the times of the odometry's clock."""
    return _by_clock(run, clock_of(run))


def clock_of(run: Run) -> Clock:
    """Of the truth, by the motions of the odometry before any fit."""
    odometry = Trajectory(time=run.log.time, poses=dead_reckoned(run.log, BASE))
    return estimate_clock(odometry, run.truth, one_point=False)


def _by_clock(run: Run, clock: Clock) -> Run:
    poses = [np.interp(clock.shown(run.log.time), run.truth.time, column) for column in run.truth.poses.T]
    return Run(log=run.log, truth=Trajectory(time=run.log.time, poses=np.column_stack(poses)), one_clock=True)


def rates() -> list[tuple[float, float]]:
    """Of each run of `CIRCLES` and `FREE`: how many times as fast the truth's clock was taken to be, and is."""
    with (DATA / "clocks.csv").open() as file:
        taken = {row["run"]: float(row["truth_s"]) / float(row["odometry_s"]) for row in csv.DictReader(file)}
    return [(taken[name], taken[name] * (1 + clock_of(run).drift)) for name in taken for run in real_runs(name)]


def main(published: Path | None) -> None:
    """Print how both fits do on runs that they have not seen."""
    found = {fitted: fit(real_runs(*fitted), BASE, ONE_WHEEL) for fitted in (*SPLITS, CIRCLES)}
    errors = []
    for fitted in SPLITS:
        runs, others = real_runs(*fitted), real_runs(*(name for name in CIRCLES if name not in fitted))
        plains = [mean_error(others, plain_fit(each)) for each in (runs, [corrected(run) for run in runs])]
        errors.append([mean_error(others, found[fitted].machine, found[fitted].sensor), *plains])
    _tell(f"{len(SPLITS)} splits of the circles", *np.mean(errors, axis=0))
    ours, plain, _ = np.array(errors).T
    print(f"of the error of the plain fit at least {np.min(ours / plain):.0%}, at most {np.max(ours / plain):.0%}")
    circles = real_runs(*CIRCLES)
    plain_fits = plain_fit(circles), plain_fit([corrected(run) for run in circles])
    _print("circles to two free runs", [corrected(run) for run in real_runs(*FREE)], found[CIRCLES], *plain_fits)
    if published is not None:
        files = [file for shape in ("free", "square") for file in sorted(published.glob(f"{shape}/*/*_run-??.csv"))]
        _print(f"circles to {len(files)} other runs", [_published(file) for file in files], found[CIRCLES], *plain_fits)


def _print(what: str, runs: Sequence[Run], found: Fit, *plains: Kinematics) -> None:
    machines = (found.machine, found.sensor), *((plain, ON_AXLE) for plain in plains)
    _tell(what, *(score([track(run, *each, RUN) for run in runs]).mean for each in machines))


def _tell(what: str, ours: float, plain: float, by_clock: float) -> None:
    words = f"{100 * ours:.2f} cm, plain {100 * plain:.2f} cm, plain by the truth's clock {100 * by_clock:.2f} cm"
    print(f"{what}: {words}", flush=True)


def _published(file: Path) -> Run:
    """A run whose clock drifts as its metadata and `RATE` say, with the offset at which the turns agree best."""
    run = _run(file.read_text(encoding="utf-8-sig"), file.stem)
    with next(file.parent.glob("*_metadata.csv")).open() as lines:
        facts = {row[0]: row[1:] for row in csv.reader(lines) if row}
    begin, end, lasted = (float(facts[name][int(file.stem[-1]) - 1]) for name in ("gt_ti", "gt_tf", "odo_tf"))
    middle, own = float(run.log.time.mean()), _turns(dead_reckoned(run.log, BASE))

    def at(offset: float) -> Run:
        return _by_clock(run, Clock(offset=offset, drift=RATE * lasted / (end - begin) - 1.0, middle=middle))

    return min(map(at, np.arange(-2.0, 2.0, 0.05)), key=lambda run: float(np.sum((_turns(run.truth.poses) - own) ** 2)))


def _turns(poses: Array) -> Array:
    return np.asarray(gaussian_filter1d(np.diff(poses[:, 2]), 4.0))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
