"""Surfaces of which a laser scanner sees a part: where they go on, if they are straight."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.beams import FEW
from artemis.motion.totals import mean

EDGE_BEAMS, LINE_BEAMS = 5, 80
"""A surface has at least twice so many beams; its line is that of so many next to its edge, or of fewer if it bends."""
RECEDES, STRAIGHT = 10.0, 0.05
"""A thing ends where it goes away from the scanner by more than this [mm]; a surface that is straight stays so near its
line [m]."""
CONTINUED, OWN = 60.0, 3.0
"""It goes on for so many places, at most, and for so many times its own length: the direction of a short piece is
uncertain."""


def beyond_edges(ends: Array, ranges: Array, near: float, apart: float) -> Iterator[Array]:
    """Of each surface with an edge so near that it may go on nearer than the scanner sees.

    Args:
        ends: of all beams, shape (2, n) [m].
        ranges: of the beams, 0 without a return [mm].
        near: an edge is, below this range [mm].
        apart: so are the places [m].

    Yields:
        Places along its line beyond the edge, shape (2, m) [m].
    """
    beams = ranges.nonzero()[0]
    for surface in np.split(beams, (np.diff(beams) > FEW + 1).nonzero()[0] + 1):
        if len(surface) < 2 * EDGE_BEAMS:
            continue
        for away in (surface, surface[::-1]):  # from its edge on
            edge, before = ranges[away[: 2 * EDGE_BEAMS]].reshape(2, EDGE_BEAMS).tolist()
            if edge[0] < near and mean(before) > mean(edge) - RECEDES:
                yield from _line(ends[:, away[:LINE_BEAMS]], apart)


def _line(points: Array, apart: float) -> Iterator[Array]:
    """Beyond the first of these points; none if they lie on no line."""
    for count in (points.shape[1], points.shape[1] // 2, points.shape[1] // 4):
        x, y = points[0, :count].tolist(), points[1, :count].tolist()
        half = count // 2
        dx, dy = mean(x[:half]) - mean(x[half:]), mean(y[:half]) - mean(y[half:])
        length, middle = hypot(dx, dy), (mean(x), mean(y))
        off = [dx * (b - middle[1]) - dy * (a - middle[0]) for a, b in zip(x, y, strict=True)]
        if half >= EDGE_BEAMS and length > 0.0 and max(map(abs, off)) <= STRAIGHT * length:
            along = (dx * (x[0] - middle[0]) + dy * (y[0] - middle[1])) / length
            most = min(CONTINUED, OWN * 2.0 * length / apart)  # its halves lie half of its length apart
            steps = along + apart * np.arange(1.0, most)
            yield np.array([middle[0] + dx / length * steps, middle[1] + dy / length * steps])
            return
