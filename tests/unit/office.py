"""A world of straight walls that many tests look at with a laser scanner."""

from __future__ import annotations

import numpy as np

from artemis_lab.bench.laser_worlds import box, walls

OFFICE = np.concatenate(
    [
        box(-6, -4, 14, 10),
        walls([(-6, 2), (-1, 2)], [(1, 2), (5, 2), (5, 6)], [(2, -4), (2, -1.5)], [(4.5, -1), (8, -1)]),
        box(-3.5, -2.5, 1.2, 0.8),
        box(5.5, -3.2, 0.7, 0.7),
        box(-4.8, 3.4, 0.9, 1.3),
    ]
)
"""Two rooms and some furniture."""
