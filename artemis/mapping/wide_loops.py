"""Looks for the robot among all old places around where only the odometry measures how far it drove.

Along a corridor the error grows with the distance, so the window does, too, and holds places that look alike. What is
believed fits better than all else in the window, and lies where the odometry may have been wrong: not beside the
corridor, where an equal one may be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from artemis.mapping.drift import Drifts
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid, Match
from artemis.mapping.matching import untold
from artemis.mapping.pose_graph import Link, match_information
from artemis.mapping.se2 import Array, between, compose, placed_surface
from artemis.mapping.settings import MapSettings

_CLOSE = 0.12
"""Standard deviation that is added where it is asked whether a place is likely [m]."""
SURE = 2.5
"""Standard deviations within which a place is searched."""
_ROUGH = 2
"""Cells of the grid are so many times as wide as where one place is searched."""
_RECENT, _POINTS, _OLD = 10, 240, 60
"""Last key scans that are looked for, with so many points in all; old ones that they are looked for on, at most."""
_NEAR, _NEAR_TURN = 0.3, 0.08
"""Window around what the rough search found [m, rad]."""


class WideLoops:
    """Has a grid of its own, made when it is first needed."""

    def __init__(self, settings: MapSettings, keys: KeyScans, grid: LikelihoodGrid) -> None:
        """Take the map, and a grid that is free between two calls."""
        self._settings, self._keys, self._grid = settings, keys, grid
        self._rough: LikelihoodGrid | None = None

    def find(self, distance: float, turn: float, drifts: Drifts) -> Link | None:
        """One of the last key scans, linked to where it fits; None: nowhere, or in several places.

        The place is looked for by all of them. The link is of the last one that constrains all directions by itself.

        Args:
            distance: from where it is believed to be, along x and y [m].
            turn: to both sides [rad].
            drifts: of the old key scans.
        """
        settings, keys = self._settings, self._keys
        key = len(keys) - 1
        middle, last = keys.poses[key], key - settings.gap
        seen = self._recent(key)
        rough, margin = self._around(middle, distance, last), settings.unique_margin
        found = rough.search(seen, middle, distance, turn, prior=settings.prior, floor=settings.loop_score)
        if found.score < 0:
            return None
        beside = np.append((found.pose - middle)[:2], _ROUGH * settings.unique)
        if rough.search(seen, middle, distance, turn, floor=found.score - margin, left_out=beside).score > 0:
            return None
        for each in range(key, max(settings.gap, key - _RECENT), -1):
            link = self._linked(each, compose(found.pose, between(middle, keys.poses[each])), drifts)
            if link is not None:
                return link
        return None

    def _linked(self, key: int, pose: Array, drifts: Drifts) -> Link | None:
        """One of the last key scans, linked to the place where it is nearest if it was taken at `pose`."""
        settings, keys = self._settings, self._keys
        away = between(pose, keys.poses[: key - settings.gap])
        place = int(np.hypot(away[:, 0], away[:, 1]).argmin())
        matched = self._matched(place, key, pose)
        if matched is None or not likely(matched.pose - keys.poses[key], drifts.covariance[place]):
            return None
        origin = keys.poses[place]
        information = match_information(matched.information, origin[2], settings.beam)
        return Link(place, key, between(origin, matched.pose), information, True)

    def _recent(self, key: int) -> Array:
        """Points of the last key scans, seen from the newest, shape (n, 4)."""
        parts = []
        for each in range(max(0, key + 1 - _RECENT), key + 1):
            pose = between(self._keys.poses[key], self._keys.poses[each])
            parts.append(placed_surface(pose, self._keys.points[each]))
        every = np.concatenate(parts)
        return np.ascontiguousarray(every[:: max(1, len(every) // _POINTS)])  # else it is compiled anew

    def _around(self, middle: Array, distance: float, last: int) -> LikelihoodGrid:
        """The rough grid with what is known of all places in the window."""
        settings, keys = self._settings, self._keys
        if self._rough is None:
            wide = replace(settings, cell=_ROUGH * settings.cell, width=_ROUGH * settings.width)
            self._rough = LikelihoodGrid(wide)
        away = np.hypot(*(keys.poses[:last, :2] - middle[:2]).T)
        near = np.flatnonzero(away < distance * 2**0.5 + settings.loop_radius)
        near = near[:: len(near) // _OLD + 1]
        self._rough.build([keys.points[each] for each in near], keys.poses[near])
        return self._rough

    def _matched(self, place: int, key: int, near: Array) -> Match | None:
        """The scan alone on the scans of one place; None: it does not fit, or does not constrain all directions."""
        settings, keys, scan = self._settings, self._keys, self._keys.points[key]
        first, last = max(0, place - settings.half), min(place + settings.half + 1, key - settings.gap)
        self._grid.build(keys.points[first:last], keys.poses[first:last])
        searched = self._grid.search(scan, near, _NEAR, _NEAR_TURN, prior=settings.prior)
        found = self._grid.refine(scan, searched.pose)
        constrained = untold(found.information, settings.weak * len(scan)) is None
        return found if found.score > settings.loop_score and constrained else None


def likely(off: Array, covariance: Array) -> bool:
    """Whether a place may be so far off, in this direction: x, y (and heading) [m], covariance of x and y [m²]."""
    allowed = covariance + _CLOSE**2 * np.eye(2)
    return bool(off[:2] @ np.linalg.solve(allowed, off[:2]) < SURE**2)
