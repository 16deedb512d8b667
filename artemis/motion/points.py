"""Points of scans in frames, as `poses` does with poses; arrays of shape (2, n) [m]."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from artemis.motion.arrays import Array
from artemis.values import Pose


def placed_points(origin: Pose, points: Array) -> Array:
    """Points that are seen from `origin`, in the frame of `origin` itself; shape (2, n), as of `poses.placed`."""
    c, s = cos(origin.heading), sin(origin.heading)
    return np.array([origin.x + c * points[0] - s * points[1], origin.y + s * points[0] + c * points[1]])


def points_from(origin: Pose, points: Array) -> Array:
    """Points as seen from `origin`: the inverse."""
    if not points.size:
        return points
    s = sin(origin.heading)
    moved = points - np.array(((origin.x,), (origin.y,)))
    turned = moved[::-1] * np.array(((s,), (-s,)))
    moved *= cos(origin.heading)
    moved += turned
    return np.asarray(moved)
