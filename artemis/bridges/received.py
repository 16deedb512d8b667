"""What other programs ask of the robot, as it arrives: understood at once, kept with its time, taken by the next tick.

It arrives in another thread, or in another process, which hands it on by `Received`. Times are those of
`clock.stopwatch`, which all processes of a computer share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from threading import Lock
from typing import Any, Protocol

from msgspec import Struct, field

from artemis.bridges.commands import Command, steered_command, twist_command
from artemis.bridges.poses import FRAME, INITIAL_POSE, POSE_TYPES, asked_initial_pose, asked_pose
from artemis.clock import stopwatch, wall_date
from artemis.values import LocatedPose, Request

MOST = 64
"""Publishers of commands that are read between two ticks, and calls of a service that are answered together."""
REQUESTS: Mapping[str, Request] = {
    "stop": Request.QUICKSTOP,
    "acknowledge": Request.ACKNOWLEDGE,
    "arm": Request.ARM,
    "end": Request.END,
    "done": Request.DONE,
}
"""By the names of topics and services."""
REFUSED, LATE = "NET-14", "NET-04"
BOOL, EMPTY = "std_msgs/msg/Bool", "std_msgs/msg/Empty"
_TWIST, _STEERED = "geometry_msgs/msg/Twist", "ackermann_msgs/msg/AckermannDrive"

Problem = tuple[str, str]
"""Row of the fault table, and what was seen."""
Taker = Callable[[bytes, str], str]
"""Called with a message and its sender, in a thread of the network; returns why it cannot be used (empty: it can)."""


class Messages(Protocol):
    """How messages of the network are understood; types are written as `geometry_msgs/msg/Twist`."""

    def prepare(self, type: str) -> None:
        """Have all that `unpack` needs of a type."""

    def unpack(self, type: str, data: bytes) -> object:
        """A message, its fields as attributes. Raises ValueError: it is none."""


class Asked(Struct, array_like=True):
    """A request, of one or several at once."""

    request: Request
    at: float
    """When the last of them arrived [s]."""
    numbers: list[int]
    """Of the calls that wait for an answer."""


class Received(Struct, array_like=True):
    """What arrived since the last one was taken."""

    commands: list[tuple[str, float, Command]] = field(default_factory=list)
    """Sender, arrival [s] and command: of each sender the newest, the last to arrive at the end."""
    enable: tuple[float, bool] | None = None
    """Arrival [s] and value of the newest on the topic `enable`."""
    asked: list[Asked] = field(default_factory=list)
    poses: dict[str, tuple[float, LocatedPose]] = field(default_factory=dict)
    """Arrival [s] and pose of the newest by topic."""
    problems: list[Problem] = field(default_factory=list)
    bad: bool = False
    """Something could not be understood."""


class Mailbox:
    """Holds what arrives until a tick takes it: of what there can be any number of, the newest."""

    def __init__(self, wake: Callable[[], None] = lambda: None, news: Callable[[], None] = lambda: None) -> None:
        """Nothing has arrived.

        Args:
            wake: is called for a stop: of many, for the first since the last that was taken.
            news: is called for whatever arrives.
        """
        self._lock, self._wake, self._news, self._numbers = Lock(), wake, news, count(1)
        self._received = Received()
        self._commands: dict[str, tuple[float, Command]] = {}
        self._asked: dict[Request, Asked] = {}
        self._stopping = False

    def command(self, sender: str, at: float, command: Command) -> None:
        """A command arrived at `at` [s]."""
        with self._lock:
            self._put(sender, at, command)
        self._news()

    def enable(self, at: float, value: bool) -> None:
        """The enable button of its own."""
        with self._lock:
            self._received.enable = at, value
        self._news()

    def pose(self, kind: str, at: float, pose: LocatedPose) -> None:
        """A goal, or about where the robot is."""
        with self._lock:
            self._received.poses[kind] = at, pose
        self._news()

    def problem(self, row: str, words: str) -> None:
        """Something could not be used."""
        with self._lock:
            self._report(row, words)
        self._news()

    def garbled(self) -> None:
        """Something could not be understood."""
        with self._lock:
            self._received.bad = True
        self._news()

    def ask(self, request: Request, at: float, *, called: bool = False) -> int:
        """A client requests it; returns the number of the call whose answer is waited for, if it is `called`."""
        number = next(self._numbers) if called else 0
        self._ask(Asked(request, at, [number] if called else []))
        return number

    def absorb(self, received: Received) -> None:
        """All that arrived in another process."""
        with self._lock:
            for sender, at, command in received.commands:
                self._put(sender, at, command)
            self._received.enable = received.enable or self._received.enable
            self._received.poses.update(received.poses)
            for row, words in received.problems:
                self._report(row, words)
            self._received.bad |= received.bad
        for asked in received.asked:
            self._ask(asked)

    def take(self) -> Received:
        """What arrived since the last call."""
        with self._lock:
            received, self._received = self._received, Received()
            received.commands = [(sender, at, command) for sender, (at, command) in self._commands.items()]
            received.asked = list(self._asked.values())
            self._commands, self._asked = {}, {}
            self._stopping = any(asked.request is Request.QUICKSTOP for asked in received.asked)
        return received

    def _put(self, sender: str, at: float, command: Command) -> None:
        self._commands.pop(sender, None)
        if len(self._commands) < MOST:
            self._commands[sender] = at, command

    def _report(self, row: str, words: str) -> None:
        if (row, words) not in self._received.problems and len(self._received.problems) < MOST:
            self._received.problems.append((row, words))

    def _ask(self, asked: Asked) -> None:
        with self._lock:
            known = self._asked.setdefault(asked.request, asked)
            if known is not asked:
                known.at = max(known.at, asked.at)
                known.numbers += asked.numbers[: MOST - len(known.numbers)]
            first = asked.request is Request.QUICKSTOP and not self._stopping
            self._stopping = self._stopping or first
        self._news()
        if first:
            self._wake()


class CommandRules(Struct, frozen=True):
    """Topics that are read, and the meaning of a command on this robot."""

    source: str
    """The input's name in the mission."""
    type: str
    commands: str
    """Their topic, unresolved."""
    as_angle: bool
    """A Twist's angular.z is the angle of the virtual front wheel."""
    wheelbase: float
    """[m]."""
    limit: float
    """Of the virtual front wheel's angle [rad]."""
    by_topic: bool
    """There is a topic `enable`."""
    requests: tuple[str, ...]
    poses: tuple[str, ...]


class Receiver:
    """Understands what arrives, in a thread of the network's."""

    def __init__(
        self, rules: CommandRules, types: Messages, mailbox: Mailbox, clock: Callable[[], float] = stopwatch
    ) -> None:
        """What it understands goes to the `mailbox`; `clock`: when what it is given now arrived [s]."""
        self.rules, self._types, self._mailbox, self._clock = rules, types, mailbox, clock
        for type in (rules.type, BOOL, *(POSE_TYPES[name] for name in rules.poses)):
            types.prepare(type)

    def topics(self) -> dict[str, tuple[str, Taker]]:
        """Topics that are read: type and receiver by the unresolved name."""
        heard: dict[str, tuple[str, Taker]] = {self.rules.commands: (self.rules.type, self._take_command)}
        if self.rules.by_topic:
            heard["enable"] = BOOL, self._take_enable
        for name in self.rules.poses:
            heard[name] = POSE_TYPES[name], partial(self._take_pose, name)
        for name in self.rules.requests:
            heard[name] = EMPTY, partial(self._take_request, name)
        return heard

    def call(self, name: str) -> int:
        """A client calls the service of that name; returns the number of the call."""
        return self._mailbox.ask(REQUESTS[name], self._clock(), called=True)

    @staticmethod
    def without_effect(name: str, why: str) -> str:
        """Text for a message on the topic `name` that was not accepted."""
        return f"{name}: {why}; send it again"

    def too_old(self, name: str, why: str) -> str:
        """A request or a pose was not accepted; returns the text of the warning."""
        words = self.without_effect(name, why)
        self._mailbox.problem(LATE, words)
        return words

    def _take_request(self, name: str, data: bytes, sender: str) -> str:
        self._mailbox.ask(REQUESTS[name], self._clock())
        return ""

    def _take_command(self, data: bytes, sender: str) -> str:
        at = self._clock()
        try:
            command = self._understood(data)
        except ValueError as error:
            self._mailbox.garbled()
            return str(error)
        self._mailbox.command(sender, at, command)
        return ""

    def _take_enable(self, data: bytes, sender: str) -> str:
        at = self._clock()
        try:
            message: Any = self._types.unpack(BOOL, data)
        except ValueError as error:
            self._mailbox.garbled()
            return str(error)
        self._mailbox.enable(at, bool(message.data))
        return ""

    def _take_pose(self, name: str, data: bytes, sender: str) -> str:
        at, source = self._clock(), self.rules.source
        try:
            message, date = self._types.unpack(POSE_TYPES[name], data), wall_date().timestamp()
            if name == INITIAL_POSE:
                pose = asked_initial_pose(message, date, source)
            else:
                pose = LocatedPose(pose=asked_pose(message, date), frame=FRAME, source=source)
        except ValueError as error:
            self._mailbox.problem(REFUSED, f"{name}: {error}")
            return str(error)
        self._mailbox.pose(name, at, pose)
        return ""

    def _understood(self, data: bytes) -> Command:
        """A command from its bytes.

        Raises:
            ValueError: they are none, or a number in them is not finite.
        """
        rules = self.rules
        message: Any = self._types.unpack(rules.type, data)
        if "Twist" in rules.type:
            twist = message.twist if rules.type != _TWIST else message
            return twist_command(twist.linear.x, twist.angular.z, rules.wheelbase, rules.limit, as_angle=rules.as_angle)
        drive = message.drive if rules.type != _STEERED else message
        return steered_command(drive.speed, drive.steering_angle, rules.limit)
