"""How far a robot may roll on an arc before its outline touches a point: exactly, for many points at once.

In the frame of the rear axle (x ahead, y left) a robot that turns left about (0, R) sees every point circle that centre
clockwise. A point outside enters the outline, a rectangle, through its front edge below the centre, its left edge ahead
of the axle, its right edge behind it, or, where the centre lies within its width, its rear edge. Turning right and
rolling backwards are the same, mirrored.

Only sums, products, quotients and roots are taken of arrays: they are exactly rounded, so every machine gets the same
bits. What a library may round as it likes, an arc cosine, is taken of one number.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, inf, pi, sin

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


def free_distances(
    points: Array, curvatures: Sequence[float], box: Rectangle, within: float = inf, *, forward: bool = True
) -> list[float]:
    """Distances that the rear axle may roll on each arc until the first of the points is touched [m].

    Args:
        points: x, y in the frame of the rear axle [m], shape (2, n).
        curvatures: of the rear axle's path on each arc [1/m], left positive.
        box: the outline.
        within: what would be touched later is of no matter [m].
        forward: else it rolls backwards.

    At most `within`: nothing is touched before. A point that would be touched after more than half a turn counts as
    touched after half a turn.
    """
    x, y = points[0], points[1]
    rear, front, half, arcs = box.rear, box.front, box.half_width, len(curvatures)
    if not forward:
        x, rear, front = -x, -front, -rear
    if within < inf:
        behind, ahead, right, left = _bounds(curvatures, rear, front, half, within)
        near = ((x >= behind) & (x <= ahead) & (y >= right) & (y <= left)).nonzero()[0]
        x, y = x.take(near), y.take(near)
    if not x.size:
        return [within] * arcs
    if ((x >= rear) & (x <= front) & (np.abs(y) <= half)).any():
        return [0.0] * arcs
    radii = [1.0 / abs(curvature) if abs(curvature) * STRAIGHT > 1.0 else STRAIGHT for curvature in curvatures]
    edges = _edges(radii, rear, front, half)
    outward = np.array([y if curvature >= 0.0 else -y for curvature in curvatures])
    u = outward - np.array(radii)[:, np.newaxis]
    square = x * x + u * u
    limits = edges[:3].reshape(3, arcs, -1, 1)
    rest = square[:, np.newaxis] - limits[0]
    meets = rest >= limits[1]
    meets &= rest <= limits[2]
    reached = meets.ravel().nonzero()[0]
    if not reached.size:
        return [within] * arcs
    edge = reached // x.size
    point = reached - edge * x.size
    turned = edge // limits.shape[2] * x.size + point
    place, across = edges[3].take(edge), edges[5].take(edge) > 0.0
    other = edges[4].take(edge) * np.sqrt(rest.take(reached))
    x_there, u_there = np.where(across, place, other), np.where(across, other, place)
    x, u = x.take(point), u.take(turned)
    cosine = (x * x_there + u * u_there) / square.take(turned)
    turns_there = u * x_there - x * u_there >= 0.0  # the sine of its angle; else after more than half a turn
    largest = np.full(rest.size, _NEVER)
    largest[reached] = np.where(turns_there, cosine, -1.0)
    return [
        within if cosine == _NEVER else min(within, radius * acos(min(max(cosine, -1.0), 1.0)))
        for radius, cosine in zip(radii, largest.reshape(arcs, -1).max(axis=1).tolist(), strict=True)
    ]


_NEVER = -2.0


def _edges(radii: list[float], rear: float, front: float, half: float) -> Array:
    """Of the front, left, right and, if any centre lies within its width, the rear edge, of one arc after the other.

    Seen from the turning centre, which lies to the left: the squares of where they lie; the least and the greatest
    squares of the other coordinate on them; where they lie; the other coordinate's sign; and whether they lie at one x,
    else at one u. Shape (6, n).
    """
    first, last = front * front, rear * rear
    ahead, beside, behind, past = max(rear, 0.0) ** 2, max(-front, 0.0) ** 2, _squared(-rear), _squared(front)
    rows: list[float] = []
    for radius in radii:
        left, right, inner = half - radius, -half - radius, max(radius - half, 0.0)
        most, inner = right * right, inner * inner
        rows += (
            *(first, inner, most, front, -1.0, 1.0),
            *(left * left, ahead, past, left, 1.0, 0.0),
            *(most, beside, behind, right, -1.0, 0.0),
        )
        if min(radii) <= half:
            rows += last, 0.0, _squared(left), rear, 1.0, 1.0
    return np.array(rows).reshape(-1, 6).T


def _squared(most: float) -> float:
    """Of what is at most so large; an edge that lies elsewhere altogether is never reached."""
    return most * most if most >= 0.0 else -1.0


def _bounds(
    curvatures: Sequence[float], rear: float, front: float, half: float, distance: float
) -> tuple[float, float, float, float]:
    """A rectangle in which the outline stays on all of the arcs: from, to along x; from, to along y."""
    left, right = distance * max(*curvatures, 0.0), -distance * min(*curvatures, 0.0)
    if max(left, right) > pi / 2.0:
        return -inf, inf, -inf, inf
    ahead, behind, beside = max(front, 0.0), max(-rear, 0.0), half * sin(max(left, right))
    to_left = max(distance * left / 2.0 + ahead * sin(left), behind * sin(right))
    to_right = max(distance * right / 2.0 + ahead * sin(right), behind * sin(left))
    return -behind - beside, distance + ahead + beside, -half - to_right, half + to_left


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
