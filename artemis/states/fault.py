"""Mode fault: stop, switch off, read the drives' error histories, wait for the operator."""

from __future__ import annotations

from dataclasses import replace

from artemis.states.mode import OFF, STOPPING, Routine, RoutineMode, come_to_rest, finish_jobs, secure
from artemis.values import Event, Goal, JobKind, Request, Snapshot, Wish

IDLE = Wish(traction=Goal.DISABLED, steering=Goal.DISABLED, supervised=False)


class FaultMode(RoutineMode):
    """Left only by an acknowledgment with the cause gone; then everything is brought up from the start."""

    def routine(self, snapshot: Snapshot) -> Routine:
        """Come to rest, off, histories, acknowledgment."""
        plan = self.plan
        exchange = plan.connected
        stopping = replace(STOPPING, exchange=exchange, heartbeat=exchange, supervised=exchange)
        if exchange:
            snapshot = yield from come_to_rest(plan, stopping, snapshot)
        else:
            _, snapshot = yield from secure(plan, stopping, snapshot)
        idle = replace(IDLE, exchange=exchange, heartbeat=exchange, phase="reading error histories")
        if exchange:
            snapshot = yield replace(OFF, phase="switching off")
            _, snapshot = yield from finish_jobs(idle, plan.jobs(JobKind.READ_HISTORY, plan.drives()))
        while True:
            if not snapshot.sensed.attended:
                plan.failed = True
                yield replace(idle, event=Event.END, phase="fault")
            phase = "acknowledge to bring the drives up again"
            if Request.ACKNOWLEDGE in snapshot.sensed.requests:
                if not snapshot.verdict.stops:
                    plan.armed = False
                    snapshot = yield replace(idle, event=Event.ACKNOWLEDGED)
                    continue
                phase = f"cannot acknowledge yet: {snapshot.verdict.faults[0].text}"
            snapshot = yield replace(idle, phase=phase)
