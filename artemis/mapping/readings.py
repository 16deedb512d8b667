"""The scans of one scanner, each with the odometry at its middle: of a run tick by tick, or of its recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from artemis.mapping.laser import Reading
from artemis.mapping.recent_odometry import KEPT, RecentOdometry
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings
from artemis.mapping.sighting import points_of
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Tick
from artemis.vehicle import RobotFile


class ScanReadings:
    """Each beam of a scan is placed where the robot was when it was measured."""

    def __init__(self, settings: MapSettings, robot: RobotFile, name: str, mounting: Mounting | None = None) -> None:
        """Take the scanner's name, and how it is mounted, if not as the robot file says."""
        self._settings, self._name, self._mounting = settings, name, mounting or robot.scanners[name]
        self._place = np.array([self._mounting.x_m, self._mounting.y_m])
        self._odometry = RecentOdometry(robot)
        self._waiting: deque[Scan] = deque(maxlen=KEPT)
        """For the odometry at their ends, which comes with the next ticks."""

    def see(self, tick: Tick, wanted: Callable[[Array], bool] = lambda _: True) -> Iterator[Reading]:
        """Take the next tick; returns the scans whose odometry is known by now.

        Args:
            tick: the next one.
            wanted: whether to return the scan at whose middle the odometry is this, shape (3,).
        """
        self._odometry.see(tick)
        self._waiting += [scan for scan in tick.snapshot.sensed.scans if scan.source == self._name]
        while self._waiting and (seen := self._odometry.sighting(self._waiting[0])) is not None:
            self._waiting.popleft()
            pose = seen.middle
            middle = np.array([pose.x, pose.y, pose.heading])
            if wanted(middle):
                points = points_of(seen, self._mounting, self._settings)
                yield Reading(time=seen.time, odometry=middle, points=points, place=self._place)
