"""How fast a path can be driven: as the wheels' steering and rolling, and the drives' accelerations, allow."""

from __future__ import annotations

import math

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.demand import steering_per_distance
from artemis.motion.path import Path
from artemis.vehicle import RobotFile

STEERING_SHARE = 0.9
"""Of the steering rate a plan uses this much; the rest is the controller's, to correct with."""
BRAKING_SHARE = 0.6
"""Of acceleration and deceleration; the rest covers the delay of the drives."""
CRAWL = 0.03
"""No plan is slower [m/s]: a kink, which would ask for standstill, is passed so slowly."""


def speed_profile(path: Path, robot: RobotFile, speed: float) -> Array:
    """Speed of the virtual front wheel at each sample of a path [m/s], shape (n,).

    At most `speed` and what the path records; no wheel steers or rolls faster than it can; braking begins ahead, and
    acceleration is the robot's. A pass in each direction bounds v^2, which falls by 2 a for each metre that the front
    wheel rolls (ds / cos(alpha)). It knows no start and no end: around a closed path it fits together, and to halt at
    the end is the follower's.

    Args:
        path: to be driven.
        robot: with its limits.
        speed: highest wish [m/s], > 0.
    """
    limits, geometry = robot.limits, robot.geometry
    turn = steering_per_distance(path.curvature, path.spacing, geometry)
    rolling, scrub = wheel_ratio(path.curvature, robot)
    rate = STEERING_SHARE * math.radians(limits.steering_rate_wheel_deg_s)
    top = np.minimum(path.speeds(speed), limits.wheel_speed_m_s / (rolling + scrub * turn))
    top = np.minimum(top, rate / np.maximum(turn, 1e-9))
    front = path.spacing * np.sqrt(1 + (path.curvature * geometry.wheelbase_m) ** 2)
    squared = np.maximum(top, CRAWL) ** 2
    if path.closed:
        squared, front = np.tile(squared[:-1], 3), np.tile(front[:-1], 3)
    distance = np.append(0.0, np.cumsum(front[:-1]))
    ahead = 2 * BRAKING_SHARE * limits.deceleration_m_s2 * distance
    squared = np.minimum.accumulate((squared + ahead)[::-1])[::-1] - ahead
    behind = 2 * BRAKING_SHARE * limits.acceleration_m_s2 * distance
    squared = np.minimum.accumulate(squared - behind) + behind
    if path.closed:
        lap = len(path.curvature) - 1
        squared = squared[lap : 2 * lap + 1]
    return np.asarray(np.minimum(np.sqrt(squared), speed))


def wheel_ratio(curvature: Array, robot: RobotFile) -> tuple[Array, float]:
    """Speed of the faster driven wheel per speed of the virtual front wheel, shape (n,), and the scrub radius [m].

    As `Ackermann.speed_ratios`, for a whole path. The scrub radius is 0 where the rear wheels are driven.
    """
    geometry = robot.geometry
    sine = np.abs(np.sin(np.arctan(geometry.wheelbase_m * curvature)))
    cosine = np.sqrt(1 - sine**2)
    if geometry.driven_axle == "front":
        outer = geometry.kingpin_distance_m / (2 * geometry.wheelbase_m) * sine
        if geometry.differential:
            return (np.hypot(sine, cosine - outer) + np.hypot(sine, cosine + outer)) / 2, 0.0
        scrub = geometry.scrub_radius_m
        return np.hypot(sine, cosine + outer) + scrub / geometry.wheelbase_m * sine, scrub
    half_track = 0.0 if geometry.differential else geometry.track_m / 2
    return cosine + half_track / geometry.wheelbase_m * sine, 0.0
