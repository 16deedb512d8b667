"""How sure a fix is, as its covariance."""

from __future__ import annotations

import math

SUREST_M, SUREST_DEG = 1e-6, 1e-4
"""Least standard deviations [m, degrees]: nothing is known exactly, and a fix that is surer is not believed
(`artemis.plugins.fixes`)."""


def covariance(std_m: float, std_deg: float) -> tuple[float, ...]:
    """Of a fix whose x and y [m] and heading [degrees] err independently, with these standard deviations."""
    position, heading = std_m**2, math.radians(std_deg) ** 2
    return position, 0.0, 0.0, position, 0.0, heading
