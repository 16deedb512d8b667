"""Latitude and longitude to metres around a place."""

from __future__ import annotations

import numpy as np

from artemis.motion.arrays import Array, wrapped

SEMI_MAJOR_AXIS, FLATTENING = 6_378_137.0, 1 / 298.257223563
"""The ellipsoid WGS 84 [m, -] (NIMA TR8350.2, table 3.1)."""


def local_metres(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """Metres to the east and to the north of the first point: equirectangular, with the ellipsoid's radii there.

    Radii of curvature of the meridian and of the prime vertical: Snyder, Map Projections - A Working Manual (USGS
    Professional Paper 1395, 1987), section 4. One kilometre to the north at 60 degrees of latitude, the scale to the
    east is off by 0.03 %.

    Args:
        latitude: [rad], north positive, shape (n,), n >= 1.
        longitude: [rad], east positive, shape (n,); may pass 180 degrees.
    """
    square = FLATTENING * (2 - FLATTENING)  # of the eccentricity
    sine = np.sin(latitude[0])
    prime_vertical = SEMI_MAJOR_AXIS / np.sqrt(1 - square * sine**2)
    meridian = SEMI_MAJOR_AXIS * (1 - square) / (1 - square * sine**2) ** 1.5
    turned = wrapped(longitude - longitude[0])
    return prime_vertical * np.cos(latitude[0]) * turned, meridian * (latitude - latitude[0])
