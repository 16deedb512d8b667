"""Piecewise cubic curves through points, and the systems of equations with few diagonals that they lead to.

scipy has them, too, but takes a third of a second to import, and LAPACK's last bits depend on the processor.
"""

from __future__ import annotations

import numpy as np

from artemis.motion.arrays import Array


class Cubic:
    """The piecewise cubic curve with given slopes at given points (Hermite)."""

    def __init__(self, parameter: Array, points: Array, slopes: Array) -> None:
        """`parameter`: of each point, rising, shape (n,), n >= 2; the others: shape (n,) or (n, k)."""
        self._parameter = parameter
        step = _like(np.diff(parameter), points)
        chord = np.diff(points, axis=0) / step
        bend = (slopes[:-1] + slopes[1:] - 2.0 * chord) / step
        self._coefficients = points[:-1], slopes[:-1], (chord - slopes[:-1]) / step - bend, bend / step

    def __call__(self, at: Array, order: int = 0) -> Array:
        """The curve at these parameters, or its derivative of this order, up to 2; shape (m,) or (m, k)."""
        last = len(self._parameter) - 2
        piece = np.clip(np.searchsorted(self._parameter, at, side="right") - 1, 0, last)
        constant, linear, square, cube = (each[piece] for each in self._coefficients)
        past = _like(at - self._parameter[piece], constant)
        if order == 0:
            return np.asarray(constant + past * (linear + past * (square + past * cube)))
        if order == 1:
            return np.asarray(linear + past * (2.0 * square + past * 3.0 * cube))
        return np.asarray(2.0 * square + past * 6.0 * cube)


def spline(parameter: Array, points: Array, *, closed: bool) -> Cubic:
    """The cubic spline through points: its second derivative is continuous, too.

    A closed one goes on smoothly from its end to its start. The ends of an open one are free: its third
    derivative is continuous at the second and at the last but one point (not-a-knot; de Boor 1978, chapter IV).

    Args:
        parameter: of each point, rising, shape (n,), n >= 2; n >= 3 for a closed curve.
        points: shape (n, k).
        closed: its first point is its last.
    """
    step = np.diff(parameter)[:, None]
    chord = np.diff(points, axis=0) / step
    if closed:
        return Cubic(parameter, points, _closed_slopes(step, chord))
    if len(points) == 2:
        return Cubic(parameter, points, np.vstack([chord, chord]))
    if len(points) == 3:  # a parabola
        middle = (step[1] * chord[0] + step[0] * chord[1]) / (step[0] + step[1])
        return Cubic(parameter, points, np.array([2.0 * chord[0] - middle, middle, 2.0 * chord[1] - middle]))
    return Cubic(parameter, points, _open_slopes(step, chord))


def _open_slopes(step: Array, chord: Array) -> Array:
    """At all points; the end conditions give those of the first and the last one, which leaves the inner ones."""
    weight = 1.0 / step
    diagonal, right = 2.0 * (weight[:-1] + weight[1:]), 3.0 * (weight[:-1] * chord[:-1] + weight[1:] * chord[1:])
    ends = []
    for end, near, far, inner in ((0, 0, 1, 0), (-1, -1, -2, -1)):
        both = step[near] + step[far]
        given = ((step[near] + 2.0 * both) * step[far] * chord[near] + step[near] ** 2 * chord[far]) / both
        diagonal[inner] -= weight[near] * weight[far] * both
        right[inner] -= weight[near] * weight[far] * given
        ends.append((end, given * weight[far], both * weight[far]))
    slopes = np.zeros((len(chord) + 1, chord.shape[1]))
    slopes[1:-1] = solved(diagonal[:, 0], weight[1:-1, 0], None, right)
    for (end, given, share), inner in zip(ends, (1, -2), strict=True):
        slopes[end] = given - share * slopes[inner]
    return slopes


def _closed_slopes(step: Array, chord: Array) -> Array:
    """At all points of a closed curve: the first one is eliminated, the others follow as if it were known."""
    weight = 1.0 / step
    before, chord_before = np.roll(weight, 1, axis=0), np.roll(chord, 1, axis=0)
    diagonal, right = 2.0 * (before + weight), 3.0 * (before * chord_before + weight * chord)
    joined = np.zeros_like(diagonal[1:])  # how the first one enters the equations of the others
    joined[0] += weight[0]
    joined[-1] += weight[-1]
    inner = solved(diagonal[1:, 0], weight[1:-1, 0], None, np.hstack([right[1:], joined]))
    known, share = inner[:, :-1], inner[:, -1:]
    entering = weight[0] * known[0] + weight[-1] * known[-1]
    first = (right[0] - entering) / (diagonal[0] - weight[0] * share[0] - weight[-1] * share[-1])
    return np.vstack([first, known - share * first, first])


def solved(diagonal: Array, beside: Array, beyond: Array | None, right: Array) -> Array:
    """Solve a symmetric positive definite system with up to two diagonals beside the main one.

    L D L' without pivoting (Golub and Van Loan 2013, section 4.3.6). Same bits on every processor.

    Args:
        diagonal: shape (n,), n >= 1.
        beside: the diagonal next to it, shape (n - 1,).
        beyond: the next one, shape (n - 2,); None: there is none.
        right: right sides, shape (n, k).
    """
    count = len(diagonal)
    near = [0.0, *beside.tolist()]
    far = [0.0, 0.0, *([0.0] * count if beyond is None else beyond.tolist())]
    pivots, first, second = [1.0] * (count + 2), [0.0] * (count + 2), [0.0] * (count + 2)  # two more: before row 0, too
    for row, main in enumerate(diagonal.tolist()):
        rest = near[row] - far[row] * first[row - 1]
        first[row], second[row] = rest / pivots[row - 1], far[row] / pivots[row - 2]
        pivots[row] = main - first[row] * rest - second[row] * far[row]
    columns = []
    for column in right.T.tolist():
        x = [*column, 0.0, 0.0]
        for row in range(count):
            x[row] -= first[row] * x[row - 1] + second[row] * x[row - 2]
        for row in reversed(range(count)):
            x[row] = x[row] / pivots[row] - first[row + 1] * x[row + 1] - second[row + 2] * x[row + 2]
        columns.append(x[:count])
    return np.array(columns).T


def _like(numbers: Array, points: Array) -> Array:
    """One number for each point, in a shape that goes with the points'."""
    return numbers if points.ndim == 1 else numbers[:, None]
