"""What runs tell of a battery and of what is taken of it: numbers of the robot file, with their intervals.

The voltage of each few seconds is that of the curve, at the charge that was left, less the drop by the current: least
squares, with the charge at which each stretch begins. No voltage tells power and capacity apart, so one of them is held
as the robot file has it. All others are fitted together: a number that the runs do not determine well is not told, and
makes the intervals of those wider that depend on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, inf, sqrt

import numpy as np
from scipy.optimize import least_squares

from artemis.battery import HOUR, Battery
from artemis.calibration.battery_log import BatteryLog
from artemis.errors import CalibrationError
from artemis.motion.arrays import Array

CAPACITY, IDLE, FORCE, RESISTANCE = "capacity_ah", "idle_w", "newtons_per_ampere", "resistance_ohm"
PER_METRE = "joules_per_metre"
KEYS = (CAPACITY, IDLE, FORCE, RESISTANCE)
SCALES = (CAPACITY, IDLE, FORCE)
"""One of them has to be held."""
WIDEST = 0.25
"""A number with a wider half of its 95 % interval, as a share of it, is not determined."""
FARTHEST = 3.0
"""Logarithm of the largest multiple of the robot file's number that is looked for: there it is not determined."""
PARTS = 10
"""So often the fit is repeated without a part of the time."""
QUANTILE = 2.26
"""Of Student's distribution with one degree of freedom less than that, 95 %."""
LEAST_DRIVEN = 10.0
"""What a shorter distance took tells nothing [m]."""
CURVE = 0.05
"""The difference of two points of the curve is that uncertain [V], a standard deviation."""
BADLY = 0.15
"""Measured voltages that are so far off what fits best [V], root mean square, have another cause."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A number of the robot file as the runs tell it, with half of its 95 % interval."""

    before: float
    after: float
    half_width: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryFit:
    """What was fitted, and what was not."""

    values: dict[str, Fitted]
    """By key of `battery` in the robot file, `PER_METRE` among them where something was driven."""
    undetermined: dict[str, float] = field(default_factory=dict)
    """Half of its interval is so wide, as a share of it: more than `WIDEST`."""
    off: float
    """Root mean square of measured and fitted voltages' difference [V]."""
    fallen: float
    """By so much the voltage without load fell, at most [V]."""


def fit_battery(battery: Battery, logs: Sequence[BatteryLog], held: Sequence[str] = (FORCE,)) -> BatteryFit:
    """Fit the numbers of `KEYS` that are not `held`: none of them is zero.

    Raises:
        CalibrationError: the runs determine none of them, or do not fit the curve.
    """
    fit = _Fit(battery, logs, [key for key in KEYS if key not in held])
    if fit.off > BADLY:
        raise CalibrationError(
            f"voltages are {fit.off:.2f} V off what fits best: charged meanwhile? another battery? another curve_v?"
        )
    found = fit.result()
    if not found.values:
        raise CalibrationError(
            f"the voltage fell by {fit.fallen:.2f} V, which determines nothing: drive longer, from a full battery on"
        )
    return found


class _Fit:
    """One least-squares fit of some of the numbers, as logarithms of multiples of the robot file's."""

    def __init__(self, battery: Battery, logs: Sequence[BatteryLog], free: Sequence[str]) -> None:
        self._battery, self._logs, self._free = battery, logs, free
        self._knots = np.array(battery.curve_v).T
        self._x, off = self._fitted(np.ones(sum(len(log.volts) for log in logs)))
        self.off = float(np.sqrt(np.mean(off**2)))
        rests = [self._rest(log, float(begin), self._x) for log, begin in zip(logs, self._x, strict=False)]
        self.fallen = float(np.ptp(np.concatenate(rests)))
        self._covariance = self._uncertain(len(off))

    def _fitted(self, weights: Array) -> tuple[Array, Array]:
        """Charges at the beginnings and the logarithms, and what is off [V]."""
        begins = [self._charge(log) for log in self._logs]
        found = least_squares(
            lambda x: weights * self._off(x), [*begins, *([0.0] * len(self._free))], x_scale="jac", max_nfev=100
        )
        return found.x, found.fun

    def _uncertain(self, count: int) -> Array:
        """Covariance of all that was fitted, by fits that each leave a part of the time out (jackknife).

        So errors that last count as few; steps in which the voltage is measured make several solutions nearly as good,
        which no curvature at one of them shows. The curve is wrong in all of them alike.
        """
        others = []
        for part in np.array_split(np.arange(count), PARTS):
            weights = np.ones(count)
            weights[part] = 0.0
            others.append(self._fitted(weights)[0])
        away = np.array(others) - np.mean(others, axis=0)
        first, of_curve = len(self._logs), np.zeros(len(self._x))
        scaled = [CAPACITY] if CAPACITY in self._free else [IDLE, FORCE]
        for place, key in enumerate(self._free):
            of_curve[first + place] = CURVE / max(self.fallen, 1e-3) if key in scaled else 0.0
        return np.asarray((PARTS - 1) / PARTS * away.T @ away + np.outer(of_curve, of_curve))

    def _charge(self, log: BatteryLog) -> float:
        amperes = (log.idle[0] + log.drive[0]) / log.seconds[0]
        return self._battery.charge_at(float(log.volts[0] + self._battery.resistance_ohm * amperes))

    def _multiples(self, x: Array) -> dict[str, float]:
        told = dict(zip(self._free, x[len(self._logs) :], strict=True))
        return {key: exp(min(max(float(told.get(key, 0.0)), -FARTHEST), FARTHEST)) for key in KEYS}

    def _rest(self, log: BatteryLog, begin: float, x: Array) -> Array:
        """Voltage without load [V]; the curve goes straight on beyond its ends."""
        multiples, (charges, volts) = self._multiples(x), self._knots
        taken = multiples[IDLE] * log.idle + multiples[FORCE] * log.drive
        shares = taken / (multiples[CAPACITY] * HOUR * self._battery.capacity_ah)
        charge = 100.0 * (begin - np.cumsum(shares) + shares / 2.0)
        slopes = np.diff(volts) / np.diff(charges)
        below, above = np.minimum(charge - charges[0], 0.0), np.maximum(charge - charges[-1], 0.0)
        return np.asarray(np.interp(charge, charges, volts) + slopes[0] * below + slopes[-1] * above)

    def _off(self, x: Array) -> Array:
        multiples, off = self._multiples(x), []
        ohms = multiples[RESISTANCE] * self._battery.resistance_ohm
        for log, begin in zip(self._logs, x, strict=False):
            amperes = (multiples[IDLE] * log.idle + multiples[FORCE] * log.drive) / log.seconds
            off.append(log.volts - self._rest(log, float(begin), x) + ohms * amperes)
        return np.concatenate(off)

    def result(self) -> BatteryFit:
        """In the units of the robot file."""
        multiples, values, shares = self._multiples(self._x), dict[str, Fitted](), dict[str, float]()
        for place, key in enumerate(self._free, len(self._logs)):
            before = float(getattr(self._battery, key))
            after = before * multiples[key]
            share = QUANTILE * sqrt(float(self._covariance[place, place]))
            shares[key] = share if abs(self._x[place]) < FARTHEST else inf
            values[key] = Fitted(before=before, after=after, half_width=after * share)
        undetermined = {key: share for key, share in shares.items() if share > WIDEST}
        metres = float(sum(log.metres.sum() for log in self._logs))
        if metres > LEAST_DRIVEN and not {IDLE, FORCE}.intersection(undetermined):
            values[PER_METRE] = self._per_metre(metres, multiples)
        return BatteryFit(
            values={key: value for key, value in values.items() if key not in undetermined},
            undetermined=undetermined,
            off=self.off,
            fallen=self.fallen,
        )

    def _per_metre(self, metres: float, multiples: dict[str, float]) -> Fitted:
        parts = {
            IDLE: multiples[IDLE] * float(sum(log.idle_joules.sum() for log in self._logs)) / metres,
            FORCE: multiples[FORCE] * float(sum(log.drive_joules.sum() for log in self._logs)) / metres,
        }
        moves = np.zeros(len(self._x))
        for place, key in enumerate(self._free):
            moves[len(self._logs) + place] = parts.get(key, 0.0)
        width = QUANTILE * sqrt(float(moves @ self._covariance @ moves))
        return Fitted(before=self._battery.joules_per_metre, after=sum(parts.values()), half_width=width)
