"""What every robot mode is, and what modes share: the plan, routines, and waiting for jobs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from artemis.motion.perception import STANDING_TIME
from artemis.motion.route import Route
from artemis.motion.steering_fit import SteeringFit
from artemis.motion.track import Track
from artemis.plugins.contracts import Follower
from artemis.supervision import catalogue
from artemis.supervision.policy import Policies
from artemis.values import (
    RESETS,
    Action,
    DriveCommand,
    DriveState,
    Event,
    Fault,
    Goal,
    Job,
    JobKind,
    JobResult,
    Nmt,
    OperatorInput,
    Pose,
    Position,
    Snapshot,
    Wish,
)
from artemis.vehicle import Robot


class ModeLogic(Protocol):
    """One mode: pure logic, asked at every tick while it lasts."""

    def enter(self, snapshot: Snapshot) -> None:
        """The mode begins with `snapshot`, which `step` will see too."""

    def step(self, snapshot: Snapshot) -> Wish:
        """What the mode wants of this tick."""


# ---------------------------------------------------------------------------------------------- the mission's steps


class CalibrateStep(Struct, frozen=True, kw_only=True):
    """Align the wheels from the potentiometers again; what else mode calibrate does are kinds of this."""

    @property
    def replaces(self) -> tuple[str, ...]:
        """Sides whose drives are to keep another calibration of the potentiometers: what they keep now is no matter."""
        return ()


class FollowStep(Struct, frozen=True, kw_only=True):
    """Follow a path to its end; `max_cross_track` [m] is where the robot counts as lost."""

    route: Route | str
    """A text: the path that was recorded under this name in an earlier step."""
    follower: Follower
    laps: int = 1
    """Of a path that is recorded first, like the next two; another one has its own."""
    from_end: bool = False
    """From its last point to its first."""
    backward: bool | None = None
    """Begin with the rear ahead, or not; None: as it was driven."""
    close_within: float = 0.0
    """A recorded path that ends so near its beginning [m] is closed."""
    round_corners: float = 0.0
    """How far a recorded path may be left at a corner that is too sharp [m]."""
    allow_slowdown: bool = False
    """Drive a recorded path slower where the steering needs it."""
    nearest: bool = False
    """Begin at the point of the path that is nearest to the robot."""
    max_cross_track: float = 0.6
    speed: float | None = None
    """Of the virtual front wheel [m/s], where the follower says: it drives no faster, and not for ever (PTH-08)."""


class TeleopStep(Struct, frozen=True, kw_only=True):
    """Drive by hand until the input says done or the time is over (`seconds` None: no limit)."""

    input: str
    seconds: float | None
    speed: float | None = None
    """Of the virtual front wheel [m/s], where the input says: it drives no faster."""
    record: str = ""
    """Name of the path that is recorded; none: nothing is."""


class WaitStep(Struct, frozen=True, kw_only=True):
    """Stand still."""

    seconds: float


Step = CalibrateStep | FollowStep | TeleopStep | WaitStep


def with_followers(steps: Iterable[Step], change: Callable[[Follower], Follower]) -> tuple[Step, ...]:
    """The steps, each follower as `change` makes it."""
    return tuple(
        replace(step, follower=change(step.follower)) if isinstance(step, FollowStep) else step for step in steps
    )


@dataclass(slots=True)
class Stop:
    """A stop by the drives under way. A mode that begins it anew goes on with it: its time does not begin again."""

    begun: float
    halted: set[str] = field(default_factory=set)
    """Driven wheels whose drives were to be stopped by SDO."""
    heartbeat: bool = True
    """False: one of them could not be, so our silence has to stop it."""


@dataclass(slots=True, kw_only=True)
class Plan:
    """The mission's steps and how far they are done; part of the core's state, shared by the modes."""

    robot: Robot
    steps: tuple[Step, ...]
    armed: bool = True
    """The next bring-up may go on to enable the drives: starting the run is the first arm, then each takes its own."""
    connected: bool = False
    """The drives have our configuration: process data may be exchanged."""
    aligned: bool = False
    """The wheels were aligned since the drives were last brought up."""
    placed: bool = False
    """The odometry has its origin: where the wheels were aligned first."""
    held: bool = False
    """A person stopped the robot, or a fault that may not go on by itself: nothing but a person's arm lets it go on."""
    stop: Stop | None = None
    """None: no stop by the drives is under way."""
    policies: Policies = field(default_factory=dict)
    """What the mission says about single faults."""
    resets: dict[str, str] = field(default_factory=dict)
    """NMT reset that a drive needs before it is brought up again: `communication` or `node`."""
    start: Pose = field(default_factory=Pose)
    """Where the odometry begins."""
    position: Position = field(default_factory=Position)
    """How far the steps are done."""
    tracks: dict[str, Track] = field(default_factory=dict)
    """What was recorded, by name."""
    found: Mapping[str, float] | None = None
    """The potentiometers are new and say nothing: angles of the wheels as they are found [rad], by side if known."""
    taken: bool = False
    """They were taken so: from then on they may have been turned."""
    steering: dict[str, SteeringFit] = field(default_factory=dict)
    """What was measured of the potentiometers, by side."""
    kept: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """What the drives' memories were given in this run, by drive."""
    tried: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Gains that drives were given for this run only, by drive; at its end they get the robot file's again."""
    _ids: itertools.count[int] = field(default_factory=lambda: itertools.count(1))

    @property
    def current(self) -> Step | None:
        """The step to do now; None after the last."""
        return self.steps[self.position.step] if self.position.step < len(self.steps) else None

    @property
    def top_speed(self) -> float:
        """What the way to stop was checked for, of the current step: speed of the virtual front wheel [m/s]."""
        step = self.current
        told = step.speed if isinstance(step, FollowStep | TeleopStep) else None
        return self.robot.limits.speed_m_s if told is None else told

    @property
    def stop_time(self) -> float:
        """Longest time that is given to a stop before the drives are switched off all the same [s]."""
        return 1.0 + 2.0 * self.robot.limits.speed_m_s / self.robot.limits.quick_stop_deceleration_m_s2

    @property
    def blind(self) -> bool:
        """Nobody knows what the potentiometers say: traction stays off."""
        return self.found is not None

    def drives(self, role: str | None = None) -> list[str]:
        """Names of all drives, or of those with `role`."""
        return [name for name, drive in self.robot.drives.items() if role in (None, drive.role)]

    def jobs(self, kind: JobKind, drives: Iterable[str], values: Iterable[float] | None = None) -> tuple[Job, ...]:
        """New jobs of one kind for several drives, each with its value."""
        names = list(drives)
        given = list(values) if values is not None else [0.0] * len(names)
        return tuple(
            Job(id=next(self._ids), kind=kind, drive=drive, value=value)
            for drive, value in zip(names, given, strict=True)
        )

    def job(self, kind: JobKind, drive: str, *values: int) -> tuple[Job, ...]:
        """A new job for one drive, with numbers to write; alone in its tuple."""
        return (Job(id=next(self._ids), kind=kind, drive=drive, values=values),)


def advance(position: Position, wish: Wish) -> Position:
    """Where the mission is after a tick in which the mode wished this."""
    if wish.over:
        return Position(step=position.step + 1)
    return position if wish.done is None else Position(step=position.step, done=wish.done)


# ---------------------------------------------------------------------------------------------- routines

Routine = Generator[Wish, Snapshot, Snapshot]
"""A motion that takes many ticks: yields a wish, receives the next snapshot; returns the last one it saw."""


class RoutineMode:
    """A mode whose logic is a routine. Entering it begins the routine anew; leaving it drops the rest."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._routine: Routine | None = None
        self._begun = False

    def routine(self, snapshot: Snapshot) -> Routine:
        """The mode's logic from its first snapshot on; must not end by itself."""
        raise TypeError(f"{type(self).__name__} has no routine")

    def enter(self, snapshot: Snapshot) -> None:
        """Begin anew."""
        self._routine = self.routine(snapshot)
        self._begun = False

    def step(self, snapshot: Snapshot) -> Wish:
        """Go on to the next wish."""
        if self._routine is None:
            self.enter(snapshot)
        routine = self._routine
        assert routine is not None
        if self._begun:
            return routine.send(snapshot)
        self._begun = True
        return next(routine)


Finished = Generator[Wish, Snapshot, tuple[tuple[JobResult, ...], Snapshot]]


def finish_jobs(wish: Wish, jobs: tuple[Job, ...]) -> Finished:
    """Wish `jobs` once, then `wish` until each has ended. Returns the results in the order of the jobs."""
    results: dict[int, JobResult] = {}
    snapshot = yield replace(wish, jobs=jobs)
    while True:
        results.update({result.id: result for result in snapshot.sensed.results})
        if all(job.id in results for job in jobs):
            return tuple(results[job.id] for job in jobs), snapshot
        snapshot = yield wish


def fail(wish: Wish, fault: Fault) -> Routine:
    """Report a fault, and stand by with `wish` until the mode changes."""
    yield replace(wish, fault=fault)
    while True:
        yield wish


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


def is_second(plan: Plan, snapshot: Snapshot) -> bool:
    """Another artemis has the drives, and we do not: nothing of ours may reach them."""
    return not plan.connected and any(fault.id == "COM-18" for fault in snapshot.verdict.faults)


def hands_on(inputs: Iterable[OperatorInput]) -> str | None:
    """What a person has to do before every control rests; None: nothing. Of some devices nothing is known at first."""
    held = [sample for sample in inputs if not sample.neutral]
    silent = [sample.source for sample in held if sample.age is None]
    if silent:
        return f"release the controls; {', '.join(silent)} was not heard yet: move it once"
    return "release the controls" if held else None


def secure(plan: Plan, wish: Wish, snapshot: Snapshot) -> Finished:
    """Have every drive stopped and off by jobs, before any process data: traction first, while steering may hold."""
    found: tuple[JobResult, ...] = ()
    snapshot = yield from listen(wish, snapshot)
    for role in ("traction", "steering"):
        if is_second(plan, snapshot):
            break
        drives = plan.drives(role)
        resets = [RESETS[plan.resets.pop(drive, "")] for drive in drives]
        results, snapshot = yield from finish_jobs(
            replace(wish, phase=JobKind.SECURE.value), plan.jobs(JobKind.SECURE, drives, resets)
        )
        found += results
    return found, snapshot


PATIENCE = 600.0
"""After waiting so long for a person the run ends [s] (OPR-03)."""


def give_up(wish: Wish, *, late: bool) -> Wish:
    """`wish`, and the end of the run as failed: nobody came in time (`late`), or nobody is there to come."""
    return replace(wish, event=Event.END, failed=True, fault=catalogue.fault("OPR-03") if late else None)


ROLLING_TIME = 10.0
"""A robot whose traction is off may roll this long before steering lets go, too [s]."""


def come_to_rest(plan: Plan, wish: Wish, snapshot: Snapshot) -> Routine:
    """Yield `wish` until the robot stands; traction is off at the latest after the plan's stop time.

    Steering holds for longer: a robot that rolls without power shall not turn on its own. It ends sooner where a
    driven wheel is not heard any more. What stood a moment ago may just have begun to move: standing counts after a
    while.

    A driven wheel whose drive is deaf would go on as it was told last: it is stopped by SDO. Where that fails, too,
    our heartbeat is withheld, so that every drive stops by itself.
    """
    stop = plan.stop = plan.stop or Stop(snapshot.time)
    while True:
        passed = snapshot.time - stop.begun
        halts = [result for result in snapshot.sensed.results if result.kind is JobKind.HALT]
        stop.heartbeat = stop.heartbeat and all(result.ok for result in halts)
        deaf = [name for name in plan.drives("traction") if _is_deaf(snapshot, name, passed)]
        jobs = plan.jobs(JobKind.HALT, [name for name in deaf if name not in stop.halted])
        stop.halted.update(deaf)
        limit = ROLLING_TIME if _is_heard(plan, snapshot) else plan.stop_time
        if not jobs and (passed >= limit or (snapshot.standing and passed >= STANDING_TIME)):
            plan.stop = None
            return snapshot
        told = wish if passed < plan.stop_time else replace(wish, traction=Goal.DISABLED)
        snapshot = yield replace(told, jobs=jobs, heartbeat=wish.heartbeat and stop.heartbeat)


DEAF = 0.1
"""A drive whose feedback is older than this [s], or that is still enabled so long after it was stopped, is deaf."""


def _is_deaf(snapshot: Snapshot, name: str, passed: float) -> bool:
    """Whether a drive takes no process data, `passed` [s] after the stop began."""
    drive = next(drive for drive in snapshot.sensed.drives if drive.name == name)
    if drive.nmt is not Nmt.OPERATIONAL or drive.age is None or drive.age > DEAF:
        return True
    return drive.state is DriveState.OPERATION_ENABLE and passed >= DEAF


def _is_heard(plan: Plan, snapshot: Snapshot) -> bool:
    """Whether the driven wheels still tell how they roll."""
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
    """All drives enabled; only steering where nobody knows how the wheels stand."""
    return STEERING_ON if plan.blind else ON
