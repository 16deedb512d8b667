"""A scan that was measured on the way: each of its beams from another place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.laser import surface_points
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings
from artemis.motion.arrays import wrapped
from artemis.motion.beams import seeing
from artemis.motion.poses import placed, seen_from
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Pose

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """A scan, and how the robot moved meanwhile: poses by the odometry, in a frame that never jumps."""

    scan: Scan
    time: float
    """Run time of its middle [s]."""
    begin: Pose
    middle: Pose
    end: Pose
    gaps: int
    """In how many ticks until then the wheels may have rolled uncounted: between two scans of one number none."""


def points_of(seen: Sighting, mounting: Mounting, settings: MapSettings) -> Array:
    """The points of a scan, seen from where the robot was in its middle: x, y [m] and normal, shape (n, 4).

    Each beam was measured elsewhere along the way; what the scanner sees of the robot itself is left out.
    """
    scan = seen.scan
    ranges = scan.millimetres * 1e-3
    angles = scan.start_angle + scan.increment * np.arange(len(ranges))
    ranges[~seeing(np.degrees(angles), mounting.mask)] = 0.0
    ranges[ranges < mounting.least_range_m] = 0.0
    place = Pose(x=mounting.x_m, y=mounting.y_m, heading=mounting.heading)
    ahead, behind = (seen_from(placed(seen.middle, place), placed(pose, place)) for pose in (seen.begin, seen.end))
    share = np.linspace(-1.0, 1.0, len(ranges))  # of the way from the middle to the begin, and to the end
    x = np.where(share < 0, -share * ahead.x, share * behind.x)
    y = np.where(share < 0, -share * ahead.y, share * behind.y)
    turn = np.where(share < 0, -share * ahead.heading, share * behind.heading)
    end_x, end_y = x + ranges * np.cos(angles + turn), y + ranges * np.sin(angles + turn)
    there = ranges > 0
    measured = np.where(there, np.hypot(end_x, end_y), 0.0)
    bearing = np.where(there, angles + turn + _bent(angles + turn, end_x, end_y), angles + turn)
    return surface_points(measured, bearing, settings, (mounting.x_m, mounting.y_m, mounting.heading))


def _bent(bearing: Floats, x: Floats, y: Floats) -> Floats:
    """How far points (x, y) [m] are from where a beam points [rad]."""
    return wrapped(np.arctan2(y, x) - bearing)
