"""Poses and motions in the plane as arrays (..., 3): x, y [m], heading [rad], counter-clockwise positive."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from artemis.motion.arrays import wrapped

Array: TypeAlias = NDArray[np.float64]

TURN_WEIGHT = 0.5
"""A turn by 1 rad counts as so many metres where motion is expressed as one number."""


def compose(first: ArrayLike, second: ArrayLike) -> Array:
    """Motion `second`, begun at pose `first`: the pose that it leads to. Both broadcast."""
    a, b = np.asarray(first, float), np.asarray(second, float)
    if a.ndim == b.ndim == 1:
        (ax, ay, at), (bx, by, bt) = a.tolist(), b.tolist()
        c, s = math.cos(at), math.sin(at)
        return np.array([ax + c * bx - s * by, ay + s * bx + c * by, (at + bt + math.pi) % math.tau - math.pi])
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrapped(a[..., 2] + b[..., 2])], -1)


def between(first: ArrayLike, second: ArrayLike) -> Array:
    """The motion that leads from pose `first` to pose `second`, seen from `first`. Both broadcast."""
    a, b = np.asarray(first, float), np.asarray(second, float)
    if a.ndim == b.ndim == 1:
        (ax, ay, at), (bx, by, bt) = a.tolist(), b.tolist()
        c, s, x, y = math.cos(at), math.sin(at), bx - ax, by - ay
        return np.array([c * x + s * y, c * y - s * x, (bt - at + math.pi) % math.tau - math.pi])
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, c * dy - s * dx, wrapped(b[..., 2] - a[..., 2])], -1)


def placed_surface(pose: Array, points: Array) -> Array:
    """Points x, y [m] with their normals, shape (n, 4), that are seen from `pose`, shape (3,), in its own frame."""
    x, y, turn = pose
    c, s = np.cos(turn), np.sin(turn)
    px, py, nx, ny = points.T
    return np.stack([x + c * px - s * py, y + s * px + c * py, c * nx - s * ny, s * nx + c * ny], 1)


def within(motion: Array, distance: float, turn: float) -> bool:
    """Whether one motion, shape (3,), is shorter than `distance` [m] and turns by less than `turn` [rad]."""
    x, y, turned = motion.tolist()
    return math.hypot(x, y) < distance and abs((turned + math.pi) % math.tau - math.pi) < turn


def effort(motions: Array) -> Array:
    """How much was driven in each motion, shape (n, 3): metres, turns counted by `TURN_WEIGHT`; shape (n,)."""
    return np.asarray(np.hypot(motions[:, 0], motions[:, 1]) + TURN_WEIGHT * np.abs(motions[:, 2]))


def driven(odometry: Array) -> Array:
    """How much was driven from the first of n poses (n, 3) to each, shape (n,); it grows a little where none moves."""
    return np.append(0.0, np.cumsum(effort(between(odometry[:-1], odometry[1:])) + 1e-5))


def shares(odometry: Array) -> Array:
    """Of poses (n, 3), n > 1: which part of what was driven from the first to the last had been driven, shape (n - 1,).

    Of the second pose on; the last is 1. Poses that do not move are spread evenly.
    """
    distance = driven(odometry)[1:]
    return np.asarray(distance / distance[-1])
