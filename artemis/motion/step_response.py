"""How a drive follows a step, or the ramp that the gate makes of one: rise, overshoot, settling, errors. Pure.

Terms as in textbooks of control (for example Ogata, Modern Control Engineering, 5th edition, 5.3): the rise goes from
10 to 90 % of the step to where the drive comes to rest; the overshoot is what it goes beyond that, as a part of the
step; it has settled once it stays within a band of so many per cent of the step. All times count from the moment at
which the set-point begins to change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, inf

import numpy as np

from artemis.errors import CalibrationError
from artemis.motion.arrays import Array

BANDS = (0.05, 0.02)
"""Of settling, as parts of the step."""
BEGUN, ARRIVED = 0.01, 0.99
"""Parts of the set-point's step: from the first on it moves, at the second it is there."""
TAIL = 0.2
"""In this last part of the time that it is watched the drive has to rest; its mean there is where it rests."""
MOVED = 0.1
"""A drive that goes less than this part of the step does not follow."""
FEWEST = 10
"""Samples from the beginning of the step on."""


MOST_OVERSHOOT, MOST_SWINGS = 0.1, 3
"""Of a step, and how often the error may turn back after the set-point is there, by `SWING` of the step or more."""
SWING = 0.05
BESIDE, NEARLY = 0.01, 0.035
"""Predicted gains rest within the first part of a step from the set-point; the second is nearly an overshoot of 5 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResponse:
    """What a drive made of one step. The unit is that of the values: rad, m/s."""

    begin: float
    """When the set-point began to change, in the time of the samples [s]."""
    step: float
    """By how much it changed."""
    ramp: float
    """How long that took [s]."""
    watched: float
    """How long the drive was watched from the beginning on [s]."""
    rise: float | None
    """10 to 90 % [s]; this and the following are None where the drive did not follow."""
    overshoot: float | None
    """As a part of the step, 0 or more."""
    settled_5: float | None
    """Stays within 5 % from then on [s]; None: not while it was watched."""
    settled_2: float | None
    """The same within 2 % [s]."""
    steady_error: float
    """Set-point less value in the end."""
    largest_error: float
    """The same on the way, without sign."""
    peak_current: float
    """Largest sampled current [A], without sign: between two samples there may be more."""


def step_response(time: Array, set_point: Array, value: Array, current: Array, margin: float = 0.0) -> StepResponse:
    """The response to the first step of a set-point that moves from rest to rest (and on from there, or back).

    Args:
        time: of the samples [s], shape (n,), rising.
        set_point: what the drive was told, shape (n,).
        value: what it measured, shape (n,).
        current: of its motor [A], shape (n,).
        margin: half the `width` that values made by `slope` belong to [s]: they know so long before of a change.

    Raises:
        CalibrationError: the set-point does not change, or there are too few samples.
    """
    first, arrived, last = _step(set_point)
    last = int(np.searchsorted(time, time[last] - margin, side="right")) - 1
    rest = float(value[int(np.searchsorted(time, time[first] - margin))])
    time, set_point, value, current = (each[first : last + 1] for each in (time, set_point, value, current))
    if len(time) < FEWEST:
        raise CalibrationError(f"only {len(time)} samples of the step")
    ramp, since = float(time[arrived - first] - time[0]), time - time[0]
    step, error = float(set_point[-1] - set_point[0]), set_point - value
    tail = since >= (1.0 - TAIL) * since[-1]
    distance = float(np.mean(value[tail])) - rest
    shares = (value - rest) / distance if abs(distance) >= MOVED * abs(step) else None
    follows = shares is not None and distance * step > 0.0
    settled = [_settled(since, shares, band) if shares is not None and follows else None for band in BANDS]
    return StepResponse(
        begin=float(time[0]),
        step=step,
        ramp=ramp,
        watched=float(since[-1]),
        rise=_reached(since, shares, 0.9) - _reached(since, shares, 0.1) if shares is not None and follows else None,
        overshoot=max(0.0, float(np.max(shares)) - 1.0) if shares is not None and follows else None,
        settled_5=settled[0],
        settled_2=settled[1],
        steady_error=float(np.mean(error[tail])),
        largest_error=float(np.max(np.abs(error))),
        peak_current=float(np.max(np.abs(current))),
    )


def slope(time: Array, value: Array, width: float) -> Array:
    """Derivative of sampled values: slope of the straight line of least squares through `width` [s] around each.

    A position in counts is too coarse for differences of two samples. What is faster than `width` is smoothed away.
    """
    slopes = np.zeros(len(time))
    begins = np.searchsorted(time, time - 0.5 * width - 1e-9, side="left")
    ends = np.searchsorted(time, time + 0.5 * width + 1e-9, side="right")
    for index, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        away = time[begin:end] - np.mean(time[begin:end])
        square = float(np.dot(away, away))
        slopes[index] = np.dot(away, value[begin:end]) / square if square > 0.0 else 0.0
    return slopes


def _step(set_point: Array) -> tuple[int, int, int]:
    """Indices: the last sample before the set-point moves, the first at its farthest place, the last there."""
    distance = set_point - set_point[:1]
    top = float(distance[np.argmax(np.abs(distance))]) if len(distance) else 0.0
    if top == 0.0:
        raise CalibrationError("the set-point does not change")
    shares = distance / top
    there = np.flatnonzero(shares >= ARRIVED)
    return max(int(np.argmax(shares > BEGUN)) - 1, 0), int(there[0]), int(there[-1])


def _reached(since: Array, shares: Array, share: float) -> float:
    """When this part of the step was passed first [s], between two samples in proportion."""
    index = int(np.argmax(shares >= share))
    if index == 0:
        return float(since[0])
    before, after = shares[index - 1], shares[index]
    return float(since[index - 1] + (since[index] - since[index - 1]) * (share - before) / (after - before))


def _settled(since: Array, shares: Array, band: float) -> float | None:
    """When the values entered the band for good [s]; None: they left it in the last part of the time."""
    away = np.abs(shares - 1.0)
    outside = np.flatnonzero(away > band)
    last = int(outside[-1])  # the first sample, which is all the way off, is one of them
    if since[last] >= (1.0 - TAIL) * since[-1]:
        return None
    return float(since[last] + (since[last + 1] - since[last]) * (away[last] - band) / (away[last] - away[last + 1]))


def reversals(values: Array, size: float) -> int:
    """How often values turned back by `size` or more."""
    farthest, sense, turned = float(values[0]), 0.0, 0
    for value in values.tolist():
        away = value - farthest
        if sense == 0.0:
            if abs(away) >= size:
                farthest, sense = value, copysign(1.0, away)
        elif sense * away > 0.0:
            farthest = value
        elif abs(away) >= size:
            farthest, sense, turned = value, -sense, turned + 1
    return turned


def quickness(response: StepResponse) -> float | None:
    """When a predicted response has settled [s], with a reserve: within 2 % where it nearly overshoots 5 %.

    None: it does not settle, or rests beside the set-point.
    """
    if abs(response.steady_error) > BESIDE * abs(response.step) or response.overshoot is None:
        return None
    return response.settled_5 if response.overshoot < NEARLY else response.settled_2


def unsteady(responses: Sequence[StepResponse], swings: Sequence[int]) -> str:
    """Why gains with these responses are never kept; empty: they may be. `swings`: reversals of their errors."""
    if any(each.settled_5 is None for each in responses):
        return "a drive did not settle"
    if max(swings) > MOST_SWINGS:
        return f"a drive oscillates: its error turned back {max(swings)} times"
    overshoot = max(each.overshoot or 0.0 for each in responses)
    return f"a drive overshoots by {overshoot:.0%}" if overshoot > MOST_OVERSHOOT else ""


def compared(now: Sequence[StepResponse], new: Sequence[StepResponse], swings: Sequence[int]) -> str:
    """Why the new gains are not kept; empty: they are steady, and the slowest new response is quicker than any before.

    Each: of all drives, repetitions and directions; `swings`: reversals of the errors with the new gains.
    """
    if problem := unsteady(new, swings):
        return problem
    before = min((each.settled_5 for each in now if each.settled_5 is not None), default=inf)
    after = max(each.settled_5 or 0.0 for each in new)
    if any(each.settled_5 is None for each in now):
        return ""
    return "" if after < before else f"no better: settled after up to {after:.3f} s, now after {before:.3f} s"
