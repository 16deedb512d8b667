"""Finds places that were visited before, and links them to the newest key scan."""

from __future__ import annotations

import numpy as np

from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.pose_graph import Link, PoseGraph, match_information
from artemis.mapping.se2 import Array, between, compose, within
from artemis.mapping.settings import MapSettings

_KNOWN_FOR = 30
"""Key scans for which a loop waits for a second one that agrees."""
_APART = 10
"""Key scans between two places that are searched for one key scan."""
_SEARCH_BELOW = 0.1
"""A searched pose may score so much less than a loop must: refining raises it."""


class LoopFinder:
    """Searches old places around the newest key scan; a loop that corrects much has to be confirmed by another."""

    def __init__(self, settings: MapSettings, keys: KeyScans, graph: PoseGraph, grid: LikelihoodGrid) -> None:
        self._settings, self._keys, self._graph, self._grid = settings, keys, graph, grid
        self._waiting: list[Link] = []
        self.searched = 0
        """Places so far."""

    def find(self) -> tuple[list[Link], bool]:
        """Loops of the newest key scan that are believed, and whether they correct so much that it is time to solve."""
        settings, poses = self._settings, self._keys.poses
        key = len(poses) - 1
        if key <= settings.gap:
            return [], False
        away = np.hypot(*(poses[: key - settings.gap, :2] - poses[key, :2]).T)
        if away.min() > settings.loop_radius + settings.loop_window:
            return [], False
        drift, drift_turn = self._drift(key, len(away))
        away[away > settings.loop_radius + np.minimum(2 * drift, settings.loop_window)] = np.inf
        self._waiting = [link for link in self._waiting if key - link.second < _KNOWN_FOR]
        found: list[Link] = []
        much = False
        for _ in range(settings.places):
            place = int(away.argmin())
            if not np.isfinite(away[place]):
                break
            away[max(0, place - _APART) : place + _APART + 1] = np.inf
            link = self._matched(place, key, float(drift[place]), float(drift_turn[place]))
            if link is None:
                continue
            believed = self._confirmed(link)
            found += believed
            much = much or len(believed) > 1
        return found, much

    def _drift(self, key: int, count: int) -> tuple[Array, Array]:
        """Standard deviations [m, rad] of the first `count` poses, seen from `key`."""
        settings = self._settings
        far = (settings.loop_window / settings.drift) ** 2  # from here on the widest window is used in any case
        way = np.minimum(self._graph.distances_from(key, key + 1, far), far)[:count]
        turn = settings.drift_turn * np.sqrt(way)
        return settings.drift * np.sqrt(way) + 0.3 * turn * way, turn

    def _matched(self, place: int, key: int, drift: float, drift_turn: float) -> Link | None:
        """The loop between an old place and the newest key scan; None: it is not seen there."""
        settings, keys = self._settings, self._keys
        self.searched += 1
        first, last = max(0, place - settings.half), min(place + settings.half + 1, key - settings.gap)
        self._grid.build(keys.points[first:last], keys.poses[first:last])
        distance, turn = min(0.3 + 2.5 * drift, settings.loop_window), min(0.1 + 2.5 * drift_turn, 0.7)
        floor, scan, middle = settings.loop_score - _SEARCH_BELOW, keys.points[key], keys.poses[key]
        searched = self._grid.search(scan, middle, distance, turn, prior=settings.prior, floor=floor)
        if searched.score < 0:
            return None
        found = self._grid.refine(scan, searched.pose)
        if found.score < settings.loop_score or np.linalg.eigvalsh(found.information)[0] < settings.loop_least:
            return None
        if distance > settings.unique:
            beside = np.append((searched.pose - middle)[:2], settings.unique)
            floor = searched.score - settings.unique_margin
            if self._grid.search(scan, middle, distance, turn, floor=floor, left_out=beside).score > 0:
                return None  # it might as well be there
        origin = keys.poses[place]
        information = match_information(found.information, origin[2], settings.beam)
        return Link(place, key, between(origin, found.pose), information, True)

    def _confirmed(self, link: Link) -> list[Link]:
        """The link and those that waited for it; nothing if it has to wait itself."""
        settings, poses = self._settings, self._keys.poses
        correction = between(between(poses[link.first], poses[link.second]), link.motion)
        if within(correction, settings.sure_loop, settings.sure_loop_turn):
            return [link]
        agreeing = [other for other in self._waiting if other.second < link.second and self._agree(other, link)]
        if not agreeing:
            self._waiting.append(link)
            return []
        self._waiting = [other for other in self._waiting if not any(other is each for each in agreeing)]
        return [link, *agreeing]

    def _agree(self, one: Link, other: Link) -> bool:
        """Whether the circle over both loops closes."""
        poses = self._keys.poses
        driven = between(poses[one.second], poses[other.second])
        seen = between(compose(poses[one.first], one.motion), compose(poses[other.first], other.motion))
        return within(between(driven, seen), self._settings.agree, self._settings.agree_turn)
