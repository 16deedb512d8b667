"""Mode fault: stop, switch off, read the drives' error histories, wait for the operator."""

from __future__ import annotations

from dataclasses import replace

from artemis.states.mode import (
    OFF,
    PATIENCE,
    RESETS,
    STOPPING,
    Plan,
    Routine,
    RoutineMode,
    come_to_rest,
    finish_jobs,
    secure,
)
from artemis.supervision import catalogue
from artemis.values import Event, Goal, JobKind, Nmt, Request, Snapshot, Wish

DEAF = 0.1
"""A drive whose feedback is older than this [s] may not hear our set-points either."""
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
        wish, resets = super().step(snapshot), self.plan.resets
        for fault in snapshot.verdict.faults:  # acknowledged ones are forgotten, what their drive needs is not
            needs = catalogue.ROWS[fault.id].recovery.reset, resets.get(fault.device, "")
            resets[fault.device] = max(needs, key=RESETS.__getitem__)
        return wish

    def routine(self, snapshot: Snapshot) -> Routine:
        """Come to rest, off, histories, acknowledgment."""
        plan = self.plan
        exchange = plan.connected
        stopping = replace(STOPPING, exchange=exchange, heartbeat=exchange, supervised=exchange)
        if exchange:
            snapshot = yield from _reach_the_deaf(plan, come_to_rest(plan, stopping, snapshot), snapshot)
        else:
            _, snapshot = yield from secure(plan, stopping, snapshot)
        idle = replace(IDLE, exchange=exchange, heartbeat=exchange, phase="reading error histories")
        if exchange:
            snapshot = yield replace(OFF, phase="switching off")
            _, snapshot = yield from finish_jobs(idle, plan.jobs(JobKind.READ_HISTORY, plan.drives()))
        latest = snapshot.time + PATIENCE
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
        goes_on = verdict.recovers and not self.plan.held and (verdict.resumes or self.plan.armed)
        if late or not (snapshot.sensed.attended or goes_on):
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


def _reach_the_deaf(plan: Plan, stop: Routine, snapshot: Snapshot) -> Routine:
    """Stop, and stop by SDO each driven wheel whose drive takes no process data: it would go on as it was told last.

    Where that fails, too, our heartbeat is withheld, so that every drive stops by itself.
    """
    asked: set[str] = set()
    heartbeat, wish = True, next(stop)
    while True:
        deaf = [name for name in plan.drives("traction") if name not in asked and _is_deaf(snapshot, name)]
        asked.update(deaf)
        snapshot = yield replace(wish, jobs=plan.jobs(JobKind.HALT, deaf), heartbeat=wish.heartbeat and heartbeat)
        heartbeat = heartbeat and all(result.ok for result in snapshot.sensed.results if result.kind is JobKind.HALT)
        try:
            wish = stop.send(snapshot)
        except StopIteration as end:
            rested: Snapshot = end.value
            return rested


def _is_deaf(snapshot: Snapshot, name: str) -> bool:
    """Whether a drive is not in the exchange of process data."""
    drive = next(drive for drive in snapshot.sensed.drives if drive.name == name)
    return drive.nmt is not Nmt.OPERATIONAL or drive.age is None or drive.age > DEAF
