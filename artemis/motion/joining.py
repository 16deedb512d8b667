"""Waypoints, near or far apart, become one smooth curve; what the curve does between them is measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from artemis.motion.path import Path
from artemis.motion.path_points import MAX_GAP, MIN_STEP
from artemis.motion.spline import Array
from artemis.motion.track import SPACING
from artemis.motion.waypoints import drawn, largest_distance


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


@dataclass(frozen=True, slots=True)
class Placement:
    """A move of the plane: the point `x`, `y` [m] comes to the origin, the direction `heading` [rad] along x."""

    x: float
    y: float
    heading: float

    def of_points(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Points, moved."""
        dx, dy = x - self.x, y - self.y
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        return dx * cosine + dy * sine, dy * cosine - dx * sine


def bulge(x: Array, y: Array, path: Path) -> tuple[float, int]:
    """How far a path leaves the straight lines between its waypoints [m], and the waypoint next to that."""
    if path.closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
    parameter = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    dense = np.union1d(parameter, np.linspace(0.0, parameter[-1], 2 * math.ceil(parameter[-1] / SPACING) + 1))
    lines = np.column_stack([np.interp(dense, parameter, x), np.interp(dense, parameter, y)])
    most, index = largest_distance(np.column_stack([path.x, path.y]), lines)
    nearest = int(np.argmin(np.hypot(x - path.x[index], y - path.y[index])))
    return most, nearest % (len(x) - 1 if path.closed else len(x))
