"""Finds and follows a robot on a map by the scans of its laser scanner."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from artemis.localisation.scan_map import ScanMap
from artemis.mapping.likelihood import NOWHERE, LikelihoodGrid, Match
from artemis.mapping.matching import match
from artemis.mapping.pose_graph import match_information
from artemis.mapping.se2 import Array, between, compose, placed_surface, within
from artemis.mapping.settings import MapSettings

_NEAR, _NEAR_TURN = 0.25, 0.08
"""Window around what the rough search found [m, rad]."""
_REFINING = 0.05
"""By so much a score may rise when the result of a search is refined,"""
_REFINED = 0.08
"""and at most by this share of it: the best pose may lie half a cell and half a turn step beside a searched one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerSettings:
    """Lengths [m], angles [rad]; scores as in `MapSettings`."""

    matching: MapSettings = field(default_factory=MapSettings)
    local: int = 8
    """Key scans that the robot's motion is measured against."""
    noise: float = 0.01
    noise_share: float = 0.03
    noise_turn: float = 0.01
    """Standard deviations of a step by these, one by one and as a share of the distance."""
    beam: float = 0.1
    """Of a beam where it is weighed against the step."""
    good: float = 0.6
    """A scan that fits the map so well is matched,"""
    well: float = 0.7
    """and so well that nothing else is searched."""
    margin: float = 0.12
    start: float = 2.0
    start_turn: float = 0.6
    start_prior: float = 0.1
    """The first scan is searched no farther around the start, and has to be better by so much at the edge."""
    search: float = 0.4
    search_turn: float = 0.15
    again: float = 0.1
    """Driven between two searches where the scans do not fit well."""
    astray: float = 0.55
    """A scan that fits those before no better may be of another place, unless it fits the map."""
    lost_after: float = 10.0
    """Driven without a match on the map, by the last scans and the odometry alone,"""
    lost_broken: float = 1.0
    """and after a scan that did not fit those before."""
    lost_scans: int = 5
    """Scans, one after the other, that do not fit those before: the robot was carried away, or sees nothing."""
    gathered: float = 1.5
    """Driven before a robot is looked for: one scan fits many places."""
    gather_scans: int = 12
    """Scans after which it is looked for, though it stands."""
    found: float = 0.58
    """What is found on the whole map has to fit so well."""
    sure: float = 0.65
    agree: float = 0.3
    agree_turn: float = 0.1
    agree_after: float = 1.0
    """What fits less well than `sure` is found once another search, so far away, finds the same."""
    odds: float = 1000.0
    evidence: float = 40.0
    misfit: float = 0.1
    """A place found on the whole map has to be `odds` times as likely as any other place: a likelihood-ratio test. With
    normal errors of unknown variance, estimated from the residuals, the ratio of the maximum likelihoods is (s2 / s1)
    to the power n / 2, s1 and s2 the mean square residuals (G. Seber, A. Lee, Linear Regression Analysis, 2003, ch. 4).
    Here 1 - score stands for the residual and `evidence` for n / 2. It is fewer than the points: the errors of
    neighbouring beams, and of scans of one place, are correlated. `misfit` is the least 1 - score that counts, as the
    map itself is not more accurate."""
    apart: float = 1.0
    points: int = 120
    """Of what was gathered, for the search."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanPose:
    """Where the robot is, by one scan."""

    pose: Array
    """In the frame of the map, shape (3,); where it is lost: the last one, carried on."""
    quality: float
    """How well the scan fits the map there, 0 to 1."""
    doubt: float
    """0: the scan was matched; 1 and above: lost. Between: part of what may be driven without a match."""
    measured: Array | None = None
    """Covariance of the pose by this scan alone, as if the map were exact, shape (3, 3); None: unmatched."""

    @property
    def lost(self) -> bool:
        """The pose means nothing."""
        return self.doubt >= 1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlaceSearch:
    """What is looked for on the whole map."""

    points: Array
    """Points of the last key scans, seen from where the robot was, shape (n, 4)."""
    at: Array
    """Where that was, in the frame in which the localizer follows the scans, shape (3,)."""
    since: int
    """How often the localizer had lost the place before."""
    given: Array | None = None
    """Where it is if what it was told is right, shape (3,): another place that fits as well is looked for; None: it is
    lost."""


class ScanLocalizer:
    """Follows by matching each scan on the map, from where the last scans and the odometry say that the robot is.

    Where nothing of the map is seen, those carry the pose on. A robot that is lost, or was never found, is looked for
    on the whole map once it has driven a little, and found only where nothing else fits nearly as well. That takes
    long, and nothing else waits for it: `wanted` says what to look for, `look` does it, in another thread if need be,
    and `take` carries what it found on to where the robot is by then.
    """

    def __init__(
        self,
        on: ScanMap,
        settings: LocalizerSettings | None = None,
        start: Array | None = None,
        start_std: tuple[float, float] | None = None,
    ) -> None:
        """Begin.

        Args:
            on: the map.
            settings: lengths, windows and scores.
            start: about where the robot is, shape (3,); None: anywhere.
            start_std: standard deviations of that [m, rad]: the first scan is searched there; None: it is known well.
        """
        self.settings, self._map = settings or LocalizerSettings(), on
        self._local = LikelihoodGrid(self.settings.matching)
        self._keys: deque[tuple[Array, Array]] = deque(maxlen=self.settings.local)
        self._odometry: Array | None = None
        self._at = np.zeros(3)
        """By the last scans and the odometry, in a frame that begins where the first scan was."""
        self._step = np.zeros(3)
        self._pose = np.zeros(3) if start is None else np.array(start, float)
        self._doubt = 1.0 if start is None else 0.0
        self._start_std = None if start is None else start_std
        self._measured: Array | None = None
        self._given: tuple[Array, tuple[float, float]] | None = None
        self.refused: float | None = None
        """How well the newest scan fitted where the robot was said to be: not well enough; None: all is well."""
        self._gathered, self._scans, self._astray, self._searched = 0.0, 0, 0, np.inf
        """Driven and seen since the last search of the whole map; scans that fitted nowhere; driven since the last one
        near by."""
        self._broken = self._looking = False
        self._unproven = start is not None
        """A place that was given was accepted, and not yet compared with the others."""
        self.rival: Array | None = None
        """Where else the newest search found that a robot may be whose place was given, shape (3,); None: nowhere."""
        self._forgotten = 0
        self._before: tuple[PlaceSearch, Match] | None = None
        """What the last search found that was not sure enough."""

    def update(self, points: Array, odometry: Array | None) -> ScanPose:
        """Take the next scan.

        Args:
            points: as of `surface_points`, seen from the robot, shape (n, 4).
            odometry: pose by the wheels, in any frame, shape (3,); None: there is no odometry.
        """
        step = self._follow(points, odometry)
        predicted = compose(self._pose, step)
        length = float(np.hypot(step[0], step[1]))
        self._gathered += length
        self._scans += 1
        self._measured, quality, self.refused = None, 0.0, None
        if (given := self._matched_as_given(points)) is not None:
            self._doubt, self._start_std, self._before, self._astray = 0.0, None, None, 0
            self._unproven = True
            self._weigh(given, given.pose, length)
            quality = given.score
        elif self._doubt < 1:
            if self._start_std is not None:
                found, self._start_std = self._matched_at_start(points, self._start_std), None
            else:
                found = self._matched(points, predicted, length, float(abs(step[2])))
            self._weigh(found, predicted, length)
            quality = max(0.0, found.score)
        else:
            self._pose = predicted
        return ScanPose(
            pose=self._pose,
            quality=quality,
            doubt=self._doubt,
            measured=self._measured,
        )

    def begin_at(self, pose: Array, std: tuple[float, float]) -> None:
        """Search the next scan around a pose, shape (3,), of these standard deviations [m, rad].

        If it fits nowhere there, all is as it was before, and `refused` says so.
        """
        self._given = np.array(pose, float), std

    def wanted(self) -> PlaceSearch | None:
        """What to look for on the whole map; None: the robot is not lost, it saw too little yet, or is looked for.

        Once after a place was given and accepted, that is whether there is another one.
        """
        settings, lost = self.settings, self._doubt >= 1
        if not (lost or self._unproven) or self._looking or not self._keys:
            return None
        if self._gathered < settings.gathered and self._scans < settings.gather_scans:
            return None
        self._gathered, self._scans, self._looking, self._unproven = 0.0, 0, True, False
        given = None if lost else self._pose.copy()
        return PlaceSearch(points=self._seen(), at=self._at, since=self._forgotten, given=given)

    def take(self, looked_for: PlaceSearch, found: Match | None) -> None:
        """Take what `look` found."""
        self._looking, self.rival = False, None
        if looked_for.given is not None:
            stands = looked_for.since == self._forgotten and not self._unproven  # else another place counts by now
            self.rival = found.pose if found is not None and stands else None
            return
        if found is None or self._doubt < 1 or looked_for.since != self._forgotten:
            return
        if found.score < self.settings.sure and not self._agrees(looked_for, found):
            return
        self._pose, self._doubt = compose(found.pose, between(looked_for.at, self._at)), 0.0
        self._astray, self._broken, self._before = 0, False, None

    def _agrees(self, looked_for: PlaceSearch, found: Match) -> bool:
        """Whether the search before found the same from somewhere else; from here it is compared with what comes."""
        settings, before = self.settings, self._before
        if before is not None and before[0].since == looked_for.since:
            moved = between(before[0].at, looked_for.at)
            if within(moved, settings.agree_after, np.pi):
                return False  # nothing new was seen
            off = between(compose(before[1].pose, moved), found.pose)
            if within(off, settings.agree, settings.agree_turn):
                return True
        self._before = looked_for, found
        return False

    def look(self, looked_for: PlaceSearch) -> Match | None:
        """Look for the robot on the whole map, or for where else it may be. Changes nothing.

        Returns None: nowhere, or in several places; if it may be nowhere else.
        """
        settings, rough, reach, seen = self.settings, self._map.rough, self._map.reach, looked_for.points
        if len(seen) < settings.matching.least_points:
            return None
        thin = np.ascontiguousarray(seen[:: max(1, len(seen) // settings.points)])  # else it is compiled anew
        if looked_for.given is not None:
            return self._other(thin, looked_for.given)
        first = rough.search(thin, self._map.middle, reach, np.pi, floor=settings.found)
        if first.score < 0:
            return None
        near = self._map.grid.search(thin, first.pose, _NEAR, _NEAR_TURN, floor=settings.found - _REFINING)
        refined = self._map.grid.refine(seen, near.pose)
        if near.score < 0 or refined.score < settings.found:
            return None
        return refined if self._other(thin, near.pose) is None else None

    def _other(self, thin: Array, pose: Array) -> Match | None:
        """Another place on the map, for points (n, 4); None: a pose is more likely than all by the factor `odds`."""
        settings, grid = self.settings, self._map.grid  # only the fine grid distinguishes places that look alike
        score = grid.refine(thin, pose).score
        margin = max(settings.misfit, 1 - score) * (settings.odds ** (1 / settings.evidence) - 1)
        beside = np.append((pose - self._map.middle)[:2], settings.apart)
        floor = (score - margin) * (1 - _REFINED)
        other = grid.search(thin, self._map.middle, self._map.reach, np.pi, floor=floor, left_out=beside)
        if other.score < 0:
            return None
        refined = grid.refine(thin, other.pose)
        return None if max(other.score, refined.score) < score - margin else refined

    def _follow(self, points: Array, odometry: Array | None) -> Array:
        """How the robot moved since the last scan, by the scans before and the odometry, shape (3,)."""
        settings = self.settings.matching
        if not self._keys:
            self._odometry = odometry
            self._add_key(points)
            return np.zeros(3)
        known = odometry is not None and self._odometry is not None
        counted = between(self._odometry, odometry) if known else None  # type: ignore[arg-type]  # both are known
        self._odometry = odometry
        predicted = compose(self._at, self._step if counted is None else counted)
        found = match(self._local, settings, points, predicted, counted)
        strays = found.score < self.settings.astray
        self._astray = self._astray + 1 if strays else 0
        self._broken = self._broken or strays
        self._step = between(self._at, found.pose)
        self._at = found.pose
        away = between(self._keys[-1][1], self._at)
        if not within(away, settings.key_distance, settings.key_turn):
            self._add_key(points)
        return self._step

    def _add_key(self, points: Array) -> None:
        self._keys.append((points, self._at))
        self._local.build([key for key, _ in self._keys], [pose for _, pose in self._keys])

    def _seen(self) -> Array:
        """Points of the last key scans, seen from where the robot is now, shape (n, 4)."""
        return np.concatenate([placed_surface(between(self._at, pose), points) for points, pose in self._keys])

    def _forget(self) -> None:
        """Drop the last scans: they may be of another place."""
        self._gathered, self._scans, self._astray = 0.0, 0, 0
        self._forgotten += 1
        self._keys.clear()

    def _matched_at_start(self, points: Array, std: tuple[float, float]) -> Match:
        """The first scan on the map, searched around where the robot should begin."""
        found = self._around(points, self._pose, std)
        if len(points) >= self.settings.matching.least_points:
            self._doubt = 0.0 if found.score >= self.settings.good else 1.0
        return found

    def _matched_as_given(self, points: Array) -> Match | None:
        """The scan on the map around a pose that was given; None: none was given, or it does not fit there."""
        if self._given is None:
            return None
        given, self._given = self._given, None
        found = self._around(points, *given)
        if found.score >= self.settings.good:
            return found
        self.refused = max(0.0, found.score)
        return None

    def _around(self, points: Array, pose: Array, std: tuple[float, float]) -> Match:
        """The scan on the map, around a pose of these standard deviations."""
        settings, grid, nowhere = self.settings, self._map.grid, Match(NOWHERE, pose, np.zeros((3, 3)))
        if len(points) < settings.matching.least_points:
            return nowhere
        distance, turn = min(3 * std[0], settings.start), min(3 * std[1], settings.start_turn)
        found = grid.search(points, pose, distance, turn, prior=settings.start_prior)
        return grid.refine(points, found.pose) if found.score > 0 else nowhere

    def _matched(self, points: Array, predicted: Array, length: float, turn: float) -> Match:
        """The scan on the map, near where the robot should be."""
        settings = self.settings
        if len(points) < settings.matching.least_points:
            return Match(NOWHERE, predicted, np.zeros((3, 3)))
        std = settings.noise + settings.noise_share * length
        std_turn = settings.noise_turn + settings.noise_share * turn
        trust = settings.beam**2 / np.array([std, std, std_turn]) ** 2
        grid = self._map.grid
        found = grid.refine(points, predicted, trust=np.diag(trust))
        self._searched += length
        if found.score < settings.well and self._searched >= settings.again:
            self._searched = 0.0
            wide = 1.0 + 2.0 * min(1.0, self._doubt)
            searched = grid.search(
                points, predicted, wide * settings.search, wide * settings.search_turn, prior=0.05, floor=found.score
            )
            if searched.score > 0:
                other = grid.refine(points, searched.pose)
                if other.score > found.score + settings.margin:
                    return other
        return found

    def _weigh(self, found: Match, predicted: Array, length: float) -> None:
        settings = self.settings
        if found.score < settings.good:
            self._pose = predicted
            after = settings.lost_broken if self._broken else settings.lost_after
            self._doubt = max(self._doubt + length / after, self._astray / settings.lost_scans)
            if self._doubt >= 1:
                self._forget()
            return
        self._pose, self._broken = found.pose, False
        self._doubt = max(0.0, self._doubt - 0.25)
        information = match_information(found.information, 0.0, settings.matching.beam)
        self._measured = np.asarray(np.linalg.inv(information))
