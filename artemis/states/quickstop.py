"""Mode quickstop: the drives' own ramp, then off; an explicit re-arm with neutral controls leads back."""

from __future__ import annotations

from dataclasses import replace

from artemis.states.alignment import enable
from artemis.states.mode import OFF, ON, STOP_TIME, STOPPING, Routine, RoutineMode, fail, finish_jobs
from artemis.supervision import catalogue
from artemis.values import DriveCommand, DriveState, Event, JobKind, Request, Severity, Snapshot, Wish


class QuickstopMode(RoutineMode):
    """Stops without any drive being at fault: S2 by the gate's ramp, drives held; else by the drives, then off."""

    def step(self, snapshot: Snapshot) -> Wish:
        """As the routine says; drives without our configuration are neither spoken to nor judged."""
        wish = super().step(snapshot)
        return wish if self.plan.connected else replace(wish, heartbeat=False, exchange=False, supervised=False)

    def routine(self, snapshot: Snapshot) -> Routine:
        """Stop, wait for re-arm, enable again with targets cleared."""
        plan = self.plan
        latest = snapshot.time + STOP_TIME
        while not snapshot.standing and snapshot.time < latest:
            snapshot = yield _ramp(snapshot) if _holds(snapshot) else STOPPING
        while True:
            if not snapshot.sensed.attended:
                plan.failed = True
                yield replace(_rest(snapshot), event=Event.END, phase="stopped")
            waits_for = _waits_for(snapshot)
            if waits_for is None and Request.ARM in snapshot.sensed.requests:
                break
            snapshot = yield replace(_rest(snapshot), phase=waits_for or "stopped: arm to go on")
        if not plan.aligned:
            plan.armed = True
            yield replace(OFF, event=Event.ACKNOWLEDGED)
        results, snapshot = yield from finish_jobs(
            _rest(snapshot), plan.jobs(JobKind.CLEAR_TARGET, [] if _holds(snapshot) else plan.drives())
        )
        for result in results:
            if not result.ok:
                return (yield from fail(OFF, catalogue.fault("COM-08", result.drive, result.detail)))
        snapshot = yield from enable(ON, snapshot)
        yield replace(_ramp(snapshot), event=Event.REARMED)
        while True:
            snapshot = yield _ramp(snapshot)


def _holds(snapshot: Snapshot) -> bool:
    """A controlled stop (S2) was asked for and the drives are still on."""
    enabled = all(drive.state is DriveState.OPERATION_ENABLE for drive in snapshot.sensed.drives)
    return enabled and snapshot.verdict.severity is Severity.CONTROLLED_STOP


def _ramp(snapshot: Snapshot) -> Wish:
    """Enabled, speed ramped to zero by the gate, wheels held."""
    return replace(ON, command=DriveCommand(steering=snapshot.set_points.steering), phase="stopping")


def _rest(snapshot: Snapshot) -> Wish:
    """Standing: held after a controlled stop, else off."""
    return _ramp(snapshot) if _holds(snapshot) else OFF


def _waits_for(snapshot: Snapshot) -> str | None:
    """What the operator has to do before arming; None: nothing."""
    if snapshot.verdict.severity >= Severity.CONTROLLED_STOP:
        return f"acknowledge: {snapshot.verdict.faults[0].text}"
    if not all(sample.neutral for sample in snapshot.sensed.inputs):
        return "release the controls"
    return None
