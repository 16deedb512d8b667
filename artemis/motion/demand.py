"""What a path asks of the steering."""

from __future__ import annotations

import numpy as np

from artemis.axles import Geometry
from artemis.linkage import MeasuredLinkage
from artemis.motion.arrays import Array


def steering_per_distance(curvature: Array, spacing: float, geometry: Geometry) -> Array:
    """How far the steering motor that turns more turns for each metre that the virtual front wheel rolls [rad/m].

    At the wheel. The directions of the kingpins are those of `ackermann`; the inner one turns up to 1.3 times as fast
    as the virtual wheel.

    Args:
        curvature: of the rear axle's path [1/m], left positive, shape (n,), n >= 2.
        spacing: arc length between its samples [m].
        geometry: of the robot.
    """
    turn = np.zeros_like(curvature)
    linkage = MeasuredLinkage(geometry) if isinstance(geometry.linkage, tuple) else None
    half = geometry.steered_kingpin_distance_m / 2
    for side in (half, -half):
        wheel = np.arctan2(curvature * geometry.wheelbase_m, 1 - curvature * side)
        if linkage is not None:
            wheel = np.array([linkage.motor(steering) for steering in wheel.tolist()])
        turn = np.maximum(turn, np.abs(np.gradient(wheel, spacing)))
    return np.asarray(turn * np.cos(np.arctan(geometry.wheelbase_m * curvature)))
