"""Waypoints, near or far apart, become one smooth curve; what the curve does between them is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.path import SMOOTHING, Path, path_from_points
from artemis.motion.path_points import MAX_GAP, MIN_STEP
from artemis.motion.route import SHORTEST, Part, Route, stretches, turns_on_the_spot
from artemis.motion.track import SPACING
from artemis.motion.waypoints import along_lines, check_extent, drawn, largest_distance


def join(x: Array, y: Array, *, closed: bool, smoothing: float | None = None, speed: Array | None = None) -> Path:
    """The smooth curve through waypoints at least `MIN_STEP` apart, as densely sampled as a recorded path.

    Args:
        x: coordinates [m], shape (n,).
        y: likewise.
        closed: goes on from its end to its start; if not, it does so where its ends meet anyway.
        smoothing: as of `path_from_points`.
        speed: at the points [m/s].

    Raises:
        ConfigError: as `drawn`.
    """
    apart = len(x) > 1 and bool(np.hypot(np.diff(x), np.diff(y)).max() > MAX_GAP)
    meet = len(x) > 1 and math.hypot(x[0] - x[-1], y[0] - y[-1]) < MIN_STEP
    decided = True if closed else meet if apart else None
    return drawn(x, y, spacing=SPACING, smoothing=smoothing, closed=decided, speed=speed)


def straight(waypoints: Sequence[Sequence[float]], *, closed: bool = False) -> Route:
    """The route of straight lines from waypoint to waypoint: x, y [m], at least `MIN_STEP` apart from each other.

    It reverses where a path file does, and begins forwards. `closed`: it goes on from its last waypoint to its first,
    if both are at the same place.

    Raises:
        ConfigError: it is too short or too long, reverses twice within `SHORTEST`, or would turn on the spot.
    """
    corners = np.array(waypoints, dtype=float)
    check_extent(*corners.T)
    x, y = along_lines(corners, _evenly_between).T
    around = closed and math.dist(corners[0], corners[-1]) < MIN_STEP
    found = stretches(x, y, None)
    parts, problems = [], []
    for first, last, backward in found:
        px, py, whole = x[first : last + 1], y[first : last + 1], len(found) == 1
        path = path_from_points(px, py, smoothing=SMOOTHING, closed=around and whole, between_halts=not whole)
        parts.append(Part(path=path, backward=backward))
    for part in parts[1:-1]:
        if part.path.length < SHORTEST:
            expected = f"expected at least {SHORTEST:g} m in one direction"
            problems.append(f"{_at(part)}: reverses twice within {part.path.length:.3f} m; {expected}")
    problems += [f"{_at(parts[number])}: {problem}" for number, problem in turns_on_the_spot(parts)]
    if problems:
        raise ConfigError(problems)
    return Route(tuple(parts))


def _evenly_between(distance: Array) -> Array:
    between = [np.linspace(a, b, math.ceil((b - a) / SPACING), endpoint=False) for a, b in pairwise(distance)]
    return np.append(np.concatenate(between), distance[-1])


def _at(part: Part) -> str:
    """Where it begins, for people."""
    return f"waypoint x {part.path.x[0]:.2f} m, y {part.path.y[0]:.2f} m"


def bulge(x: Array, y: Array, path: Path) -> tuple[float, int]:
    """How far a path leaves the straight lines between its waypoints [m], and the waypoint next to that."""
    if path.closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
    lines = along_lines(
        np.column_stack([x, y]),
        lambda at: np.union1d(at, np.linspace(0.0, at[-1], 2 * math.ceil(at[-1] / SPACING) + 1)),
    )
    most, index = largest_distance(np.column_stack([path.x, path.y]), lines)
    nearest = int(np.argmin(np.hypot(x - path.x[index], y - path.y[index])))
    return most, nearest % (len(x) - 1 if path.closed else len(x))
