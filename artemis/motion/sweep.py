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
    x, y = points
    rear, front, half = box.rear, box.front, box.half_width
    if not forward:
        x, rear, front = -x, -front, -rear
    if within < inf:
        behind, ahead, right, left = _bounds(curvatures, rear, front, half, within)
        near = ((x >= behind) & (x <= ahead) & (y >= right) & (y <= left)).nonzero()[0]
        x, y = x[near], y[near]
    if not x.size:
        return [within] * len(curvatures)
    if ((x >= rear) & (x <= front) & (abs(y) <= half)).any():
        return [0.0] * len(curvatures)
    radii = [1.0 / abs(curvature) if abs(curvature) * STRAIGHT > 1.0 else STRAIGHT for curvature in curvatures]
    table = np.array([_edges(radius, rear, front, half) for radius in radii]).reshape(-1, 4, 4, 1)
    u = np.array(
        [y - radius if curvature >= 0.0 else -y - radius for radius, curvature in zip(radii, curvatures, strict=True)]
    )
    square = x * x + u * u
    rest = square[:, None] - table[:, 0]
    reached = ((rest >= table[:, 1]) & (rest <= table[:, 2])).ravel().nonzero()[0]
    number, point = np.divmod(reached, x.size)
    edge, arc = number & 3, number >> 2
    place, other = table[:, 3].take(number), _SIDE[edge] * np.sqrt(rest.take(reached))
    across = _ACROSS[edge]
    x_there, u_there = np.where(across, place, other), np.where(across, other, place)
    turned = arc * x.size + point
    x, u = x[point], u.take(turned)
    cosine = (x * x_there + u * u_there) / square.take(turned)
    turns_there = u * x_there - x * u_there >= 0.0  # the sine of its angle; else after more than half a turn
    largest = np.full(len(radii), _NEVER)
    np.maximum.at(largest, arc, np.where(turns_there, cosine, -1.0))
    return [
        within if cosine == _NEVER else min(within, radius * acos(min(max(cosine, -1.0), 1.0)))
        for radius, cosine in zip(radii, largest.tolist(), strict=True)
    ]


_ACROSS, _SIDE = np.array([True, False, False, True]), np.array([-1.0, 1.0, -1.0, 1.0])
"""Whether the front, left, right and rear edge lie at one x, else at one u; and the other coordinate's sign on them."""
_NEVER = -2.0


def _edges(radius: float, rear: float, front: float, half: float) -> list[float]:
    """Of the front, left, right and rear edge, seen from the turning centre, which lies to the left.

    First the squares of where they lie, then the least and the greatest squares of the other coordinate on them, then
    where they lie.
    """
    left, right, inner = half - radius, -half - radius, max(radius - half, 0.0)
    inner, ahead, behind, most = inner * inner, max(rear, 0.0) ** 2, max(-front, 0.0) ** 2, right * right
    return [
        *(front * front, left * left, most, rear * rear),
        *(inner, ahead, behind, 0.0),
        *(most, _squared(front), _squared(-rear), _squared(left)),
        *(front, left, right, rear),
    ]


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
