"""What a mapper is fed with: readings of a laser scanner and of the odometry, as plain values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from artemis.mapping import kernels
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings
from artemis.scan import Scan


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Reading:
    """What was known at one time: a scan, the odometry, or both."""

    time: float
    """[s], by any clock."""
    odometry: Array | None = None
    """Pose of the robot by its wheels, in any frame, shape (3,); None: nobody counted."""
    points: Array | None = None
    """Of the scan, as `surface_points` gives them, shape (n, 4); None: there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannerPlace:
    """Where a scanner is on its robot: seen from the robot's reference point, x ahead, y left."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    """[rad], counter-clockwise."""
    upside_down: bool = False
    """The scanner's angles then count clockwise, seen from above."""


AT_CENTRE = ScannerPlace()


def surface_points(
    ranges: ArrayLike, angles: ArrayLike, settings: MapSettings, mounting: ScannerPlace = AT_CENTRE
) -> Array:
    """The points of one scan, seen from the robot.

    Args:
        ranges: [m], shape (n,); what is out of range, 0 or nan is no return.
        angles: of the beams [rad], evenly spaced, counter-clockwise seen from the scanner's top, shape (n,).
        settings: which returns count.
        mounting: of the scanner.

    Returns:
        x, y [m] and the unit normal of the surface (0, 0: unknown), shape (m, 4).
    """
    bearing = -np.asarray(angles, float) if mounting.upside_down else np.asarray(angles, float)
    distance = np.nan_to_num(np.asarray(ranges, float), nan=0.0)
    seen = kernels.LOOPS.surface_points(
        distance, bearing + mounting.heading, settings.nearest, settings.farthest, settings.spacing
    )
    seen[:, :2] += mounting.x, mounting.y
    return np.asarray(seen)


def points_of(scan: Scan, settings: MapSettings, mounting: ScannerPlace = AT_CENTRE) -> Array:
    """The points of a scan of artemis, seen from the robot, shape (m, 4)."""
    ranges = scan.millimetres * 1e-3
    return surface_points(ranges, scan.start_angle + scan.increment * np.arange(len(ranges)), settings, mounting)
