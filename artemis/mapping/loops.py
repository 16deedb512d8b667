"""Finds places that were visited before, and links them to the newest key scan."""

from __future__ import annotations

import numpy as np

from artemis.mapping.drift import Drift, Drifts
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.pose_graph import Link, PoseGraph, match_information
from artemis.mapping.se2 import Array, between, compose, within
from artemis.mapping.settings import MapSettings
from artemis.mapping.wide_loops import SURE, WideLoops, likely

_KNOWN_FOR, _KNOWN_WIDE = 30, 80
"""Key scans for which a loop waits for a second one that agrees; and if that was found by a wide search."""
_APART = 10
"""Key scans between two places that are searched for one key scan."""
_EVERY, _STRETCH = 3, 3
"""Key scans from one wide search to the next, and at least between two that confirm each other."""
_LEAST, _LEAST_TURN, _MOST_TURN = 0.3, 0.1, 0.7
"""Of a window [m, rad]."""
_SEARCH_BELOW = 0.1
"""A searched pose may score so much less than a loop must: refining raises it."""


class LoopFinder:
    """Searches old places around the newest key scan; a loop that corrects much has to be confirmed by another."""

    def __init__(self, settings: MapSettings, keys: KeyScans, graph: PoseGraph, grid: LikelihoodGrid) -> None:
        self._settings, self._keys, self._grid = settings, keys, grid
        self._wide = WideLoops(settings, keys, grid)
        self._waiting: list[Link] = []
        self.drift = Drift(settings, keys, graph)
        self.searched = 0
        """Places so far."""

    def find(self) -> tuple[list[Link], bool]:
        """Loops of the newest key scan that are believed, and whether they correct so much that it is time to solve."""
        settings, poses = self._settings, self._keys.poses
        key = len(poses) - 1
        if key <= settings.gap:
            return [], False
        away = np.hypot(*(poses[: key - settings.gap, :2] - poses[key, :2]).T)
        if away.min() > settings.loop_radius + settings.wide_window:
            return [], False
        drifts = self.drift.seen_from_newest(len(away))
        self._waiting = [link for link in self._waiting if key - link.second < _KNOWN_WIDE]
        found: list[Link] = []
        reach = _LEAST + SURE * drifts.most
        narrow = reach <= settings.loop_window
        near = narrow & (away < settings.loop_radius + 2 * drifts.most)
        if key % _EVERY == 0 and not near.any():
            found = self._found_wide(away, reach, drifts)
        much = bool(found)
        away[~near] = np.inf
        for _ in range(settings.places):
            place = int(away.argmin())
            if not np.isfinite(away[place]):
                break
            away[max(0, place - _APART) : place + _APART + 1] = np.inf
            link = self._matched(place, key, float(reach[place]), drifts)
            if link is None:
                continue
            believed = self._confirmed(link)
            found += believed
            much = much or len(believed) > 1
        return found, much

    def _found_wide(self, away: Array, reach: Array, drifts: Drifts) -> list[Link]:
        """Loops to places that may be farther away than one place is searched for."""
        settings = self._settings
        away = np.where((reach <= settings.wide_window) & (away < settings.loop_radius + reach), away, np.inf)
        place = int(away.argmin())
        if not np.isfinite(away[place]):
            return []
        self.searched += 1
        link = self._wide.find(float(reach[place]), _turn(drifts, place), drifts)
        return [] if link is None else self._confirmed(link, wide=True)

    def _matched(self, place: int, key: int, distance: float, drifts: Drifts) -> Link | None:
        """The loop between an old place and the newest key scan; None: it is not seen there."""
        settings, keys = self._settings, self._keys
        self.searched += 1
        first, last = max(0, place - settings.half), min(place + settings.half + 1, key - settings.gap)
        self._grid.build(keys.points[first:last], keys.poses[first:last])
        turn = _turn(drifts, place)
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

    def _confirmed(self, link: Link, *, wide: bool = False) -> list[Link]:
        """The link and those that waited for it; nothing if it has to wait itself."""
        settings, poses = self._settings, self._keys.poses
        correction = between(between(poses[link.first], poses[link.second]), link.motion)
        if within(correction, settings.sure_loop, settings.sure_loop_turn):
            return [link]
        apart, known = (_STRETCH, _KNOWN_WIDE) if wide else (1, _KNOWN_FOR)
        before = [other for other in self._waiting if apart <= link.second - other.second < known]
        agreeing = [other for other in before if self._agree(other, link, wide)]
        if not agreeing:
            self._waiting.append(link)
            return []
        self._waiting = [other for other in self._waiting if not any(other is each for each in agreeing)]
        return [link, *agreeing]

    def _agree(self, one: Link, other: Link, wide: bool) -> bool:
        """Whether the circle over both loops closes; if `wide`, as far as the drift between them allows."""
        poses, settings = self._keys.poses, self._settings
        driven = between(poses[one.second], poses[other.second])
        seen = between(compose(poses[one.first], one.motion), compose(poses[other.first], other.motion))
        off = between(driven, seen)
        if not wide:
            return within(off, settings.agree, settings.agree_turn)
        sides = (one.first, other.first), (one.second, other.second)
        covariances = [self.drift.seen_from(end, begin + 1).covariance[begin] for begin, end in sides]
        on_map = compose([0.0, 0.0, poses[other.second, 2]], off)
        return abs(off[2]) < settings.agree_turn and likely(on_map, covariances[0] + covariances[1])


def _turn(drifts: Drifts, place: int) -> float:
    """To both sides of a search [rad]."""
    return min(_LEAST_TURN + SURE * float(drifts.turn[place]), _MOST_TURN)
