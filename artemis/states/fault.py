"""Mode fault: stop, switch off, read the drives' error histories, wait for the operator."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.drive_states import Goal
from artemis.states.alignment import Lookout, switch_off
from artemis.states.mode import (
    OFF,
    PATIENCE,
    STOPPING,
    Routine,
    RoutineMode,
    come_to_rest,
    failure,
    finish_jobs,
    give_up,
    is_second,
    may_answer,
    nobody_answers,
    secure,
)
from artemis.supervision import catalogue
from artemis.values import RESETS, Event, JobKind, Request, Snapshot, Wish

IDLE = Wish(traction=Goal.DISABLED, steering=Goal.DISABLED, supervised=False)


class FaultMode(RoutineMode):
    """Left by an acknowledgment with the cause gone, or automatically where all faults allow it.

    Then everything is brought up from the start.
    """

    def enter(self, snapshot: Snapshot) -> None:
        """Begin anew."""
        super().enter(snapshot)
        self._acknowledged = self._resumes = False
        self._insecure: set[str] = set()
        self._lookout = Lookout()

    def step(self, snapshot: Snapshot) -> Wish:
        """As the routine says; an acknowledgment counts also while the robot is still stopping."""
        self._acknowledged = self._acknowledged or Request.ACKNOWLEDGE in snapshot.sensed.requests
        if snapshot.verdict.stops:
            self._resumes = snapshot.verdict.resumes
        wish, resets = super().step(snapshot), self.bring_up.resets
        for fault in snapshot.verdict.faults:  # acknowledged ones are forgotten, what their drive needs is not
            needs = catalogue.ROWS[fault.id].recovery.reset, resets.get(fault.device, "")
            resets[fault.device] = max(needs, key=RESETS.__getitem__)
        return self._secure_again(wish, snapshot)

    def _secure_again(self, wish: Wish, snapshot: Snapshot) -> Wish:
        """Drives that could not be secured may still turn: they are tried until they are. The first one is a fault."""
        ended = [result for result in snapshot.sensed.results if result.kind is JobKind.SECURE]
        failed = [result.drive for result in ended if not result.ok]
        if failed and not self._insecure and not nobody_answers(snapshot):
            wish = replace(wish, fault=failure(ended))
        self._insecure.difference_update(result.drive for result in ended)
        self._insecure.update(failed)
        if not self._insecure or is_second(self.shared, snapshot):
            return wish
        phase = f"not secured: {', '.join(sorted(self._insecure))}; {wish.phase}"
        return replace(wish, jobs=(*wish.jobs, *self.bring_up.jobs(JobKind.SECURE, failed)), phase=phase)

    def routine(self, snapshot: Snapshot) -> Routine:
        """Come to rest, off, histories, acknowledgment."""
        shared, plan, bring_up = self.shared, self.plan, self.bring_up
        exchange = bring_up.connected
        judged = exchange and not bring_up.proving  # what drives miss meanwhile is no fault of theirs
        stopping = replace(STOPPING, exchange=exchange, heartbeat=exchange, supervised=judged)
        if exchange:
            snapshot = yield from come_to_rest(shared, stopping, snapshot)
        else:
            _, snapshot = yield from secure(shared, stopping, snapshot)
        idle = replace(IDLE, exchange=exchange, heartbeat=exchange, phase="reading error histories")
        if exchange:
            snapshot = yield from switch_off(shared, replace(OFF, supervised=judged), snapshot)
            _, snapshot = yield from finish_jobs(idle, bring_up.jobs(JobKind.READ_HISTORY, plan.drives()))
        latest = snapshot.time + PATIENCE
        while snapshot.verdict.stops:
            snapshot = yield from self._wait(idle, snapshot, latest)
        by_person = self._acknowledged or bring_up.held
        bring_up.armed = not by_person and (bring_up.armed or self._resumes)
        while True:
            yield replace(idle, event=Event.ACKNOWLEDGED, phase="acknowledged" if self._acknowledged else "recovered")

    def _wait(self, idle: Wish, snapshot: Snapshot, latest: float) -> Routine:
        """One tick more, with the reason why."""
        verdict, present = snapshot.verdict, snapshot.verdict.faults[0]
        late = snapshot.time > latest
        continues = verdict.recovers and not self.bring_up.held and (verdict.resumes or self.bring_up.armed)
        answers = snapshot.sensed.attended if self._insecure else may_answer(snapshot)
        alone = not (answers or continues)
        if late or alone or is_second(self.shared, snapshot):
            phase = "no operator to acknowledge" if alone and not verdict.final else "fault"
            return (yield give_up(replace(idle, phase=phase), late=late))
        if verdict.final:
            phase = f"this run cannot continue; end it: {present.text}"
        elif verdict.recovers:
            phase = "recovers automatically"
        elif self._acknowledged:
            self._acknowledged = False
            phase = f"cannot acknowledge yet: {present.text}"
        else:
            phase = "acknowledge to bring the drives up again"
        return (yield self._lookout.watch(self.shared, replace(idle, phase=phase), snapshot))
