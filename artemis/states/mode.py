"""What every robot mode is, and what modes have in common: routines, and waiting for jobs."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Protocol

from msgspec.structs import replace

from artemis.drive_states import POWERED, DriveState, Goal, Nmt
from artemis.motion.perception import STANDING_TIME
from artemis.states.plan import DriveStop, Plan, Shared
from artemis.supervision import catalogue
from artemis.values import (
    RESETS,
    Action,
    DriveCommand,
    DriveFeedback,
    Event,
    Fault,
    Job,
    JobKind,
    JobResult,
    Snapshot,
    Tracking,
    Wish,
)


class ModeLogic(Protocol):
    """One mode: pure logic, asked at every tick while it lasts."""

    shared: Shared
    """What it shares with the others."""

    def enter(self, snapshot: Snapshot) -> None:
        """The mode begins with `snapshot`, which `step` will see too."""

    def step(self, snapshot: Snapshot) -> Wish:
        """What the mode wants of this tick."""


# ---------------------------------------------------------------------------------------------- routines

Routine = Generator[Wish, Snapshot, Snapshot]
"""A motion that takes many ticks: yields a wish, receives the next snapshot; returns the last one it saw."""


class Failed(Exception):
    """A routine cannot continue: its mode reports the fault, and stands by with the wish until the mode changes."""

    def __init__(self, wish: Wish, fault: Fault) -> None:
        super().__init__(fault.text)
        self.wish, self.fault = wish, fault


class RoutineMode:
    """A mode whose logic is a routine. Entering it begins the routine anew; leaving it drops the rest."""

    def __init__(self, shared: Shared) -> None:
        self.shared, self.plan, self.bring_up = shared, shared.plan, shared.bring_up
        self._routine: Routine | None = None

    def routine(self, snapshot: Snapshot) -> Routine:
        """The mode's logic from its first snapshot on; must not end by itself."""
        raise TypeError(f"{type(self).__name__} has no routine")

    def enter(self, snapshot: Snapshot) -> None:
        """Begin anew."""
        self._routine = self._run(snapshot)
        self._begun = False

    def step(self, snapshot: Snapshot) -> Wish:
        """Continue with the next wish."""
        if self._routine is None:
            self.enter(snapshot)
        routine = self._routine
        assert routine is not None
        if self._begun:
            return routine.send(snapshot)
        self._begun = True
        return next(routine)

    def _run(self, snapshot: Snapshot) -> Routine:
        """The routine; one that fails reports its fault once, and stands by."""
        try:
            return (yield from self.routine(snapshot))
        except Failed as failed:
            wish, fault = failed.wish, failed.fault
        yield replace(wish, fault=fault)
        while True:
            yield wish


Finished = Generator[Wish, Snapshot, tuple[tuple[JobResult, ...], Snapshot]]


def finish_jobs(
    wish: Wish, jobs: tuple[Job, ...], check: Callable[[Snapshot], None] = lambda snapshot: None
) -> Finished:
    """Wish `jobs` once, then `wish` until each has ended; `check` sees each snapshot.

    Returns the results in the order of the jobs.
    """
    results: dict[int, JobResult] = {}
    snapshot = yield replace(wish, jobs=jobs)
    while True:
        check(snapshot)
        results.update({result.id: result for result in snapshot.sensed.results})
        if all(job.id in results for job in jobs):
            return tuple(results[job.id] for job in jobs), snapshot
        snapshot = yield wish


def failure(results: Iterable[JobResult]) -> Fault | None:
    """What the first job met that failed."""
    return next((catalogue.fault(it.fault, it.drive, it.detail) for it in results if not it.ok), None)


LISTEN = 0.3
"""Seconds of listening before the first frame of ours."""


def listen(wish: Wish, snapshot: Snapshot, until: float = LISTEN) -> Routine:
    """Yield `wish`, which sends nothing, up to a run time [s]."""
    while snapshot.time < until:
        snapshot = yield replace(wish, phase="listening")
    return snapshot


def is_second(shared: Shared, snapshot: Snapshot) -> bool:
    """Another artemis has the drives, and we do not: nothing of ours may reach them."""
    return not shared.bring_up.connected and any(fault.id == "COM-18" for fault in snapshot.verdict.faults)


def nobody_answers(snapshot: Snapshot) -> bool:
    """No drive was ever heard, and that is said (COM-32): what each does not answer is no news."""
    heard = any(drive.nmt is not None or drive.age is not None for drive in snapshot.sensed.drives)
    return not heard and any(fault.id == "COM-32" for fault in snapshot.verdict.faults)


def secure(shared: Shared, wish: Wish, snapshot: Snapshot) -> Finished:
    """Have every drive stopped and off by jobs, before any process data: traction first, while steering may hold."""
    found: tuple[JobResult, ...] = ()
    snapshot = yield from listen(wish, snapshot)
    for role in ("traction", "steering"):
        if is_second(shared, snapshot):
            break
        drives = shared.plan.drives(role)
        resets = [RESETS[shared.bring_up.resets.pop(drive, "")] for drive in drives]
        results, snapshot = yield from finish_jobs(
            replace(wish, phase=JobKind.SECURE.value), shared.bring_up.jobs(JobKind.SECURE, drives, resets)
        )
        found += results
    return found, snapshot


def may_answer(snapshot: Snapshot) -> bool:
    """Whether somebody can acknowledge and arm; or may still come who can, where every drive is off until then."""
    sensed = snapshot.sensed
    off = not any(drive.state in POWERED for drive in sensed.drives)
    return sensed.attended or (sensed.awaited and off and not snapshot.verdict.final)


PATIENCE = 600.0
"""After waiting so long for a person the run ends [s] (OPR-03)."""


def give_up(wish: Wish, *, late: bool) -> Wish:
    """`wish`, and the end of the run as failed: no operator came in time (`late`), or there is none."""
    return replace(wish, event=Event.END, failed=True, fault=catalogue.fault("OPR-03") if late else None)


ROLLING_TIME = 10.0
"""A robot whose traction is off may roll this long before steering lets go, too [s]."""


def come_to_rest(shared: Shared, wish: Wish, snapshot: Snapshot) -> Routine:
    """Yield `wish` until the robot stands; traction is off at the latest after the plan's stop time.

    Steering holds for longer: a robot that rolls without power shall not turn on its own. It ends sooner where a
    driven wheel is not heard any more. What stood a moment ago may just have begun to move: standing counts after a
    while.

    A driven wheel whose drive is unresponsive would continue at its last set-point: it is stopped by SDO. Where that
    fails, too, our heartbeat is withheld, so that every drive stops by itself.
    """
    stop = shared.bring_up.stop = shared.bring_up.stop or DriveStop(snapshot.time, _ramp_time(shared.plan, snapshot))
    while True:
        passed = snapshot.time - stop.begun
        halts = [result for result in snapshot.sensed.results if result.kind is JobKind.HALT]
        stop.heartbeat = stop.heartbeat and all(result.ok for result in halts)
        unresponsive = [name for name in shared.plan.drives("traction") if _is_unresponsive(snapshot, name, passed)]
        jobs = shared.bring_up.jobs(JobKind.HALT, [name for name in unresponsive if name not in stop.halted])
        stop.halted.update(unresponsive)
        limit = ROLLING_TIME if _is_heard(shared.plan, snapshot) else shared.plan.stop_time
        if not jobs and (passed >= limit or (snapshot.standing and passed >= stop.ramp)):
            shared.bring_up.stop = None
            return snapshot
        told = wish if passed < shared.plan.stop_time else replace(wish, traction=Goal.DISABLED)
        snapshot = yield replace(told, jobs=jobs, heartbeat=stop.heartbeat)


def change_time(plan: Plan, usual: float) -> float:
    """Longest time for the drives to change their state [s]: the usual one, or what one of them is allowed."""
    return max(usual, *(drive.tables.state_time for drive in plan.robot.drives.values()))


UNRESPONSIVE = 0.1
"""A drive whose feedback is older than this [s], or still enabled so long after it was stopped, is unresponsive."""


def _ramp_time(plan: Plan, snapshot: Snapshot) -> float:
    """How long [s] the drives slow down from the set-points, or the wheels have to be still to count as standing."""
    fastest = max(abs(snapshot.set_points.speed_left), abs(snapshot.set_points.speed_right))
    return max(STANDING_TIME, fastest / plan.robot.limits.quick_stop_deceleration_m_s2)


def feedback(snapshot: Snapshot, name: str) -> DriveFeedback:
    """What one drive reports."""
    return next(drive for drive in snapshot.sensed.drives if drive.name == name)


def _is_unresponsive(snapshot: Snapshot, name: str, passed: float) -> bool:
    """Whether a drive takes no process data, `passed` [s] after the stop began."""
    drive = feedback(snapshot, name)
    if drive.nmt is not Nmt.OPERATIONAL or drive.age is None or drive.age > UNRESPONSIVE:
        return True
    return drive.state is DriveState.OPERATION_ENABLE and passed >= UNRESPONSIVE


def _is_heard(plan: Plan, snapshot: Snapshot) -> bool:
    """Whether the driven wheels still report how they roll."""
    driven = plan.drives("traction")
    return all(d.age is not None and d.age < HEARD for d in snapshot.sensed.drives if d.name in driven)


HEARD = 0.5
"""A drive whose feedback is older than this [s] is gone."""
STOPPING = Wish(
    command=DriveCommand(action=Action.QUICKSTOP), traction=Goal.QUICK_STOPPED, steering=Goal.HOLD, phase="stopping"
)
"""The drives' own quick stop for traction; steering holds its angle."""
OFF = Wish(traction=Goal.DISABLED, steering=Goal.DISABLED)
"""All drives off, watched and exchanging."""
ON = Wish(traction=Goal.ENABLED, steering=Goal.ENABLED)
"""All drives enabled, standing, wheels straight."""
STEERING_ON = Wish(traction=Goal.DISABLED, steering=Goal.ENABLED)
"""Wheels may be turned; nothing can drive the robot."""


def at_rest(plan: Plan) -> Wish:
    """All drives enabled; only steering where the wheels' angles are unknown."""
    return STEERING_ON if plan.blind else ON


def stand(
    snapshot: Snapshot, *, event: Event | None = None, fault: Fault | None = None, tracking: Tracking | None = None
) -> Wish:
    """Stand with the wheels where they are."""
    command = DriveCommand(steering=snapshot.set_points.steering)
    return replace(ON, command=command, event=event, fault=fault, tracking=tracking, phase="standing")
