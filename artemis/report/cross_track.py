"""Where the robot really was on the path that it followed by its odometry."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from math import isfinite, nan

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.fitting import route_for
from artemis.motion.joining import straight
from artemis.motion.path import Path
from artemis.motion.perception import moment, stale_age
from artemis.motion.poses import placed, seen_from
from artemis.motion.route import Route, route_from_csv
from artemis.motion.waypoints import along_lines, distances
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.report.rows import Errors
from artemis.states.outline import numbered
from artemis.values import Pose, Tracking

SAME = 1e-3
"""A path whose length differs by more [m] from what was followed is another one."""
PROJECTION_WINDOW = 0.5
"""The true pose is looked for this far [m] around its last place on the path."""
STEP = 0.05
"""So far it moves from one tick to the next on its path at most [m], or it is looked for anew."""
SPACING = 0.02
BLOCK = 512
_NOWHERE = nan, nan


def routes_of(recording: Recording) -> dict[int, tuple[Route, bool]]:
    """The path files and waypoints that the mission follows and that can be read, by the step's number.

    As it wants them driven; and whether they are begun at the place that is nearest to the robot.
    """
    routes = {}
    for number, (_, word, body) in enumerate(numbered(recording.mission.get("steps"))):
        follow = body if word == "follow" else {}
        direction, rounding = follow.get("direction"), follow.get("round_corners_m")
        try:
            given, lines = _given(recording, follow.get("path"), follow.get("laps", 1))
            route, _ = route_for(
                given,
                recording.robot,
                (follow.get("follower") or {}).get("speed_m_s") or recording.robot.limits.speed_m_s,
                from_end=follow.get("from_end", False),
                backward=None if direction is None else direction == "backward",
                round_corners=float(lines) if rounding is None else rounding,
            )
        except (KeyError, UnicodeDecodeError, ConfigError):
            continue  # none, recorded in this run, or damaged in the recording: then there is no path to compare with
        routes[number] = route, follow.get("start") == "nearest"
    return routes


def _given(recording: Recording, path: object, laps: int) -> tuple[Route, bool]:
    """The route as the mission gives it, and whether by waypoints.

    Raises KeyError: it does not, or not by something that is in the recording. ConfigError, UnicodeDecodeError: it
    cannot be read.
    """
    if isinstance(path, str):
        return route_from_csv(recording.files[path].decode(), path), False
    if isinstance(path, dict):
        return straight(path["waypoints"], closed=laps > 1), True
    raise KeyError


def _followed(route: Route, nearest: bool, tracking: Tracking, pose: Pose | None) -> tuple[Route, float] | None:
    """What was left of a route, or of some laps of it, when it was begun with this `tracking` at this `pose`.

    And how much of it was driven before [m]. None: it is not what was followed, for its length is another.
    """
    laps = max(1, round(tracking.length / route.length)) if route.closed else 1
    if abs(laps * route.length - tracking.length) > SAME:
        return None
    route = route.with_laps(laps)
    if not nearest or not route.closed or pose is None:
        return route, 0.0
    begun = route.begun_at(route.nearest(pose.x, pose.y), tracking.arc_length)
    return begun, route.length - begun.length


class TruePoses:
    """True poses at the moments that the estimated ones are of: when the drives measured, not when the tick began."""

    def __init__(self, recording: Recording) -> None:
        self._left, self._right, *_ = recording.robot.places
        self._stale = stale_age(1.0 / recording.mission.get("tick_hz", 50))
        self._last: tuple[float, Pose] | None = None
        """Run time [s] and true pose of the last tick."""

    def of(self, tick: TickRecord) -> tuple[float, Pose | None]:
        """Moment [s of the run] of a tick's estimated pose, and the true pose then; None: nobody knows."""
        sensed, true = tick.snapshot.sensed, tick.true_pose
        drives = sensed.drives
        measured = moment(sensed.time, drives[self._left], drives[self._right], self._stale) if drives else sensed.time
        last, self._last = self._last, None
        if true is None or not isfinite(true.x):
            return measured, None
        self._last = sensed.time, true
        if last is None or tick.wish.reset_pose or not last[0] <= measured < sensed.time:
            return measured, true
        share, step = (measured - last[0]) / (sensed.time - last[0]), seen_from(last[1], true)
        there = Pose(x=share * step.x, y=share * step.y, heading=share * step.heading)
        return measured, placed(last[1], there)


def _changed(route: Route) -> Array | None:
    """The points that a route was made of, as a line with a point every `SPACING`; None: it leaves none of them."""
    points, curves = [], []
    for part in route.parts:
        if part.path.drawn is None:
            return None
        points.append(part.path.drawn.points)
        curves.append(np.column_stack([part.path.x, part.path.y]))
    if distances(np.vstack(points), np.vstack(curves)).max() <= SAME:
        return None
    return np.vstack([along_lines(part, lambda at: np.union1d(at, np.arange(0.0, at[-1], SPACING))) for part in points])


class GivenErrors:
    """How far poses are from the points of a path as they were given, before smoothing and rounding."""

    def __init__(self) -> None:
        self._errors = Errors()
        self._line: Array | None = None
        self._poses: list[tuple[float, float]] = []

    def add(self, pose: Pose | None, line: Array | None) -> None:
        """A pose that follows the path of these points; None: unknown, or there is no such path."""
        if line is not self._line or len(self._poses) >= BLOCK:
            self.finish()
            self._line = line
        if pose is not None and line is not None:
            self._poses.append((pose.x, pose.y))

    def finish(self) -> Errors:
        """Count the last ones; those of all."""
        if self._line is not None and self._poses:
            self._errors.add(distances(np.array(self._poses), self._line))
        self._poses.clear()
        return self._errors


class TruePlaces:
    """Where the true pose is on the path that is followed, tick by tick."""

    def __init__(self, routes: Mapping[int, tuple[Route, bool]]) -> None:
        """`routes` as of `routes_of`."""
        self.paths: list[Path] = []
        """Every path that was followed so far."""
        self.given: Array | None = None
        """Points of the route that is followed as they were given, x, y [m]; None: its curve leaves none of them."""
        self._routes = routes
        self._given = {step: points for step, (route, _) in routes.items() if (points := _changed(route)) is not None}
        self._following = False
        self._route: Route | None = None
        self._begins: list[float] = []
        self._near: dict[int, float] = {}
        """Arc length [m] where the true pose was last, by the number of the route's part."""

    def find(self, step: int, tracking: Tracking | None, true: Pose | None) -> tuple[float, float]:
        """Arc length on the route and cross-track of the true pose [m]; nan: not known.

        Args:
            step: of the mission, in the tick.
            tracking: of the estimated pose; None: nothing is followed in this tick.
            true: pose; None: nobody knows.
        """
        if tracking is None:
            self._following, self.given = False, None
            return _NOWHERE
        if not self._following:
            self._following = True
            self._begin(step, tracking, true)
        if self._route is None or true is None:
            return _NOWHERE
        number = max(bisect_right(self._begins, tracking.arc_length) - 1, 0)
        begin, path = self._begins[number], self._route.parts[number].path
        known, near = number in self._near, self._near.get(number, tracking.arc_length - begin)
        projection = path.project(true.x, true.y, near, 2 * STEP if known else PROJECTION_WINDOW)
        if known and abs(projection.arc_length - near) > STEP:
            projection = path.project(true.x, true.y, near, PROJECTION_WINDOW)
        self._near[number] = projection.arc_length
        return projection.arc_length + begin, projection.cross_track

    def _begin(self, step: int, tracking: Tracking, true: Pose | None) -> None:
        route = self._routes.get(step)
        found = None if route is None else _followed(*route, tracking, true)
        self._route, self._near, self.given = None, {}, None
        if found is not None:
            self._route, driven = found
            self._begins = [begin + driven for begin in self._route.begins]
            self.given = self._given.get(step)
            for part in self._route.parts:
                if not any(part.path.x is other.x for other in self.paths):
                    self.paths.append(part.path)
