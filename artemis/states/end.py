"""Mode end: the ordered end of every run. Stop, stand, disable, disarm, Pre-Operational, last heartbeat."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal
from artemis.states.gains import restore_gains
from artemis.states.mode import (
    STOPPING,
    Routine,
    RoutineMode,
    change_time,
    come_to_rest,
    finish_jobs,
    is_second,
    listen,
    nobody_answers,
)
from artemis.supervision import catalogue
from artemis.values import JobKind, Snapshot, Wish

OFF_TIME = 0.5
"""Longest time for the drives to report that they are off [s], unless one is allowed more."""
IDLE = Wish(traction=Goal.DISABLED, steering=Goal.DISABLED, supervised=False, phase="ending")
_OFF_STATES = (DriveState.SWITCH_ON_DISABLED, DriveState.FAULT, DriveState.NOT_READY, DriveState.START)


class EndMode(RoutineMode):
    """Leaves the drives without a fault: they no longer expect our heartbeat when it stops."""

    def routine(self, snapshot: Snapshot) -> Routine:
        """From whatever state the run is in to drives that rest and a process that may exit."""
        shared, plan, bring_up = self.shared, self.plan, self.bring_up
        if bring_up.connected:
            snapshot = yield from come_to_rest(shared, replace(STOPPING, supervised=False), snapshot)
            latest = snapshot.time + change_time(plan, OFF_TIME)
            while snapshot.time < latest:
                snapshot = yield IDLE
                if all(drive.state in _OFF_STATES for drive in snapshot.sensed.drives):
                    break
        idle = replace(IDLE, exchange=bring_up.connected, heartbeat=bring_up.connected)
        snapshot = yield from listen(idle, snapshot)
        if not is_second(shared, snapshot):
            snapshot = yield from restore_gains(shared, idle, snapshot)
        for role in ("traction", "steering"):
            if is_second(shared, snapshot):
                break
            results, snapshot = yield from finish_jobs(idle, bring_up.jobs(JobKind.DISARM, plan.drives(role)))
            for result in results:
                if not result.ok and not nobody_answers(snapshot):
                    fault = catalogue.fault("COM-34", result.drive, result.detail)
                    snapshot = yield replace(idle, fault=fault, failed=True)
        yield replace(idle, exchange=False)  # the last heartbeat
        while True:
            yield replace(idle, exchange=False, heartbeat=False, finished=True, phase="ended")
