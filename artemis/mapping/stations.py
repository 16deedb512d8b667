"""Where the robot was at every reading: seen from a key scan, or between two readings that are."""

from __future__ import annotations

import itertools
from array import array

import numpy as np

from artemis.mapping.laser import Reading
from artemis.mapping.se2 import Array, between, compose, shares


class Stations:
    """Readings in their order. Those with a matched scan are stations; between them the odometry tells the way."""

    def __init__(self) -> None:
        self.points: list[Array] = []
        """Of each station's scan, seen from the robot, shape (n, 4)."""
        self.keys: list[int] = []
        """Of each station: the key scan from which it is seen."""
        self.motions: list[Array] = []
        """From there to it, shape (3,)."""
        self.readings: list[int] = []
        """Of each station: the number of its reading."""
        self._times = array("d")
        self._odometry = array("d")
        """x, y, heading of each reading; nan: there was none."""

    def stop(self, reading: Reading, key: int, motion: Array) -> None:
        """Add a reading with a scan: `motion`, shape (3,), leads to it from a key scan."""
        if reading.points is None:
            raise ValueError("a station needs a scan")
        self.points.append(reading.points)
        self.keys.append(key)
        self.motions.append(motion)
        self.readings.append(len(self._times))
        self.pass_by(reading.time, reading.odometry)

    def pass_by(self, time: float, odometry: Array | None) -> None:
        """Add a reading without a scan, or with one that tells nothing new."""
        self._times.append(time)
        self._odometry.extend((np.nan,) * 3 if odometry is None else odometry)

    def step_to(self, odometry: Array | None) -> Array | None:
        """By the odometry, from the last station to here, shape (3,); None: nobody counted."""
        last = self.odometry[self.readings[-1]]
        if odometry is None or np.isnan(last[0]):
            return None
        return between(last, odometry)

    def pose_of(self, station: int, key_poses: Array) -> Array:
        """Pose of a station, shape (3,), by its number, from the poses of all key scans, shape (n, 3)."""
        return compose(key_poses[self.keys[station]], self.motions[station])

    @property
    def odometry(self) -> Array:
        """Of each reading, shape (n, 3); nan: there was none. A copy."""
        return np.array(self._odometry).reshape(-1, 3)

    def trajectory(self, poses: Array) -> tuple[Array, Array]:
        """Times [s] and poses of all readings, from the poses of the stations, shape (m, 3).

        Between two stations: by the odometry, what is missing to the second one spread over what was driven. Before the
        first station: by the odometry, back from it; after the last likewise.
        """
        times, odometry = np.array(self._times), self.odometry
        found = np.empty((len(times), 3))
        at = self.readings
        found[at] = poses
        for number, (begin, end) in enumerate(itertools.pairwise(at)):
            if end - begin > 1:
                way = _counted(odometry[begin : end + 1])
                gap = between(compose(poses[number], between(way[0], way[-1])), poses[number + 1])
                there = compose(poses[number], between(way[0], way[1:-1]))
                found[begin + 1 : end] = compose(there, shares(way)[:-1, None] * gap)
        if at:
            found[: at[0]] = compose(poses[0], between(_counted(odometry[at[0]]), _counted(odometry[: at[0]])))
            found[at[-1] + 1 :] = compose(
                poses[-1], between(_counted(odometry[at[-1]]), _counted(odometry[at[-1] + 1 :]))
            )
        return times, found


def _counted(odometry: Array) -> Array:
    """Where nobody counted, nothing moved."""
    return np.nan_to_num(odometry, nan=0.0)
