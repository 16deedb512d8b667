"""What a localizer tells, checked: its fixes as plain values, without those that cannot be true."""

from __future__ import annotations

from math import isfinite, sqrt

import numpy as np

from artemis.motion.angles import wrap
from artemis.values import Pose, PoseFix

FARTHEST, SUREST, VAGUEST = 1e6, 1e-12, 1e6
"""A fix is not farther away [m]; its variances [m², rad²] are not smaller and not larger."""
DEPENDENT = 1e-6
"""Nor do its x, y and heading depend on each other so much: determinant of the correlations."""
_NUMBER = (int, float, np.integer, np.floating)


def plain_fixes(answer: object) -> tuple[PoseFix | None, ...] | None:
    """A localizer's answer of plain values; None in it: such a fix cannot be true. None: one is no whole fix."""
    if not isinstance(answer, tuple | list) or not all(map(_is_whole, answer)):
        return None
    return tuple(_plain(fix) for fix in answer)


def _is_whole(fix: object) -> bool:
    if not isinstance(fix, PoseFix) or not isinstance(fix.pose, Pose) or not isinstance(fix.source, str):
        return False
    numbers = (fix.time, fix.pose.x, fix.pose.y, fix.pose.heading, fix.quality, fix.doubt)
    for matrix in (fix.covariance, fix.common):
        if not isinstance(matrix, tuple) or len(matrix) not in (0, 6):
            return False
    return all(isinstance(number, _NUMBER) for number in (*numbers, *fix.covariance, *fix.common))


def _plain(fix: PoseFix) -> PoseFix | None:
    """A whole fix of the types that it is declared to have; None: its numbers are not finite, or too large or small."""
    try:
        time, x, y, heading = map(float, (fix.time, fix.pose.x, fix.pose.y, fix.pose.heading))
        quality, doubt, covariance = float(fix.quality), float(fix.doubt), tuple(map(float, fix.covariance))
        common = tuple(map(float, fix.common))
    except OverflowError:  # a whole number too large for a float
        return None
    if not (isfinite(time) and isfinite(heading) and abs(x) <= FARTHEST and abs(y) <= FARTHEST):
        return None
    if not (0.0 <= quality <= 1.0 and 0.0 <= doubt <= FARTHEST):
        return None
    if not all(is_positive(*matrix) for matrix in (covariance, common) if matrix):
        return None
    return PoseFix(
        time=time,
        pose=Pose(x=x, y=y, heading=wrap(heading)),
        covariance=covariance,
        source=str(fix.source),
        quality=quality,
        doubt=doubt,
        common=common,
    )


def is_positive(xx: float, xy: float, xh: float, yy: float, yh: float, hh: float) -> bool:
    """Whether a covariance is definite, within the bounds of what anybody measures."""
    if not all(SUREST <= variance <= VAGUEST for variance in (xx, yy, hh)):
        return False
    a, b, c = xy / sqrt(xx * yy), xh / sqrt(xx * hh), yh / sqrt(yy * hh)
    return a * a < 1.0 and 1.0 - a * a - b * b - c * c + 2.0 * a * b * c > DEPENDENT
