"""Fits a machine's parameters to runs whose true trajectory is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from scipy.optimize import minimize
from scipy.special import stdtrit  # scipy has no types

from artemis.calibration import increments
from artemis.calibration.fitted_run import STEP, FittedRun, Run, case_of
from artemis.calibration.increments import motions
from artemis.calibration.kinematics import Kinematics, Parameter, altered, dead_reckoned
from artemis.calibration.knowledge import QUANTILE, Estimates, Mask, condition_of, covariance_of, estimates_of, hold
from artemis.errors import CalibrationError
from artemis.motion.clocks import Clock
from artemis.motion.spline import Array

SENSOR = (
    Parameter("sensor ahead", 1.0, "curves"),
    Parameter("sensor left", 1.0, "curves"),
    Parameter("sensor heading", 0.3, "a truth with headings"),
)
"""Where the truth's sensor is, seen from the centre of the rear axle [m, rad]."""
MOUNTED = 0.02
"""A sensor whose place is known better [m, rad] and"""
CHANCE = {1: 6.6, 2: 9.2}
"""may be at zero with a squared distance below this (chi square with so many degrees of freedom, 99 %) is there,"""
ON_THE_AXLE = 1e-5
"""to this [m, rad]. Its place and its heading are looked at one by one: a heading says nothing of the place."""
FAST = len(increments.NOISES)
"""Of the noises; the others are `increments.SLOW`."""
TRIED = 8
"""Noises that are remembered while they are fitted: as many as a derivative takes, and a few."""
ROUNDS = 2
"""Of fitting the parameters and then the noise."""
STEPS = 8
"""Of the least squares, at most."""
PIECE = 12
"""Motions between two moments, that scatter together."""
ROBUST = 10.0
"""Whitened differences beyond count less (soft L1),"""
OUTLIER = 30.0
"""and beyond this not at all."""
FIRST_NOISE = (0.003, 0.005, 0.005, 0.005, 0.005, 0.01, 0.002, 0.002, 0.005)
"""As `increments.NOISES` and `increments.SLOW`,"""
NOISE_BOUNDS = (1e-5, 1.0)
"""each."""

Products: TypeAlias = tuple[Array, Array, Array]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit(Estimates):
    """What the runs say; the sensor's place is the last of the estimates."""

    sensor: tuple[float, float, float]
    runs: tuple[Run, ...]
    clocks: tuple[Clock, ...]
    """Of the truth in each run."""
    noise: tuple[float, ...]
    """Standard deviations, as `increments.NOISES`."""
    left_out: int
    """Motions between two moments that fit nothing."""
    moments: int

    @property
    def knows_heading(self) -> bool:
        """Whether the truth of any run has headings; else nobody knows how its sensor is turned."""
        return any(run.truth.knows_heading for run in self.runs)

    def clock_of(self, run: Run) -> Clock:
        """Of the truth of one of the fitted runs."""
        return self.clocks[self.runs.index(run)]


def fit(runs: Sequence[Run], base: Kinematics, parameters: Sequence[Parameter], on_axle: bool = False) -> Fit:
    """Fit by robust generalised least squares on whole trajectories.

    Args:
        runs: with what is true of them.
        base: the machine as it is described, which the runs were counted with.
        parameters: in which it may differ; of those that look alike to the runs, later ones are held first.
        on_axle: the truth is of the rear axle's centre for sure.

    Raises:
        CalibrationError: the runs show nothing.
        ConfigError: a truth and its run have nothing in common.
    """
    problem = Problem([case_of(run, base) for run in runs], base, (*parameters, *SENSOR))
    bands = problem.bands()
    free = np.ones(len(bands), dtype=bool)
    sensor = slice(len(parameters), len(bands))
    free[-1] = any(run.truth.knows_heading for run in runs)
    x, noise = np.zeros(len(bands)), np.array(FIRST_NOISE)
    for _ in range(ROUNDS):
        problem.weigh(x, noise)
        x = problem.solved(x, free)
        problem.leave_out(x)
        noise = problem.noise_of(x, noise)
    problem.weigh(x, noise)
    x = problem.solved(x, free)
    information = problem.information(x)
    for mount in (slice(sensor.start, sensor.stop - 1), slice(sensor.stop - 1, sensor.stop)):
        free[mount] &= not (on_axle or _may_be_zero(information, bands, x, mount))
    reasons = hold(information, bands, parameters, free)
    if not free[: len(parameters)].any():
        raise CalibrationError("the runs determine none of the parameters: drive farther, and along curves")
    x = problem.solved(np.where(free, x, 0.0), free)
    bands[sensor] = np.where(free[sensor], bands[sensor], ON_THE_AXLE)
    return _result(problem, x, bands, free, reasons, noise)


def refitted(found: Fit, runs: Sequence[Run]) -> Kinematics:
    """The machine as some of the fitted runs alone show it: the same held, the same noise."""
    problem = Problem(
        [case_of(run, found.base, found.clock_of(run)) for run in runs],
        found.base,
        tuple(each.parameter for each in found.estimates),
    )
    x = np.array([each.value for each in found.estimates])
    free = np.array([each.seen for each in found.estimates])
    problem.weigh(x, np.array(found.noise))
    x = problem.solved(x, free)
    return altered(found.base, problem.values(x))


def clocks_of(found: Fit, runs: Sequence[Run]) -> tuple[Clock, ...]:
    """Of the truth of runs that were not fitted, and nothing else, with the fitted machine and sensor."""
    problem = Problem([case_of(run, found.machine) for run in runs], found.machine, SENSOR)
    x = np.array(found.sensor)
    problem.weigh(x, np.array(found.noise))
    problem.solved(x, np.zeros(len(x), dtype=bool))
    return tuple(case.clock for case in problem.cases)


class Problem:
    """Differences of all runs as a function of what is unknown.

    Common to all runs are the machine's parameters and the sensor's place (`x`). Each run's own unknowns, its clock and
    its slow errors (`FittedRun.own`), are eliminated from the normal equations run by run.
    """

    def __init__(self, cases: list[FittedRun], base: Kinematics, names: Sequence[Parameter]) -> None:
        self.cases, self.base, self.names = cases, base, names

    def bands(self) -> Array:
        """Of the common unknowns."""
        return np.array([each.band for each in self.names])

    def differences(self, case: FittedRun, x: Array) -> Array:
        """Of one run, shape (n, 3)."""
        return case.differences(self._reckoned(case, x), self.sensor(x))

    def _reckoned(self, case: FittedRun, x: Array) -> Array:
        return dead_reckoned(case.run.log, altered(self.base, self.values(x)))

    def values(self, x: Array) -> dict[str, float]:
        """By the names of the parameters."""
        return {parameter.name: float(value) for parameter, value in zip(self.names, x, strict=True)}

    def sensor(self, x: Array) -> tuple[float, float, float]:
        """Ahead, left [m], heading [rad]."""
        ahead, left, heading = x[-3:]
        return float(ahead), float(left), float(heading)

    def columns(self, case: FittedRun, x: Array) -> Array:
        """A run's differences, their derivatives by the common unknowns and by its own; shape (3 n, 1 + unknowns)."""
        reckoned, shifts = self._reckoned(case, x), STEP * self.bands()
        here = case.differences(reckoned, self.sensor(x))
        columns = [here.ravel()]
        for place, shift in enumerate(shifts):
            there = x.copy()
            there[place] += shift
            moved = self._reckoned(case, there) if place < len(x) - len(SENSOR) else reckoned
            columns.append((case.differences(moved, self.sensor(there)) - here).ravel() / shift)
        return np.column_stack([*columns, case.own_slopes(reckoned, self.sensor(x))])

    # ------------------------------------------------------------------------------------------------ least squares

    def weigh(self, x: Array, noise: Array) -> None:
        """Make each run's weights of the noise."""
        for case in self.cases:
            case.true = motions(case.moments.beside(case.averaged(self._reckoned(case, x), self.sensor(x))))
            case.parts = increments.covariances(case.true, case.rolled(), self.sensor(x)[:2])
            case.root, case.prior = increments.factor(case.covariance(noise[:FAST])), case.precision(noise[FAST:])

    def leave_out(self, x: Array) -> None:
        """Find the motions that fit nothing."""
        white = [increments.whitened(case.root, self.differences(case, x).reshape(-1, 1))[:, 0] for case in self.cases]
        std = 1.4826 * float(np.median(np.abs(np.concatenate(white))))
        for case, each in zip(self.cases, white, strict=True):
            case.lost = np.abs(each).reshape(-1, 3).max(axis=1) > OUTLIER * std

    def solved(self, x: Array, free: Mask) -> Array:
        """The unknowns that fit best, those that are not free as they are: Gauss-Newton, outliers weighted less."""
        prior, taken = np.diag(self.bands()[free] ** -2.0), np.append(True, free)
        for _ in range(STEPS):
            normal, gains = np.zeros((1 + int(free.sum()),) * 2), []
            for case in self.cases:
                white = increments.whitened(case.root, self.columns(case, x))
                white /= (1.0 + (white[:, :1] / ROBUST) ** 2) ** 0.25
                common, own = white[:, : 1 + len(x)], white[:, 1 + len(x) :]
                common[:, 0] -= own @ case.own + common[:, 1:][:, free] @ x[free]
                part, gain, _ = eliminated(products(common[:, taken], own), case.prior)
                normal += part
                gains.append(gain)
            inverse = np.linalg.inv(normal[1:, 1:] + prior)
            old, x = x, x.copy()
            x[free] = -inverse @ normal[1:, 0]
            for case, gain in zip(self.cases, gains, strict=True):
                case.own = -gain @ np.append(1.0, x[free])
            if np.all(np.abs(x - old)[free] < 0.02 * np.sqrt(np.diag(inverse))):
                break
        return x

    def information(self, x: Array) -> Array:
        """Normal matrix of the common unknowns, without their bands."""
        return self._gram([self.columns(case, x)[:, 1:] for case in self.cases])

    def _gram(self, columns: list[Array]) -> Array:
        parts = []
        for case, each in zip(self.cases, columns, strict=True):
            white = increments.whitened(case.root, each)
            count = white.shape[1] - len(case.own)
            parts.append(eliminated(products(white[:, :count], white[:, count:]), case.prior)[0])
        return np.asarray(np.sum(parts, axis=0))

    def bends(self, x: Array, bands: Array, free: Mask) -> Array:
        """What is fitted errs by what is held also in second order: its second moment, shape (free, free).

        A parameter h that is held at 0 and normal with its band b moves the others by half the curvature times h², and
        the mean of h⁴ is 3 b⁴.
        """
        inner = np.linalg.inv(self.information(x)[np.ix_(free, free)] + np.diag(bands[free] ** -2.0))
        total, unshifted = np.zeros_like(inner), [self.columns(case, x) for case in self.cases]
        for place in np.flatnonzero(~free):
            step, columns = np.zeros(len(x)), [each.copy() for each in unshifted]
            step[place] = bands[place]
            for case, each in zip(self.cases, columns, strict=True):
                shifted = [self.differences(case, x + sign * step).ravel() for sign in (1.0, -1.0)]
                each[:, 0] = (shifted[0] + shifted[1]) / 2.0 - each[:, 0]
            shift = inner @ self._gram(columns)[1:, 0][free]
            total += 3.0 * np.outer(shift, shift)
        return total

    def excess(self, x: Array, bands: Array, free: Mask) -> Array:
        """Factors of the standard deviations: pieces of the runs may scatter more than the noise explains.

        The cluster-robust covariance of Liang and Zeger (1986, Biometrika 73:13) of pieces that are longer than noise
        is correlated, where it is the larger one; and Student's quantile for as few pieces.
        """
        normal, scores = np.diag(bands[free] ** -2.0), []
        for case in self.cases:
            white = increments.whitened(case.root, self.columns(case, x))
            common, own = white[:, 1 : 1 + len(x)][:, free], white[:, 1 + len(x) :]
            rest = common - own @ np.linalg.solve(own.T @ own + case.prior, own.T @ common)
            normal += common.T @ rest
            scores.append(np.add.reduceat(rest * white[:, :1], np.arange(0, len(white), 3 * PIECE)))
        pieces, inverse = np.concatenate(scores), np.linalg.inv(normal)
        freedom = max(len(pieces) - len(inverse), 1.0)
        scatter = len(pieces) / freedom * inverse @ pieces.T @ pieces @ inverse
        larger = np.sqrt(np.maximum(1.0, np.diag(scatter) / np.diag(inverse)))
        return np.asarray(larger * stdtrit(freedom, 0.975) / QUANTILE)

    def blurred(self, x: Array, bands: Array, free: Mask) -> Array:
        """What is fitted errs where truths were filtered, which nobody says: its covariance, shape (free, free)."""
        inner = np.linalg.inv(self.information(x)[np.ix_(free, free)] + np.diag(bands[free] ** -2.0))
        total, columns = np.zeros_like(inner), [self.columns(case, x) for case in self.cases]
        for filtered in self.cases:
            for case, each in zip(self.cases, columns, strict=True):
                each[:, 0] = case.filtered(self._reckoned(case, x), self.sensor(x)) if case is filtered else 0.0
            shift = inner @ self._gram(columns)[1:, 0][free]
            total += np.outer(shift, shift)
        return total

    def noise_of(self, x: Array, first: Array) -> Array:
        """The noise by restricted maximum likelihood of the differences, linear at `x` (Harville 1977)."""
        columns = [self.columns(case, x) for case in self.cases]
        for case, each in zip(self.cases, columns, strict=True):
            each[:, 0] -= each[:, 1:] @ np.append(x, case.own)
        prior, count = np.diag(self.bands() ** -2.0), 1 + len(x)

        @lru_cache(TRIED)  # derivatives by one kind of noise need the other kind's part again and again
        def weighed(*fast: float) -> list[tuple[Products, float]]:
            found = []
            for case, each in zip(self.cases, columns, strict=True):
                root = increments.factor(case.covariance(np.array(fast)))
                white = increments.whitened(root, each)
                found.append((products(white[:, :count], white[:, count:]), float(np.sum(np.log(root[0])))))
            return found

        @lru_cache(TRIED)
        def priors(*slow: float) -> list[tuple[Array, float]]:
            precisions = [case.precision(np.array(slow)) for case in self.cases]
            return [(each, np.linalg.slogdet(each)[1]) for each in precisions]

        def unlikeliness(logs: Array) -> float:
            noise, total, normal = np.exp(logs).tolist(), 0.0, np.zeros((count, count))
            pairs = zip(weighed(*noise[:FAST]), priors(*noise[FAST:]), strict=True)
            for (white, log_root), (precision, log_precision) in pairs:
                part, _, log_own = eliminated(white, precision)
                normal += part
                total += log_root + (log_own - log_precision) / 2.0
            inner = normal[1:, 1:] + prior
            fitted = normal[0, 1:] @ np.linalg.solve(inner, normal[1:, 0])
            return float(total + (np.linalg.slogdet(inner)[1] + normal[0, 0] - fitted) / 2.0)

        options = {"maxiter": 25, "ftol": 1e-7}
        bounds = [np.log(NOISE_BOUNDS)] * len(first)
        found = minimize(unlikeliness, np.log(first), method="L-BFGS-B", bounds=bounds, options=options)
        return np.asarray(np.exp(found.x))


def products(common: Array, own: Array) -> Products:
    """Of two sets of white columns: of the first with itself, of the second with the first, of the second."""
    return common.T @ common, own.T @ common, own.T @ own


def eliminated(white: Products, prior: Array) -> tuple[Array, Array, float]:
    """Of least squares with two sets of white columns: normal matrix of the first without the second.

    Args:
        white: of the columns.
        prior: precision of the values of the second set.

    Returns:
        That matrix; the values of the second set that fit each column of the first; the logarithm of the determinant of
        the second's own normal matrix with its prior.
    """
    common, mixed, own = white
    normal = own + prior
    gain = np.asarray(np.linalg.solve(normal, mixed), dtype=np.float64)
    return common - mixed.T @ gain, gain, float(np.linalg.slogdet(normal)[1])


def _may_be_zero(information: Array, bands: Array, x: Array, mount: slice) -> bool:
    """Whether the sensor may have exactly the rear axle's centre, or heading: no chance mounts one there so well."""
    covariance = np.linalg.inv(information + np.diag(bands**-2.0))[mount, mount]
    exact = np.all(np.sqrt(np.diag(covariance)) < MOUNTED)
    return bool(exact and x[mount] @ np.linalg.solve(covariance, x[mount]) < CHANCE[len(covariance)])


def _result(problem: Problem, x: Array, bands: Array, free: Mask, reasons: Sequence[str], noise: Array) -> Fit:
    information = problem.information(x)
    covariance = covariance_of(information, bands, free)
    covariance[np.ix_(free, free)] *= np.multiply.outer(*[problem.excess(x, bands, free)] * 2)
    covariance[np.ix_(free, free)] += problem.bends(x, bands, free) + problem.blurred(x, bands, free)
    known = any(case.run.truth.knows_heading for case in problem.cases)
    mounted = "" if free[len(reasons)] else "the truth is of the rear axle's centre"
    turned = "the truth's headings are the robot's" if known else "needs a truth with headings"
    said = [*reasons, mounted, mounted, "" if free[-1] else turned]
    return Fit(
        base=problem.base,
        machine=altered(problem.base, problem.values(x)),
        estimates=estimates_of(problem.names, x, covariance, free, said),
        covariance=covariance,
        condition=condition_of(information, free),
        sensor=problem.sensor(x),
        runs=tuple(case.run for case in problem.cases),
        clocks=tuple(case.clock for case in problem.cases),
        noise=tuple(noise.tolist()),
        left_out=sum(int(case.lost.sum()) for case in problem.cases),
        moments=sum(len(case.true) for case in problem.cases),
    )
