"""What two clocks have to do with each other, by the motion that both saw: no common frame is needed.

Chords (distances between the places at two times), turns and bends are the same in every frame; turns also of every
point of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory

STEP = 0.1
"""Between the times at which motions are compared [s]."""
COARSE = 8.0
"""Window [s] over which motions are taken to search for the offset."""
FINE = ((2.0, 8.0), (0.5, 2.0, 8.0))
"""Those to make it exact, one after the other: short ones tell more, long ones lead there from farther away."""
SPAN = 100_000.0
"""The longest trajectory [s]: longer ones have other units."""
LEAST = 5.0
"""Both must have so much time in common [s]."""
SHARE = 0.3
"""Both must have this share of their motion in common, of the motion of the one that moved less."""
ASTRAY = 5.0
"""Offsets that differ by more [s] are different ones."""
AMBIGUOUS, ALIKE = 1.5, 1e-4
"""An offset whose disagreement is within this ratio of the least, and this share of the motion, is as good."""
DISAGREEMENT = 0.1
"""Motions that disagree by more are not of one run; 1: they have nothing to do with each other."""
REST = 0.1
"""Nor those whose distances still differ by more when clock and odometry are corrected, as a share."""
DRIFT = 0.05
"""Clocks that differ by more are none."""
DRIFT_SIGMA = 2e-3
"""Standard deviation of drifts before anything is measured: most clocks are better, some of cheap devices are not."""
UNSURE = 0.2
"""An offset with a larger standard deviation [s] is none."""
CALM = np.linspace(-0.25, 0.25, 11)
"""Times over which noise is averaged [s]."""
NUDGE = 0.1
"""By which times are moved to see what follows [s]."""
TINY = 1e-4
"""No chord [m] and no turn [rad] agrees better."""
BIT = 1e-4
"""By which the odometry is corrected to see what follows."""
PRIOR = np.array([np.inf, DRIFT, 0.1, 0.1, 0.1])
"""Standard deviations of what the least squares look for, as far as the motion does not tell; the offset is free."""
ONE_CLOCK = "if the truth has the run's own clock, say so with --same-clock"
UNSOLVABLE = 1e14
"""Condition of the normal equations beyond."""
OVERLAP = 4
"""Windows of one length over each moment: so many of them tell as much as one."""
STEPS = 20
"""Of the least squares, at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """When the run's clock shows t, the truth's shows t + offset + drift (t - middle)."""

    offset: float = 0.0
    """[s]."""
    drift: float = 0.0
    """[s/s]."""
    middle: float = 0.0
    """Of the time that both saw, by the run's clock [s]."""
    offset_sigma: float = 0.0
    """Standard deviation [s], at the middle."""
    drift_sigma: float = 0.0
    """Standard deviation [s/s]."""

    def shown(self, time: Array) -> Array:
        """Times by the truth's clock [s], of those by the run's."""
        return time + self.offset + self.drift * (time - self.middle)

    def run_time(self, shown: Array) -> Array:
        """Times by the run's clock [s], of those by the truth's."""
        return self.middle + (shown - self.offset - self.middle) / (1 + self.drift)


RUN = Clock()
"""The run's own."""


def estimate_clock(run: Trajectory, truth: Trajectory, *, one_point: bool = True) -> Clock:
    """Offset and drift of the truth's clock, by which the motions agree best.

    A search over all offsets by correlation, then weighted least squares, with scale, bend and scale of turns of the
    odometry as nuisance; outliers count less (Huber 1964). The standard deviations allow for windows that overlap.

    Args:
        run: by the odometry, clock of the run.
        truth: its own clock, any frame.
        one_point: both are of the same point of the robot; else their turns alone are compared, or if they are not
            known, distances that may differ.

    Raises:
        ConfigError: they do not overlap, do not agree, or agree at several offsets; what to try.
    """
    for name, each in (("run", run), ("truth", truth)):
        if not LEAST <= (span := float(np.ptp(each.time))) <= SPAN:
            raise ConfigError(f"the {name} spans {span:g} s; expected {LEAST:g} to {SPAN:.0f} s, times in seconds")
    run, truth = _calmed(run), _calmed(truth)
    kinds = ("chord", "bend") if not truth.knows_heading else ("chord", "turn") if one_point else ("turn",)
    offset = _coarse(run, truth, kinds)
    begin = max(run.time[0], truth.time[0] - offset)
    end = min(run.time[-1], truth.time[-1] - offset)
    clock = Clock(offset=offset, middle=float(begin + end) / 2)
    for windows in FINE:
        clock = _refined(clock, run, truth, windows, kinds, one_point)
    return clock


@dataclass(slots=True, kw_only=True)
class _Motion:
    """Chords, turns or bends of one trajectory on a grid of times, 0 where unknown; and where known."""

    value: Array
    known: Array


def _coarse(run: Trajectory, truth: Trajectory, kinds: Sequence[str]) -> float:
    """The offset [s] at which chords and turns disagree least, as a share of what they are."""
    disagreement, energy = np.zeros(1), np.zeros(1)
    enough = np.ones(1, dtype=bool)
    window = _windows([COARSE], run, truth)[0]
    for kind in kinds:
        a, b = (_on_grid(each, window, kind) for each in (run, truth))
        scale = np.sqrt((a.value**2).sum() / max(a.known.sum(), 1.0))
        if scale == 0.0:
            continue
        a.value, b.value = a.value / scale, b.value / scale
        own, other = _overlapping(a.value**2, b.known), _overlapping(a.known, b.value**2)
        disagreement = disagreement + own + other - 2 * _overlapping(a.value, b.value)
        energy = energy + own + other
        least = SHARE * min((a.value**2).sum(), (b.value**2).sum())
        enough = enough & (np.minimum(own, other) >= least) & (_overlapping(a.known, b.known) * STEP >= LEAST)
    if not enough.any() or not energy.any():
        raise ConfigError("the truth and the run have no motion in common")
    ratio = np.where(enough, disagreement.clip(0) / np.where(energy > 0, energy, 1.0), np.inf)
    best = int(np.argmin(ratio))
    if ratio[best] > DISAGREEMENT:
        raise ConfigError("the motions do not agree at any offset of the clocks: is it the truth of this run?")
    astray = np.abs(np.arange(len(ratio)) - best) * STEP > ASTRAY
    offsets = truth.time[0] - run.time[0] + (len(_grid(truth)) - 1 - np.arange(len(ratio))) * STEP
    if (ratio[astray] <= AMBIGUOUS * ratio[best] + ALIKE).any():
        second = int(np.argmin(np.where(astray, ratio, np.inf)))
        raise ConfigError(
            f"offsets of {offsets[best]:.1f} s and {offsets[second]:.1f} s agree equally well; {ONE_CLOCK}"
        )
    return float(offsets[best])


def _calmed(trajectory: Trajectory) -> Trajectory:
    """Averaged over half a second; both sides alike, so that what they have in common stays so."""
    if _step(trajectory) > CALM[-1]:
        return trajectory
    gap = longest_gap(trajectory.time)
    poses = np.mean([trajectory.at(trajectory.time + shift, gap) for shift in CALM], axis=0)
    kept = np.isfinite(poses[:, 0])
    if kept.sum() < 2:
        raise ConfigError("its poses are in pieces: none lasts half a second")
    return Trajectory(time=trajectory.time[kept], poses=poses[kept])


def _windows(choice: Sequence[float], run: Trajectory, truth: Trajectory) -> list[float]:
    """Those [s] over which both trajectories have poses enough, in a quarter of the time that they last."""
    shortest = 2 * max(_step(run), _step(truth))
    longest = min(float(np.ptp(run.time)), float(np.ptp(truth.time))) / 4
    windows = [window for window in choice if shortest <= window <= longest]
    if not windows and shortest <= longest:
        windows = [longest]
    if not windows:
        raise ConfigError(f"poses {shortest / 2:g} s apart are too few to find the offset of the clocks")
    return windows


def _step(trajectory: Trajectory) -> float:
    return float(np.median(np.diff(trajectory.time)))


def longest_gap(time: Array) -> float:
    """Between two poses that are farther apart [s] nothing is known; `time` of all of them [s], shape (n,)."""
    return max(0.5, 3 * float(np.median(np.diff(time)))) if len(time) > 1 else 0.5


def _grid(trajectory: Trajectory) -> Array:
    begin, end = trajectory.time[[0, -1]]
    return np.arange(begin, end, STEP)


def _on_grid(trajectory: Trajectory, window: float, kind: str) -> _Motion:
    value = _motion(trajectory, _grid(trajectory), window, kind)
    known = np.isfinite(value)
    return _Motion(value=np.where(known, value, 0.0), known=known.astype(float))


def _motion(trajectory: Trajectory, time: Array, window: float, kind: str, clock: Clock = RUN) -> Array:
    """Chord [m], turn [rad] or bend [m^2] of a window [s] around each time [s] by the run's clock; nan where unknown.

    A bend is the vector product of the window's halves; where no heading is known it tells left from right.
    """
    gap = longest_gap(trajectory.time)
    begin, end = clock.shown(time - window / 2), clock.shown(time + window / 2)
    before = trajectory.at(begin, gap)
    change = trajectory.at(end, gap) - before
    if kind == "turn":  # over a gap the robot may have turned once more than can be seen
        resumed = trajectory.time[1:][np.diff(trajectory.time) > gap]
        seen = np.searchsorted(resumed, begin, side="right") == np.searchsorted(resumed, end, side="right")
        return np.where(seen, change[:, 2], np.nan)
    if kind == "chord":
        return np.hypot(change[:, 0], change[:, 1])
    first = trajectory.at(clock.shown(time), gap) - before
    return first[:, 0] * change[:, 1] - first[:, 1] * change[:, 0]


def _overlapping(a: Array, b: Array) -> Array:
    """Sum of the products of what overlaps, for every shift of `b`, from its last value on `a`'s first."""
    from scipy.signal import correlate  # half a second to import

    return np.asarray(correlate(a, b, mode="full", method="fft"))


# ---------------------------------------------------------------------------------------------------- least squares


@dataclass(slots=True, kw_only=True)
class _Equations:
    """Linearised: `error` changes by `slopes` @ (offset, drift, scale, bend, turn scale)."""

    time: Array
    error: Array
    slopes: Array
    weight: Array


def _refined(
    clock: Clock, run: Trajectory, truth: Trajectory, windows: Sequence[float], kinds: Sequence[str], one_point: bool
) -> Clock:
    """Gauss-Newton from `clock` on."""
    wrong = np.zeros(3)
    prior = 1 / PRIOR**2
    for _ in range(STEPS):
        rows = _linearised(clock, wrong, run, truth, windows, kinds)
        weighted = rows.slopes * rows.weight[:, np.newaxis]
        normal = weighted.T @ rows.slopes + np.diag(prior)
        if np.linalg.cond(normal) > UNSOLVABLE:
            raise ConfigError(f"the motion is too uniform to find the offset of the clocks; {ONE_CLOCK}")
        sought = np.array([0.0, clock.drift, *wrong])
        step = -np.linalg.solve(normal, weighted.T @ rows.error + prior * sought)
        clock = replace(clock, offset=clock.offset + step[0], drift=clock.drift + step[1])
        wrong += step[2:]
        if abs(step[0]) < 1e-4 and abs(step[1]) < 1e-6:
            break
    if one_point:
        _check(clock, _corrected(run, wrong), truth, max(windows))
    variances = OVERLAP * np.linalg.inv(normal)
    gain = variances[:, 1] / (variances[1, 1] + DRIFT_SIGMA**2)
    clock = replace(clock, offset=clock.offset - gain[0] * clock.drift, drift=clock.drift - gain[1] * clock.drift)
    sigma = np.sqrt(np.diag(variances - np.outer(gain, variances[1])).clip(0.0))
    if abs(clock.drift) > DRIFT:
        raise ConfigError(f"the clocks would differ by {clock.drift:.1%}; no clock is so wrong")
    if sigma[0] > UNSURE:
        raise ConfigError(
            f"the motion is too uniform: the clocks' offset is found to {sigma[0]:.1f} s only; {ONE_CLOCK}"
        )
    return replace(clock, offset_sigma=float(sigma[0]), drift_sigma=float(sigma[1]))


def _check(clock: Clock, corrected: Trajectory, truth: Trajectory, window: float) -> None:
    """Refuse chords that differ though everything that may be wrong was corrected."""
    time = np.arange(corrected.time[0], corrected.time[-1], window / 4)
    own, theirs = _motion(corrected, time, window, "chord"), _motion(truth, time, window, "chord", clock)
    known = np.isfinite(own - theirs)
    if np.sum((own - theirs)[known] ** 2) > REST**2 * np.sum(own[known] ** 2):
        raise ConfigError("the motions do not agree: is it the truth of this run?")


def _linearised(
    clock: Clock,
    wrong: Array,
    run: Trajectory,
    truth: Trajectory,
    windows: Sequence[float],
    kinds: Sequence[str],
) -> _Equations:
    corrected = _corrected(run, wrong)
    others = [_corrected(run, wrong + BIT * unit) for unit in np.eye(3)]
    parts = []
    for window in windows:
        time = np.arange(run.time[0] + window / 2, run.time[-1] - window / 2, window / OVERLAP)
        for kind in kinds:
            own = _motion(corrected, time, window, kind)
            error = own - _motion(truth, time, window, kind, clock)
            later, earlier = (_motion(corrected, time + shift, window, kind) for shift in (NUDGE, -NUDGE))
            slope = (earlier - later) / (2 * NUDGE)  # of the odometry, for it is smooth: noise of the truth has no part
            changes = [(_motion(other, time, window, kind) - own) / BIT for other in others]
            slopes = np.column_stack([slope, slope * (time - clock.middle), *changes])
            known = np.isfinite(error) & np.isfinite(slope)
            parts.append((time[known], error[known], slopes[known], _weights(error[known])))
    time, error, slopes, weight = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Equations(time=time, error=error, slopes=slopes, weight=weight)


def _corrected(run: Trajectory, wrong: Array) -> Trajectory:
    """What the odometry would have been with its distance scaled, bent [rad/m], and with its turns scaled."""
    scale, bend, turn_scale = wrong
    steps = np.diff(run.poses[:, :2], axis=0)
    distance = np.append(0.0, np.cumsum(np.hypot(*steps.T)))
    turned = bend * distance + turn_scale * (run.poses[:, 2] - run.poses[0, 2])
    rotation = np.exp(1j * (turned[1:] + turned[:-1]) / 2) * (1 + scale)
    place = np.append(0.0, np.cumsum((steps[:, 0] + 1j * steps[:, 1]) * rotation))
    return Trajectory(time=run.time, poses=np.column_stack([place.real, place.imag, run.poses[:, 2] + turned]))


def _weights(error: Array) -> Array:
    """Of each error by the standard deviation of all, less for outliers."""
    if not len(error):
        return error
    std = 1.4826 * float(np.median(np.abs(error))) + TINY
    return 1 / (std**2 * np.maximum(1.0, np.abs(error) / (3 * std)))
