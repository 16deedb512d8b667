"""Values as a healthy robot would give them, a player for modes, and drives that obey at once: for tests of the core."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from artemis.states.mode import ModeLogic, Plan, Step
from artemis.supervision import catalogue
from artemis.values import (
    DriveFeedback,
    DriveState,
    Goal,
    Job,
    JobKind,
    JobResult,
    Nmt,
    Odometry,
    Sensed,
    SetPoints,
    Snapshot,
    Verdict,
    Wish,
)
from artemis.vehicle import Robot
from artemis.yaml_file import load

ROBOT = Robot.model_validate(load(Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").data)
PERIOD = 0.02
TRACTION, STEERING = ("traction-left", "traction-right"), ("steer-left", "steer-right")
NAMES = (*TRACTION, *STEERING)
STRAIGHT_VOLTS = {"steer-left": (2.51, 2.48), "steer-right": (2.49, 2.52)}
LOST_HEARTBEAT = 0x8130


def drive(name: str, **changes: Any) -> DriveFeedback:
    """A drive that is enabled, well, and just heard."""
    healthy = DriveFeedback(
        name=name,
        state=DriveState.OPERATION_ENABLE,
        statusword=0x0337,
        mode=-1 if name in STEERING else 3,
        potentiometers=STRAIGHT_VOLTS.get(name, (0.0, 0.0)),
        age=0.02,
        nmt=Nmt.OPERATIONAL,
        heartbeat_age=0.05,
    )
    return replace(healthy, **changes)


def drives(*different: DriveFeedback, **changes: Any) -> tuple[DriveFeedback, ...]:
    """All four drives, with the same changes; `different` ones replace those of their name."""
    instead = {feedback.name: feedback for feedback in different}
    return tuple(instead.get(name) or drive(name, **changes) for name in NAMES)


def sensed(time: float = 0.0, **changes: Any) -> Sensed:
    return replace(Sensed(index=round(time / PERIOD), time=time, attended=True, drives=drives()), **changes)


def snapshot(
    time: float = 0.0,
    *,
    standing: bool = True,
    verdict: Verdict | None = None,
    set_points: SetPoints | None = None,
    **changes: Any,
) -> Snapshot:
    """A snapshot of a healthy robot; `changes` are those of what was sensed."""
    return Snapshot(
        sensed=sensed(time, **changes),
        dt=PERIOD,
        odometry=Odometry(),
        standing=standing,
        set_points=set_points or SetPoints(),
        verdict=verdict or Verdict(),
    )


def verdict(id: str, device: str = "") -> Verdict:
    """The verdict on one fault of the catalogue."""
    fault = catalogue.fault(id, device)
    return Verdict(severity=fault.severity, faults=(fault,), to_fault=fault.to_fault)


def plan(*steps: Step, **state: Any) -> Plan:
    return Plan(robot=ROBOT, steps=steps, **state)


class ObedientDrives:
    """Drives that do at once what a wish asks for; some are deaf to a lost heartbeat, some states are stuck."""

    def __init__(self, state: DriveState = DriveState.SWITCH_ON_DISABLED) -> None:
        self.states = dict.fromkeys(NAMES, state)
        self.angles = dict.fromkeys(STEERING, 0.0)
        self.changes: dict[str, dict[str, Any]] = {name: {} for name in NAMES}
        self.deaf: set[str] = set()
        self.lazy: set[str] = set()
        self._heard = dict.fromkeys(NAMES, False)

    def react(self, wish: Wish) -> tuple[DriveFeedback, ...]:
        """Feedback after a tick with this wish."""
        return tuple(self._react(name, wish) for name in NAMES)

    def _react(self, name: str, wish: Wish) -> DriveFeedback:
        emergencies: tuple[int, ...] = ()
        if wish.exchange and name not in self.lazy:
            self.states[name] = _next(self.states[name], wish.traction if name in TRACTION else wish.steering)
        if wish.heartbeat:
            self._heard[name] = True
        elif self._heard[name] and wish.exchange and name not in self.deaf:
            self._heard[name] = False
            self.states[name], emergencies = DriveState.FAULT, (LOST_HEARTBEAT,)
        if name in STEERING and self.states[name] is DriveState.OPERATION_ENABLE:
            self.angles[name] = wish.command.steering
        angle = self.angles.get(name, 0.0)
        feedback = drive(name, state=self.states[name], emergencies=emergencies, position=angle)
        return replace(feedback, **self.changes[name])


def _next(state: DriveState, goal: Goal) -> DriveState:
    if state is DriveState.FAULT and goal is not Goal.FAULT_RESET:
        return state
    if goal is Goal.HOLD:
        return state
    if goal is Goal.QUICK_STOPPED:
        on = state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE)
        return DriveState.QUICK_STOP_ACTIVE if on else DriveState.SWITCH_ON_DISABLED
    return DriveState.OPERATION_ENABLE if goal is Goal.ENABLED else DriveState.SWITCH_ON_DISABLED


class Player:
    """Plays one mode tick by tick. Jobs end in the next tick, well but for those in `refused`: (kind, drive)."""

    def __init__(self, mode: ModeLogic, react: Callable[[Wish], tuple[DriveFeedback, ...]] | None = None) -> None:
        self.mode = mode
        self.time = 0.0
        self.wishes: list[Wish] = []
        self.refused: set[tuple[JobKind, str]] = set()
        self.world: dict[str, Any] = {}
        self._react = react or (lambda wish: drives())
        self._wish = Wish(exchange=False, heartbeat=False)
        self._results: tuple[JobResult, ...] = ()
        self._entered = False

    @property
    def jobs(self) -> list[Job]:
        """Every job so far."""
        return [job for wish in self.wishes for job in wish.jobs]

    def tick(self, **once: Any) -> Wish:
        """One tick; `once` changes the snapshot of this one, `world` that of all."""
        values = {"drives": self._react(self._wish), "results": self._results, **self.world, **once}
        seen = snapshot(self.time, **values)
        if not self._entered:
            self.enter(seen)
        self._wish = self.mode.step(seen)
        self._results = tuple(map(self._perform, self._wish.jobs))
        self.wishes.append(self._wish)
        self.time += PERIOD
        return self._wish

    def enter(self, seen: Snapshot | None = None) -> None:
        self.mode.enter(seen or snapshot(self.time, **self.world))
        self._entered = True

    def until(self, done: Callable[[Wish], bool], *, longest: float = 20.0) -> Wish:
        """Tick until a wish is as wanted."""
        latest = self.time + longest
        while self.time < latest:
            if done(wish := self.tick()):
                return wish
        raise AssertionError(f"never happened in {longest} s; last: {self._wish}")

    def _perform(self, job: Job) -> JobResult:
        ok = (job.kind, job.drive) not in self.refused
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=ok, detail="" if ok else "broken in the test")
