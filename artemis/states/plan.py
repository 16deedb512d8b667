"""What a run is to do, step by step, and what its modes share while it does it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field

from msgspec import Struct
from msgspec.structs import replace

from artemis.motion.route import Route
from artemis.motion.steering_fit import SteeringFit
from artemis.motion.track import Track
from artemis.plugins.contracts import Follower
from artemis.supervision.policy import Policies
from artemis.values import Job, JobKind, Pose, Position, Wish
from artemis.vehicle import RobotFile


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
    enabled_by: str = "the enable button"
    """What a person holds to drive, as messages name it."""


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
class DriveStop:
    """A stop by the drives under way. A mode that begins it anew goes on with it: its time does not begin again."""

    begun: float
    halted: set[str] = field(default_factory=set)
    """Driven wheels whose drives were to be stopped by SDO."""
    heartbeat: bool = True
    """False: one of them could not be, so our silence has to stop it."""


class Plan(Struct, frozen=True, kw_only=True):
    """What a run is to do; it never changes."""

    robot: RobotFile
    steps: tuple[Step, ...]
    policies: Policies = {}
    """What the mission says about single faults."""
    found: Mapping[str, float] | None = None
    """The potentiometers are new and say nothing: angles of the wheels as they are found [rad], by side if known."""
    begin: Position = Position()
    """Where the run begins in it; other than the first step only where an earlier run is gone on with."""
    start: Pose | None = None
    """Where the odometry begins, likewise; None: where the wheels are aligned first."""
    localized: bool = False
    """A localizer tells where the robot is."""
    tracks: Mapping[str, Track] = {}
    """What the earlier run has recorded, by name."""

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


@dataclass(slots=True, kw_only=True)
class BringUp:
    """How far the drives are brought up, and what has to come before they may be: the modes' memory of it."""

    armed: bool = True
    """The next bring-up may go on to enable the drives: starting the run is the first arm, then each takes its own."""
    connected: bool = False
    """The drives have our configuration: process data may be exchanged."""
    proving: bool = False
    """Our heartbeat is withheld, or was: the drives may miss it at any moment."""
    aligned: bool = False
    """The wheels were aligned since the drives were last brought up."""
    placed: bool = False
    """The odometry has its origin: where the wheels were aligned first."""
    held: bool = False
    """A person stopped the robot, or a fault that may not go on by itself: nothing but a person's arm lets it go on."""
    taken: bool = False
    """Wheels with new potentiometers were taken as they were found: from then on they may have been turned."""
    stop: DriveStop | None = None
    """None: no stop by the drives is under way."""
    resets: dict[str, str] = field(default_factory=dict)
    """NMT reset that a drive needs before it is brought up again: `communication` or `node`."""
    _ids: itertools.count[int] = field(default_factory=lambda: itertools.count(1))

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


@dataclass(slots=True, kw_only=True)
class Results:
    """What a run leaves behind."""

    tracks: dict[str, Track] = field(default_factory=dict)
    """What was recorded, by name."""
    steering: dict[str, SteeringFit] = field(default_factory=dict)
    """What was measured of the potentiometers, by side."""
    kept: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """What the drives' memories were given in this run, by drive."""
    tried: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Gains that drives were given for this run only, by drive; at its end they get the robot file's again."""


class Shared:
    """What the modes of a run share. `Modes` alone moves the position, as their wishes say."""

    def __init__(self, plan: Plan) -> None:
        """As a run of the plan begins."""
        self.plan, self.position = plan, plan.begin
        self.bring_up = BringUp(placed=plan.start is not None)
        self.results = Results(tracks=deepcopy(dict(plan.tracks)))

    @property
    def current(self) -> Step | None:
        """The step to do now; None after the last."""
        steps, number = self.plan.steps, self.position.step
        return steps[number] if number < len(steps) else None

    @property
    def top_speed(self) -> float:
        """What the way to stop was checked for, of the current step: speed of the virtual front wheel [m/s]."""
        step = self.current
        told = step.speed if isinstance(step, FollowStep | TeleopStep) else None
        return self.plan.robot.limits.speed_m_s if told is None else told


def advance(position: Position, wish: Wish) -> Position:
    """Where the mission is after a tick in which the mode wished this."""
    if wish.over:
        return Position(step=position.step + 1)
    return position if wish.done is None else Position(step=position.step, done=wish.done)
