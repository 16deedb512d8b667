"""Smoothing and arc length of plane curves given by points."""

from __future__ import annotations

import math

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.cubic import Cubic, solved


def smoothed(parameter: Array, points: Array, wavelength: float, closed: bool) -> Array:
    """Points moved onto the smoothing spline: a low pass 1 / (1 + (w / w_c)^4), w_c = 2 pi / wavelength.

    Minimises sum(weight (point - curve)^2) + (wavelength / 2 pi)^4 integral(curve''^2), where a point's weight is the
    length it stands for (Reinsch 1967; matrices Q and R of Green and Silverman 1994, section 2.1.2).

    Args:
        parameter: of each point, rising (chord length [m]), shape (n,).
        points: x, y [m], shape (n, 2). A closed curve repeats its first point at its end.
        wavelength: of which the amplitude is halved [m].
        closed: the curve goes on smoothly from its end to its start.
    """
    if closed:  # three laps, of which the middle one is free of ends
        count, lap = len(points) - 1, parameter[-1]
        around = np.concatenate([parameter[:-1] - lap, parameter[:-1], parameter + lap])
        middle = smoothed(around, np.vstack([points[:-1], points[:-1], points]), wavelength, closed=False)
        return np.vstack([middle[count : 2 * count], middle[count : count + 1]])
    if len(points) < 3:
        return points
    step = np.diff(parameter)
    inverse_weight = 1 / np.append(np.append(step[0], step[:-1] + step[1:]) / 2, step[-1] / 2)
    inverse_weight[0] = 2 / step[0]
    before, after = 1 / step[:-1], 1 / step[1:]
    centre = -before - after
    stiffness = (wavelength / math.tau) ** 4
    diagonal = (step[:-1] + step[1:]) / 3 + stiffness * (
        before**2 * inverse_weight[:-2] + centre**2 * inverse_weight[1:-1] + after**2 * inverse_weight[2:]
    )
    beside = step[1:-1] / 6 + stiffness * (
        centre[:-1] * inverse_weight[1:-2] * before[1:] + after[:-1] * inverse_weight[2:-1] * centre[1:]
    )
    beyond = stiffness * after[:-2] * inverse_weight[2:-2] * before[2:]
    slope = np.diff(points, axis=0) / step[:, None]
    bend = solved(diagonal, beside, beyond, np.diff(slope, axis=0))
    force = np.zeros_like(points)
    force[:-2] += before[:, None] * bend
    force[1:-1] += centre[:, None] * bend
    force[2:] += after[:, None] * bend
    return np.asarray(points - stiffness * inverse_weight[:, None] * force)


def smoothed_between_halts(parameter: Array, points: Array, wavelength: float) -> Array:
    """As `smoothed` an open curve, but one that keeps its curvature up to its ends, where the robot stands.

    The curve is smoothed with its reflections across the normals at its ends, by which an arc goes on as an arc; a
    smoothing spline by itself ends straight.
    """
    if len(points) < 3:
        return points
    before, after = _reflected(parameter, points, wavelength), _reflected(-parameter[::-1], points[::-1], wavelength)
    count = len(before[0])
    whole = np.concatenate([before[0], parameter, -after[0][::-1]])
    rows = np.vstack([before[1], points, after[1][::-1]])
    return smoothed(whole, rows, wavelength, closed=False)[count : count + len(points)]


def _reflected(parameter: Array, points: Array, wavelength: float) -> tuple[Array, Array]:
    """What goes before the first point: parameters, rising, and points; reaching two wavelengths."""
    distance = parameter - parameter[0]
    near = max(int(np.searchsorted(distance, wavelength / 2, side="right")), 3)
    tangent = np.array([np.polyfit(distance[:near], column, 2)[1] for column in points[:near].T])
    tangent /= np.hypot(*tangent)
    last = max(int(np.searchsorted(distance, 2 * wavelength, side="right")), 2)
    off = points[1:last] - points[0]
    return (parameter[0] - distance[1:last])[::-1], (points[0] + off - 2 * (off @ tangent)[:, None] * tangent)[::-1]


def parameter_from_arc(curve: Cubic, end: float, spacing: float) -> tuple[Array, float]:
    """Where to evaluate a curve so that its points have a constant distance along it.

    Args:
        curve: a plane curve with parameter 0 ... `end`.
        end: its last parameter.
        spacing: arc length between points, at most [m].

    Returns:
        Parameters, shape (n,), n >= 3; and the curve's length [m].
    """
    grid = np.linspace(0.0, end, 2 * math.ceil(end / spacing) + 2)
    at_grid = np.hypot(*curve(grid, 1).T)
    at_middle = np.hypot(*curve((grid[:-1] + grid[1:]) / 2, 1).T)
    pieces = (at_grid[:-1] + 4 * at_middle + at_grid[1:]) / 6 * np.diff(grid)  # Simpson's rule
    arc = np.append(0.0, np.cumsum(pieces))
    length = float(arc[-1])
    inverse = Cubic(arc, grid, 1 / at_grid)
    count = max(math.ceil(length / spacing - 1e-9), 2)
    return np.clip(inverse(np.linspace(0.0, length, count + 1)), 0.0, end), length
