"""What runs tell of parameters and what not: plausible bands, information, intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from artemis.calibration.kinematics import Kinematics, Parameter
from artemis.motion.arrays import Array

Mask: TypeAlias = NDArray[np.bool_]

ALIKE = 60.0
"""A parameter is estimated if its interval is not so many times wider than if all the others were known: beyond, any
small error of the model would be attributed to several correlated parameters."""
QUANTILE = 1.96
"""Of the 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What became of one parameter."""

    parameter: Parameter
    value: float
    """Deviation from the description."""
    half_width: float
    """Of its 95 % interval; of one that is held, what its plausible band allows."""
    seen: bool
    reason: str = ""
    """Why it is held."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimates:
    """What runs say of a machine."""

    base: Kinematics
    machine: Kinematics
    estimates: tuple[Estimate, ...]
    covariance: Array
    """Of the estimates, in their order."""
    condition: float
    """Of the normal matrix of what is not held, scaled to a diagonal of ones."""


def hold(information: Array, bands: Array, parameters: Sequence[Parameter], free: Mask) -> list[str]:
    """Take from `free` what the runs do not show, and say why; of what looks alike the later parameter first.

    Args:
        information: normal matrix of all unknowns, of which `parameters` are the first.
        bands: standard deviations that are plausible without any run.
        parameters: that may be held.
        free: changed in place.
    """
    reasons = [""] * len(parameters)
    seen = np.array([*(each.seen for each in parameters), *[1.0] * (len(free) - len(parameters))])
    scaled = information * np.outer(bands, bands)
    while True:
        places = np.flatnonzero(free).tolist()
        part = scaled[np.ix_(places, places)] + np.eye(len(places))
        sigma = np.sqrt(np.diag(np.linalg.inv(part)))
        alike = sigma * np.sqrt(np.diag(part)) / ALIKE
        poor = [
            place for place, share in zip(places, np.maximum(sigma / seen[places], alike), strict=True) if share > 1.0
        ]
        poor = [place for place in poor if place < len(parameters)]
        if not poor:
            return reasons
        last = poor[-1]
        free[last] = False
        reasons[last] = f"needs {parameters[last].needs}"
        if part[places.index(last), places.index(last)] ** -0.5 < seen[last]:  # seen if all the others were known
            other, correlation = _most_correlated(part, places, last)
            name = parameters[other].name if other < len(parameters) else "the sensor's place"
            reasons[last] += f"; these runs do not separate it from {name} (correlation {correlation:+.2f})"


def _most_correlated(part: Array, places: list[int], place: int) -> tuple[int, float]:
    covariance = np.linalg.inv(part)
    at, sigma = places.index(place), np.sqrt(np.diag(covariance))
    correlations = covariance[at] / (sigma[at] * sigma)
    correlations[at] = 0.0
    best = int(np.argmax(np.abs(correlations)))
    return places[best], float(correlations[best])


def covariance_of(information: Array, bands: Array, free: Mask) -> Array:
    """Of all unknowns: those that are held err by their bands, and what is fitted errs with them."""
    inner = np.linalg.inv(information[np.ix_(free, free)] + np.diag(bands[free] ** -2.0))
    gain = inner @ information[np.ix_(free, ~free)]
    covariance = np.zeros_like(information)
    prior = np.diag(bands[~free] ** 2.0)
    covariance[np.ix_(free, free)] = inner + gain @ prior @ gain.T
    covariance[np.ix_(~free, ~free)] = prior
    covariance[np.ix_(free, ~free)] = -gain @ prior
    covariance[np.ix_(~free, free)] = -prior @ gain.T
    return covariance


def condition_of(information: Array, free: Mask) -> float:
    """Of the part of the normal matrix that is free, scaled to a diagonal of ones."""
    part = information[np.ix_(free, free)]
    root = np.sqrt(np.where(np.diag(part) > 0.0, np.diag(part), 1.0))
    return float(np.linalg.cond(part / np.outer(root, root)))


def estimates_of(
    parameters: Sequence[Parameter], x: Array, covariance: Array, free: Mask, reasons: Sequence[str]
) -> tuple[Estimate, ...]:
    """In words, one for each of the parameters, which are the first unknowns."""
    half_widths = QUANTILE * np.sqrt(np.diag(covariance))
    return tuple(
        Estimate(
            parameter=parameter,
            value=float(x[place]),
            half_width=float(half_widths[place]),
            seen=bool(free[place]),
            reason=reasons[place],
        )
        for place, parameter in enumerate(parameters)
    )
