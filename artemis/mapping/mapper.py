"""Makes a map of readings, one after the other: simultaneous localisation and mapping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from artemis.mapping.final_pass import matched_again, refined_steps
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.loops import LoopFinder
from artemis.mapping.matching import match
from artemis.mapping.pose_graph import Link, PoseGraph, match_information
from artemis.mapping.se2 import Array, between, compose, within
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations

_ORIGIN = np.zeros(3)
_ROUNDS, _LAST_ROUNDS = 5, 20
"""Of the solver: on the way, and at the end."""


@dataclass(slots=True)
class MapCounts:
    """What happened."""

    scans: int = 0
    unmatched: int = 0
    """Scans that fitted nowhere: there the odometry stood."""
    solutions: int = 0


class Mapper:
    """The same readings give the same map. Memory grows with the distance, and by a few numbers per reading.

    Attributes:
        keys: the scans that make up the map, with the poses that are believed at present.
        graph: the links between them.
        counts: what happened.
    """

    def __init__(self, settings: MapSettings | None = None) -> None:
        self.settings = settings or MapSettings()
        self.keys, self.graph, self.counts = KeyScans(), PoseGraph(), MapCounts()
        self._grid, self._place = LikelihoodGrid(self.settings), LikelihoodGrid(self.settings)
        self._loops = LoopFinder(self.settings, self.keys, self.graph, self._place)
        self._stations = Stations()
        self._moved_unseen = False
        self._unsolved, self._loop_count, self._last_step = 0, 0, _ORIGIN

    @property
    def pose(self) -> Array:
        """Of the last reading, as it is believed at present, shape (3,)."""
        return self._stations.newest(self.keys.poses)

    @property
    def key_readings(self) -> list[int]:
        """Number of the reading of each key scan."""
        first = np.searchsorted(self._stations.keys, np.arange(len(self.keys)))
        return [self._stations.readings[station] for station in first.tolist()]

    @property
    def searched(self) -> int:
        """Places so far at which a loop was looked for."""
        return self._loops.searched

    def add(self, reading: Reading) -> None:
        """Take the next reading."""
        if reading.points is None:
            self._stations.pass_by(reading.time, reading.odometry)
            return
        self.counts.scans += 1
        if not len(self.keys):
            self._stations.stop(reading, 0, _ORIGIN)
            self._add_key(reading.points, _ORIGIN, None)
            return
        step = None if self._moved_unseen else self._stations.step_to(reading.odometry)
        self._moved_unseen = False
        predicted = compose(self.pose, self._last_step if step is None else step)
        found = match(self._grid, self.settings, reading.points, predicted, step)
        self._last_step = between(self.pose, found.pose) if found.score >= 0 else _ORIGIN
        if found.score < 0:
            self.counts.unmatched += 1
        settings, last = self.settings, len(self.keys) - 1
        if step is not None and within(step, settings.still, settings.still_turn):
            if found.score < 0 or within(
                between(predicted, found.pose), settings.key_distance / 10, settings.key_turn / 10
            ):
                self._stations.pass_by(reading.time, reading.odometry)
                return
        motion = between(self.keys.poses[last], found.pose)
        if self._is_key(motion, found.score):
            link = Link(last, last + 1, motion, self._information(found.information), False)
            self._stations.stop(reading, last + 1, _ORIGIN)
            self._add_key(reading.points, found.pose, link)
        else:
            self._stations.stop(reading, last, motion)

    def begin_run(self) -> None:
        """The next reading is of another run, whose odometry begins anew: about where the robot was last."""
        self._moved_unseen, self._last_step = True, _ORIGIN

    def undo(self, loop: int) -> None:
        """Take a loop back, by its number in the graph, and solve without it."""
        self.graph.remove(loop)
        self.solve()

    def solve(self, rounds: int = _LAST_ROUNDS) -> None:
        """Move all poses to where they fit the links best."""
        settings = self.settings
        self.keys.poses = self.graph.solve(self.keys.poses, rounds, settings.cauchy_loop, settings.cauchy_step)
        self.counts.solutions += 1
        self._unsolved = 0

    def finish(self) -> None:
        """Solve, match every key scan with its neighbours again, and solve with these matches."""
        if len(self.keys) > 1:
            self.solve()
            self.keys.poses = matched_again(self.settings, self.keys, self.graph, self._place)

    def trajectory(self) -> tuple[Array, Array]:
        """Times [s] and poses of all readings in their order, shapes (n,) and (n, 3). After `finish`."""
        poses = refined_steps(self.settings, self.keys, self.graph, self._place, self._stations)
        return self._stations.trajectory(poses)

    def _information(self, information: Array) -> Array:
        return match_information(information, float(self.keys.poses[-1][2]), self.settings.beam)

    def _is_key(self, motion: Array, score: float) -> bool:
        settings = self.settings
        share = 1.0 if score >= settings.key_score else 0.25
        return not within(motion, share * settings.key_distance, share * settings.key_turn)

    def _add_key(self, points: Array, pose: Array, link: Link | None) -> None:
        self.keys.append(points, pose)
        if link is not None:
            self.graph.add(link)
        found, much = self._loops.find()
        for loop in found:
            self.graph.add(loop)
        self._unsolved += len(found)
        self._loop_count += len(found)
        if much or self._unsolved >= max(self.settings.solve_every, self.settings.solve_share * self._loop_count):
            self.solve(_ROUNDS)
        first = max(0, len(self.keys) - self.settings.local)
        self._grid.build(self.keys.points[first:], self.keys.poses[first:])
