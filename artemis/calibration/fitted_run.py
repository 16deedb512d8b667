"""One run while a machine is fitted: its truth, its own unknowns, and the covariance of its noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from artemis.calibration.increments import BIN, Moments, covariances, factor, motions, whitened
from artemis.calibration.kinematics import Kinematics, dead_reckoned
from artemis.calibration.knowledge import Mask
from artemis.calibration.wheel_log import WheelLog
from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.clocks import Clock, estimate_clock
from artemis.motion.trajectory import Trajectory

CLOCK = (0.5, 0.01)
"""Bands of offset [s] and drift [s/s] of the truth's clock in each run, beyond the first estimate."""
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
    """Both were written with one clock."""


@dataclass(slots=True, eq=False)
class FittedRun:
    """One run while it is fitted."""

    run: Run
    first_clock: Clock
    moments: Moments
    own: Array = field(default_factory=lambda: np.zeros(2))
    """Unknowns of this run: offset [s] and drift of the clock beyond the first estimate."""
    true: Array = field(init=False)
    """Motions between the moments, shape (n, 3)."""
    parts: Array = field(init=False)
    """Their covariances by each of `increments.NOISES`."""
    lost: Mask = field(init=False)
    """Motions that fit nothing."""
    root: Array = field(init=False)

    def __post_init__(self) -> None:
        self.lost = np.zeros(len(self.moments.poses) - 1, dtype=bool)

    @property
    def clock(self) -> Clock:
        """Of the truth."""
        first, (offset, drift) = self.first_clock, self.own.tolist()
        return Clock(offset=first.offset + offset, drift=first.drift + drift, middle=first.middle)

    def averaged(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Mean poses of the sensor by the odometry, shape (n, 3)."""
        return self.moments.averaged(self.clock.shown(self.run.log.time), at_sensor(reckoned, sensor))

    def differences(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Of the motions by truth and odometry, shape (n, 3)."""
        return self.true - motions(self.averaged(reckoned, sensor))

    def own_slopes(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """Derivatives of the differences by this run's unknowns, shape (3 n, 2)."""
        here, columns = motions(self.averaged(reckoned, sensor)), []
        for place, step in enumerate((1e-3, 1e-6)):
            self.own[place] += step
            columns.append((here - motions(self.averaged(reckoned, sensor))).ravel() / step)
            self.own[place] -= step
        return np.column_stack(columns)

    def filtered(self, reckoned: Array, sensor: tuple[float, float, float]) -> Array:
        """By how much the motions change where the truth is filtered over a usual time, shape (3 n,)."""
        poses, time = at_sensor(reckoned, sensor), self.clock.shown(self.run.log.time)
        means = self.moments.averaged(time, poses)
        return (motions(means + FILTERED * self.moments.bent(time, poses)) - motions(means)).ravel()

    def see(self, reckoned: Array, sensor: tuple[float, float, float]) -> None:
        """Take the true motions and the covariances by what is known now."""
        self.true = motions(self.moments.beside(self.averaged(reckoned, sensor)))
        log = self.run.log
        steps = np.abs(np.diff(log.distance_left)) + np.abs(np.diff(log.distance_right))
        driven = np.append(0.0, np.cumsum(steps))[:, np.newaxis] / 2.0
        rolled = np.abs(np.diff(self.moments.averaged(self.clock.shown(log.time), driven)[:, 0]))
        self.parts = covariances(self.true, rolled, sensor[:2])

    def weigh(self, noise: Array) -> None:
        """Make the weights; `noise`: standard deviations as `increments.NOISES`."""
        variances = noise**2
        if not self.run.truth.knows_heading:
            variances[1] = UNKNOWN**2
        total = np.tensordot(variances, self.parts, axes=1)
        total[0] += LOST * np.repeat(self.lost, 3)
        self.root = factor(total)

    def white(self, columns: Array) -> Array:
        """Columns (3 n, k) of differences, weighed."""
        return whitened(self.root, columns)


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
            f"{log.name}: the true poses cover {len(moments.poses)} intervals of {BIN:g} s of this run; "
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
