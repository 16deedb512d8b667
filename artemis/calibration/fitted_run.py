"""One run while a machine is fitted: its truth, its own unknowns, and the covariance of its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from artemis.calibration import increments
from artemis.calibration.increments import Moments, Slips, motions
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
BLUR, SHARP = 0.05, 1e-4
"""Band of the variance of the time over which the truth is filtered [s²], and of one that is not."""
LEAST_MOMENTS = 10
LOST = 1.0
"""Variance of a motion that says nothing [m², rad²]."""
UNKNOWN = 0.3
"""So far off are headings that the truth does not know, at each moment alone [rad]: much farther than they may be."""
STEP = 1e-3
"""Of a parameter's band, and of a second, for derivatives;"""
TINY = 1e-6
"""and of what changes poses."""


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
    blur: float = BLUR
    """Band of the last of `own`."""
    own: Array = field(init=False)
    """Unknowns of this run: offset [s] and drift of the clock beyond the first estimate, variance of the time over
    which the truth is filtered [s²]."""
    true: Array = field(init=False)
    """Motions between the moments, shape (n, 3)."""
    parts: Array = field(init=False)
    slips: Slips = field(init=False)
    root: Array = field(init=False)
    prior: Array = field(init=False)
    lost: Mask = field(init=False)
    driven: Array = field(init=False)
    """Distance rolled until each row of the log [m]."""

    def __post_init__(self) -> None:
        log = self.run.log
        steps = np.abs(np.diff(log.distance_left)) + np.abs(np.diff(log.distance_right))
        self.driven = np.append(0.0, np.cumsum(steps)) / 2.0
        self.own = np.zeros(3)
        self.lost = np.zeros(len(self.moments.poses) - 1, dtype=bool)

    @property
    def clock(self) -> Clock:
        """Of the truth."""
        first = self.first_clock
        return Clock(offset=first.offset + self.own[0], drift=first.drift + self.own[1], middle=first.middle)

    def _time(self) -> Array:
        """Of each row of the log, by the truth's clock [s]."""
        return self.clock.shown(self.run.log.time)

    def averaged(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Mean poses of the sensor by the odometry, shape (n, 3)."""
        poses, time = at_sensor(reckoned, sensor), self._time()
        return np.asarray(self.moments.averaged(time, poses) + self.own[2] * self.moments.bent(time, poses))

    def _distance(self) -> Array:
        return self.moments.averaged(self._time(), self.driven[:, np.newaxis])[:, 0]

    def weigh(self, wheels: Sequence[Array], sensor: tuple[float, float, float]) -> None:
        """Make the parts of the covariance.

        Args:
            wheels: derivatives of the odometry's motions by the share that each wheel rolls more, shape (n, 3) each.
            sensor: of the truth.
        """
        distance, time = self._distance(), self.moments.time[self.moments.starts]
        rolled = np.diff(distance)[:, np.newaxis]
        _, across, turn = increments.levers(sensor[:2])
        self.parts = increments.covariances(self.true, np.abs(rolled[:, 0]), sensor[:2])
        levers = (wheels, (rolled * across,), (rolled * turn,))
        self.slips = Slips.of(levers, (distance[1:] + distance[:-1]) / 2.0, time[1:])

    def differences(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Of the motions by truth and odometry, shape (n, 3)."""
        return self.true - motions(self.averaged(reckoned, sensor))

    def own_slopes(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Derivatives of the differences by this run's unknowns, shape (3 n, unknowns)."""
        poses, time, moments = at_sensor(reckoned, sensor), self._time(), self.moments
        later, sooner = (moments.averaged(time + step, poses) for step in (STEP, -STEP))
        change, means = (later - sooner) / (2.0 * STEP), self.averaged(reckoned, sensor)
        since = moments.time[moments.starts] - self.clock.offset - self.clock.middle
        changes = (change, change * since[:, np.newaxis], moments.bent(time, poses))
        here = motions(means)
        return np.column_stack([(here - motions(means + TINY * each)).ravel() / TINY for each in changes])

    def covariance(self, noise: Array) -> Array:
        """Of the differences, lower banded."""
        variances = noise[: len(increments.NOISES)] ** 2
        if not self.run.truth.knows_heading:
            variances[1] = UNKNOWN**2
        total = np.tensordot(variances, self.parts, axes=1)
        total[0] += LOST * np.repeat(self.lost, 3)
        slow = self.slips.covariance(noise[len(increments.NOISES) : -1] ** 2, noise[-1])
        slow[: len(total)] += total
        return slow

    def precision(self) -> Array:
        """Inverse of the prior covariance of `own`."""
        return np.diag(np.array([*(ONE_CLOCK if self.run.one_clock else CLOCK), self.blur]) ** -2.0)


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
