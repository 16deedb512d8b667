"""Sums and means that have the same bits on every Python: `sum` of floats compensates its rounding since 3.12."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import exp
from typing import TypeVar

Number = TypeVar("Number", int, float)


def total(values: Iterable[Number]) -> Number:
    """All of them, added from left to right."""
    result: Number = 0
    for value in values:
        result += value
    return result


def mean(values: Sequence[float]) -> float:
    """Of at least one."""
    return total(values) / len(values)


def smoothed(before: float, value: float, elapsed: float, time: float) -> float:
    """A running mean of the last `time` [s], `elapsed` [s] after it was `before`: a low pass of first order."""
    return before + (value - before) * (1.0 - exp(-elapsed / time))
