"""Matches each scan against the last key scans: the part of mapping that has to keep up with the scanner.

Its poses are those of the chain of key scans alone. No loop moves them, so what it finds does not depend on when loops
are looked for: beside it, in another thread, or at once.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from artemis.mapping.laser import Reading
from artemis.mapping.likelihood import LikelihoodGrid, Match
from artemis.mapping.matching import match, odometry_trust, untold
from artemis.mapping.pose_graph import match_information
from artemis.mapping.se2 import Array, between, compose, within
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations

_ORIGIN = np.zeros(3)
_GUESS, _GUESSED = 0.05, 10.0
"""Odometry is taken to be wrong by this share, until so many metres were driven that scans measured."""

_BASE, _TOLD = 4.0, 0.2
"""Distance over which the odometry is compared with the scans [m], and the share of it that scans may leave open."""


@dataclass(slots=True)
class MapCounts:
    """What happened."""

    scans: int = 0
    unmatched: int = 0
    """Scans that fitted nowhere: there the odometry stood."""


class NewKey(NamedTuple):
    """A key scan, and how it was reached from the one before."""

    points: Array
    """Seen from the robot, shape (n, 4)."""
    place: Array
    """Of the scanner on the robot, x, y [m], shape (2,)."""
    before: int
    """Number of the key scan that it was reached from; none before the first."""
    motion: Array
    """From there, shape (3,)."""
    information: Array
    """Of the motion, shape (3, 3)."""
    untold: Array
    """Part of it that only the odometry measured: x, y [m] seen from there, shape (2,)."""
    share: float
    """By which the odometry is wrong, as far as is known: standard deviation as a share of the distance."""


class Tracker:
    """Follows the robot from scan to scan.

    Attributes:
        stations: where it was at each reading, seen from key scans.
        counts: what happened.
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self.stations, self.counts = Stations(), MapCounts()
        self._grid = LikelihoodGrid(settings)
        self._recent: deque[tuple[Array, Array]] = deque(maxlen=settings.local)
        self._before = self._newest = -1
        self._pose = _ORIGIN
        self._moved_unseen, self._last_step = False, _ORIGIN
        self._odometry: Array | None = None
        """Of the last scan that was kept."""
        self._since_key = _ORIGIN
        """Motion from the last key scan to the last scan that was kept."""
        self._untold: Array = np.zeros(2)
        self._counted = _ORIGIN
        self._off, self._driven = _GUESS**2 * _GUESSED, _GUESSED
        self._odds = self._length = 0.0

    def resume(self, keys: list[tuple[Array, Array]], nearest: int, newest: int, pose: Array) -> None:
        """Continue a map: the next reading is of another run, whose odometry begins anew.

        Args:
            keys: points and poses of its key scans around, the nearest at the end.
            nearest: the number of that.
            newest: the number of the last key scan of the map.
            pose: about where the robot is, in the same frame, shape (3,).
        """
        self._recent.extend(keys)
        self._grid.build(*zip(*self._recent, strict=True))
        self._before, self._newest, self._pose, self._moved_unseen = nearest, newest, pose, True
        self._last_step, self._since_key, self._untold = _ORIGIN, _ORIGIN, np.zeros(2)
        self._counted = between(keys[-1][1], pose)

    @property
    def pose(self) -> Array:
        """Of the last reading, in the frame of the chain, shape (3,)."""
        return self._pose

    def add(self, reading: Reading) -> NewKey | None:
        """Take the next reading; returns the key scan that it is, if it is one."""
        if reading.points is None:
            self.stations.pass_by(reading.time, reading.odometry)
            return None
        self.counts.scans += 1
        if self._newest < 0:
            return self._key(reading, reading.points, _ORIGIN, np.zeros((3, 3)), _ORIGIN)
        step = None
        if not (self._moved_unseen or self._odometry is None or reading.odometry is None):
            step = between(self._odometry, reading.odometry)
        self._moved_unseen = False
        predicted = compose(self._pose, self._last_step if step is None else step)
        found = match(self._grid, self._settings, reading.points, predicted, step)
        self._last_step = between(self._pose, found.pose) if found.score >= 0 else _ORIGIN
        if found.score < 0:
            self.counts.unmatched += 1
        if step is not None and self._stands(step, predicted, found):
            self.stations.pass_by(reading.time, reading.odometry)
            return None
        self._note(step, found, len(reading.points))
        motion = between(self._recent[-1][1], found.pose)
        if self._is_key(motion, found.score):
            return self._key(reading, reading.points, motion, found.information, found.pose)
        self._pose, self._odometry = found.pose, reading.odometry
        keep = not within(between(self._since_key, motion), self._settings.kept_distance, self._settings.kept_turn)
        self._since_key = motion if keep else self._since_key
        self.stations.stop(reading, self._before, motion, keep=keep)
        return None

    def _note(self, step: Array | None, found: Match, beams: int) -> None:
        """Note what of the way since the last key scan is known by the odometry alone."""
        moved = (found.pose - self._pose)[:2]
        self._counted = compose(self._counted, between(self._pose, found.pose) if step is None else step)
        if found.score < 0:
            self._untold = self._untold + moved
        elif (weakest := untold(found.information, self._settings.weak * beams)) is not None:
            told, direction = weakest
            trust = odometry_trust(self._settings, _ORIGIN if step is None else step)
            told = max(0.0, told - self._settings.seeming * beams) * self._settings.local
            self._untold = self._untold + trust / (trust + told) * float(moved @ direction) * direction

    def _learn(self, motion: Array) -> None:
        """Compare the odometry with the scans, where these measured all the way from the last key scan to here."""
        length = float(np.hypot(motion[0], motion[1]))
        if np.hypot(*self._untold) > _TOLD * length:
            return
        along = float(self._counted[0] * motion[0] + self._counted[1] * motion[1]) / length - length if length else 0.0
        self._odds, self._length = self._odds + along, self._length + length
        if self._length >= _BASE:
            self._off += self._odds**2 / self._length
            self._driven += self._length
            self._odds = self._length = 0.0

    @property
    def _share(self) -> float:
        return float(np.sqrt(self._off / self._driven))

    def _stands(self, step: Array, predicted: Array, found: Match) -> bool:
        """Whether the robot stands, so that a scan adds nothing."""
        settings = self._settings
        if not within(step, settings.still, settings.still_turn):
            return False
        near = settings.key_distance / 10, settings.key_turn / 10
        return found.score < 0 or within(between(predicted, found.pose), *near)

    def _is_key(self, motion: Array, score: float) -> bool:
        settings = self._settings
        share = 1.0 if score >= settings.key_score else 0.25
        return not within(motion, share * settings.key_distance, share * settings.key_turn)

    def _key(self, reading: Reading, points: Array, motion: Array, information: Array, pose: Array) -> NewKey:
        heading = float(self._recent[-1][1][2]) if self._recent else 0.0
        told = match_information(information, heading, self._settings.beam)
        self._learn(motion)
        c, s = np.cos(heading), np.sin(heading)
        x, y = self._untold
        untold = np.array([c * x + s * y, c * y - s * x])
        seen, share = np.append(untold * self._share, 0.0), self._share
        told = np.asarray(np.linalg.inv(np.linalg.inv(told) + np.outer(seen, seen)), float)
        self._untold, self._counted = np.zeros(2), _ORIGIN
        before, self._pose, self._odometry, self._since_key = self._before, pose, reading.odometry, _ORIGIN
        self._before = self._newest = self._newest + 1
        self.stations.stop(reading, self._newest, _ORIGIN)
        self._recent.append((points, pose))
        self._grid.build(*zip(*self._recent, strict=True))
        return NewKey(points, reading.place, before, motion, told, untold, share)
