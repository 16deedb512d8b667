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
from numpy.typing import NDArray

from artemis.motion.arrays import Array

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

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Which points lie within it: x, y [m], shape (2, n)."""
        x, y = points[0], points[1]
        return np.asarray((x > self.rear) & (x < self.front) & (y > -self.half_width) & (y < self.half_width))


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
    if not forward:
        points, box = points * _MIRRORED, Rectangle(-box.front, -box.rear, box.half_width)
    x, y = points[0], points[1]
    behind, ahead, right, left = _bounds(curvatures, box, within)
    points = points.take(((x >= behind) & (x <= ahead) & (y >= right) & (y <= left)).nonzero()[0], 1)
    x, y, size = points[0], points[1], points.shape[1]
    if not size:
        return [within] * len(curvatures)
    beside = (x <= box.front).nonzero()[0]
    if beside.size and ((x.take(beside) >= box.rear) & (np.abs(y.take(beside)) <= box.half_width)).any():
        return [0.0] * len(curvatures)
    centres = [_centre(curvature) for curvature in curvatures]
    edges = np.array(_edges(centres, box)).reshape(-1, _COLUMNS).T
    seen, edges = points[:, np.newaxis].repeat(edges.shape[1], 1).reshape(2, -1), edges.repeat(size, 1)
    x, y = seen[0], seen[1] - edges[3]
    square = x * x + y * y
    rest = square - edges[0]
    reached = ((rest >= edges[1]) & (rest <= edges[2])).nonzero()[0]
    if not reached.size:
        return [within] * len(curvatures)
    x, y, square = x.take(reached), y.take(reached), square.take(reached)
    edge, root = edges.take(reached, 1), np.sqrt(rest.take(reached))
    x_there, y_there = edge[4] + edge[6] * root, edge[5] + edge[7] * root
    cosine = (x * x_there + y * y_there) / np.copysign(square, edge[3])
    cosine[y * x_there < x * y_there] = -1.0  # its sine is negative: after more than half a turn
    rest.fill(_NEVER)
    rest[reached] = cosine
    found = rest.reshape(len(centres), -1)
    largest = [found.item(arc, place) for arc, place in enumerate(found.argmax(1).tolist())]
    return [
        within if cosine == _NEVER else min(within, abs(centre) * acos(min(max(cosine, -1.0), 1.0)))
        for centre, cosine in zip(centres, largest, strict=True)
    ]


_NEVER = -2.0
_MIRRORED: Array = np.array(((-1.0,), (1.0,)))
_COLUMNS = 8


def _centre(curvature: float) -> float:
    """Where an arc's turning centre lies beside the rear axle, left positive [m]."""
    if abs(curvature) * STRAIGHT > 1.0:
        return 1.0 / curvature
    return STRAIGHT if curvature >= 0.0 else -STRAIGHT


def _edges(centres: Sequence[float], box: Rectangle) -> list[float]:
    """Of the front, inner, outer and, if any centre lies within its width, rear edge, of one arc after the other.

    `_COLUMNS` numbers each. Seen from the turning centre an edge lies at one x or one y: its square; the least and the
    greatest square of the other coordinate on the edge; where the centre lies; and a, b, c, d. A point whose square is
    by r² larger meets the edge at (a + c r, b + d r); if the centre lies to the right, at the opposite, for the points
    circle it the other way.
    """
    rear, front, half = box.rear, box.front, box.half_width
    first, last = front * front, rear * rear
    ahead, beside, behind, past = max(rear, 0.0) ** 2, max(-front, 0.0) ** 2, _squared(-rear), _squared(front)
    tight = min(map(abs, centres)) <= half
    numbers: list[float] = []
    for centre in centres:
        side, radius = (1.0, centre) if centre > 0.0 else (-1.0, -centre)
        inner, outer = half - radius, -half - radius
        least, most = max(-inner, 0.0), outer * outer
        numbers += first, least * least, most, centre, side * front, 0.0, 0.0, -1.0
        numbers += inner * inner, ahead, past, centre, 0.0, inner, side, 0.0
        numbers += most, beside, behind, centre, 0.0, outer, -side, 0.0
        if tight:
            numbers += last, 0.0, _squared(inner), centre, side * rear, 0.0, 0.0, 1.0
    return numbers


def _squared(most: float) -> float:
    """Of what is at most so large; an edge that lies elsewhere altogether is never reached."""
    return most * most if most >= 0.0 else -1.0


def _bounds(curvatures: Sequence[float], box: Rectangle, distance: float) -> tuple[float, float, float, float]:
    """A rectangle in which the outline stays on all of the arcs: from, to along x; from, to along y."""
    left, right = distance * max(*curvatures, 0.0), -distance * min(*curvatures, 0.0)
    if not max(left, right) <= pi / 2.0:  # or no number: straight ahead for ever
        return -inf, inf, -inf, inf
    ahead, behind, half = max(box.front, 0.0), max(-box.rear, 0.0), box.half_width
    turned = half * sin(max(left, right))
    to_left = max(distance * left / 2.0 + ahead * sin(left), behind * sin(right))
    to_right = max(distance * right / 2.0 + ahead * sin(right), behind * sin(left))
    return -behind - turned, distance + ahead + turned, -half - to_right, half + to_left


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
