"""Mode follow: a follower plugin drives the robot along the path of the present step."""

from __future__ import annotations

import math

from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.drive_states import Goal
from artemis.errors import ConfigError
from artemis.motion.planned_route import unpacked_route
from artemis.motion.route import Route
from artemis.plugins.contracts import Following
from artemis.progress import SHORT
from artemis.states.distance_left import distance_after
from artemis.states.gains import OscillationDetector
from artemis.states.mode import stand
from artemis.states.parts import PartByPart
from artemis.states.plan import FollowStep, GotoStep, Shared
from artemis.supervision import catalogue
from artemis.values import Event, Fault, Pose, Severity, Snapshot, Tracking, Wish

START_DISTANCE, START_ANGLE = 1.0, math.radians(60)
"""A path is not begun from further away or more askew than this [m, rad] (PTH-05)."""
ARMED_AFTER, ARMED_AT_LAST = 1.0, 5.0
"""The limit of the cross-track error counts once it was kept while the robot drove the first so much [m], at the latest
after the second."""
SLACK, SLOWEST = 10.0, 0.05
"""A path may take twice its time, at the second speed [m/s] where the follower states none, and for each of its parts
the first [s] (PTH-08)."""
CONTRADICTED = 0.35
"""Fixes may contradict the pose for so long [s] (LOC-02)."""
CERTAIN = 5.0
"""A range that is shorter than what is left, by more than its standard deviation, for so long [s] ends a step."""
AT_END, OVERRUN = 0.01, 0.2
"""So close to its end [m] a part is over; a follower must not drive on for more than the second [m] (PTH-08)."""

_ENABLED = Goal.ENABLED


class FollowMode:
    """Asks the follower at each tick. A step that was interrupted resumes where it stopped."""

    _entry: int  # this and the next belong to the step that has begun
    _planned: tuple[int, ...]
    _spent: float
    _speed: float
    _longest: float
    _last: float | None  # and these to what was entered last
    _driven: float
    _outside: float
    _armed: bool
    _short: str
    _after: float
    _lacking: float
    _over: float | None
    _oscillation: OscillationDetector | None

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self._begun: FollowStep | None = None
        self._drive: PartByPart | None = None
        self._fault: Fault | None = None

    def enter(self, snapshot: Snapshot) -> None:
        """Begin what is left of the path, unless the follower is on its way already."""
        step = self.shared.current
        tried = self.shared.results.tried
        self._oscillation = OscillationDetector(self.shared.plan, tried, snapshot) if tried else None
        self._fault, self._last, self._armed, self._over, self._short = None, None, False, None, ""
        self._lacking = 0.0
        if not isinstance(step, FollowStep):
            return
        begun = step is self._begun and self._entry == self.shared.entry and self._planned is self.shared.route.planned
        if (drive := self._drive if begun else None) is not None:
            drive.resume()
            return
        try:
            route = self._route(step)
        except ConfigError as error:
            self._fault = catalogue.fault("PTH-01", "", "; ".join(error.problems), Severity.CONTROLLED_STOP)
            return
        rest = self._rest(route, step, snapshot.pose.pose)
        self._after = distance_after(self.shared.tree, self.shared.position, self.shared.plan.length_of)
        if (battery := snapshot.battery) is not None and rest.length + self._after > battery.range_m:
            self._short = _too_far(rest.length + self._after, battery)
        self._drive = PartByPart(step.follower, rest, route.length - rest.length, self.shared.plan.robot)
        self._speed = step.speed or SLOWEST
        self._longest = 2 * route.duration(self._speed) + SLACK * len(route.parts)
        self._begun, self._entry, self._planned, self._spent = step, self.shared.entry, self.shared.route.planned, 0.0

    def step(self, snapshot: Snapshot) -> Wish:
        """The follower's command; done when it has finished and the robot stands."""
        step, drive = self.shared.current, self._drive
        if not isinstance(step, FollowStep):
            return stand(snapshot, event=Event.DONE)
        if fault := place_fault(snapshot, localized=self.shared.plan.localized):
            return stand(snapshot, fault=fault)
        if drive is None or self._fault is not None:
            return stand(snapshot, fault=self._fault)
        if self._short and not self.shared.rests:  # else the mission does something else already
            ended = stand(snapshot, event=Event.DONE if snapshot.standing else None)
            return replace(ended, phase=self._short, outcome=SHORT if snapshot.standing else "")
        following = drive.step(snapshot)
        if isinstance(following, Fault):
            return stand(snapshot, fault=following)
        tracking = following.tracking
        self._watch_battery(tracking, snapshot)
        if fault := self._off_path(tracking, snapshot.odometry.distance, step.max_cross_track):
            return stand(snapshot, fault=fault, tracking=tracking)
        return replace(self._on_path(drive, following, snapshot), tracking=tracking, done=max(tracking.arc_length, 0.0))

    def _on_path(self, drive: PartByPart, following: Following, snapshot: Snapshot) -> Wish:
        """As the follower says, unless it is at the end, or something is wrong."""
        if self.shared.rests or (
            isinstance(self.shared.current, GotoStep) and not self.shared.route.planned
        ):  # another goal
            return stand(snapshot, event=Event.DONE if snapshot.standing else None)
        if following.finished:  # whatever the follower still commands
            return replace(stand(snapshot, event=Event.DONE), over=True) if snapshot.standing else stand(snapshot)
        if self._oscillation and (fault := self._oscillation.look(snapshot)):
            return stand(snapshot, fault=fault)
        self._spent += snapshot.dt * self._share(snapshot)
        if fault := self._overrun(following.tracking, drive.end, snapshot.odometry.distance):
            return stand(snapshot, fault=fault)
        return Wish(command=following.command, traction=_ENABLED, steering=_ENABLED, phase="following")

    def _share(self, snapshot: Snapshot) -> float:
        """How much of the time counts: less where a fault or what the scanners see keeps the robot slow."""
        if not snapshot.verdict.limits and snapshot.set_points.clearance is None:
            return 1.0
        return min(1.0, abs(snapshot.set_points.speed) / self._speed)

    def _watch_battery(self, tracking: Tracking, snapshot: Snapshot) -> None:
        """What is left to drive is certainly more than the battery reaches, for some time: the step is to end."""
        if (battery := snapshot.battery) is None:
            return
        needed = tracking.length - tracking.arc_length + self._after
        lacks = needed > battery.range_m + battery.range_std_m
        self._lacking = self._lacking + snapshot.dt if lacks else 0.0
        if self._lacking > CERTAIN:
            self._short = _too_far(needed, battery)

    def _route(self, step: FollowStep) -> Route:
        """The step's route; of what was planned, or recorded in this run, it is in the newest job's result.

        Raises:
            ConfigError: several laps are wanted of one that is open.
        """
        if isinstance(step.route, Route):
            return step.route
        route = unpacked_route(self.shared.route.planned)
        return route.directed(from_end=step.from_end, backward=step.backward).with_laps(step.laps)

    def _rest(self, route: Route, step: FollowStep, pose: Pose) -> Route:
        """What is left of it: where an open route resumes is given by what is done, for it may pass a place twice."""
        if step.nearest and (route.closed or not self.shared.position.done):
            return route.begun_at(route.nearest(pose.x, pose.y), self.shared.position.done)
        return route.rest(self.shared.position.done)

    def _off_path(self, tracking: Tracking, distance: float, limit: float) -> Fault | None:
        """Too far away to begin (PTH-05), or lost on the way (PTH-06); `distance`: of the robot [m]."""
        away = abs(tracking.cross_track)
        if self._last is None:
            if away > START_DISTANCE or abs(tracking.heading_error) > START_ANGLE:
                return catalogue.fault("PTH-05", "", _seen(tracking))
            self._last, self._driven, self._outside = distance, 0.0, 0.0
        self._driven += abs(distance - self._last)
        self._last = distance
        if away > limit:
            self._outside = self._driven
        self._armed = self._armed or self._driven - self._outside >= ARMED_AFTER or self._driven >= ARMED_AT_LAST
        return catalogue.fault("PTH-06", "", _seen(tracking)) if self._armed and away > limit else None

    def _overrun(self, tracking: Tracking, end: float, distance: float) -> Fault | None:
        """Under way for too long, or driven on after the end of a part; `distance`: of the robot [m]."""
        if self._spent > self._longest:
            at = f"at {tracking.arc_length:.2f} m of {tracking.length:.2f} m"
            return catalogue.fault("PTH-08", "", f"{at} after {self._spent:.0f} s")
        if end - tracking.arc_length > AT_END:
            self._over = None
            return None
        self._over = distance if self._over is None else self._over
        beyond = abs(distance - self._over)
        return catalogue.fault("PTH-08", "", f"{beyond:.2f} m beyond the end") if beyond > OVERRUN else None


def place_fault(snapshot: Snapshot, *, localized: bool) -> Fault | None:
    """Nobody knows where the robot is: until the next fix (LOC-01), or without a localizer for good (RUN-08).

    Or fixes have said for some time that it is somewhere else (LOC-02). None: it is known.
    """
    pose = snapshot.pose
    if not pose.lost:
        seen = f"for {pose.contradicted:.1f} s"
        return catalogue.fault("LOC-02", "", seen) if pose.contradicted > CONTRADICTED else None
    if not localized:
        return catalogue.fault("RUN-08")
    return catalogue.fault("LOC-01", "", "no fix yet" if pose.age is None else f"the last fix is {pose.age:.1f} s old")


def _too_far(needed: float, battery: BatteryState) -> str:
    return f"{needed:.0f} m to drive, the battery reaches {battery.range_m:.0f} m"


def _seen(tracking: Tracking) -> str:
    askew = math.degrees(tracking.heading_error)
    return f"{tracking.cross_track:+.2f} m, {askew:+.0f} degrees at {tracking.arc_length:.2f} m"
