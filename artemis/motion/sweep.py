"""How far a robot may roll on an arc before its outline touches a point: exactly, for many points at once.

In the frame of the rear axle (x ahead, y left) a robot that turns left about (0, R) sees every point circle that centre
clockwise. A point outside enters the outline, a rectangle, through its front edge below the centre, its left edge ahead
of the axle, its right edge behind it, or, where the centre lies within its width, its rear edge. Turning right and
rolling backwards are the same, mirrored.

Only sums, products, quotients and roots are taken of arrays: they are exactly rounded, so every machine gets the same
bits. What a library may round as it likes, an arc cosine, is taken of one number.
"""

from __future__ import annotations

from math import acos, inf

import numpy as np
from msgspec import Struct

from artemis.motion.spline import Array

STRAIGHT = 1000.0
"""Radius [m] that stands for straight ahead: 0.5 mm off after 1 m."""


class Rectangle(Struct, frozen=True):
    """A rectangle around the rear axle's centre [m]: `rear` is negative where it reaches behind the axle."""

    rear: float
    front: float
    half_width: float

    def grown(self, margin: float) -> Rectangle:
        """By a margin on every side [m]."""
        return Rectangle(self.rear - margin, self.front + margin, self.half_width + margin)


def free_distance(points: Array, curvature: float, box: Rectangle, *, forward: bool = True) -> float:
    """Distance that the rear axle may roll until the first of the points is touched [m]; infinite: none is.

    Args:
        points: x, y in the frame of the rear axle [m], shape (2, n).
        curvature: of the rear axle's path [1/m], left positive.
        box: the outline.
        forward: else it rolls backwards.

    A point that would be touched after more than half a turn counts as touched after half a turn.
    """
    x, y = points
    if not x.size:
        return inf
    rear, front, half = box.rear, box.front, box.half_width
    if not forward:
        x, rear, front = -x, -front, -rear
    if curvature < 0.0:
        y, curvature = -y, -curvature
    radius = 1.0 / curvature if curvature * STRAIGHT > 1.0 else STRAIGHT
    u = y - radius
    square = x * x + u * u
    inside = max(0.0, radius - half)
    least = inside * inside + (0.0 if rear <= 0.0 <= front else min(front * front, rear * rear))
    swept = (square >= least) & (square <= max(front * front, rear * rear) + (radius + half) ** 2)
    x, u, square = x[swept], u[swept], square[swept]
    if not x.size:
        return inf
    low, high = -half - radius, half - radius
    if ((x >= rear) & (x <= front) & (u >= low) & (u <= high)).any():
        return 0.0
    edges = [
        _through(x, u, square, front, low, min(high, 0.0), -1.0),
        _through(u, x, square, high, max(rear, 0.0), front, 1.0, turned=True),
        _through(u, x, square, low, rear, min(front, 0.0), -1.0, turned=True),
    ]
    if high > 0.0:
        edges.append(_through(x, u, square, rear, 0.0, high, 1.0))
    cosine = max(edges)
    return inf if cosine < -1.0 else radius * acos(min(cosine, 1.0))


def _through(
    along: Array, across: Array, square: Array, edge: float, low: float, high: float, side: float, turned: bool = False
) -> float:
    """Largest cosine of the angle by which a point turns until it enters through an edge; -2: none does.

    The edge lies at `edge` of the first coordinate and reaches from `low` to `high` of the other one, which has the
    sign `side` there; `turned`: the first coordinate is that to the left.
    """
    rest = square - edge * edge
    least, most = (low, high) if side > 0.0 else (-high, -low)
    if most < 0.0:
        return -2.0
    reached = np.flatnonzero((rest >= max(least, 0.0) ** 2) & (rest <= most * most))
    if not reached.size:
        return -2.0
    other = side * np.sqrt(rest[reached])
    along, across, square = along[reached], across[reached], square[reached]
    ahead = across * edge - along * other  # of the sine of the angle, with its sign
    if turned:
        ahead = -ahead
    cosine = (along * edge + across * other) / square
    return float(np.where(ahead >= 0.0, cosine, -1.0).max())


def stopping_speed(distance: float, reaction: float, deceleration: float) -> float:
    """Greatest speed from which a robot stands within `distance` [m]: v t + v² / 2a [m/s].

    Args:
        distance: infinite: any speed.
        reaction: time until it slows down [s].
        deceleration: then [m/s²].
    """
    if distance <= 0.0:
        return 0.0
    if distance == inf:
        return inf
    root: float = (reaction * reaction + 2.0 * distance / deceleration) ** 0.5
    return deceleration * (root - reaction)
