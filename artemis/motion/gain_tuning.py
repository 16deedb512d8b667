"""Regulator gains from a recorded step: what the drive moves, gains that suit it, the response to expect. Pure.

A drive that follows a step under known gains shows what it moves: a model of inertia, Coulomb friction and dead time in
the same loop is fitted to what was recorded (output error, Ljung, System Identification, 2nd edition, 7.2; Levenberg
1944, Marquardt 1963). Gains follow by pole placement; how fast the poles may be is decided by the margins and by the
response that the model predicts.

Everything is told of the motor shaft: rad, rad/s, A.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, degrees, inf, pi

import numpy as np

from artemis.errors import CalibrationError
from artemis.families.family import GainScale
from artemis.motion.arrays import Array
from artemis.motion.step_response import StepResponse

HOLD = 1.5
"""Dead time of a regulator that computes once a period: half a period of hold, one until the current is there."""
PHASE_MARGIN, GAIN_MARGIN = 40.0, 2.0
"""[degrees], factor: of the loop at the inertia that was found and at `LIGHTEST` of it. Textbooks ask for 30 to 60
degrees and for 2 or more (Astrom and Murray, Feedback Systems, 9.3)."""
LIGHTEST = 0.5
"""A motor in its play, or without the load, has so much of its inertia left."""
TIMES = tuple(float(time) for time in np.geomspace(0.002, 0.3, 22))
"""Of the closed loop [s], from stiff to soft: those that are looked at."""
SLOWER = (4.0, 12.0)
"""By so much is the pole of the integral part slower than the others: the slower, the less it overshoots."""
ENOUGH = 1.1
"""No stiffer than needed: the softest gains are proposed that settle within so many times the shortest time."""
NEAR_RAMP, AT_LIMIT = 1.5, 0.98
"""A drive that settles within so many times its ramp, or reaches so much of its largest current, is held up by that."""
WINDOW = 1.5
"""So much of a recording is used [s]."""
MOST_DELAY = 0.02
"""[s]."""
SIZES, DELAYS = tuple(np.arange(-4.0, 4.1, 0.5).tolist()), (0.5, 3.0)
"""Where the fit may begin: logarithms of the inertia as a multiple of a guess, dead times [ms]."""
KNOWN_UNITS = 0.5
"""Weight of the documented units of the gains: what a loop at its current limit does hardly depends on them."""
LARGEST_SCALE = 3.0
"""Logarithm of how far the units of the gains may be off."""
UNEXPLAINED = 0.3
"""A model that leaves more than this part of what the drive lagged behind is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRecord:
    """One drive that moved from rest; arrays of shape (n,)."""

    time: Array
    """[s]."""
    told: Array
    """Set-point from each time on: [rad] of a position, [rad/s] of a velocity."""
    position: Array
    """[rad]."""
    current: Array
    """[A]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLoop:
    """A regulator, PI or PID, whose output is a current."""

    is_position: bool
    p: float
    i: float
    d: float
    limit: float
    """Largest current [A]."""
    top: float
    """Largest speed [rad/s], of what the supply allows."""
    period: float = 1e-3
    """Of the regulator [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedLoad:
    """What a drive moves."""

    inertia: float
    """[A s²/rad]."""
    friction: float
    """[A] at any speed."""
    delay: float
    """Dead time of measuring [s]."""
    scale: float
    """True current as a multiple of what the units of the gains say."""
    unexplained: float
    """Of the lag behind the set-points, as a part (root of mean squares); 0: the model explains all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Gains to try, and what is expected of them."""

    gains: tuple[int, ...]
    """P, I of a velocity, or P, I, D of a position."""
    phase_margin: float
    """[degrees]; the smallest of all loads, at `LIGHTEST` of the inertia too."""
    gain_margin: float
    settled: float
    """Within 5 % [s], the longest of all drives, as the model predicts."""


def loop_of(gains: Sequence[int], scale: GainScale, limit: float, top: float) -> ControlLoop:
    """The regulator with these gains of a drive: two of a velocity, three of a position."""
    is_position = len(gains) == len(scale.position)
    units = scale.position if is_position else scale.velocity
    p, i, d = (*(unit * gain for unit, gain in zip(units, gains, strict=True)), 0.0)[:3]
    return ControlLoop(is_position=is_position, p=p, i=i, d=d, limit=limit, top=top, period=scale.period)


def followed(load: MovedLoad, loop: ControlLoop, time: Array, told: Array) -> tuple[Array, Array]:
    """Position [rad], from 0, and current [A] at each time, of a load that begins at rest, under these set-points."""
    position, velocity, integral, last = 0.0, 0.0, 0.0, 0.0
    late = load.delay / loop.period
    back = ceil(late)
    share = back - late  # of the younger one of two samples
    seen = [0.0] * (back + 1)
    """Places, or velocities."""
    p, i, d = (load.scale * gain for gain in (loop.p, loop.i, loop.d))
    limit, top, friction, inertia, is_position = loop.limit, loop.top, load.friction, load.inertia, loop.is_position
    shown_places, shown_currents = np.zeros(len(time)), np.zeros(len(time))
    current, started = 0.0, False
    periods = np.maximum(1, np.round(np.diff(time) / loop.period)).astype(int).tolist()
    for index, (wanted, count, length) in enumerate(
        zip(told.tolist(), [*periods, 1], [*np.diff(time).tolist(), loop.period], strict=True)
    ):
        shown_places[index], shown_currents[index] = position, current
        dt = length / count
        for _ in range(count):
            seen.append(position if is_position else velocity)
            measured = seen[-1 - back] + (share * (seen[-back] - seen[-1 - back]) if back else 0.0)
            error = wanted - measured
            demand = p * error + integral + i * error * dt
            if is_position and started:
                demand += d * (error - last) / dt
            last, started = error, True
            current = demand
            if demand > limit:
                current = limit
            elif demand < -limit:
                current = -limit
            if current == demand or error * demand < 0.0:
                integral += i * error * dt
            before = velocity
            if before == 0.0:  # as `sim.axis.rolled`, written out: this is all the work of a fit
                push = current - friction if current > 0.0 else current + friction
                velocity = 0.0 if -friction <= current <= friction else push * dt / inertia
            else:
                velocity += (current - friction if before > 0.0 else current + friction) * dt / inertia
                if velocity * before < 0.0 and -friction <= current <= friction:
                    velocity = 0.0
            if velocity > top:
                velocity = top
            elif velocity < -top:
                velocity = -top
            position += 0.5 * (before + velocity) * dt
    return shown_places, shown_currents


# ---------------------------------------------------------------------------------------------- identification


def identified(records: Sequence[StepRecord], loop: ControlLoop) -> MovedLoad:
    """The load that explains best how one drive followed under these gains.

    Raises:
        CalibrationError: no model of this kind explains what was recorded.
    """
    records = [_cut(record) for record in records]
    lags = [_lag(loop, record) for record in records]
    scale = max(float(np.max(np.abs(lag))) for lag in lags)
    peak = max(float(np.max(np.abs(record.current))) for record in records)
    if not scale > 0.0 or not peak > 0.0:
        raise CalibrationError("it did not move")

    def misfit(values: Array) -> Array:
        load, parts = _load(values), []
        for record in records:
            position, current = followed(load, loop, record.time, record.told)
            parts += [
                (position - (record.position - record.position[0])) / (0.02 * scale),
                (current - record.current) / (0.2 * peak),
            ]
        return np.concatenate([*(part / np.sqrt(len(part)) for part in parts), KNOWN_UNITS * values[2:3]])

    inertia, friction = _guess(records, peak)
    starts = [np.array([inertia + size, friction, 0.0, delay]) for size in SIZES for delay in DELAYS]
    nearest = sorted(starts, key=lambda start: float(np.sum(misfit(start) ** 2)))[:2]
    values, _ = min((_fitted(misfit, start) for start in nearest), key=lambda found: found[1])
    load = _load(values)
    errors = np.concatenate(
        [
            followed(load, loop, record.time, record.told)[0] - (record.position - record.position[0])
            for record in records
        ]
    )
    unexplained = float(np.sqrt(np.mean(errors**2) / np.mean(np.concatenate(lags) ** 2)))
    if unexplained > UNEXPLAINED:
        raise CalibrationError(
            f"a load with inertia, friction and dead time does not explain how it followed: {unexplained:.0%} of the "
            "lag is left"
        )
    return MovedLoad(
        inertia=load.inertia, friction=load.friction, delay=load.delay, scale=load.scale, unexplained=unexplained
    )


def _cut(record: StepRecord) -> StepRecord:
    """From shortly before the first change of the set-point on."""
    begin = max(0, int(np.argmax(record.told != record.told[0])) - 5)
    kept = slice(begin, int(np.searchsorted(record.time, record.time[begin] + WINDOW, side="right")))
    return StepRecord(
        time=record.time[kept],
        told=record.told[kept] - record.told[0],
        position=record.position[kept],
        current=record.current[kept],
    )


def _lag(loop: ControlLoop, record: StepRecord) -> Array:
    """Set-points less positions [rad]."""
    told = record.told
    if not loop.is_position:
        told = np.concatenate([[0.0], np.cumsum(record.told[:-1] * np.diff(record.time))])
    lag: Array = told - (record.position - record.position[0])
    return lag


def _guess(records: Sequence[StepRecord], peak: float) -> tuple[float, float]:
    """Logarithms of inertia and friction to begin with."""
    speed = max(float(np.max(np.abs(np.gradient(record.position, record.time)))) for record in records)
    friction = 0.25 * float(np.median([np.mean(np.abs(record.current)) for record in records])) + 1e-3 * peak
    return float(np.log(peak * 0.1 / max(speed, 1e-9))), float(np.log(friction))


def _load(values: Array) -> MovedLoad:
    inertia, friction = np.exp(np.clip(values[:2], -40.0, 10.0))
    scale = np.exp(np.clip(values[2], -LARGEST_SCALE, LARGEST_SCALE))
    delay = float(np.clip(values[3], 0.0, 1e3 * MOST_DELAY)) * 1e-3
    return MovedLoad(inertia=float(inertia), friction=float(friction), delay=delay, scale=float(scale), unexplained=0.0)


def _fitted(misfit: Callable[[Array], Array], values: Array) -> tuple[Array, float]:
    """Least squares (Levenberg, Marquardt) with differences of finite size: the model has corners."""
    steps = np.array([0.02, 0.05, 0.02, 0.1])
    damping, errors = 1e-2, misfit(values)
    cost = float(errors @ errors)
    for _ in range(25):
        columns = [(misfit(values + step * unit) - errors) / step for step, unit in zip(steps, np.eye(4), strict=True)]
        slopes = np.array(columns).T
        square = slopes.T @ slopes
        gained = 0.0
        for _ in range(6):
            change = np.linalg.solve(square + damping * np.diag(np.diag(square) + 1e-9), -slopes.T @ errors)
            tried = values + np.clip(change, -1.0, 1.0)
            tried[3] = np.clip(tried[3], 0.0, 1e3 * MOST_DELAY)
            new = misfit(tried)
            if (value := float(new @ new)) < cost:
                gained, values, errors, cost, damping = (cost - value) / cost, tried, new, value, 0.3 * damping
                break
            damping *= 4.0
        if gained < 1e-3:
            break
    return values, cost


# ---------------------------------------------------------------------------------------------- gains


def placed(
    load: MovedLoad, time_constant: float, slower: float, scale: GainScale, is_position: bool
) -> tuple[int, ...]:
    """Gains that place the poles of the closed loop on a load without friction and dead time.

    With w = 1 / `time_constant`: one pole of a velocity loop, two of a position loop at -w, and that of the integral
    part at -w / `slower`, all real, so the loop does not swing (pole placement by comparing coefficients: Astrom and
    Murray, Feedback Systems, 11.2).
    """
    inertia, w = load.inertia / load.scale, 1.0 / time_constant
    a = w / slower
    if is_position:
        wanted: tuple[float, ...] = (inertia * (w * w + 2.0 * w * a), inertia * w * w * a, inertia * (2.0 * w + a))
        return tuple(round(gain / unit) for gain, unit in zip(wanted, scale.position, strict=True))
    wanted = (inertia * (w + a), inertia * w * a)
    return tuple(round(gain / unit) for gain, unit in zip(wanted, scale.velocity, strict=True))


def margins(load: MovedLoad, loop: ControlLoop) -> tuple[float, float]:
    """Phase margin [degrees] and gain margin of the loop; a loop that is not stable has a margin of 0."""
    omega = np.geomspace(0.1, pi / loop.period, 3000)
    s = 1j * omega
    regulator = loop.p + loop.i / s + (loop.d * s if loop.is_position else 0.0)
    order = 2 if loop.is_position else 1
    size = np.abs(regulator) * load.scale / (load.inertia * omega**order)
    phase = np.angle(regulator) - 0.5 * pi * order - omega * (load.delay + HOLD * loop.period)
    crossed = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
    falling = np.flatnonzero((phase[:-1] > -pi) & (phase[1:] <= -pi))
    rising = np.flatnonzero((phase[:-1] <= -pi) & (phase[1:] > -pi))
    phase_margin = min((degrees(pi + float(phase[index])) for index in crossed), default=0.0)
    factors = [1.0 / size[falling], size[rising]]  # more gain, and less where integral parts alone would swing
    gain_margin = min((float(factor) for each in factors for factor in each), default=1.0)
    return (0.0, 0.0) if phase_margin <= 0.0 or gain_margin <= 1.0 else (phase_margin, gain_margin)


def proposals(
    loads: Sequence[MovedLoad],
    most: Sequence[int],
    scale: GainScale,
    present: ControlLoop,
    settled: Callable[[MovedLoad, ControlLoop], float | None],
) -> list[Proposal]:
    """Gains that suit all of these loads, from stiff to soft; empty where none have the margins.

    Args:
        loads: of the drives that are to have the same gains.
        most: no gain may exceed this.
        scale: what the numbers of the gains mean.
        present: the loop as it is: of a velocity or a position, with these limits.
        settled: when a load under a loop has settled, as the model predicts [s]; None: not.
    """
    lightest = min(loads, key=lambda load: load.inertia / load.scale)
    found = []
    for time_constant, slower in product(TIMES, SLOWER):
        gains = placed(lightest, time_constant, slower, scale, present.is_position)
        if any(gain > top for gain, top in zip(gains, most, strict=True)) or not all(gains):
            continue
        loop = loop_of(gains, scale, present.limit, present.top)
        all_margins = [margins(each, loop) for load in loads for each in (load, _lighter(load))]
        phase, gain = min(phase for phase, _ in all_margins), min(gain for _, gain in all_margins)
        if phase < PHASE_MARGIN or gain < GAIN_MARGIN:
            continue
        times = [settled(load, loop) for load in loads]
        if None in times:
            continue
        found.append(
            Proposal(
                gains=gains,
                phase_margin=phase,
                gain_margin=gain,
                settled=max(time for time in times if time is not None),
            )
        )
    return found


def _lighter(load: MovedLoad) -> MovedLoad:
    return MovedLoad(
        inertia=LIGHTEST * load.inertia,
        friction=load.friction,
        delay=load.delay,
        scale=load.scale,
        unexplained=load.unexplained,
    )


def in_order(found: Sequence[Proposal], present: Sequence[float | None]) -> list[Proposal]:
    """What to try first: the softest that is about as quick as any, then softer, then stiffer ones.

    `present`: when the drives settle now [s]; None: not. What is not predicted to be quicker is left out.
    """
    slowest = inf if None in present else max(time for time in present if time is not None)
    found = [each for each in found if each.settled < slowest]
    if not found:
        return []
    enough = ENOUGH * min(each.settled for each in found)
    first = max(index for index, each in enumerate(found) if each.settled <= enough)
    order = [first, min(first + 2, len(found) - 1), max(first - 2, 0)]
    return [found[index] for index in dict.fromkeys(order)]


def obstacle(response: StepResponse, after: float, limit: float) -> str:
    """Why a drive does not settle much sooner than `after` [s]; `limit`: of its current [A]."""
    if after < NEAR_RAMP * response.ramp:
        return f"the ramp that the gate makes of the step takes {response.ramp:.2f} s"
    if response.peak_current >= AT_LIMIT * limit:
        return f"the current reaches its limit of {limit:.1f} A"
    return "stiffer gains lack the margins, or exceed what a trial allows"
