"""Makes a map of readings, one after the other: simultaneous localisation and mapping."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from artemis.mapping.closing import LoopCloser
from artemis.mapping.final_pass import matched_again, refined_steps
from artemis.mapping.graph_file import MapGraph
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.pose_graph import PoseGraph
from artemis.mapping.se2 import Array, between, effort
from artemis.mapping.settings import MapSettings
from artemis.mapping.tracking import MapCounts, NewKey, Tracker

_LAST_ROUNDS = 20
"""Of the solver at the end."""
Later = Callable[[Callable[[NewKey], None], NewKey], None]


def at_once(work: Callable[[NewKey], None], key: NewKey) -> None:
    """Look for the loops of a key scan before the next reading is taken."""
    work(key)


class Mapper:
    """The same readings give the same map. Memory grows with the distance, and by ten numbers for each reading.

    Attributes:
        keys: the scans that make up the map, with the poses that are believed at present.
        graph: the links between them.
    """

    def __init__(
        self,
        settings: MapSettings | None = None,
        *,
        begun: MapGraph | None = None,
        start: Array | None = None,
        later: Later = at_once,
    ) -> None:
        """Begin.

        Args:
            settings: how.
            begun: a map to continue; its poses may move.
            start: about where the robot is on it, shape (3,); None: where the last run ended.
            later: has the loops of each key scan looked for, in their order; it may be another thread. All of it has to
                be done before anything but `add` and `begin_run` is called. The map is the same.
        """
        self.settings = settings or MapSettings()
        self._begun, self._later = begun, later
        self.keys, self.graph = (KeyScans(), PoseGraph()) if begun is None else (begun.keys, begun.graph)
        self._tracker = Tracker(self.settings)
        self._closer = LoopCloser(self.settings, self.keys, self.graph)
        if begun is not None:
            self._seen_from = begun.nearest_keys()
            self.begin_run(begun.trajectory[-1, 1:] if start is None else start)

    @property
    def counts(self) -> MapCounts:
        """What happened."""
        return self._tracker.counts

    @property
    def pose(self) -> Array:
        """Of the last reading, as it is believed at present, shape (3,)."""
        return self.pose_of(self.station)

    @property
    def station(self) -> int:
        """Number of the last reading whose scan was matched, of those; -1: there is none."""
        return len(self._tracker.stations.keys) - 1

    @property
    def key_readings(self) -> list[int]:
        """Number of the reading of each key scan that was added."""
        stations = self._tracker.stations
        first = np.unique(stations.keys, return_index=True)[1]
        return [stations.readings[station] for station in first.tolist()]

    @property
    def searched(self) -> int:
        """Places so far at which a loop was looked for."""
        return self._closer.loops.searched

    @property
    def solutions(self) -> int:
        """How often the graph was solved."""
        return self._closer.solutions

    def pose_of(self, station: int) -> Array:
        """Of a reading whose scan was matched, as it is believed at present, shape (3,); by its number of those."""
        return self._tracker.stations.pose_of(station, self.keys.poses)

    def add(self, reading: Reading) -> None:
        """Take the next reading."""
        key = self._tracker.add(reading)
        if key is not None:
            self._later(self._closer.add, key)

    def begin_run(self, start: Array) -> None:
        """The next reading is of another run, whose odometry begins anew: the robot is about at `start`, shape (3,)."""
        away = effort(between(self.keys.poses, start))
        near = np.argsort(away, kind="stable")[: self.settings.local][::-1].tolist()
        around = [(self.keys.points[key], self.keys.poses[key].copy()) for key in near]
        self._tracker.resume(around, near[-1], len(self.keys) - 1, start)

    def solve(self) -> None:
        """Move all poses to where they fit the links best."""
        self._closer.solve(_LAST_ROUNDS)

    def finish(self) -> None:
        """Solve, match every key scan with its neighbours again, and solve with these matches."""
        if len(self.keys) > 1:
            self.solve()
            self.keys.poses = matched_again(self.settings, self.keys, self.graph, self._closer.grid)

    def trajectory(self) -> tuple[Array, Array]:
        """Times [s] and poses of all readings in their order, shapes (n,) and (n, 3). After `finish`.

        Those of a map that was continued come first.
        """
        stations = self._tracker.stations
        poses = refined_steps(self.settings, self.keys, self.graph, self._closer.grid, stations)
        times, found = stations.trajectory(poses)
        if self._begun is None:
            return times, found
        before = self._begun.trajectory
        moved = self._seen_from.poses(self.keys.poses)
        return np.concatenate([before[:, 0], times]), np.concatenate([moved, found])

    def result(self) -> MapGraph:
        """The map as it is kept. After `finish`."""
        times, poses = self.trajectory()
        return MapGraph(self.keys, self.graph, np.c_[times, poses])
