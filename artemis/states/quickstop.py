"""Mode quickstop: the drives' own ramp, then off; an explicit re-arm with neutral controls leads back."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.drive_states import DriveState
from artemis.states.alignment import Lookout, enable, switch_off
from artemis.states.mode import (
    OFF,
    ON,
    PATIENCE,
    STOPPING,
    Failed,
    Routine,
    RoutineMode,
    come_to_rest,
    failure,
    finish_jobs,
    give_up,
    may_answer,
    secure,
)
from artemis.values import DriveCommand, Event, JobKind, Request, Severity, Snapshot, Wish


class QuickstopMode(RoutineMode):
    """Stops without any drive being at fault: S2 by the gate's ramp, drives held; else by the drives, then off.

    Which of the two is decided when the mode begins. A request to quick-stop begins it anew (see the table), so it
    turns a held stop into a quick one and ends a re-arm under way; nothing turns a quick stop into a milder one.
    """

    def enter(self, snapshot: Snapshot) -> None:
        """Begin anew."""
        super().enter(snapshot)
        self._acknowledged = self._resumes = False
        self._lookout = Lookout()
        self.bring_up.armed = False  # what was meant for a bring-up is no arm after a stop
        if self.bring_up.proving:  # not all were heard yet, or miss us: at no fault, secured as before
            self.bring_up.connected = False

    def step(self, snapshot: Snapshot) -> Wish:
        """As the routine says; drives without our configuration exchange nothing, their jobs stop them."""
        self._acknowledged = self._acknowledged or Request.ACKNOWLEDGE in snapshot.sensed.requests
        if snapshot.verdict.stops:
            self._resumes = snapshot.verdict.resumes
        wish = super().step(snapshot)
        return wish if self.bring_up.connected else replace(wish, heartbeat=False, exchange=False, supervised=False)

    def routine(self, snapshot: Snapshot) -> Routine:
        """Stop, wait for re-arm, enable again with targets cleared."""
        shared, plan, bring_up = self.shared, self.plan, self.bring_up
        if not bring_up.connected:
            results, snapshot = yield from secure(shared, STOPPING, snapshot)
            if fault := failure(results):
                raise Failed(STOPPING, fault)
        hold = bring_up.connected and _asks_to_hold(snapshot)
        latest = snapshot.time + plan.stop_time
        while hold and not snapshot.standing:
            snapshot = yield _ramp(snapshot)
            hold = snapshot.time < latest
        if bring_up.connected and not hold:
            snapshot = yield from come_to_rest(shared, STOPPING, snapshot)
            snapshot = yield from switch_off(shared, OFF, snapshot)
        latest = snapshot.time + PATIENCE
        while not self._may_continue(snapshot):
            snapshot = yield self._waiting(_ramp(snapshot) if hold else OFF, snapshot, latest)
        bring_up.held = False
        if not bring_up.aligned:
            bring_up.armed = True
            yield replace(OFF, event=Event.ACKNOWLEDGED)
        if not hold:
            results, snapshot = yield from finish_jobs(OFF, bring_up.jobs(JobKind.CLEAR_TARGET, plan.drives()))
            if fault := failure(results):
                raise Failed(OFF, fault)
        snapshot = yield from enable(shared, ON, snapshot)
        yield replace(_ramp(snapshot), event=Event.REARMED, phase="armed again")
        while True:
            snapshot = yield _ramp(snapshot)

    def _may_continue(self, snapshot: Snapshot) -> bool:
        """Armed by a person, or by a mission that says so where all causes are gone; with the controls released."""
        if waits_for(snapshot, self.shared.hands.held(snapshot)) is not None:
            return False
        return Request.ARM in snapshot.sensed.requests or self._continues

    @property
    def _continues(self) -> bool:
        """By itself, once all causes are gone: the mission says so, and no person has taken the stop in hand."""
        return self._resumes and not (self.bring_up.held or self._acknowledged)

    def _waiting(self, rest: Wish, snapshot: Snapshot, latest: float) -> Wish:
        """At rest, with what it waits for; ends the run where no operator will come."""
        alone = not (may_answer(snapshot) or self._continues)
        if alone or snapshot.time > latest:
            return give_up(replace(rest, phase="no operator to arm" if alone else "stopped"), late=not alone)
        held = self.shared.hands.held(snapshot)
        wish = replace(rest, phase=waits_for(snapshot, held) or "stopped: arm to continue")
        return self._lookout.watch(self.shared, wish, snapshot)


def _asks_to_hold(snapshot: Snapshot) -> bool:
    """A controlled stop (S2) is asked for, nothing more, and every drive is on."""
    enabled = all(drive.state is DriveState.OPERATION_ENABLE for drive in snapshot.sensed.drives)
    only_s2 = snapshot.verdict.severity is Severity.CONTROLLED_STOP
    return enabled and only_s2 and Request.QUICKSTOP not in snapshot.sensed.requests


def _ramp(snapshot: Snapshot) -> Wish:
    """Enabled, speed ramped to zero by the gate, wheels held."""
    return replace(ON, command=DriveCommand(steering=snapshot.set_points.steering), phase="stopping")


def waits_for(snapshot: Snapshot, held: str | None) -> str | None:
    """What the operator has to do before arming, last what is `held`; None: nothing."""
    verdict = snapshot.verdict
    if verdict.final:
        return f"this run cannot continue; end it: {verdict.faults[0].text}"
    if verdict.stops:
        return "recovers automatically" if verdict.recovers else f"acknowledge: {verdict.faults[0].text}"
    return held
