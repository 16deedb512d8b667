"""What `ros1`, `ros2` and `rosbridge` share: commands become an operator's wish, a stop is obeyed, poses are passed on.

Messages arrive in another thread, and are taken at the next tick; how old a command is counts from there. Where the
last one was to stand, silence is rest; where it was to drive, silence is a stop (INP-03).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self

from pydantic import Field, model_validator

from artemis.bridges.commands import Command, steered_command, twist_command
from artemis.bridges.poses import FRAME, GOAL_POSE, INITIAL_POSE, POSE_TYPES, asked_initial_pose, asked_pose
from artemis.bridges.ros1.settings import GraphName
from artemis.clock import wall_date
from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.values import LocatedPose, OperatorInput, Request
from artemis.vehicle import WishedSpeed

FIND = 3.0
"""A network that never answered is missed after this time [s]."""
HELD = 0.15
"""A publisher that drives keeps others out until it was silent for so long [s]; so long an enable counts."""
FORGOTTEN = 0.5
"""A command that nothing followed for so long is one no more [s]: what held the enable button has let go of it."""
MOST = 64
"""Messages of a topic that wait for a tick; of more the newest are kept."""
REQUESTS = {
    "stop": Request.QUICKSTOP,
    "acknowledge": Request.ACKNOWLEDGE,
    "arm": Request.ARM,
    "end": Request.END,
    "done": Request.DONE,
}
REFUSED = "NET-14"
BOOL, EMPTY = "std_msgs/msg/Bool", "std_msgs/msg/Empty"
_TWIST, _STEERED = "geometry_msgs/msg/Twist", "ackermann_msgs/msg/AckermannDrive"

Taker = Callable[[bytes, str], None]
"""Is given a message and who sent it, in a thread of the network's."""


class Messages(Protocol):
    """How messages of the network are understood; types are written as `geometry_msgs/msg/Twist`."""

    def prepare(self, type: str) -> None:
        """Have all that `unpack` needs of a type."""

    def unpack(self, type: str, data: bytes) -> object:
        """A message, its fields as attributes. Raises ValueError: it is none."""


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
    """What may be asked for besides `stop`. With acknowledge and arm somebody counts as present in the run. goal_pose:
    where a step `goto: {to: {from_input: NAME}}` drives; initialpose: about where the robot is, for the localizer."""
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


class CommandedInput(ABC):
    """An input that is commanded. Nothing is opened before the first tick."""

    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True
    live: bool = True

    def __init__(self, config: CommandKeys, context: PluginContext, types: Messages) -> None:
        """Take the robot.

        Raises:
            ConfigError: more speed than the robot has.
        """
        limits = context.robot.limits
        self._top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._limit, self._wheelbase = math.radians(limits.steering_deg), context.robot.geometry.wheelbase_m
        self._keys, self._name, self._wake, self._types = config, context.name, context.wake, types
        self.live = {"acknowledge", "arm"} <= set(config.allow)
        package, *_, kind = config.type.split("/")
        self._type = f"{package}/msg/{kind}"
        self._places: dict[str, deque[bytes]] = {name: deque(maxlen=1) for name in POSE_TYPES if name in config.allow}
        """Poses that have arrived, of each kind the newest."""
        for type in (self._type, BOOL, *(POSE_TYPES[name] for name in self._places)):
            types.prepare(type)
        self._opened = False
        self._begun: float | None = None
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=MOST)
        self._enables: deque[bytes] = deque(maxlen=MOST)
        self._asked: dict[Request, None] = {}
        self._stopping = False
        self._problems: list[tuple[str, str]] = []
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
        requests = tuple(self._asked)
        for request in requests:
            del self._asked[request]
        self._stopping = Request.QUICKSTOP in requests
        bad = self._take(now)
        if now - self._news > FORGOTTEN:
            self._command = Command()
        heard, problem = self._heard()
        if problem and not heard and Request.QUICKSTOP not in requests:  # a stop goes first
            if now - self._begun >= FIND:
                raise DeviceLost(self._name, problem)
        command = self._command
        button = command.moves if self._keys.enabled_by == "command" else now - self._enabled_at <= HELD
        return OperatorInput(
            source=self._name,
            speed=max(min(command.speed, self._top_speed), -self._top_speed),
            steering=max(min(command.steering, self._limit), -self._limit),
            enabled=button and command.moves,
            neutral=command.rests and (self._keys.enabled_by == "command" or not button),
            requests=requests,
            age=now - self._news if command.moves else 0.0,
            raw=command.raw,
            axes=(math.nan,) if bad else (),  # out of range: the guard counts such samples (INP-06)
            buttons=(button,),
            goal=None if (goal := self._placed(GOAL_POSE)) is None else goal.pose,
            initial_pose=self._placed(INITIAL_POSE),
        )

    def take_problems(self) -> list[tuple[str, str]]:
        """Poses that could not be used since the last call."""
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
        """Whether somebody publishes commands; and why there is no network (empty: there is one)."""

    def _topics(self) -> dict[str, tuple[str, Taker]]:
        """What is heard: type and taker by the name of the topic, unresolved."""
        heard: dict[str, tuple[str, Taker]] = {
            self._keys.commands: (self._type, lambda data, sender: self._arrived.append((sender, data)))
        }
        if self._keys.enabled_by == "topic":
            heard["enable"] = (BOOL, lambda data, sender: self._enables.append(data))
        for name, waiting in self._places.items():
            heard[name] = POSE_TYPES[name], lambda data, sender, waiting=waiting: waiting.append(data)  # type: ignore[misc]
        for name in self._keys.requests:
            request = REQUESTS[name]
            heard[name] = (EMPTY, lambda data, sender, request=request: self._ask(request))  # type: ignore[misc]
        return heard

    def _ask(self, request: Request) -> None:
        """Somebody asks for it: in a thread of the network's. Of many stops the first makes a tick of its own."""
        self._asked[request] = None
        if request is Request.QUICKSTOP and not self._stopping:
            self._stopping = True
            self._wake()

    # ------------------------------------------------------------------------------------------ in the ticks

    def _take(self, now: float) -> bool:
        """Take what has arrived, the newest last; whether some of it could not be understood."""
        bad = False
        for _ in range(len(self._enables)):
            try:
                enabled: Any = self._types.unpack(BOOL, self._enables.popleft())
            except ValueError:
                bad = True
                continue
            self._enabled_at = now if enabled.data else -math.inf
        for _ in range(len(self._arrived)):
            sender, data = self._arrived.popleft()
            drives = self._command.moves and now - self._news <= HELD
            if drives and sender != self._holder:
                continue
            try:
                command = self._understood(data)
            except ValueError:
                bad = True
                continue
            self._command, self._holder, self._news = command, sender, now
        return bad

    def _placed(self, name: str) -> LocatedPose | None:
        """The newest pose of a kind that has arrived; of one that cannot be used is told why."""
        if not (waiting := self._places.get(name)):
            return None
        try:
            return self._pose(name, waiting.popleft())
        except ValueError as error:
            self._refuse(name, error)
            return None

    def _refuse(self, name: str, error: ValueError) -> None:
        self._problems.append((REFUSED, f"{name}: {error}"))

    def _pose(self, name: str, data: bytes) -> LocatedPose:
        """A pose from its bytes.

        Raises:
            ValueError: they are none, or why it cannot be used.
        """
        message, now = self._types.unpack(POSE_TYPES[name], data), wall_date().timestamp()
        if name == INITIAL_POSE:
            return asked_initial_pose(message, now, self._name)
        return LocatedPose(pose=asked_pose(message, now), frame=FRAME, source=self._name)

    def _understood(self, data: bytes) -> Command:
        """A command from its bytes.

        Raises:
            ValueError: they are none, or a number in them is not finite.
        """
        message: Any = self._types.unpack(self._type, data)
        if "Twist" in self._type:
            twist = message.twist if self._type != _TWIST else message
            as_angle = self._keys.angular_is == "steering_angle"
            return twist_command(twist.linear.x, twist.angular.z, self._wheelbase, self._limit, as_angle=as_angle)
        drive = message.drive if self._type != _STEERED else message
        return steered_command(drive.speed, drive.steering_angle, self._limit)
