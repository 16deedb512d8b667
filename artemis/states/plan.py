"""What a run is to do, step by step, and what its modes share while it does it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import chain, count

from msgspec import Struct
from msgspec.structs import replace

from artemis.motion.route import Route
from artemis.motion.steering_fit import SteeringFit, SteeringZero
from artemis.motion.track import Track
from artemis.plugins.contracts import Behaviour, Declared, Follower
from artemis.progress import DONE, Acted, MissionEvent, Position
from artemis.scan import ObstacleRules
from artemis.states.advance import MissionFacts, Passive, advance, told_after
from artemis.states.answers import answers_to
from artemis.states.condition import asks_battery
from artemis.states.hands import OperatorHands
from artemis.states.route_progress import RouteProgress
from artemis.states.tree import Tree, fault_names, list_of
from artemis.supervision.catalogue import ROWS
from artemis.supervision.policy import Policies
from artemis.values import Fault, Job, JobKind, Pose, Request, Snapshot, Wish
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
    """A text: the path that was recorded under this name in an earlier step; a job fits it, by the step's number."""
    follower: Follower
    laps: int = 1
    """Of a path that is recorded first, like the next two; another one has its own."""
    from_end: bool = False
    """From its last point to its first."""
    backward: bool | None = None
    """Begin with the rear ahead, or not; None: as it was driven."""
    nearest: bool = False
    """Begin at the point of the path that is nearest to the robot."""
    max_cross_track: float = 0.6
    speed: float | None = None
    """Of the virtual front wheel [m/s], where the follower says: it drives no faster, and not for ever (PTH-08)."""
    obstacles: ObstacleRules | None = None
    """None: as in the mission."""


class GotoStep(FollowStep, frozen=True, kw_only=True):
    """Follow a route to a place on a map; a job plans it, by the step's number, while the robot stands."""

    place: str
    """For people."""
    asks: str = ""  # the input that gives the goal while the step runs; empty: the planner knows it
    replans: int = 3
    """So often another route is planned where an obstacle stands on the present one."""


class TeleopStep(Struct, frozen=True, kw_only=True):
    """Drive by hand until the input says done or the time is over (`seconds` None: no limit)."""

    input: str
    lower: tuple[str, ...] = ()
    """Other inputs, by falling priority: each drives only while none before it is active."""
    seconds: float | None
    speed: float | None = None
    """Of the virtual front wheel [m/s], where every input says: the fastest drives no faster."""
    record: str = ""
    """Name of the path that is recorded; none: nothing is."""
    enabled_by: str = "the enable button"
    """What a person holds to drive, as messages name it."""
    stale: tuple[float, ...] = ()
    """Until its samples are so old each input is heard [s]; empty: all until they are as old as those of a device."""
    obstacles: ObstacleRules | None = None
    """None: as in the mission."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """All its inputs, the one of the highest priority first."""
        return self.input, *self.lower


class WaitStep(Passive, frozen=True, kw_only=True):
    """Stand still for a time, or until a condition holds."""


class AskStep(Passive, frozen=True, kw_only=True):
    """Stand still until an operator answers."""

    question: str


class BehaviourStep(Struct, frozen=True, kw_only=True):
    """What a behaviour plugin does, until it ends."""

    name: str
    """Of the plugin."""
    behaviour: Behaviour
    declared: Declared
    speed: float | None = None
    """Of the virtual front wheel [m/s], where its keys say: it drives no faster."""


Step = CalibrateStep | FollowStep | TeleopStep | WaitStep | AskStep | BehaviourStep


def with_followers(steps: Iterable[Step], change: Callable[[Follower], Follower]) -> tuple[Step, ...]:
    """The steps, each follower as `change` makes it."""
    return tuple(
        replace(step, follower=change(step.follower)) if isinstance(step, FollowStep) else step for step in steps
    )


def with_behaviours(steps: Iterable[Step], change: Callable[[str, Behaviour], Behaviour]) -> tuple[Step, ...]:
    """The steps, each behaviour as `change` makes it."""
    return tuple(
        replace(step, behaviour=change(step.name, step.behaviour)) if isinstance(step, BehaviourStep) else step
        for step in steps
    )


@dataclass(slots=True)
class DriveStop:
    """A stop by the drives under way. A mode that begins it anew continues it: its time does not begin again."""

    begun: float
    ramp: float
    """So long [s] the drives may turn a wheel: one that is blocked stands, and rolls where it comes free."""
    halted: set[str] = field(default_factory=set)
    """Driven wheels whose drives were to be stopped by SDO."""
    heartbeat: bool = True
    """False: one of them could not be, so our silence has to stop it."""


class Plan(Struct, frozen=True, kw_only=True):
    """What a run is to do; it never changes."""

    robot: RobotFile
    steps: tuple[Step, ...]
    """Those that take time, by their numbers."""
    tree: Tree | None = None
    """How the mission composes them; None: one after the other."""
    policies: Policies = {}
    """What the mission says about single faults."""
    found: Mapping[str, float] | None = None
    """The potentiometers are new and say nothing: angles of the wheels as they are found [rad], by side if known."""
    begin: Position = Position()
    """Where the run begins in it; other than the first step only where an earlier run is resumed."""
    start: Pose | None = None
    """Where the odometry begins, likewise; None: where the wheels are aligned first."""
    localized: bool = False
    """A localizer reports where the robot is."""
    obstacles: ObstacleRules = ObstacleRules()
    """In steps that have no rules of their own."""
    tracks: Mapping[str, Track] = {}
    """What the earlier run has recorded, by name."""
    armed: bool = True
    """Its start is the first arm; False: an operator arms before the drives are enabled."""

    @property
    def stop_time(self) -> float:
        """Longest time that is given to a stop before the drives are switched off all the same [s]."""
        return 1.0 + 2.0 * self.robot.limits.speed_m_s / self.robot.limits.quick_stop_deceleration_m_s2

    @property
    def blind(self) -> bool:
        """Nobody knows what the potentiometers say: traction stays off."""
        return self.found is not None

    @property
    def rules(self) -> tuple[ObstacleRules, ...]:
        """All that hold for obstacles in any of its steps."""
        own = [step.obstacles for step in self.steps if isinstance(step, FollowStep | TeleopStep)]
        return self.obstacles, *[each for each in own if each is not None]

    @property
    def needs_scanners(self) -> bool:
        """The robot stops where a scanner of its fails: one of its steps is driven by what that sees."""
        return any([rules.mode != "off" for rules in self.rules])

    @property
    def spare(self) -> frozenset[str]:
        """Inputs that are never the first of a step: the loss of one that is not needed is only a warning."""
        steps = [step for step in self.steps if isinstance(step, TeleopStep)]
        return frozenset(name for step in steps for name in step.lower) - {step.input for step in steps}

    def length_of(self, step: int) -> float | None:
        """Of the path that a step follows [m]; 0: it has none, or it is made only when the step begins.

        None: the battery may be charged in it, by a person or a behaviour, or while it waits for a charged battery.
        """
        found = self.steps[step]
        if isinstance(found, AskStep | TeleopStep | BehaviourStep):
            return None
        if isinstance(found, WaitStep) and asks_battery(found.condition):
            return None
        return found.route.length if isinstance(found, FollowStep) and isinstance(found.route, Route) else 0.0

    def drives(self, role: str | None = None) -> list[str]:
        """Names of all drives, or of those with `role`."""
        return [name for name, drive in self.robot.drives.items() if role in (None, drive.role)]


@dataclass(slots=True, kw_only=True)
class BringUp:
    """How far the drives are brought up, and what has to come before they may be: the modes' memory of it."""

    armed: bool = True
    """The next bring-up may enable the drives: at first as the plan says, then after an arm each."""
    connected: bool = False
    """The drives have our configuration: process data may be exchanged."""
    proving: bool = False
    """First contact and the proof of the watchdogs: what drives do not report yet, or miss, is no fault of theirs."""
    aligned: bool = False
    """The wheels were aligned since the drives were last brought up."""
    placed: bool = False
    """The odometry has its origin: where the wheels were aligned first."""
    held: bool = False
    """A person stopped the robot, or a fault that may not end by itself: it continues only when a person arms."""
    taken: bool = False
    """Wheels with new potentiometers were taken as they were found: from then on they may have been turned."""
    stop: DriveStop | None = None
    """None: no stop by the drives is under way."""
    resets: dict[str, str] = field(default_factory=dict)
    """NMT reset that a drive needs before it is brought up again: `communication` or `node`."""
    _ids: count[int] = field(default_factory=lambda: count(1))

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
    zeros: dict[str, SteeringZero] = field(default_factory=dict)  # of what else finds the angle, likewise
    kept: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """What the drives' memories were given in this run, by drive."""
    tried: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Gains that drives were given for this run only, by drive; at its end they get the robot file's again."""


class Shared:
    """What the modes of a run share. `Modes` alone moves the position, as their wishes say."""

    def __init__(self, plan: Plan) -> None:
        """As a run of the plan begins."""
        self.plan, self.position = plan, plan.begin
        self.spare = plan.spare
        by_hand = [step.inputs for step in plan.steps if isinstance(step, TeleopStep)]
        self.hands = OperatorHands(chain.from_iterable(by_hand), plan.spare)
        self.needed: tuple[str, ...] = ()
        """Inputs that have to be heard now, in mode teleop: the one that has the robot, and those before it."""
        self.bring_up = BringUp(armed=plan.armed, held=not plan.armed, placed=plan.start is not None)
        self.results = Results(tracks=deepcopy(dict(plan.tracks)))
        self.tree = plan.tree or list_of(
            step.declared.signals if isinstance(step, BehaviourStep) else () for step in plan.steps
        )
        self.entry = 0
        """How many steps have begun, or were resumed after another one: a mode sees that its step is a new one."""
        self.rests = False  # the present step is to come to rest, for something else is next
        self.route = RouteProgress(self._goto_state)  # of the present step, if its path is made by jobs
        self.beside: Mapping[int, str] = {}
        """Steps that run beside the present one, each with the state of its behaviour (JSON; empty: it begins)."""
        self._passive = [step if isinstance(step, Passive) else None for step in plan.steps]

    @property
    def current(self) -> Step | None:
        """The step to do now; None after the last."""
        steps, number = self.plan.steps, self.position.step
        return steps[number] if number < len(steps) else None

    @property
    def top_speed(self) -> float:
        """What the way to stop was checked for, of the current step: speed of the virtual front wheel [m/s]."""
        step = self.current
        told = step.speed if isinstance(step, FollowStep | TeleopStep | BehaviourStep) else None
        return self.plan.robot.limits.speed_m_s if told is None else told

    @property
    def rules(self) -> ObstacleRules:
        """What holds for obstacles now."""
        step = self.current
        own = step.obstacles if isinstance(step, FollowStep | TeleopStep) else None
        return self.plan.obstacles if own is None else own

    @property
    def _goto_state(self) -> str:
        return self.position.state if isinstance(self.current, GotoStep) else ""

    def note_faults(self, faults: Iterable[Fault]) -> None:
        """These stop the robot in its step: they are reported to the mission once it may continue."""
        known = self.position.faults
        named = [fault.id for fault in faults if self.tree.faults.intersection(fault_names(fault.id))]
        if not set(named).issubset(known):
            ids = sorted(dict.fromkeys((*known, *named)), key=lambda id: -ROWS[id].severity)
            self.position = replace(self.position, faults=tuple(ids))

    def advance(self, wish: Wish, snapshot: Snapshot, *, standing: bool) -> tuple[MissionEvent, ...]:
        """Move the position after a tick in which the mission ran; what happened in it."""
        position, self.beside = self.position, {}
        if position.step >= self.tree.size:
            return ()
        sensed = snapshot.sensed
        given = sensed.answers or sensed.typed
        answers, over = answers_to(position.step, wish.done, sensed) if given else ((), ())
        acted = {told.step: told for told in wish.acted}
        if isinstance(self.current, GotoStep) and self.route.state != position.state:
            acted[position.step] = Acted(step=position.step, state=self.route.state)
        if self.tree.is_list and not (wish.over or wish.outcome or self._passive[position.step]):
            if acted:
                told = told_after(position, acted)
                position = replace(position, state=acted[position.step].state, told=told)
            self.position = position if wish.done is None else replace(position, done=wish.done)
            return over
        outcome = wish.outcome or (DONE if wish.over else "")
        facts = MissionFacts(
            signals=self._signals(snapshot),
            dt=snapshot.dt,
            standing=standing,
            done=wish.done,
            outcome=outcome,
            answers=answers,
            acted=acted,
        )
        advanced = advance(self.tree, self._passive, position, facts)
        self.position, self.rests, self.beside = advanced.position, advanced.rests, advanced.beside
        self.entry += advanced.begun
        if advanced.begun:
            self.route = RouteProgress(self._goto_state)
        return (*over, *advanced.events)

    def _signals(self, snapshot: Snapshot) -> dict[str, float | str | bool]:
        sensed, position = snapshot.sensed, self.position
        signals: dict[str, float | str | bool] = {
            "run_s": position.time + sensed.time,
            "driven_m": position.driven + snapshot.odometry.driven,
        }
        if sensed.battery_v is not None:
            signals["battery_v"] = sensed.battery_v
        if (battery := snapshot.battery) is not None:
            charge = 100.0 * battery.charge
            signals |= {"charge_percent": charge, "range_m": battery.range_m, "time_left_s": battery.time_left_s}
        for sample in sensed.inputs:
            if sample.requests:
                signals[f"{sample.source}.done"] = Request.DONE in sample.requests
                signals[f"{sample.source}.record"] = Request.RECORD in sample.requests
        return signals
