"""Mode follow: a follower plugin drives the robot along the path of the present step."""

from __future__ import annotations

import math
from dataclasses import replace
from math import inf

from artemis.errors import ConfigError
from artemis.motion.path import Path
from artemis.motion.track import Track
from artemis.plugins.border import PLUGIN_ERRORS, plain_following, told
from artemis.plugins.contracts import Following
from artemis.states.mode import ON, FollowStep, Plan
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Event, Fault, Goal, Severity, Snapshot, Tracking, Wish

START_DISTANCE, START_ANGLE = 1.0, math.radians(60)
"""A path is not begun from further away or more askew than this [m, rad] (PTH-05)."""
ARMING_WAY, CONVERGENCE_WAY = 1.0, 5.0
"""The limit of the cross-track error counts once it was kept while the robot drove the first way [m], at the latest
after the second."""
SLACK, SLOWEST = 10.0, 0.05
"""A path may take twice its time and this [s], at the second speed [m/s] where the follower tells none (PTH-08)."""
AT_END, OVERRUN = 0.01, 0.2
"""So close to its end [m] the path is over; a follower must not drive on for more than the second [m] (PTH-08)."""


class FollowMode:
    """Asks the follower at each tick. A step that was interrupted goes on where it stopped."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._begun: FollowStep | None = None
        self._driven = 0.0
        self._fault: Fault | None = None
        self._last: float | None = None
        self._way = self._outside = 0.0
        self._armed = False
        self._over: float | None = None
        self._spent, self._longest = 0.0, inf

    def enter(self, snapshot: Snapshot) -> None:
        """Start the follower on what is left of the path, unless it is on its way already."""
        step = self._plan.current
        self._fault, self._last, self._armed, self._over = None, None, False, None
        if isinstance(step, FollowStep) and step is not self._begun:
            try:
                path = self._path(step)
            except ConfigError as error:
                self._fault = catalogue.fault("PTH-01", "", "; ".join(error.problems), Severity.CONTROLLED_STOP)
                return
            if step.nearest:
                pose = snapshot.odometry.pose
                rest = path.begun_at(path.nearest(pose.x, pose.y), self._plan.done)
            else:
                rest = path.rest(self._plan.done)
            self._driven = path.length - rest.length
            self._longest = 2 * path.length / (step.speed or SLOWEST) + SLACK
            try:
                step.follower.start(rest, snapshot)
            except PLUGIN_ERRORS as error:
                self._fault = catalogue.fault("PLG-02", "follower", f"start: {told(error)}")
            else:
                self._begun, self._spent = step, 0.0

    def step(self, snapshot: Snapshot) -> Wish:
        """The follower's command; done when it has finished and the robot stands."""
        step = self._plan.current
        if not isinstance(step, FollowStep):
            return _stand(snapshot, event=Event.DONE)
        if snapshot.odometry.lost:
            return _stand(snapshot, fault=catalogue.fault("RUN-08"))
        following = self._ask(step, snapshot) if self._fault is None else self._fault
        if isinstance(following, Fault):
            return _stand(snapshot, fault=following)
        tracking = self._on_whole_path(following.tracking)
        if fault := self._off_path(tracking, snapshot.odometry.distance, step.max_cross_track):
            return _stand(snapshot, fault=fault, tracking=tracking)
        self._plan.done = max(tracking.arc_length, 0.0)
        if following.finished:  # whatever the follower still commands
            if snapshot.standing:
                self._plan.advance()
            return _stand(snapshot, event=Event.DONE if snapshot.standing else None, tracking=tracking)
        self._spent += snapshot.dt
        if fault := self._overrun(tracking, snapshot.odometry.distance, self._longest):
            return _stand(snapshot, fault=fault, tracking=tracking)
        return Wish(
            command=following.command,
            traction=Goal.ENABLED,
            steering=Goal.ENABLED,
            tracking=tracking,
            phase="following",
        )

    def _path(self, step: FollowStep) -> Path:
        """The step's path; one that was recorded in this run is made now.

        Raises:
            ConfigError: nothing was recorded that can be followed.
        """
        if isinstance(step.path, Path):
            return step.path
        track = self._plan.tracks.get(step.path, Track())
        path = track.path(self._plan.robot, step.speed, step.close_within)
        return path.with_laps(step.laps)

    def _on_whole_path(self, tracking: Tracking) -> Tracking:
        """Counted from where the step began, be it in an earlier run."""
        if not self._driven:
            return tracking
        return replace(tracking, arc_length=tracking.arc_length + self._driven, length=tracking.length + self._driven)

    def _off_path(self, tracking: Tracking, distance: float, limit: float) -> Fault | None:
        """Too far away to begin (PTH-05), or lost on the way (PTH-06); `distance`: way of the robot [m]."""
        away = abs(tracking.cross_track)
        if self._last is None:
            if away > START_DISTANCE or abs(tracking.heading_error) > START_ANGLE:
                return catalogue.fault("PTH-05", "", _seen(tracking))
            self._last, self._way, self._outside = distance, 0.0, 0.0
        self._way += abs(distance - self._last)
        self._last = distance
        if away > limit:
            self._outside = self._way
        self._armed = self._armed or self._way - self._outside >= ARMING_WAY or self._way >= CONVERGENCE_WAY
        return catalogue.fault("PTH-06", "", _seen(tracking)) if self._armed and away > limit else None

    def _overrun(self, tracking: Tracking, distance: float, longest: float) -> Fault | None:
        """Driven on after the end, or for longer than `longest` [s]; `distance`: way of the robot [m]."""
        if self._spent > longest:
            return catalogue.fault("PTH-08", "", f"{tracking.arc_length:.2f} m after {self._spent:.0f} s")
        if tracking.length - tracking.arc_length > AT_END:
            self._over = None
            return None
        self._over = distance if self._over is None else self._over
        beyond = abs(distance - self._over)
        return catalogue.fault("PTH-08", "", f"{beyond:.2f} m beyond the end") if beyond > OVERRUN else None

    def _ask(self, step: FollowStep, snapshot: Snapshot) -> Following | Fault:
        try:
            answer = step.follower.step(snapshot)
        except PLUGIN_ERRORS as error:
            return catalogue.fault("PLG-02", "follower", told(error))
        return plain_following(answer) or catalogue.fault("PLG-06", "follower", told(answer))


def _stand(
    snapshot: Snapshot, *, event: Event | None = None, fault: Fault | None = None, tracking: Tracking | None = None
) -> Wish:
    """Stand with the wheels where they are."""
    command = DriveCommand(steering=snapshot.set_points.steering)
    return replace(ON, command=command, event=event, fault=fault, tracking=tracking, phase="standing")


def _seen(tracking: Tracking) -> str:
    askew = math.degrees(tracking.heading_error)
    return f"{tracking.cross_track:+.2f} m, {askew:+.0f} degrees at {tracking.arc_length:.2f} m"
