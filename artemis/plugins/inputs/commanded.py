"""What `ros1`, `ros2` and `rosbridge` share: commands become an operator's wish, a stop is obeyed, poses are passed on.

Messages arrive in another thread, and are taken by the next tick; how old they are counts from their arrival. Where
the last command was to stand, silence is rest; where it was to drive, silence is a stop (INP-03). Of what waited while
the run was held up only a stop has an effect.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, ClassVar, Literal, Protocol, Self

from pydantic import Field, model_validator

from artemis.bridges.commands import Command
from artemis.bridges.poses import GOAL_POSE, INITIAL_POSE, POSE_TYPES
from artemis.bridges.received import LATE, REQUESTS, Asked, CommandRules, Mailbox, Problem, Received
from artemis.bridges.ros1.settings import GraphName
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.values import OperatorInput, Request, Tick
from artemis.vehicle import WishedSpeed

FIND = 3.0
"""A network that never answered is missed after this time [s]."""
HELD = 0.15
"""A publisher that drives keeps others out until it was silent for so long [s]; so long an enable counts, and what is
asked for may have waited."""
FORGOTTEN = 0.5
"""A command that nothing followed for so long is one no more [s]: what held the enable button has let go of it."""
_NAMES = {request: name for name, request in REQUESTS.items()}


class CommandKeys(Config):
    """Keys of an input that is commanded.

    Its speeds are those of the rear axle's centre, its angles those of the virtual front wheel.
    """

    type: str
    """What the commands are."""
    topic: str | None = None
    """Of the commands; if left out: cmd_vel, or ackermann_cmd."""
    angular_is: Literal["velocity", "steering_angle"] | None = None
    """What angular.z of a Twist is. velocity (the default): the angle follows from it and the speed; at speed 0 the
    robot stands, and its wheels are held. steering_angle [rad]: that of the virtual front wheel."""
    enabled_by: Literal["topic", "command"] = "topic"
    """topic: true on the topic `enable` (std_msgs/Bool), ten times a second or more. command: any command that is
    not to stand counts as an enable button that is held, as long as it is fresh."""
    allow: Annotated[
        tuple[Literal["acknowledge", "arm", "end", "done", "goal_pose", "initialpose"], ...], Field(strict=False)
    ] = ()
    """What may be asked for besides `stop`. With acknowledge and arm an operator counts as present in the run.
    goal_pose: where a step `goto: {to: {from_input: NAME}}` drives; initialpose: about where the robot is, for the
    localizer."""
    max_speed_m_s: WishedSpeed | None = None
    """Faster commands are cut to this speed of the virtual front wheel; None: the robot's limit."""

    @property
    def commands(self) -> str:
        """The topic of the commands, as the mission or the default names it."""
        return self.topic or ("cmd_vel" if "Twist" in self.type else "ackermann_cmd")

    @property
    def enable(self) -> str:
        """What is held to drive."""
        return "the topic enable at true" if self.enabled_by == "topic" else "a command to move"

    @property
    def requests(self) -> tuple[str, ...]:
        """What may be asked for that has no content."""
        return ("stop", *(name for name in self.allow if name in REQUESTS))

    @model_validator(mode="after")
    def _angle(self) -> Self:
        if self.angular_is is not None and "Twist" not in self.type:
            raise ValueError(f"angular_is: {self.type} has a steering angle; leave the key out")
        return self


class Ros1CommandKeys(CommandKeys):
    """Of one whose types and topics are named as in ROS 1."""

    type: Literal[
        "geometry_msgs/Twist",
        "geometry_msgs/TwistStamped",
        "ackermann_msgs/AckermannDrive",
        "ackermann_msgs/AckermannDriveStamped",
    ] = "geometry_msgs/Twist"
    """What the commands are."""
    topic: GraphName | None = None
    """Of the commands; if left out: cmd_vel, or ackermann_cmd."""


class NodeKeys(Protocol):
    """Of an input that is commanded, and a node."""

    @property
    def commands(self) -> str:
        """Its topic."""

    @property
    def node(self) -> str | None:
        """Its name; None: that of the input."""


def may_share(one: NodeKeys, other: NodeKeys, _files: Mapping[str, bytes]) -> bool:
    """Whether both hear one topic, or are one node."""
    return one.commands == other.commands or (one.node is not None and one.node == other.node)


class CommandedInput(ABC):
    """An input that is commanded. Nothing is opened before the first tick."""

    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True
    live: bool = True

    def __init__(self, config: CommandKeys, context: PluginContext, clock: Callable[[], float] = stopwatch) -> None:
        """Take the robot.

        Args:
            config: The mission's keys.
            context: Of the run.
            clock: Of arrivals [s].

        Raises:
            ConfigError: more speed than the robot has.
        """
        self._top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._limit = math.radians(context.robot.limits.steering_deg)
        self._keys, self._name, self._ignored, self._clock = config, context.name, context.ignored, clock
        self.live = {"acknowledge", "arm"} <= set(config.allow)
        package, *_, kind = config.type.split("/")
        self._rules = CommandRules(
            source=context.name,
            type=f"{package}/msg/{kind}",
            commands=config.commands,
            as_angle=config.angular_is == "steering_angle",
            wheelbase=context.robot.geometry.wheelbase_m,
            limit=self._limit,
            by_topic=config.enabled_by == "topic",
            requests=config.requests,
            poses=tuple(name for name in POSE_TYPES if name in config.allow),
        )
        self._mailbox = Mailbox(context.wake)
        self._opened = False
        self._begun: float | None = None
        self._asked: list[Asked] = []
        """Requests of the last sample, whose callers wait for what becomes of them."""
        self._problems: list[Problem] = []
        self._command = Command()
        self._holder = ""
        self._news = self._enabled_at = -math.inf

    def read(self, now: float) -> OperatorInput:
        """What was commanded last, at run time `now` [s].

        Raises:
            DeviceLost: neither the network nor a publisher is there.
        """
        self._begun = now if self._begun is None else self._begun
        if not self._opened:
            try:
                self._open()
            except ConfigError as error:
                raise DeviceLost(self._name, str(error)) from None
            self._opened = True
        received, time = self._mailbox.take(), self._clock()
        self._problems += received.problems
        requests = self._counting(received.asked, time)
        self._follow(received, time)
        heard, problem = self._heard()
        if problem and not heard and Request.QUICKSTOP not in requests:  # a stop goes first
            if now - self._begun >= FIND:
                raise DeviceLost(self._name, problem)
        command, age = self._command, max(time - self._news, 0.0)
        button = command.moves if self._keys.enabled_by == "command" else time - self._enabled_at <= HELD
        poses = {kind: pose for kind, (at, pose) in received.poses.items() if not self._is_late(kind, time - at)}
        return OperatorInput(
            source=self._name,
            speed=max(min(command.speed, self._top_speed), -self._top_speed),
            steering=max(min(command.steering, self._limit), -self._limit),
            enabled=button and command.moves,
            neutral=command.rests and (self._keys.enabled_by == "command" or not button),
            requests=requests,
            age=age if command.moves else 0.0,
            raw=command.raw,
            axes=(math.nan,) if received.bad else (),  # out of range: the guard counts such samples (INP-06)
            buttons=(button,),
            goal=None if (goal := poses.get(GOAL_POSE)) is None else goal.pose,
            initial_pose=poses.get(INITIAL_POSE),
        )

    def show(self, tick: Tick) -> str:
        """Answer who called a service, now that it is known what became of it."""
        asked, self._asked = self._asked, []
        samples = [sample for sample in tick.snapshot.sensed.inputs if sample.source == self._name]
        for each in asked:
            why: str | None = "the input is lost, or was sent what cannot be used"
            if any(each.request in sample.requests for sample in samples):
                why = self._ignored(each.request, tick)
            words = "requested" if why is None else f"ignored, {why}"
            self._answer(each.numbers, why is None, f"{_NAMES[each.request]}: {words}")
        return ""

    def take_problems(self) -> list[Problem]:
        """What could not be used since the last call, and what is wrong with the network."""
        problems, self._problems = self._problems, []
        return problems

    # ------------------------------------------------------------------------------------------ what the network adds

    @abstractmethod
    def _open(self) -> None:
        """Take part.

        Raises:
            ConfigError: that cannot be.
        """

    @abstractmethod
    def _heard(self) -> tuple[bool, str]:
        """Whether a publisher of commands is there; and why there is no network (empty: there is one)."""

    @abstractmethod
    def _answer(self, numbers: Sequence[int], taken: bool, words: str) -> None:
        """Answer the calls of services that have these numbers: whether they were `taken`, and what became of them."""

    # ------------------------------------------------------------------------------------------ in the ticks

    def _counting(self, asked: Sequence[Asked], time: float) -> tuple[Request, ...]:
        """What is asked for at `time` [s]; what waited for a run that was held up has no effect, but for a stop."""
        counting = []
        for each in asked:
            if each.request is not Request.QUICKSTOP and self._is_late(_NAMES[each.request], time - each.at):
                if each.numbers:
                    self._answer(each.numbers, False, self._problems[-1][1])
                continue
            counting.append(each.request)
            if each.numbers:
                self._asked.append(each)
        return tuple(counting)

    def _is_late(self, what: str, age: float) -> bool:
        """Whether something waited too long; then that is a problem."""
        if late := age > HELD:
            self._problems.append((LATE, f"{what}: {age:.1f} s old, without effect; ask again"))
        return late

    def _follow(self, received: Received, time: float) -> None:
        """Take the newest command of who may command, at `time` [s]."""
        if received.enable is not None:
            at, value = received.enable
            self._enabled_at = at if value else -math.inf
        newest = sorted(received.commands, key=lambda each: each[0] != self._holder)  # the holder's first
        for sender, at, command in newest:
            drives = self._command.moves and at - self._news <= HELD
            if not drives or sender == self._holder:
                self._command, self._holder, self._news = command, sender, at
        if time - self._news > FORGOTTEN:
            self._command = Command()
