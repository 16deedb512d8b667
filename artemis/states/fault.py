"""Mode fault: stop, switch off, read the drives' error histories, wait for the operator."""

from __future__ import annotations

from dataclasses import replace

from artemis.states.mode import OFF, PATIENCE, STOPPING, Routine, RoutineMode, come_to_rest, finish_jobs, secure
from artemis.supervision import catalogue
from artemis.values import Event, Goal, JobKind, Request, Snapshot, Wish

IDLE = Wish(traction=Goal.DISABLED, steering=Goal.DISABLED, supervised=False)


class FaultMode(RoutineMode):
    """Left by an acknowledgment with the cause gone, or automatically where all faults allow it.

    Then everything is brought up from the start.
    """

    def enter(self, snapshot: Snapshot) -> None:
        """Begin anew."""
        super().enter(snapshot)
        self._acknowledged = self._resumes = False

    def step(self, snapshot: Snapshot) -> Wish:
        """As the routine says; an acknowledgment counts also while the robot still stops."""
        self._acknowledged = self._acknowledged or Request.ACKNOWLEDGE in snapshot.sensed.requests
        if snapshot.verdict.stops:
            self._resumes = snapshot.verdict.resumes
        return super().step(snapshot)

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
        latest = snapshot.time + PATIENCE
        for fault in snapshot.verdict.faults:
            plan.resets[fault.device] = catalogue.ROWS[fault.id].recovery.reset or plan.resets.get(fault.device, "")
        while snapshot.verdict.stops:
            snapshot = yield from self._wait(idle, snapshot, latest)
        by_person = self._acknowledged or plan.held
        plan.armed = not by_person and (plan.armed or self._resumes)
        while True:
            yield replace(idle, event=Event.ACKNOWLEDGED, phase="acknowledged" if by_person else "recovered")

    def _wait(self, idle: Wish, snapshot: Snapshot, latest: float) -> Routine:
        """One tick more, with the reason why."""
        verdict, present = snapshot.verdict, snapshot.verdict.faults[0]
        late = snapshot.time > latest
        if late or not (snapshot.sensed.attended or verdict.recovers):
            self.plan.failed = True
            expired = catalogue.fault("OPR-03") if late else None
            return (yield replace(idle, event=Event.END, fault=expired, phase="fault"))
        if verdict.final:
            phase = f"this run cannot go on, end it: {present.text}"
        elif verdict.recovers:
            phase = "recovers by itself"
        elif self._acknowledged:
            self._acknowledged = False
            phase = f"cannot acknowledge yet: {present.text}"
        else:
            phase = "acknowledge to bring the drives up again"
        return (yield replace(idle, phase=phase))
