"""The scans of one scanner, tick by tick, each with the odometry at its middle: of a run, or of its recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from artemis.mapping.laser import Reading
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.settings import MapSettings
from artemis.mapping.sighting import Sighting, points_of
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Pose, Tick

_KEPT = 150
"""Ticks whose odometry is kept: a scan comes later than it was measured, by less."""
_ORIGIN = np.zeros(3)


class ScanReadings:
    """Each beam of a scan is placed where the robot was when it was measured."""

    def __init__(self, settings: MapSettings, name: str, mounting: Mounting) -> None:
        """Take the scanner's name, and how it is mounted."""
        self._settings, self._name, self._mounting = settings, name, mounting
        self._way: deque[tuple[float, Array]] = deque(maxlen=_KEPT)
        self._origin, self._reset = _ORIGIN, False

    def see(self, tick: Tick, wanted: Callable[[Array], bool] = lambda _: True) -> Iterator[Reading]:
        """Take the next tick; returns its scans, but only those at whose odometry (shape (3,)) they are wanted."""
        pose = tick.snapshot.odometry.pose
        counted = np.array([pose.x, pose.y, pose.heading])
        if self._reset:  # another origin: the robot has not moved
            self._origin = compose(self._way[-1][1], between(counted, _ORIGIN))
        self._reset = tick.wish.reset_pose
        self._way.append((tick.snapshot.time, compose(self._origin, counted)))
        for scan in tick.snapshot.sensed.scans:
            if scan.source == self._name:
                lasting = scan.beam_time * max(0, len(scan.millimetres) - 1)
                middle = self._at(scan.time + lasting / 2)
                if wanted(middle):
                    yield self._reading(scan, lasting, middle)

    def _reading(self, scan: Scan, lasting: float, middle: Array) -> Reading:
        time = scan.time + lasting / 2
        begin, half, end = (_pose(each) for each in (self._at(scan.time), middle, self._at(scan.time + lasting)))
        seen = Sighting(scan=scan, time=time, begin=begin, middle=half, end=end, counted=True)
        return Reading(time=time, odometry=middle, points=points_of(seen, self._mounting, self._settings))

    def _at(self, time: float) -> Array:
        """The odometry at a time, between two ticks; the nearest where there is none around."""
        later = self._way[-1]
        for earlier in reversed(self._way):
            if earlier[0] <= time:
                if later[0] <= earlier[0]:
                    return earlier[1]
                share = min(1.0, (time - earlier[0]) / (later[0] - earlier[0]))
                return compose(earlier[1], share * between(earlier[1], later[1]))
            later = earlier
        return later[1]


def _pose(pose: Array) -> Pose:
    x, y, heading = pose.tolist()
    return Pose(x=x, y=y, heading=heading)
