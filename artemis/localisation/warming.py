"""Compiles what matches scans, before a robot is touched: the first time that takes half a minute."""

from __future__ import annotations

import numpy as np

from artemis.localisation.scan_localizer import LocalizerSettings, ScanLocalizer
from artemis.localisation.scan_map import ScanMap
from artemis.mapping.laser import Reading, surface_points
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import occupancy


def warm_up() -> None:
    """Map a little, and look for the robot there: so nothing is compiled while it drives."""
    mapper, bearings = Mapper(), np.radians(np.arange(-90.0, 90.0))
    wall = np.minimum(3.0 / np.maximum(np.abs(np.sin(bearings)), 0.3), 4.0 / np.maximum(np.cos(bearings), 0.3))
    points = surface_points(wall, bearings, mapper.settings)
    for number in range(3 * mapper.settings.gap):
        pose = np.array([0.3 * (number % 4), 0.0, 0.4 * (number % 3)])
        mapper.add(Reading(time=float(number), odometry=pose, points=points))
    mapper.finish()
    occupancy(mapper.keys, 0.2)
    settings = LocalizerSettings(matching=mapper.settings, gather_scans=1, found=0.0)
    localizer = ScanLocalizer(ScanMap.of_scans([points], np.zeros((1, 3)), mapper.settings), settings)
    localizer.update(points, None)
    if (wanted := localizer.wanted()) is not None:
        localizer.take(wanted, localizer.look(wanted))
    localizer.update(points, None)
