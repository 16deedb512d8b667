"""One run while a machine is fitted: its truth, its own unknowns, and the covariance of its noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag  # scipy has no types

from artemis.calibration import increments
from artemis.calibration.increments import Knots, Moments, motions
from artemis.calibration.kinematics import Kinematics, dead_reckoned
from artemis.calibration.knowledge import Mask
from artemis.calibration.wheel_log import WheelLog
from artemis.errors import ConfigError
from artemis.motion.clocks import Clock, estimate_clock
from artemis.motion.spline import Array
from artemis.motion.trajectory import Trajectory

CLOCK, ONE_CLOCK = (0.5, 1e-4), (0.02, 1e-6)
"""Bands of offset [s] and drift [s/s] of the truth's clock in each run, beyond the first estimate; and where both were
written with one clock: the time that values take to the tick."""
FILTERED = 0.04
"""Standard deviation of what nobody says of a truth: the variance of the time over which it was filtered [s²]."""
LEAST_MOMENTS = 10
LOST = 1.0
"""Variance of a motion that says nothing [m², rad²]."""
UNKNOWN = 0.3
"""So far off are headings that the truth does not know, at each moment alone [rad]: much farther than they may be."""
STEP = 1e-3
"""Of a parameter's band, for derivatives."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Run:
    """One run with its truth."""

    log: WheelLog
    truth: Trajectory
    one_clock: bool = False
    """Both were written with one clock: what offset is left is of the way that the values took."""


@dataclass(slots=True, eq=False)
class FittedRun:
    """One run while it is fitted."""

    run: Run
    first_clock: Clock
    moments: Moments
    own: Array = field(init=False)
    """Unknowns of this run: offset [s] and drift of the clock beyond the first estimate, then the slow errors at their
    knots: of the clock, along, across, in turn."""
    true: Array = field(init=False)
    """Motions between the moments, shape (n, 3)."""
    parts: Array = field(init=False)
    root: Array = field(init=False)
    prior: Array = field(init=False)
    lost: Mask = field(init=False)
    times: Knots = field(init=False)
    distances: Knots = field(init=False)
    driven: Array = field(init=False)
    """Distance rolled until each row of the log [m]."""

    def __post_init__(self) -> None:
        log = self.run.log
        steps = np.abs(np.diff(log.distance_left)) + np.abs(np.diff(log.distance_right))
        self.driven = np.append(0.0, np.cumsum(steps)) / 2.0
        self.times = Knots.over(float(log.time[-1] - log.time[0]), increments.LENGTHS[0])
        self.distances = Knots.over(float(self.driven[-1]), increments.LENGTHS[1])
        self.own = np.zeros(2 + len(self.times.places) + 3 * len(self.distances.places))
        self.lost = np.zeros(len(self.moments.poses) - 1, dtype=bool)

    @property
    def clock(self) -> Clock:
        """Of the truth, with the straight part of its slow error."""
        first, begin = self.first_clock, float(self.run.log.time[0])
        late = self.own[2 : 2 + len(self.times.places)]
        drift, offset = np.polyfit(begin + self.times.places - first.middle, late, 1)
        return self._clock(self.own[0] + offset, self.own[1] + drift)

    def _clock(self, offset: float, drift: float) -> Clock:
        """Beyond the first estimate."""
        first = self.first_clock
        return Clock(offset=first.offset + offset, drift=first.drift + drift, middle=first.middle)

    def _time(self) -> Array:
        """Of each row of the log, by the truth's clock [s]."""
        log, count = self.run.log, len(self.times.places)
        late = np.interp(log.time - log.time[0], self.times.places, self.own[2 : 2 + count])
        return np.asarray(self._clock(self.own[0], self.own[1]).shown(log.time) + late)

    def averaged(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Mean poses of the sensor by the odometry, shape (n, 3)."""
        return self.moments.averaged(self._time(), at_sensor(reckoned, sensor))

    def _distance(self) -> Array:
        return self.moments.averaged(self._time(), self.driven[:, np.newaxis])[:, 0]

    def rolled(self) -> Array:
        """By the driven wheels between the moments [m], shape (n,)."""
        return np.abs(np.diff(self._distance()))

    def _slips(self, sensor: tuple[float, float, float]) -> Array:
        """Derivatives of the differences by the slips at the knots, shape (3 n, 3 knots)."""
        distance = self._distance()
        weights = self.distances.weights((distance[1:] + distance[:-1]) / 2.0) * np.diff(distance)[:, np.newaxis]
        parts = [np.multiply.outer(weights, lever).swapaxes(1, 2) for lever in increments.levers(sensor[:2])]
        return -np.concatenate(parts, axis=2).reshape(3 * len(weights), -1)

    def differences(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Of the motions by truth and odometry, shape (n, 3)."""
        slips = self._slips(sensor) @ self.own[2 + len(self.times.places) :]
        return self.true - motions(self.averaged(reckoned, sensor)) + slips.reshape(-1, 3)

    def own_slopes(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Derivatives of the differences by this run's unknowns, shape (3 n, unknowns)."""
        here, columns, slips = motions(self.averaged(reckoned, sensor)), [], self._slips(sensor)
        for place in range(2 + len(self.times.places)):
            step = STEP * (1e-3 if place == 1 else 1.0)
            self.own[place] += step
            columns.append((here - motions(self.averaged(reckoned, sensor))).ravel() / step)
            self.own[place] -= step
        return np.column_stack([*columns, slips])

    def filtered(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """By how much the motions change where the truth is filtered over a usual time, shape (3 n,)."""
        poses, time = at_sensor(reckoned, sensor), self._time()
        means = self.moments.averaged(time, poses)
        return (motions(means + FILTERED * self.moments.bent(time, poses)) - motions(means)).ravel()

    def covariance(self, fast: Array) -> Array:
        """Of the differences, lower banded; `fast`: standard deviations as `increments.NOISES`."""
        variances = fast**2
        if not self.run.truth.knows_heading:
            variances[1] = UNKNOWN**2
        total = np.tensordot(variances, self.parts, axes=1)
        total[0] += LOST * np.repeat(self.lost, 3)
        return np.asarray(total)

    def precision(self, slow: Array) -> Array:
        """Inverse of the prior covariance of `own`; `slow`: standard deviations as `increments.SLOW`."""
        clock, *slips = slow**2
        bands = ONE_CLOCK if self.run.one_clock else CLOCK
        parts = [np.diag(np.square(bands)), self.times.covariance(clock)]
        parts += [self.distances.covariance(slip) for slip in slips]
        return np.asarray(block_diag(*(np.linalg.inv(part) for part in parts)))


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
        raise ConfigError(
            f"{log.name}: the true poses cover {len(moments.poses)} intervals of {increments.BIN:g} s of this run; "
            f"expected at least {LEAST_MOMENTS}"
        )
    return FittedRun(run, clock, moments)


def at_sensor(poses: Array, sensor: tuple[float, float, float]) -> Array:
    """Poses of a sensor that is `sensor` (ahead, left [m], heading [rad]) on the robot."""
    ahead, left, heading = sensor
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack(
        [poses[:, 0] + c * ahead - s * left, poses[:, 1] + s * ahead + c * left, poses[:, 2] + heading]
    )
