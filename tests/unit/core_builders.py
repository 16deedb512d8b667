"""Values as a healthy robot gives them, a player for modes, and drives that obey at once: for tests of the core."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, ClassVar

import numpy as np
from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Goal, Nmt
from artemis.errors import DeviceLost
from artemis.motion.ackermann import Ackermann
from artemis.motion.path import Path, path_from_points
from artemis.motion.route import Part, Route
from artemis.plugins.contracts import Following
from artemis.progress import Position
from artemis.states.mode import ModeLogic
from artemis.states.plan import Plan, Shared, Step, TeleopStep
from artemis.supervision import catalogue
from artemis.values import (
    Action,
    DriveCommand,
    DriveFeedback,
    Event,
    Job,
    JobKind,
    JobResult,
    LocatedPose,
    Odometry,
    Sensed,
    SetPoints,
    Snapshot,
    Tracking,
    Verdict,
    Wish,
)
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

ROBOT = RobotFile.model_validate(load(FilePath(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").data)
PERIOD = 0.02
TRACTION, STEERING = ("traction-left", "traction-right"), ("steer-left", "steer-right")
NAMES = (*TRACTION, *STEERING)
STRAIGHT_VOLTS = {"steer-left": (2.51, 2.48), "steer-right": (2.49, 2.52)}
LOST_HEARTBEAT = 0x8130
WATCH = 10
"""Ticks without our heartbeat after which a drive misses it."""
PATH = path_from_points(np.linspace(0.0, 4.0, 9), np.zeros(9))
ROUTE = Route((Part(path=PATH),))


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
    odometry: Odometry | None = None,
    pose: LocatedPose | None = None,
    battery: BatteryState | None = None,
    **changes: Any,
) -> Snapshot:
    """A snapshot of a healthy robot, located by its odometry; `changes` are those of what was sensed."""
    odometry = odometry or Odometry()
    return Snapshot(
        sensed=sensed(time, **changes),
        dt=PERIOD,
        pose=pose or LocatedPose(pose=odometry.pose, lost=odometry.lost),
        odometry=odometry,
        standing=standing,
        set_points=set_points or SetPoints(),
        verdict=verdict or Verdict(),
        battery=battery,
    )


def judged(*ids: str, device: str = "", **says: Any) -> Verdict:
    """The verdict on faults of the catalogue; `says` what follows."""
    faults = tuple(catalogue.fault(id, device) for id in ids)
    to_fault = any(fault.to_fault for fault in faults)
    return Verdict(severity=max(fault.severity for fault in faults), faults=faults, to_fault=to_fault, **says)


def verdict(id: str, device: str = "") -> Verdict:
    """The verdict on one fault of the catalogue."""
    return judged(id, device=device)


def shared(*steps: Step, done: float = 0.0, **state: Any) -> Shared:
    """What modes share in a run with these steps, of whose first so much is done; `state` is that of the bring-up.

    The controls were at rest when the step began.
    """
    made = Shared(Plan(robot=ROBOT, steps=steps, begin=Position(done=done)))
    made.hands.released = frozenset(name for step in steps if isinstance(step, TeleopStep) for name in step.inputs)
    for name, value in state.items():
        setattr(made.bring_up, name, value)
    return made


class ObedientDrives:
    """Drives that do at once what a wish asks for, with wheels that stand and roll as the set-points say.

    Those that are `unresponsive` do not notice a lost heartbeat, `lazy` ones change no state; `changes` is what a drive
    says instead of the truth.
    """

    def __init__(self, state: DriveState = DriveState.SWITCH_ON_DISABLED) -> None:
        self.states = dict.fromkeys(NAMES, state)
        self.angles = {"steer-left": math.radians(7.0), "steer-right": math.radians(-4.0)}
        self.distances = dict.fromkeys(TRACTION, 0.0)
        self.changes: dict[str, dict[str, Any]] = {name: {} for name in NAMES}
        self.unresponsive: set[str] = set()
        self.lazy: set[str] = set()
        self._beats_missed = dict.fromkeys(NAMES, -math.inf)

    def react(self, wish: Wish, points: SetPoints) -> tuple[DriveFeedback, ...]:
        """Feedback after a tick with this wish and these set-points."""
        return tuple(self._react(name, wish, points) for name in NAMES)

    def _react(self, name: str, wish: Wish, points: SetPoints) -> DriveFeedback:
        emergencies: tuple[int, ...] = ()
        if wish.exchange and name not in self.lazy:
            self.states[name] = _next(self.states[name], wish.traction if name in TRACTION else wish.steering)
        self._beats_missed[name] = 0.0 if wish.heartbeat else self._beats_missed[name] + 1.0
        if self._beats_missed[name] == WATCH and wish.exchange and name not in self.unresponsive:
            self.states[name], emergencies = DriveState.FAULT, (LOST_HEARTBEAT,)
        said: dict[str, Any] = {"state": self.states[name], "emergencies": emergencies}
        side = ROBOT.drives[name].side
        obeys = self.states[name] is DriveState.OPERATION_ENABLE and wish.exchange
        if name in STEERING:
            if obeys:
                self.angles[name] = points.steering_left if side == "left" else points.steering_right
            said["position"] = self.angles[name]
            said["potentiometers"] = volts(side, self.angles[name])
        else:
            if obeys:
                self.distances[name] += PERIOD * (points.speed_left if side == "left" else points.speed_right)
            said["position"] = self.distances[name]
        return drive(name, **{**said, **self.changes[name]})


def volts(side: str, angle: float) -> tuple[float, float]:
    """What both potentiometers of a wheel show when it stands at `angle` [rad]."""
    calibration = ROBOT.potentiometers(side)
    first, second = (
        zero + math.degrees(angle) / slope
        for zero, slope in zip(calibration.zero_v, calibration.slope_deg_per_v, strict=True)
    )
    return first, second


def points_from(wish: Wish, last: SetPoints) -> SetPoints:
    """What a gate without limits makes of a wish."""
    if wish.command.action is not Action.RUN:
        return last
    left, right = Ackermann(ROBOT.geometry).wheel_angles(wish.command.steering)
    command = wish.command
    return SetPoints(speed=command.speed, steering=command.steering, steering_left=left, steering_right=right)


def _next(state: DriveState, goal: Goal) -> DriveState:
    if state is DriveState.FAULT and goal is not Goal.FAULT_RESET:
        return state
    if goal is Goal.HOLD:
        return state
    if goal is Goal.QUICK_STOPPED:
        on = state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE)
        return DriveState.QUICK_STOP_ACTIVE if on else DriveState.SWITCH_ON_DISABLED
    return DriveState.OPERATION_ENABLE if goal is Goal.ENABLED else DriveState.SWITCH_ON_DISABLED


React = Callable[[Wish, SetPoints], tuple[DriveFeedback, ...]]
"""Feedback after a tick with this wish and these set-points."""


class Player:
    """Plays one mode tick by tick. Jobs end in the next tick, well but for those in `refused`: (kind, drive)."""

    def __init__(self, mode: ModeLogic, react: React | None = None) -> None:
        self.mode = mode
        self.time = 0.0
        self.wishes: list[Wish] = []
        self.refused: set[tuple[JobKind, str]] = set()
        self.world: dict[str, Any] = {}
        self._react: React = react or (lambda wish, points: drives())
        self._points = SetPoints()
        self._wish = Wish(exchange=False, heartbeat=False)
        self._results: tuple[JobResult, ...] = ()
        self._entered = False

    @property
    def jobs(self) -> list[Job]:
        """Every job so far."""
        return [job for wish in self.wishes for job in wish.jobs]

    def tick(self, **once: Any) -> Wish:
        """One tick; `once` changes the snapshot of this one, `world` that of all."""
        values = {"drives": self._react(self._wish, self._points), "results": self._results, **self.world, **once}
        seen = snapshot(self.time, **{"set_points": self._points, **values})
        if not self._entered:
            self.enter(seen)
        shared = self.mode.shared
        shared.hands.see(seen)
        self._wish = self.mode.step(seen)
        shared.advance(self._wish, seen, standing=True)
        self._points = points_from(self._wish, self._points)
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
        detail, fault = ("", "") if ok else ("broken in the test", "COM-08")
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=ok, detail=detail, fault=fault)


def powered(wish: Wish) -> bool:
    """Something is to be enabled."""
    return wish.exchange and Goal.ENABLED in (wish.traction, wish.steering)


def has_fault(wish: Wish) -> bool:
    return wish.fault is not None


def has_event(wish: Wish) -> bool:
    return wish.event is not None


def expires(player: Player) -> None:
    """Nobody comes for ten minutes: the run ends as failed."""
    assert player.tick().event is None
    player.time += 590.0
    assert player.tick().event is None
    player.time += 11.0
    wish = player.tick()
    assert wish.event is Event.END
    assert fault_of(wish) == ("OPR-03", "")
    assert wish.failed


def fault_of(wish: Wish) -> tuple[str, str]:
    """Id and device of the fault that is wished."""
    assert wish.fault is not None
    return wish.fault.id, wish.fault.device


class StubFollower:
    """Answers what the test says, and counts."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, answer: Callable[[], Any] | None = None) -> None:
        self.starts = self.steps = 0
        self.answer = answer or following

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self.starts += 1

    def step(self, snapshot: Snapshot) -> Following:
        self.steps += 1
        answer: Following = self.answer()
        return answer


def following(
    *, cross_track: float = 0.0, arc_length: float = 0.0, heading_error: float = 0.0, finished: bool = False
) -> Following:
    tracking = Tracking(arc_length=arc_length, length=4.0, cross_track=cross_track, heading_error=heading_error)
    return Following(command=DriveCommand(speed=0.3, steering=0.1), tracking=tracking, finished=finished)


class FakeBus:
    """Keeps what was sent; gives out what a test put in."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []
        self.arrived: list[Frame] = []
        self.lost = False
        self.error_frames = 0
        self.wake: Callable[[], None] = lambda: None
        self.clock: Callable[[], float] = lambda: 0.0

    def send(self, frame: Frame) -> None:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        self.sent.append(replace(frame, time=self.clock()))

    def receive(self) -> list[Frame]:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        arrived, self.arrived = self.arrived, []
        return arrived

    def listen(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def close(self) -> None: ...

    def take(self) -> list[Frame]:
        sent, self.sent = self.sent, []
        return sent
