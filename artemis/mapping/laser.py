"""What a mapper is fed with: readings of a laser scanner and of the odometry, as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from artemis.mapping import kernels
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Reading:
    """What was known at one time: a scan, the odometry, or both."""

    time: float
    """[s], by any clock."""
    odometry: Array | None = None
    """Pose of the robot by its wheels, in any frame, shape (3,); None: there is no odometry."""
    points: Array | None = None
    """Of the scan, as `surface_points` gives them, shape (n, 4); None: there was none."""
    place: Array = field(default_factory=lambda: np.zeros(2))
    """Of the scanner on the robot: x ahead, y left [m], shape (2,)."""


AT_CENTRE = (0.0, 0.0, 0.0)


def surface_points(ranges: ArrayLike, angles: ArrayLike, settings: MapSettings, place: ArrayLike = AT_CENTRE) -> Array:
    """The points of one scan, seen from the robot.

    Args:
        ranges: [m], shape (n,); what is out of range, 0 or nan is no return.
        angles: of the beams [rad], evenly spaced, counter-clockwise seen from above, shape (n,).
        settings: which returns count.
        place: of the scanner on the robot: x ahead, y left [m], heading [rad], shape (3,).

    Returns:
        x, y [m] and the unit normal of the surface (0, 0: unknown), shape (m, 4).
    """
    x, y, heading = np.asarray(place, float)
    distance = np.nan_to_num(np.asarray(ranges, float), nan=0.0)
    bearings = np.asarray(angles, float) + heading
    seen = kernels.LOOPS.surface_points(distance, bearings, settings.nearest, settings.farthest, settings.spacing)
    seen[:, :2] += x, y
    return np.asarray(seen)
