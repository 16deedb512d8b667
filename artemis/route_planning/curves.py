"""Shortest curves of a car that also reverses: three pieces, arcs of the least radius and straight lines.

After J. A. Reeds and L. A. Shepp, Optimal paths for a car that goes both forwards and backwards, Pacific Journal of
Mathematics 145 (1990), formulas 8.1 to 8.3: the words CSC and CCC, each also driven backwards and mirrored. Words of
four and five pieces are left out: what they save, the search around this finds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from artemis.route_planning.kernels import compiled

Array = NDArray[np.float64]
LEFT, STRAIGHT, RIGHT = 1.0, 0.0, -1.0
TURN = 2.0 * math.pi
_LONG = 1e9


@compiled
def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    angle = angle % TURN
    return angle - TURN if angle > math.pi else angle


@compiled
def _take(
    word: Array, best: float, t: float, u: float, v: float, middle: float, last: float, ahead: float, side: float,
    before: float, price: Array,
) -> float:  # fmt: skip
    """Keep a word if it is cheaper than the best one; the cost of the cheaper one.

    Args:
        word: the best one so far; its three lengths [radii], negative backwards, and their kinds.
        best: its cost.
        t: first length, and so on.
        u: second.
        v: third.
        middle: kind of the second piece, as of the word that begins to the left.
        last: of the third.
        ahead: -1: all of it is driven the other way.
        side: -1: it is mirrored.
        before: as of `shortest`.
        price: likewise.
    """
    cost, last_length = 0.0, before * _LONG
    for length in (ahead * t, ahead * u, ahead * v):
        if abs(length) > 1e-6:
            cost += length if length > 0.0 else -price[0] * length
            if last_length * length < 0.0:
                cost += price[1]
                if min(abs(last_length), abs(length)) < price[2]:
                    return best
            last_length = length
    if cost < best:
        word[0], word[1], word[2] = ahead * t, ahead * u, ahead * v
        word[3], word[4], word[5] = side, side * middle, side * last
        return cost
    return best


@compiled
def _both(
    word: Array, best: float, t: float, u: float, v: float, last: float, ahead: float, side: float, before: float,
    price: Array,
) -> float:  # fmt: skip
    """`_take` a word with a straight piece, each of its arcs either way around."""
    for first in (t, t + TURN if t < 0.0 else t - TURN):
        for third in (v, v + TURN if v < 0.0 else v - TURN):
            best = _take(word, best, first, u, third, STRAIGHT, last, ahead, side, before, price)
    return best


@compiled
def rolled(x: float, y: float, heading: float, length: float, bend: float) -> tuple[float, float, float]:
    """The pose after an arc.

    Args:
        x: of the pose before.
        y: likewise.
        heading: [rad].
        length: of the arc, negative backwards.
        bend: its curvature, left positive.
    """
    half = length * bend / 2.0
    chord = length if abs(half) < 1e-6 else length * math.sin(half) / half
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + 2.0 * half


@compiled
def shortest(x: float, y: float, heading: float, before: float, price: Array, word: Array) -> float:
    """The cheapest word from the origin, heading 0, to a pose; its cost.

    Args:
        x: of the pose, in units of the least radius.
        y: likewise.
        heading: of the pose [rad].
        before: direction in which the car came to the origin: 1 forwards, -1 backwards, 0 it stood.
        price: of a length driven backwards, where forwards it is 1; of a change of direction; and the least length of
            a piece before or after one [radii].
        word: gets the three lengths [radii], negative backwards, and the kinds of the pieces: `LEFT` and so on.
    """
    best = 1e9
    for ahead in (1.0, -1.0):
        for side in (1.0, -1.0):
            px, py, turn = ahead * x, side * y, ahead * side * heading
            a, b = px - math.sin(turn), py - 1.0 + math.cos(turn)
            distance, angle = math.hypot(a, b), math.atan2(b, a)
            best = _both(word, best, wrapped(angle), distance, wrapped(turn - angle), LEFT, ahead, side, before, price)
            if distance <= 4.0:
                u = -2.0 * math.asin(distance / 4.0)
                t = wrapped(angle + u / 2.0 + math.pi)
                v = wrapped(turn - t + u)
                best = _take(word, best, t, u, v, RIGHT, LEFT, ahead, side, before, price)
            a, b = px + math.sin(turn), py - 1.0 - math.cos(turn)
            square = a * a + b * b
            if square >= 4.0:
                u = math.sqrt(square - 4.0)
                t = wrapped(math.atan2(b, a) + math.atan2(2.0, u))
                best = _both(word, best, t, u, wrapped(t - turn), RIGHT, ahead, side, before, price)
    return best
