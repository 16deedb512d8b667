"""Fits a machine's parameters to runs whose true trajectory is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import chdtri, stdtrit  # scipy has no types

from artemis.calibration.fitted_run import CLOCK, STEP, FittedRun, Run, case_of
from artemis.calibration.kinematics import Kinematics, Parameter, altered, dead_reckoned
from artemis.calibration.knowledge import QUANTILE, Estimates, Mask, condition_of, covariance_of, estimates_of, hold
from artemis.errors import CalibrationError
from artemis.motion.arrays import Array
from artemis.motion.clocks import Clock

SENSOR = (
    Parameter("sensor ahead", 1.0, "curves"),
    Parameter("sensor left", 1.0, "curves"),
    Parameter("sensor heading", 0.3, "a truth with headings"),
)
"""Where the truth's sensor is, seen from the centre of the rear axle [m, rad]."""
KNOWN = 0.02
"""A sensor whose place (or heading) the runs show to this standard deviation [m, rad],"""
CHANCE = {1: 6.6, 2: 9.2}
"""and whose squared distance from zero is below the 99 % quantile of chi square (by degrees of freedom), is assumed to
be at the rear axle's centre (to have the robot's heading). Both are tested separately."""
MOUNTING = (0.003, 0.003, 0.005)
"""How accurately such a sensor is assumed to be mounted [m, m, rad], one standard deviation: at most, the runs may show
it better;"""
EXACT = 1e-5
"""and where the caller knows that the truth is of that centre [m, rad]."""
ROUNDS = 6
"""Of fitting parameters and noise, at most: as long as more outliers are found."""
STEPS = 8
"""Of Gauss-Newton, at most: until nothing changes by more than a fiftieth of its standard deviation, and no clock by"""
SETTLED = (1e-4, 1e-6)
"""more than this [s, s/s]."""
PIECE = 12
"""Motions in a cluster of the cluster-robust covariance: 6 s."""
BY_CHANCE = 1e-3
"""Probability that any motion of the runs is rejected as an outlier, if all noise is normal."""
FIRST_NOISE = (0.003, 0.005, 0.005, 0.005, 0.01)
"""Initial standard deviations, as `increments.NOISES`,"""
NOISE_BOUNDS = (1e-5, 1.0)
"""and the bounds of each."""


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
    """Motions between two moments that were rejected as outliers."""
    moments: int

    @property
    def knows_heading(self) -> bool:
        """Whether the truth of any run has headings; else nobody knows how its sensor is turned."""
        return any(run.truth.knows_heading for run in self.runs)

    def clock_of(self, run: Run) -> Clock:
        """Of the truth of one of the fitted runs."""
        return self.clocks[self.runs.index(run)]


def fit(runs: Sequence[Run], base: Kinematics, parameters: Sequence[Parameter], on_axle: bool = False) -> Fit:
    """Fit by generalised least squares on whole trajectories, without outliers.

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
    problem.weigh(x, noise)
    x = problem.solved(x, free)
    for _ in range(ROUNDS):
        noise = problem.noise_of(x, noise)
        x, more = problem.settled(x, free, noise)
        if not more:
            break
    information = problem.information(x)
    covariance = np.asarray(np.linalg.inv(information + np.diag(bands**-2.0)), np.float64)
    for mount in (slice(sensor.start, sensor.stop - 1), slice(sensor.stop - 1, sensor.stop)):
        free[mount] &= not (on_axle or _may_be_zero(covariance[mount, mount], x[mount]))
    reasons = hold(information, bands, parameters, free)
    if not free[: len(parameters)].any():
        raise CalibrationError("the runs determine none of the parameters: drive farther, and along curves")
    x = problem.solved(np.where(free, x, 0.0), free)
    mounting = EXACT if on_axle else np.minimum(MOUNTING, np.sqrt(np.diag(covariance)[sensor]))
    bands[sensor] = np.where(free[sensor], bands[sensor], mounting)
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
    x, _ = problem.settled(x, free, np.array(found.noise))
    return altered(found.base, problem.values(x))


def clocks_of(found: Fit, runs: Sequence[Run]) -> tuple[Clock, ...]:
    """Of the truth of runs that were not fitted, and nothing else, with the fitted machine and sensor."""
    problem = Problem([case_of(run, found.machine) for run in runs], found.machine, SENSOR)
    problem.settled(np.array(found.sensor), np.zeros(len(SENSOR), dtype=bool), np.array(found.noise))
    return tuple(case.clock for case in problem.cases)


class Problem:
    """Differences of all runs as a function of what is unknown.

    Common to all runs are the machine's parameters and the sensor's place (`x`). The clock of each run
    (`FittedRun.own`) is eliminated from the normal equations run by run.
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

    def linear(self, case: FittedRun, x: Array, free: Mask) -> Array:
        """The same, but the differences as they would be if all that is free, and the run's own unknowns, were zero."""
        columns = self.columns(case, x)
        columns[:, 0] -= columns[:, 1:] @ np.append(np.where(free, x, 0.0), case.own)
        return columns

    # ------------------------------------------------------------------------------------------------ least squares

    def weigh(self, x: Array, noise: Array) -> None:
        """Make each run's weights of the noise."""
        for case in self.cases:
            case.see(self._reckoned(case, x), self.sensor(x))
            case.weigh(noise)

    def settled(self, x: Array, free: Mask, noise: Array) -> tuple[Array, bool]:
        """Solve, and reject outliers until there are no more. Returns the unknowns, and whether any were rejected.

        A motion is an outlier if its whitened difference is longer than normal noise explains (data snooping, Baarda
        1968): counts that were lost, a wheel that spun, a tracker that jumped. It stays rejected.
        """
        most, any_found = chdtri(3, BY_CHANCE / sum(len(case.moments.poses) for case in self.cases)), False
        while True:
            self.weigh(x, noise)
            x = self.solved(x, free)
            found = False
            for case in self.cases:
                white = case.white(self.differences(case, x).reshape(-1, 1)).reshape(-1, 3)
                lost = (np.sum(white**2, axis=1) > most) & ~case.lost
                case.lost |= lost
                found |= bool(lost.any())
            if not found:
                return x, any_found
            any_found = True

    def solved(self, x: Array, free: Mask) -> Array:
        """The unknowns that fit best, those that are not free as they are: Gauss-Newton."""
        prior = np.diag(self.bands()[free] ** -2.0)
        taken = np.flatnonzero(np.append(True, free))
        for _ in range(STEPS):
            normal, gains = np.zeros((1 + len(x),) * 2), []
            for case in self.cases:
                rest, gain, _ = apart(case.white(self.linear(case, x, free)))
                normal += rest.T @ rest
                gains.append(gain[:, taken])
            normal = normal[np.ix_(taken, taken)]
            inverse = np.linalg.inv(normal[1:, 1:] + prior)
            old, x = x, x.copy()
            x[free] = -inverse @ normal[1:, 0]
            moved = False
            for case, gain in zip(self.cases, gains, strict=True):
                own, case.own = case.own, -gain @ np.append(1.0, x[free])
                moved |= bool(np.any(np.abs(case.own - own) > SETTLED))
            if not moved and np.all(np.abs(x - old)[free] < 0.02 * np.sqrt(np.diag(inverse))):
                break
        return x

    def information(self, x: Array) -> Array:
        """Normal matrix of the common unknowns, without their bands."""
        return self._gram([self.columns(case, x) for case in self.cases])[1:, 1:]

    def _gram(self, columns: list[Array]) -> Array:
        rests = [apart(case.white(each))[0] for case, each in zip(self.cases, columns, strict=True)]
        return np.asarray(np.sum([rest.T @ rest for rest in rests], axis=0))

    def excess(self, x: Array, bands: Array, free: Mask) -> Array:
        """Factors of the standard deviations: pieces of the runs may scatter more than the noise explains.

        The cluster-robust covariance of Liang and Zeger (1986, Biometrika 73:13) of pieces that are longer than noise
        is correlated, where it is the larger one; and Student's quantile for as few pieces.
        """
        normal, scores = np.diag(bands[free] ** -2.0), []
        for case in self.cases:
            white = case.white(self.columns(case, x))
            rest = apart(white)[0][: len(white), 1:][:, free]
            normal += rest.T @ rest
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
        columns = [self.linear(case, x, np.ones(len(x), dtype=bool)) for case in self.cases]
        prior = np.diag(self.bands() ** -2.0)

        def unlikeliness(logs: Array) -> float:
            noise, total, normal = np.exp(logs), 0.0, np.zeros((1 + len(x),) * 2)
            for case, each in zip(self.cases, columns, strict=True):
                case.weigh(noise)
                rest, _, log_own = apart(case.white(each))
                normal += rest.T @ rest
                total += float(np.sum(np.log(case.root[0]))) + log_own / 2.0
            inner = normal[1:, 1:] + prior
            fitted = normal[0, 1:] @ np.linalg.solve(inner, normal[1:, 0])
            return float(total + (np.linalg.slogdet(inner)[1] + normal[0, 0] - fitted) / 2.0)

        options = {"maxiter": 25, "ftol": 1e-7}
        bounds = [np.log(NOISE_BOUNDS)] * len(first)
        found = minimize(unlikeliness, np.log(first), method="L-BFGS-B", bounds=bounds, options=options)
        return np.asarray(np.exp(found.x))


def apart(white: Array) -> tuple[Array, Array, float]:
    """Least squares of white columns by the last two, a run's own unknowns with their prior `CLOCK`.

    Args:
        white: columns, shape (n, k + 2).

    Returns:
        What is left of the first columns, with a row for each prior, shape (n + 2, k); the own unknowns that fit each
        of them, shape (2, k); the logarithm of the determinant of the own unknowns' normal matrix.
    """
    columns = np.vstack([white, np.zeros((2, white.shape[1]))])
    columns[-2:, -2:] = np.diag(1.0 / np.array(CLOCK))
    common, own = columns[:, :-2], columns[:, -2:]
    normal = own.T @ own
    gain = np.linalg.solve(normal, own.T @ common)
    return common - own @ gain, gain, float(np.linalg.slogdet(normal)[1])


def _may_be_zero(covariance: Array, x: Array) -> bool:
    """Whether the sensor may have exactly the rear axle's centre, or heading: no chance mounts one there so well."""
    exact = np.all(np.sqrt(np.diag(covariance)) < KNOWN)
    return bool(exact and x @ np.linalg.solve(covariance, x) < CHANCE[len(covariance)])


def _result(problem: Problem, x: Array, bands: Array, free: Mask, reasons: Sequence[str], noise: Array) -> Fit:
    information = problem.information(x)
    covariance = covariance_of(information, bands, free)
    covariance[np.ix_(free, free)] *= np.multiply.outer(*[problem.excess(x, bands, free)] * 2)
    covariance[np.ix_(free, free)] += problem.blurred(x, bands, free)
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
