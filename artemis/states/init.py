"""Mode init: find the drives, configure them, prove that they watch us, wait for arm, align the wheels."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.families.objects import LOST_HEARTBEAT
from artemis.states.homing import find_angles
from artemis.states.keeping import contradiction
from artemis.states.mode import (
    LISTEN,
    OFF,
    PATIENCE,
    Failed,
    Routine,
    RoutineMode,
    at_rest,
    change_time,
    failure,
    finish_jobs,
    give_up,
    listen,
    may_answer,
    secure,
)
from artemis.supervision import catalogue
from artemis.supervision.measures import FAULT_STATES
from artemis.values import RESETS, DriveFeedback, Event, JobKind, Request, Snapshot, Wish

ANSWER_TIME = 1.5
"""Longest time for a state to be reached that needs no motion [s], unless a drive is allowed more; and for a lost
heartbeat to be noticed, for which none is."""
HEARTBEATS = 5
"""Ticks with our heartbeat before it is withheld: a drive begins to watch with the first it hears."""
WATCH_TIME = 0.2
"""No drive misses our heartbeat sooner than this after the last one [s]."""
NO_ANSWER = "COM-08"

SILENT = Wish(heartbeat=False, exchange=False, supervised=False)
WAKING = Wish(supervised=False, phase="first contact")
PROOF = "proving the watchdog"
WITHHOLDING = Wish(heartbeat=False, supervised=False, phase=PROOF)
RESETTING = Wish(traction=Goal.FAULT_RESET, steering=Goal.FAULT_RESET, supervised=False, phase=PROOF)


class InitMode(RoutineMode):
    """Brings the drives from whatever state they are in to enabled, watching, aligned."""

    def routine(self, snapshot: Snapshot) -> Routine:
        """Listen, secure, configure, prove, wait for arm, align."""
        shared, plan, bring_up = self.shared, self.plan, self.bring_up
        silent = replace(SILENT, heartbeat=bring_up.connected)  # drives of ours still watch: secured, they no longer do
        bring_up.connected = bring_up.proving = bring_up.aligned = False
        snapshot = yield from listen(silent, snapshot, snapshot.time + LISTEN)
        results, snapshot = yield from secure(shared, silent, snapshot)
        if all(result.ok for result in results):
            wish = replace(silent, phase=JobKind.CONFIGURE.value)
            jobs = bring_up.jobs(JobKind.CONFIGURE, plan.drives())
            jobs += bring_up.jobs(JobKind.READ_CALIBRATION, plan.drives("steering") * plan.robot.has_potentiometers)
            results, snapshot = yield from finish_jobs(wish, jobs)
        if all(result.fault == NO_ANSWER for result in results):
            raise Failed(SILENT, catalogue.fault("COM-32"))
        if fault := failure(results) or contradiction(shared, results):
            raise Failed(SILENT, fault)
        bring_up.connected = bring_up.proving = True
        forgetful = [result.drive for result in results if result.kind is JobKind.CONFIGURE and result.values]
        snapshot = yield from self._prove_watchdog(snapshot, forgetful)
        latest = snapshot.time + PATIENCE
        while (held := shared.hands.held(snapshot)) or not (bring_up.armed or Request.ARM in snapshot.sensed.requests):
            late = snapshot.time > latest
            if late or not (bring_up.armed or may_answer(snapshot)):
                yield give_up(replace(OFF, phase="no operator to arm"), late=late)
            snapshot = yield replace(OFF, phase=held or "waiting for arm")
        bring_up.armed = bring_up.held = False
        yield from find_angles(shared, snapshot)
        first, bring_up.aligned, bring_up.placed = not bring_up.placed, not plan.blind, True
        stand = at_rest(plan)
        yield replace(stand, event=Event.ALIGNED, reset_pose=first, phase="as found" if plan.blind else "aligned")
        while True:
            yield stand

    def _prove_watchdog(self, snapshot: Snapshot, forgetful: list[str]) -> Routine:
        """Withhold our heartbeat once, with no torque on: every drive must report it, then reset.

        A drive that is in fault before it can miss our heartbeat has another reason, which no reset may hide. Those
        that are `forgetful`, or left the exchange of process data, have their communication reset and are configured
        again.
        """
        change = change_time(self.plan, ANSWER_TIME)
        snapshot = yield from until(_off, WAKING, change, "COM-08", "no process data after configuration", snapshot)
        for _ in range(HEARTBEATS):
            last_beat = snapshot.time
            snapshot = require_healthy((yield WAKING))
        missed: set[str] = set()

        def is_lost(drive: DriveFeedback) -> bool:
            if LOST_HEARTBEAT in drive.emergencies:
                missed.add(drive.name)
            stopped = drive.name in missed and drive.nmt is Nmt.PRE_OPERATIONAL  # it may have left the exchange with it
            return drive.state is DriveState.FAULT or stopped

        earliest, problem = last_beat + WATCH_TIME, "no fault without our heartbeat"
        snapshot = yield from until(is_lost, WITHHOLDING, ANSWER_TIME, "COM-30", problem, snapshot, earliest)
        unheard = [name for name in self.plan.drives() if name not in missed]
        if unheard:  # an EMCY is sent once and may be lost; the drive remembers
            histories = self.bring_up.jobs(JobKind.READ_HISTORY, unheard)
            told, snapshot = yield from finish_jobs(WITHHOLDING, histories, require_no_restart)
            for result in told:
                if LOST_HEARTBEAT not in result.values[:1]:
                    seen = (
                        f"in fault for another reason: {', '.join(map(hex, result.values)) or result.detail or 'none'}"
                    )
                    raise Failed(SILENT, catalogue.fault("COM-30", result.drive, seen))
        stopped = {drive.name for drive in snapshot.sensed.drives if drive.nmt is not Nmt.OPERATIONAL}
        again = [name for name in self.plan.drives() if name in stopped.union(forgetful)]
        if again:
            jobs, resets = self.bring_up.jobs, [RESETS["communication"]] * len(again)
            for orders in jobs(JobKind.SECURE, again, resets), jobs(JobKind.CONFIGURE, again):
                told, snapshot = yield from finish_jobs(RESETTING, orders)
                if fault := failure(told):
                    raise Failed(SILENT, fault)
        snapshot = yield from until(_off, RESETTING, change, "COM-08", "fault reset refused", snapshot)
        self.bring_up.proving = False
        return snapshot


def until(
    done: Callable[[DriveFeedback], bool],
    wish: Wish,
    longest: float,
    id: str,
    problem: str,
    snapshot: Snapshot,
    earliest: float = 0.0,
) -> Routine:
    """Yield `wish` until every drive is `done`; those that are not within `longest` [s] are the fault `id`.

    Before `earliest` [s of the run] no drive may be in fault; none may restart.
    """
    latest = snapshot.time + longest
    while True:
        snapshot = yield wish
        if snapshot.time < earliest:
            require_healthy(snapshot)
        else:
            require_no_restart(snapshot)
        waiting = [drive for drive in snapshot.sensed.drives if not done(drive)]
        if not waiting:
            return snapshot
        if snapshot.time > latest:
            seen = f"{problem}; state {waiting[0].state.value}"
            id = "COM-01" if waiting[0].state is DriveState.FAULT else id
            raise Failed(SILENT, catalogue.fault(id, waiting[0].name, seen))


def require_healthy(snapshot: Snapshot) -> Snapshot:
    """The snapshot.

    Raises:
        Failed: a drive restarted (COM-26) or is in fault in it (COM-01).
    """
    require_no_restart(snapshot)
    for drive in snapshot.sensed.drives:
        if drive.state in FAULT_STATES:
            raise Failed(SILENT, catalogue.fault("COM-01", drive.name, "before it could miss us"))
    return snapshot


def require_no_restart(snapshot: Snapshot) -> None:
    """Nothing is judged while the watchdog is being proven; what a drive proved before it restarted is void.

    Raises:
        Failed: a drive booted (COM-26).
    """
    for drive in snapshot.sensed.drives:
        if drive.boots:
            raise Failed(SILENT, catalogue.fault("COM-26", drive.name))


def _off(drive: DriveFeedback) -> bool:
    """The drive exchanges process data and waits in Switch On Disabled."""
    heard = drive.age is not None and drive.nmt is Nmt.OPERATIONAL
    return heard and drive.state is DriveState.SWITCH_ON_DISABLED
