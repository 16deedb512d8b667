"""Mode follow: a follower plugin drives the robot along the path of the present step."""

from __future__ import annotations

import math
from dataclasses import replace

from artemis.plugins.contracts import Following
from artemis.states.mode import ON, FollowStep, Plan
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Event, Fault, Snapshot, Wish


class FollowMode:
    """Asks the follower at each tick. A step that was interrupted goes on where it stopped."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._begun: FollowStep | None = None
        self._fault: Fault | None = None

    def enter(self, snapshot: Snapshot) -> None:
        """Start the follower, unless it is on its way already."""
        step = self._plan.current
        self._fault = None
        if isinstance(step, FollowStep) and step is not self._begun:
            try:
                step.follower.start(step.path, snapshot)
            except Exception as error:  # noqa: BLE001  the border to foreign code: whatever it raises is a fault
                self._fault = catalogue.fault("PLG-02", "follower", f"start: {error!r}")
            else:
                self._begun = step

    def step(self, snapshot: Snapshot) -> Wish:
        """The follower's command; done when it has finished and the robot stands."""
        step = self._plan.current
        stand = replace(ON, command=DriveCommand(steering=snapshot.set_points.steering))
        if not isinstance(step, FollowStep):
            return replace(stand, event=Event.DONE)
        following = self._ask(step, snapshot) if self._fault is None else self._fault
        if isinstance(following, Fault):
            return replace(stand, fault=following)
        wish = replace(ON, command=following.command, tracking=following.tracking, phase="following")
        lost = abs(following.tracking.cross_track) > step.max_cross_track
        if lost:
            seen = f"{following.tracking.cross_track:.2f} m at {following.tracking.arc_length:.2f} m"
            return replace(wish, fault=catalogue.fault("PTH-06", "", seen))
        if following.finished and snapshot.standing:
            self._plan.advance()
            return replace(wish, event=Event.DONE)
        return wish

    def _ask(self, step: FollowStep, snapshot: Snapshot) -> Following | Fault:
        try:
            following = step.follower.step(snapshot)
        except Exception as error:  # noqa: BLE001  the border to foreign code: whatever it raises is a fault
            return catalogue.fault("PLG-02", "follower", repr(error))
        if not isinstance(following, Following):
            return catalogue.fault("PLG-06", "follower", repr(following)[:80])
        if not math.isfinite(following.tracking.cross_track):
            return catalogue.fault("PLG-06", "follower", "cross-track error is not a number")
        return following
