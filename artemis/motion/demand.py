"""What a path asks of the steering."""

from __future__ import annotations

import numpy as np

from artemis.motion.spline import Array
from artemis.vehicle import Geometry


def steering_per_distance(curvature: Array, spacing: float, geometry: Geometry) -> Array:
    """How far the wheel that turns more is steered for each metre that the virtual front wheel rolls [rad/m].

    The directions of the kingpins are those of `ackermann`; the inner one turns up to 1.3 times as fast as the virtual
    wheel.

    Args:
        curvature: of the rear axle's path [1/m], left positive, shape (n,), n >= 2.
        spacing: arc length between its samples [m].
        geometry: of the robot.
    """
    turn = np.zeros_like(curvature)
    for side in (geometry.kingpin_distance_m / 2, -geometry.kingpin_distance_m / 2):
        wheel = np.arctan2(curvature * geometry.wheelbase_m, 1 - curvature * side)
        turn = np.maximum(turn, np.abs(np.gradient(wheel, spacing)))
    return np.asarray(turn * np.cos(np.arctan(geometry.wheelbase_m * curvature)))
