"""What the columns of a table without a header are: told by their numbers, or not at all."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from artemis.motion.arrays import Array

FASTEST = 30.0
"""No robot that anybody follows a path with drives faster [m/s]."""
LEAST = 0.1
"""Shorter is no path [m]."""
TUM = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
LEAST_TURN = 0.3
"""A heading that turns by less [rad] may be another column that hardly changes."""
DEGREES = "expected rad, these are degrees: call the column heading_deg"
"""Of headings that `is_in_degrees`."""
_READINGS: tuple[tuple[str, ...], ...] = (
    ("x", "y"),
    ("x", "y", "z"),
    ("x", "y", "heading"),
    ("x", "y", "heading_deg"),
    ("time", "x", "y"),
    ("x", "y", "heading", "speed"),
    ("x", "y", "z", "heading"),
    ("time", "x", "y", "z"),
    ("time", "x", "y", "heading"),
    ("time", "x", "y", "heading_deg"),
    TUM,
)
"""That a table without a header may have."""


def layout_of(columns: Sequence[Sequence[float]]) -> tuple[str, ...] | str:
    """The names of columns without a header, by what their numbers can be; or why they cannot be known.

    Two columns are x and y. More are read only if exactly one reading is possible: a time rises in even steps, a
    heading points along or against the path, a height stays, a quaternion has the length 1. What can be a heading is no
    height, and if it turns, no place.

    Args:
        columns: all equally long.
    """
    count = len(columns)
    if count < 3:
        return ("x", "y")[:count]
    arrays = [np.array(column) for column in columns]
    possible = [names for names in _READINGS if len(names) == count and _fits(dict(zip(names, arrays, strict=True)))]
    headed = [names for names in possible if "heading" in names or "heading_deg" in names]
    possible = [names for names in possible if not (headed and "z" in names)]
    if headed and _turns(arrays[headed[0].index("heading" if "heading" in headed[0] else "heading_deg")]):
        possible = headed
    if len(possible) == 1:
        return possible[0]
    if possible:
        return f"{count} columns without names can be {' or '.join(', '.join(names) for names in possible)}{_NAMES}"
    return f"{count} columns without names{_NAMES}"


def _turns(heading: Array) -> bool:
    """Whether a heading says so much that no other column would point along a path by chance."""
    return float(np.ptp(heading)) > LEAST_TURN


_NAMES = ": write their names in a first line, such as x,y,heading_rad or time,x,y"


def _fits(columns: dict[str, Array]) -> bool:
    """Whether numbers can be these columns."""
    x, y = columns["x"], columns["y"]
    length = float(np.hypot(np.diff(x), np.diff(y)).sum())
    if length < LEAST and "time" not in columns:  # one that stands may write a log, too
        return False
    if "time" in columns:
        step = np.diff(columns["time"])
        if len(step) < 2 or step.min() <= 0 or step.max() > 3 * np.median(step):
            return False
        if length > FASTEST * float(np.sum(step)):
            return False
    if "z" in columns and "qw" not in columns and np.ptp(columns["z"]) > 0.02 * length:
        return False
    if "speed" in columns and not 0 < columns["speed"].min() <= columns["speed"].max() <= FASTEST:
        return False
    if "qw" in columns:
        rotation = np.array([columns[name] for name in ("qx", "qy", "qz", "qw")])
        return bool(
            np.abs(np.sqrt(np.square(rotation).sum(axis=0)) - 1).max() < 0.05 and np.abs(rotation[:2]).max() < 0.2
        )
    if "heading" in columns:
        return _along(x, y, columns["heading"])
    if "heading_deg" in columns:
        return _as_degrees(x, y, columns["heading_deg"])
    return True


def is_in_degrees(x: Array, y: Array, heading: Array) -> bool:
    """Whether a heading [rad] fits the path [m] only if its numbers are degrees."""
    return _as_degrees(x, y, heading) and not _along(x, y, heading)


def _as_degrees(x: Array, y: Array, heading: Array) -> bool:
    """Whether the numbers of a heading are degrees along or against the path, and too large for small angles [rad]."""
    return bool(np.abs(heading).max() > math.tau) and _along(x, y, np.radians(heading))


def _along(x: Array, y: Array, heading: Array) -> bool:
    """Whether a heading points along or against the path, nearly everywhere."""
    dx, dy = np.diff(x), np.diff(y)
    moves = np.hypot(dx, dy) > 1e-3
    direction = np.arctan2(dy[moves], dx[moves])
    middle = heading[:-1][moves] + np.diff(np.unwrap(heading))[moves] / 2
    across = np.abs(np.sin(middle - direction))
    return bool(len(across)) and float(np.quantile(across, 0.9)) < 0.2
