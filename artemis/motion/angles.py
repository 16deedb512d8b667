"""Angles in radians, counter-clockwise positive. The only place where one is wrapped; many: `arrays.wrapped`."""

from __future__ import annotations

import math

SERIES_BELOW = 1e-4
"""Below this argument [rad] two terms of the series of sin(z)/z are exact to double precision (z^4/120 < 1e-18)."""


def wrap(angle: float) -> float:
    """The same direction in (-pi, pi].

    Raises:
        ValueError: `angle` is infinite.
    """
    wrapped = math.remainder(angle, math.tau)
    return wrapped if wrapped != -math.pi else math.pi


def difference(angle: float, reference: float) -> float:
    """Shortest rotation that leads from `reference` to `angle` [rad], in (-pi, pi]."""
    return wrap(angle - reference)


def sinc(angle: float) -> float:
    """Ratio sin(z)/z of chord to arc for half the turned angle z [rad]; 1 at zero."""
    if abs(angle) < SERIES_BELOW:
        return 1.0 - angle * angle / 6.0
    return math.sin(angle) / angle
