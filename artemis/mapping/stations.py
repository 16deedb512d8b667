"""Where the robot was at every reading: seen from a key scan, or between two readings that are."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.laser import Reading
from artemis.mapping.se2 import Array, between, compose, driven

MOST_POINTS = 200
"""Of a scan that is kept to be matched once more: as many as the beams of a scanner with 1 degree between them."""


class Stations:
    """Readings in their order. Those with a matched scan are stations; between them the poses follow the odometry.

    Of a scan at most `MOST_POINTS` are kept, and only if the caller wants it: so memory depends neither on the number
    of beams nor, for each metre, on that of the scans. Beside it there are a few numbers of each reading.
    """

    def __init__(self) -> None:
        self.keys = array("q")
        """Of each station: the key scan from which it is seen."""
        self.readings = array("q")
        """Of each station: the number of its reading."""
        self._points: dict[int, NDArray[np.float32]] = {}
        self._motions = array("d")
        self._times = array("d")
        self._odometry = array("d")
        """x, y, heading of each reading; nan: there was none."""

    def stop(self, reading: Reading, key: int, motion: Array, *, keep: bool = False) -> None:
        """Add a reading with a matched scan: `motion`, shape (3,), leads to it from a key scan.

        If `keep`, points of it are kept.
        """
        if keep and reading.points is not None:
            thin = reading.points[:: 1 + (len(reading.points) - 1) // MOST_POINTS]
            self._points[len(self.keys)] = thin.astype(np.float32)
        self.keys.append(key)
        self._motions.extend(motion.tolist())
        self.readings.append(len(self._times))
        self.pass_by(reading.time, reading.odometry)

    def pass_by(self, time: float, odometry: Array | None) -> None:
        """Add a reading without a scan, or with one that adds nothing."""
        self._times.append(time)
        self._odometry.extend((np.nan,) * 3 if odometry is None else odometry)

    def points_of(self, station: int) -> Array | None:
        """Of the scan of a station, by its number: seen from the robot, shape (n, 4); None: they were not kept."""
        kept = self._points.get(station)
        return None if kept is None else kept.astype(float)

    def pose_of(self, station: int, key_poses: Array) -> Array:
        """Pose of a station, shape (3,), by its number, from the poses of all key scans, shape (n, 3)."""
        return compose(key_poses[self.keys[station]], np.array(self._motions[3 * station : 3 * station + 3]))

    @property
    def motions(self) -> Array:
        """Of each station, from its key scan to it, shape (n, 3). A copy."""
        return np.array(self._motions).reshape(-1, 3)

    @property
    def odometry(self) -> Array:
        """Of each reading, shape (n, 3); nan: there was none. A copy."""
        return np.array(self._odometry).reshape(-1, 3)

    def trajectory(self, poses: Array) -> tuple[Array, Array]:
        """Times [s] and poses of all readings, from the poses of the stations, shape (m, 3).

        Between two stations: by the odometry, what is missing to the second one spread over what was driven. Before the
        first station: by the odometry, back from it; after the last likewise.
        """
        times, odometry = np.array(self._times), np.nan_to_num(self.odometry)  # without odometry it counts as standing
        at, readings = np.array(self.readings), np.arange(len(times))
        if not at.size:
            return times, np.zeros((len(times), 3))
        before, distance = np.maximum(np.searchsorted(at, readings, side="right") - 1, 0), driven(odometry)
        found = compose(poses[before], between(odometry[at[before]], odometry))
        missing = between(compose(poses[:-1], between(odometry[at[:-1]], odometry[at[1:]])), poses[1:])
        inner = (readings > at[0]) & (readings < at[-1])
        number = before[inner]
        share = (distance[inner] - distance[at[number]]) / (distance[at[number + 1]] - distance[at[number]])
        found[inner] = compose(found[inner], share[:, None] * missing[number])
        found[at] = poses
        return times, found
