"""Two rooms that look alike, seven metres apart."""

from __future__ import annotations

import numpy as np

from artemis.localisation.scan_map import ScanMap
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings
from artemis_lab.bench.laser_worlds import box, scan


def room(x: float) -> Array:
    """A room whose lower left corner is at (x, 0), with things in it that show which way is which."""
    return np.concatenate([box(x, 0, 5, 4), box(x + 1, 0, 1.2, 0.7), box(x + 4.3, 1.5, 0.7, 0.5)])


APART = np.array([7.0, 0.0, 0.0])
TWINS = np.concatenate([room(0), room(APART[0])])
STANDS = np.array([[x, y, turn] for x in (1, 4, 8, 11) for y in (1.5, 3) for turn in (0, 2, 4)], float)


def twin_map(settings: MapSettings) -> ScanMap:
    return ScanMap.of_scans([scan(TWINS, pose) for pose in STANDS], STANDS, settings)
