"""Zero and slope of the potentiometers of one steered wheel, from readings while it turns (two-point, thesis 4.3.1).

And the zero of what else finds the wheel's angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, inf, sqrt
from operator import mul
from typing import Any, NamedTuple

from artemis.axles import AbsoluteEncoder, HardStop, HomeSwitch, Potentiometers
from artemis.motion.totals import mean, total

ZERO_DIGITS, SLOPE_DIGITS = 4, 3
"""Results are rounded to 0.1 mV (0.007 degrees) and 0.001 degrees per volt: less than their standard deviation."""

ANGLE_DIGITS = 4
"""So are angles of the robot file [degrees]: less than one count of 20 bits."""
STILL = 1e-9
"""A wheel whose angles differ by less than about the root of this [rad] did not turn."""


class Pass(NamedTuple):
    """Readings while a wheel turned one way."""

    direction: float
    """1 to the left, -1 to the right."""
    readings: Sequence[tuple[float, float, float]]
    """The encoder's angle of the wheel [rad], and the voltages of both potentiometers [V]."""


class Line(NamedTuple):
    """Voltage of one potentiometer over the encoder's angle: volt + per_radian * angle + lag * direction [V].

    `lag` is what the wheel, and its potentiometers with it, stays behind its motor: half of the play.
    """

    volt: float
    per_radian: float
    lag: float
    covariance: tuple[tuple[float, ...], ...]
    """Of these three."""
    misfit: float
    """How far the mean of a pass is off at most [rad]; infinite where the voltage does not follow the wheel at all."""

    def at(self, angle: float, direction: float = 0.0) -> float:
        """Voltage [V]; direction 0: in the middle of the play."""
        return self.volt + self.per_radian * angle + self.lag * direction

    def std(self, angle: float, direction: float = 0.0) -> float:
        """Standard deviation of `at` [V]."""
        at = 1.0, angle, direction
        shares = [total(map(mul, row, at)) for row in self.covariance]
        return sqrt(max(0.0, total(map(mul, shares, at))))


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringFit:
    """What was found of one wheel. Pairs: both potentiometers."""

    calibration: Potentiometers
    zero_std_v: tuple[float, float]
    """Standard deviations of the means, like the next."""
    slope_std_deg_per_v: tuple[float, float]
    backlash_deg: float
    """Play between motor and wheel, and what the analog inputs lag behind the encoder."""
    misfit_deg: float
    """How far the mean of a pass is off its line at most."""

    @property
    def record(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "zero_v": list(self.calibration.zero_v),
            "slope_deg_per_v": list(self.calibration.slope_deg_per_v),
            "zero_std_v": list(self.zero_std_v),
            "slope_std_deg_per_v": list(self.slope_std_deg_per_v),
            "backlash_deg": self.backlash_deg,
            "misfit_deg": self.misfit_deg,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringZero:
    """Where a wheel without potentiometers stands straight: one number of the robot file."""

    key: str
    before: float
    """What the robot file says [degrees], and what it should say."""
    after: float

    @property
    def record(self) -> dict[str, Any]:
        """As plain data."""
        return {self.key: self.after}


def moved(known: HardStop | HomeSwitch | AbsoluteEncoder, straight: float) -> SteeringZero:
    """What the robot file should say where a wheel that counts `straight` [rad] truly stands straight."""
    turned = degrees(straight)
    if isinstance(known, AbsoluteEncoder):
        after = (known.zero_deg + (-turned if known.mirrored else turned)) % 360.0
        return SteeringZero(key="zero_deg", before=known.zero_deg, after=round(after, ANGLE_DIGITS))
    key = "stop_deg" if isinstance(known, HardStop) else "switch_deg"
    before: float = getattr(known, key)
    return SteeringZero(key=key, before=before, after=round(before - turned, ANGLE_DIGITS))


def lines_through(passes: Sequence[Pass]) -> tuple[Line, Line]:
    """The least-squares line of each potentiometer. Needs passes at two angles at least, in both directions."""
    return _line(passes, 1), _line(passes, 2)


def _line(passes: Sequence[Pass], column: int) -> Line:
    rows = [((1.0, reading[0], one.direction), reading[column]) for one in passes for reading in one.readings]
    inverse = _inverse([[total([row[i] * row[j] for row, _ in rows]) for j in range(3)] for i in range(3)], len(rows))
    wanted = [total([row[i] * volt for row, volt in rows]) for i in range(3)]
    volt, per_radian, lag = (total(map(mul, row, wanted)) for row in inverse)
    line = Line(volt, per_radian, lag, (), inf)
    off = [[reading[column] - line.at(reading[0], one.direction) for reading in one.readings] for one in passes]
    variance = total([each * each for part in off for each in part]) / (len(rows) - 3)
    worst = max(abs(mean(part)) for part in off)
    return line._replace(
        covariance=tuple(tuple(variance * number for number in row) for row in inverse),
        misfit=worst / abs(per_radian) if per_radian else inf,
    )


def _inverse(matrix: Sequence[Sequence[float]], readings: int) -> tuple[tuple[float, ...], ...]:
    """Of a symmetric one; all zeros where that many readings tell nothing, because the wheel did not turn."""
    (a, b, c), (_, d, e), (_, _, f) = matrix
    adjugate = (
        (d * f - e * e, c * e - b * f, b * e - c * d),
        (c * e - b * f, a * f - c * c, b * c - a * e),
        (b * e - c * d, b * c - a * e, a * d - b * b),
    )
    determinant = total(map(mul, matrix[0], adjugate[0]))
    turned = determinant > STILL * readings**3
    return tuple(tuple(number / determinant if turned else 0.0 for number in row) for row in adjugate)


def shown_straight(lines: tuple[Line, Line], known: Potentiometers) -> float:
    """Encoder's angle [rad] at which a wheel stands straight by the mean of its potentiometers as they were known."""
    offset = rise = 0.0
    for line, zero, slope in zip(lines, known.zero_v, known.slope_deg_per_v, strict=True):
        offset += slope * (line.volt - zero)
        rise += slope * line.per_radian
    return -offset / rise


def fitted(lines: tuple[Line, Line], straight: float, direction: float, known: Potentiometers) -> SteeringFit:
    """The calibration of a wheel.

    Args:
        lines: Of its potentiometers.
        straight: Encoder's angle at which the wheel truly stands straight [rad].
        direction: Which way it came there, see `Line.at`.
        known: What the robot file said; what is not fitted stays.
    """
    slopes = tuple(degrees(1.0) / line.per_radian for line in lines)
    stds = tuple(
        abs(slope / line.per_radian) * sqrt(line.covariance[1][1]) for slope, line in zip(slopes, lines, strict=True)
    )
    play = mean([-2.0 * line.lag / line.per_radian for line in lines])
    zeros = tuple(round(line.at(straight, direction), ZERO_DIGITS) for line in lines)
    found = {"zero_v": zeros, "slope_deg_per_v": tuple(round(slope, SLOPE_DIGITS) for slope in slopes)}
    calibration = Potentiometers.model_validate({**known.model_dump(), **found})
    return SteeringFit(
        calibration=calibration,
        zero_std_v=(lines[0].std(straight, direction), lines[1].std(straight, direction)),
        slope_std_deg_per_v=(stds[0], stds[1]),
        backlash_deg=degrees(play),
        misfit_deg=degrees(max(line.misfit for line in lines)),
    )
