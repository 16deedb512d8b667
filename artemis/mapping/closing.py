"""Adds key scans to the graph, finds their loops and moves the poses: the part of mapping that may come later."""

from __future__ import annotations

from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.loops import LoopFinder
from artemis.mapping.pose_graph import Link, PoseGraph
from artemis.mapping.se2 import compose
from artemis.mapping.settings import MapSettings
from artemis.mapping.tracking import NewKey

_ROUNDS = 5
"""Of the solver while the map grows."""


class LoopCloser:
    """Key scans, the links between them, and the poses that are believed at present.

    Attributes:
        keys: the key scans.
        graph: their links.
        grid: to match on; free between two calls.
        loops: finds them.
        solutions: how often the graph was solved.
    """

    def __init__(self, settings: MapSettings, keys: KeyScans, graph: PoseGraph) -> None:
        self._settings, self.keys, self.graph = settings, keys, graph
        self.grid = LikelihoodGrid(settings)
        self.loops = LoopFinder(settings, keys, graph, self.grid)
        self.solutions, self._unsolved = 0, 0
        self._loop_count = len(graph.loops)

    def add(self, key: NewKey) -> None:
        """Take the next key scan."""
        number, before = len(self.keys), key.before
        self.loops.drift.add(before, key.untold)
        if before < 0:
            self.keys.append(key.points, key.motion, key.place)
            return
        self.keys.append(key.points, compose(self.keys.poses[before], key.motion), key.place)
        self.graph.add(Link(before, number, key.motion, key.information, before < number - 1, key.untold))
        self.loops.drift.share = key.share
        found, much = self.loops.find()
        for loop in found:
            self.graph.add(loop)
        self._unsolved += len(found)
        self._loop_count += len(found)
        if much or self._unsolved >= max(self._settings.solve_every, self._settings.solve_share * self._loop_count):
            self.solve(_ROUNDS)

    def solve(self, rounds: int) -> None:
        """Move all poses to where they fit the links best."""
        settings = self._settings
        self.keys.poses = self.graph.solve(self.keys.poses, rounds, settings.cauchy_loop, settings.cauchy_step)
        self.solutions += 1
        self._unsolved = 0
