"""Fits a machine's parameters to runs whose true trajectory is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np
from scipy.optimize import minimize  # scipy has no types

from artemis.calibration import increments
from artemis.calibration.increments import Indices, Moments, motions
from artemis.calibration.kinematics import Kinematics, Parameter, altered, dead_reckoned
from artemis.calibration.knowledge import Estimates, Mask, condition_of, covariance_of, estimates_of, hold
from artemis.calibration.wheel_log import WheelLog
from artemis.errors import CalibrationError, ConfigError
from artemis.motion.clocks import Clock, estimate_clock
from artemis.motion.spline import Array
from artemis.motion.trajectory import Trajectory

SENSOR = (
    Parameter("sensor ahead", 1.0, "curves"),
    Parameter("sensor left", 1.0, "curves"),
    Parameter("sensor heading", 0.3, "a truth with headings"),
)
"""Where the truth's sensor is, seen from the centre of the rear axle [m, rad]."""
CLOCK, ONE_CLOCK = (0.5, 1e-4), (0.02, 1e-6)
"""Bands of offset [s] and drift [s/s] of the truth's clock in each run, beyond the first estimate; and where both were
written with one clock: the time that values take to the tick."""
MOUNTED = 0.02
"""A sensor whose place is known better [m, rad] and"""
CHANCE = {2: 9.2, 3: 11.3}
"""may be on the axle with a squared distance below this (chi square with so many degrees of freedom, 99 %) is there,"""
ON_THE_AXLE = 1e-5
"""to this [m, rad]."""
ROUNDS = 2
"""Of fitting the parameters and then the noise."""
STEPS = 8
"""Of the least squares, at most."""
LEAST_MOMENTS = 10
ROBUST = 10.0
"""Whitened differences beyond count less (soft L1),"""
OUTLIER = 30.0
"""and beyond this not at all."""
LOST = 1.0
"""Variance of a motion that says nothing [m², rad²]."""
UNKNOWN = 0.3
"""So far off are headings that the truth does not know, at each moment alone [rad]: much farther than they may be."""
FIRST_NOISE = (0.003, 0.005, 0.005, 0.005, 0.005)
_STEP = 1e-3
"""Of a parameter's band, for derivatives."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Run:
    """One run with its truth."""

    log: WheelLog
    truth: Trajectory
    one_clock: bool = False
    """Both were written with one clock: what offset is left is of the way that the values took."""


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


@dataclass(slots=True, eq=False)
class FittedRun:
    """One run while it is fitted."""

    run: Run
    clock: Clock
    moments: Moments
    true: Array = field(init=False)
    """Motions between the moments, shape (n, 3)."""
    parts: Array = field(init=False)
    root: Array = field(init=False)
    lost: Mask = field(init=False)

    def __post_init__(self) -> None:
        self.lost = np.zeros(len(self.moments.poses) - 1, dtype=bool)


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
    sensor = slice(len(parameters), len(parameters) + len(SENSOR))
    free[sensor.stop - 1] = any(run.truth.knows_heading for run in runs)
    x, noise = np.zeros(len(bands)), np.array(FIRST_NOISE)
    for _ in range(ROUNDS):
        problem.weigh(x, noise)
        x = problem.solved(x, free)
        problem.leave_out(x)
        noise = problem.noise_of(x, noise)
    problem.weigh(x, noise)
    x = problem.solved(x, free)
    mount = sensor.start + np.flatnonzero(free[sensor])
    free[mount] = not (on_axle or _is_on_the_axle(problem.information(x), bands, x, mount))
    reasons = hold(problem.information(x), bands, parameters, free)
    if not free[: len(parameters)].any():
        raise CalibrationError("the runs show none of the machine's parameters: drive farther, and along curves")
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
    x = np.array([each.value for each in found.estimates] + [0.0] * (2 * len(runs)))
    free = np.array([each.seen for each in found.estimates] + [True] * (2 * len(runs)))
    problem.weigh(x, np.array(found.noise))
    x = problem.solved(x, free)
    return altered(found.base, problem.values(x))


def clocks_of(found: Fit, runs: Sequence[Run]) -> tuple[Clock, ...]:
    """Of the truth of runs that were not fitted, and nothing else, with the fitted machine and sensor."""
    problem = Problem([case_of(run, found.machine) for run in runs], found.machine, SENSOR)
    x = np.array([*found.sensor] + [0.0] * (2 * len(runs)))
    free = np.array([False] * len(SENSOR) + [True] * (2 * len(runs)))
    problem.weigh(x, np.array(found.noise))
    x = problem.solved(x, free)
    return tuple(problem.clock(number, x) for number in range(len(runs)))


def case_of(run: Run, base: Kinematics, clock: Clock | None = None) -> FittedRun:
    """A run with the moments of its truth.

    Raises:
        ConfigError: the truth is not of this run.
    """
    log = run.log
    if clock is None:
        offset = 0.0
        if not run.one_clock:
            try:
                odometry = Trajectory(time=log.time, poses=dead_reckoned(log, base))
                offset = estimate_clock(odometry, run.truth, one_point=False).offset
            except ConfigError as error:
                raise ConfigError([f"{log.name}: {problem}" for problem in error.problems]) from None
        clock = Clock(offset=offset, middle=float(log.time[0] + log.time[-1]) / 2.0)
    begin, end = clock.shown(log.time[[0, -1]])
    moments = Moments.of(run.truth, float(begin), float(end))
    if len(moments.poses) < LEAST_MOMENTS:
        raise ConfigError(f"{log.name}: the truth knows only {len(moments.poses)} moments of this run")
    return FittedRun(run, clock, moments)


class Problem:
    """Differences of all runs as a function of all unknowns: the machine's, the sensor's, each run's clock."""

    def __init__(self, cases: list[FittedRun], base: Kinematics, names: Sequence[Parameter]) -> None:
        self.cases, self.base, self.names = cases, base, names

    def bands(self) -> Array:
        """Of all unknowns."""
        clocks = [band for case in self.cases for band in (ONE_CLOCK if case.run.one_clock else CLOCK)]
        return np.array([*(each.band for each in self.names), *clocks])

    def differences(self, number: int, x: Array) -> Array:
        """Of one run, shape (n, 3)."""
        return self._differences(number, x, self._reckoned(number, x))

    def _reckoned(self, number: int, x: Array) -> Array:
        return dead_reckoned(self.cases[number].run.log, altered(self.base, self.values(x)))

    def _differences(self, number: int, x: Array, reckoned: Array) -> Array:
        return self.cases[number].true - motions(self._own(number, x, reckoned))

    def _own(self, number: int, x: Array, reckoned: Array) -> Array:
        case = self.cases[number]
        time = self.clock(number, x).shown(case.run.log.time)
        return case.moments.averaged(time, at_sensor(reckoned, self.sensor(x)))

    def values(self, x: Array) -> dict[str, float]:
        """By the names of the parameters."""
        return {parameter.name: float(value) for parameter, value in zip(self.names, x, strict=False)}

    def sensor(self, x: Array) -> tuple[float, float, float]:
        """Ahead, left [m], heading [rad]."""
        ahead, left, heading = x[len(self.names) - 3 : len(self.names)]
        return float(ahead), float(left), float(heading)

    def clock(self, number: int, x: Array) -> Clock:
        """Of one run's truth."""
        first, old = len(self.names) + 2 * number, self.cases[number].clock
        return Clock(offset=old.offset + x[first], drift=old.drift + x[first + 1], middle=old.middle)

    def slopes(self, number: int, x: Array) -> Array:
        """A run's differences and their derivatives by all unknowns, shape (3 n, 1 + unknowns)."""
        bands, reckoned = self.bands(), self._reckoned(number, x)
        here = self._differences(number, x, reckoned)
        common, own = len(self.names), len(self.names) + 2 * number
        columns = np.zeros((3 * len(here), 1 + len(x)))
        columns[:, 0] = here.ravel()
        for place in (*range(common), own, own + 1):
            there = x.copy()
            there[place] += _STEP * bands[place]
            moved = self._reckoned(number, there) if place < common - len(SENSOR) else reckoned
            columns[:, 1 + place] = (self._differences(number, there, moved) - here).ravel() / (_STEP * bands[place])
        return columns

    # ------------------------------------------------------------------------------------------------ least squares

    def weigh(self, x: Array, noise: Array) -> None:
        """Make each run's weights of the noise."""
        for number, case in enumerate(self.cases):
            case.true = motions(case.moments.beside(self._own(number, x, self._reckoned(number, x))))
            case.parts = increments.covariances(case.true, self.sensor(x)[:2])
            case.root = increments.factor(_noise_covariance(case, noise**2))

    def leave_out(self, x: Array) -> None:
        """Find the motions that fit nothing."""
        white = [self._white(number, x) for number in range(len(self.cases))]
        std = 1.4826 * float(np.median(np.abs(np.concatenate(white))))
        for case, each in zip(self.cases, white, strict=True):
            case.lost = np.abs(each).reshape(-1, 3).max(axis=1) > OUTLIER * std

    def _white(self, number: int, x: Array) -> Array:
        return increments.whitened(self.cases[number].root, self.differences(number, x).reshape(-1, 1))[:, 0]

    def solved(self, x: Array, free: Mask) -> Array:
        """The unknowns that fit best, those that are not free as they are: Gauss-Newton, outliers weighted less."""
        prior = np.diag(self.bands()[free] ** -2.0)
        for _ in range(STEPS):
            normal, slope = self._normal(x, ROBUST)
            inverse = np.linalg.inv(normal[np.ix_(free, free)] + prior)
            step = -inverse @ (slope[free] + prior @ x[free])
            x = x.copy()
            x[free] += step
            if np.all(np.abs(step) < 0.02 * np.sqrt(np.diag(inverse))):
                break
        return x

    def information(self, x: Array) -> Array:
        """Normal matrix of all unknowns, without their bands."""
        return self._normal(x, inf)[0]

    def _normal(self, x: Array, robust: float) -> tuple[Array, Array]:
        normal, slope = np.zeros((len(x), len(x))), np.zeros(len(x))
        for number, case in enumerate(self.cases):
            white = increments.whitened(case.root, self.slopes(number, x))
            weighted = white[:, 1:] / np.sqrt(1.0 + (white[:, :1] / robust) ** 2)
            normal += weighted.T @ white[:, 1:]
            slope += weighted.T @ white[:, 0]
        return normal, slope

    def bends(self, x: Array, bands: Array, free: Mask) -> Array:
        """What is fitted errs by what is held also in second order: its second moment, shape (free, free).

        A parameter h that is held at 0 and normal with its band b moves the others by half the curvature times h², and
        the mean of h⁴ is 3 b⁴.
        """
        inner = np.linalg.inv(self.information(x)[np.ix_(free, free)] + np.diag(bands[free] ** -2.0))
        total = np.zeros_like(inner)
        for place in np.flatnonzero(~free):
            slope = np.zeros(len(inner))
            for number, case in enumerate(self.cases):
                step = np.zeros(len(x))
                step[place] = bands[place]
                shifted = [self.differences(number, x + sign * step).ravel() for sign in (1.0, -1.0)]
                columns = self.slopes(number, x)
                columns[:, 0] = (shifted[0] + shifted[1]) / 2.0 - columns[:, 0]
                white = increments.whitened(case.root, columns)
                slope += white[:, 1:][:, free].T @ white[:, 0]
            shift = inner @ slope
            total += 3.0 * np.outer(shift, shift)
        return total

    def noise_of(self, x: Array, first: Array) -> Array:
        """Standard deviations of the noise by maximum likelihood of the differences."""
        differences = [self.differences(number, x).reshape(-1, 1) for number in range(len(self.cases))]

        def unlikeliness(logs: Array) -> float:
            total = 0.0
            for case, difference in zip(self.cases, differences, strict=True):
                root = increments.factor(_noise_covariance(case, np.exp(2.0 * logs)))
                white = increments.whitened(root, difference)
                total += float(np.sum(np.log(root[0])) + 0.5 * np.sum(white**2))
            return total

        bounds = [(np.log(1e-5), 0.0)] * len(first)
        options = {"maxiter": 25, "ftol": 1e-7}
        found = minimize(unlikeliness, np.log(first), method="L-BFGS-B", bounds=bounds, options=options)
        return np.asarray(np.exp(found.x))


def _noise_covariance(case: FittedRun, variances: Array) -> Array:
    if not case.run.truth.knows_heading:
        variances = np.array([variances[0], UNKNOWN**2, *variances[2:]])
    total = np.tensordot(variances, case.parts, axes=1)
    total[0] += LOST * np.repeat(case.lost, 3)
    return total


def at_sensor(poses: Array, sensor: tuple[float, float, float]) -> Array:
    """Poses of a sensor that is `sensor` (ahead, left [m], heading [rad]) on the robot."""
    ahead, left, heading = sensor
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack(
        [poses[:, 0] + c * ahead - s * left, poses[:, 1] + s * ahead + c * left, poses[:, 2] + heading]
    )


def _is_on_the_axle(information: Array, bands: Array, x: Array, mount: Indices) -> bool:
    """Whether the truth may be of the rear axle's centre itself: nobody mounts a sensor there so well by chance."""
    covariance = np.linalg.inv(information + np.diag(bands**-2.0))[np.ix_(mount, mount)]
    exact = np.all(np.sqrt(np.diag(covariance)) < MOUNTED)
    return bool(exact and x[mount] @ np.linalg.solve(covariance, x[mount]) < CHANCE[len(mount)])


def _result(problem: Problem, x: Array, bands: Array, free: Mask, reasons: Sequence[str], noise: Array) -> Fit:
    information = problem.information(x)
    covariance = covariance_of(information, bands, free)
    covariance[np.ix_(free, free)] += problem.bends(x, bands, free)
    mounted = "" if free[len(reasons)] else "the truth is of the rear axle's centre"
    said = [*reasons, mounted, mounted, "" if free[len(reasons) + 2] else mounted or "needs a truth with headings"]
    return Fit(
        base=problem.base,
        machine=altered(problem.base, problem.values(x)),
        estimates=estimates_of(problem.names, x, covariance, free, said),
        covariance=covariance[: len(problem.names), : len(problem.names)],
        condition=condition_of(information, free),
        sensor=problem.sensor(x),
        runs=tuple(case.run for case in problem.cases),
        clocks=tuple(problem.clock(number, x) for number in range(len(problem.cases))),
        noise=tuple(noise.tolist()),
        left_out=sum(int(case.lost.sum()) for case in problem.cases),
        moments=sum(len(case.true) for case in problem.cases),
    )
