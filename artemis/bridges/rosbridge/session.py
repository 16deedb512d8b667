"""What one client of rosbridge may send, and what is sent to it: protocol version 2, on no connection yet.

The protocol is that of github.com/RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md. There is no compression, no
fragment, no authentication: such a request is refused by name.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from artemis.bridges.json_messages import FORMS, JsonMessages, full_name
from artemis.bridges.names import absolute, check_name

QUEUE = 64
"""Messages that may wait for a slow client, by default, and for the time that a client wants between two; then the
oldest is dropped."""
MOST_TOPICS = 256
"""Topics that a client may subscribe to or advertise, and its subscriptions to one."""
SETTLED = 0.5
"""A connection is so old before what moves the robot counts on it [s]: clients keep what is said while they have no
connection, for however long, and send all of it as soon as they have one."""
LEVELS = ("none", "error", "warning", "info")
_ENCODE = msgspec.json.encode
Message = dict[str, Any]


@dataclass(slots=True)
class Outgoing:
    """A topic that clients may subscribe to."""

    type: str
    latched: bool = False
    last: bytes = b""
    """The newest message of a latched one, as it goes over the connection."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What a server has for its clients, by absolute names."""

    told: Mapping[str, Outgoing] = field(default_factory=dict)
    heard: Mapping[str, tuple[str, Callable[[bytes, str], str]]] = field(default_factory=dict)
    """Topics that clients may publish: their type, and what takes a message and its sender. That returns why the
    message cannot be used (empty: it can)."""
    services: Mapping[str, Callable[[Message], Message | Coroutine[Any, Any, Message]]] = field(default_factory=dict)
    """What answers a call with its arguments, at once or later. Raises ValueError: why not."""
    early: Mapping[str, Callable[[str], str]] = field(default_factory=dict)
    """Topics and services that have no effect on a connection younger than `SETTLED`: what makes a refusal of why."""
    elsewhere: str = ""
    """URL of a server for topics and services that are not here; empty: none."""


@dataclass(slots=True)
class _Subscription:
    """One topic: what the client's subscriptions under their ids want of it."""

    wants: dict[str, tuple[float, int]] = field(default_factory=dict)
    """Shortest time between two messages [s], and how many may wait for that."""
    sent: float = -1e9
    waiting: deque[bytes] = field(default_factory=deque)

    @property
    def period(self) -> float:
        return min(period for period, _ in self.wants.values())

    @property
    def queue(self) -> int:
        return min(queue for _, queue in self.wants.values())


class Refused(ValueError):
    """A request of a client is impossible: it gets this text."""


class ClientSession:
    """One client. Nothing here waits: what is for it goes to `send`."""

    def __init__(
        self,
        offer: Offer,
        name: str,
        send: Callable[[bytes], None],
        messages: JsonMessages,
        now: float,
        begin: Callable[[Coroutine[Any, Any, None]], object],
    ) -> None:
        """A client connects.

        Args:
            offer: what there is for it.
            name: of the client, by which its commands are kept apart from others'.
            send: takes what is for it.
            messages: packs and unpacks.
            now: the time [s].
            begin: has something done that takes longer.
        """
        self._offer, self._name, self._send, self._messages = offer, name, send, messages
        self._connected, self._begin = now, begin
        self._subscribed: dict[str, _Subscription] = {}
        self._advertised: set[str] = set()
        self._level = LEVELS.index("error")
        self._operations: dict[str, Callable[[Message, float], None]] = {
            "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe,
            "advertise": self._advertise,
            "unadvertise": self._unadvertise,
            "publish": self._publish,
            "call_service": self._call,
            "set_level": self._set_level,
        }

    @property
    def subscribed(self) -> set[str]:
        """Names of the topics that it subscribed to."""
        return set(self._subscribed)

    def take(self, text: str | bytes, now: float) -> bool:
        """Do what the client requests at time `now` [s]; False: it is for those elsewhere."""
        message: Message = {}
        try:
            try:
                decoded = msgspec.json.decode(text)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                raise Refused("what was sent is no JSON") from None
            if not isinstance(decoded, dict):
                raise Refused("what was sent is no object")
            message = decoded
            operation = self._operations.get(self._text(message, "op"))
            if operation is None:
                raise Refused(f"unknown operation {message['op']!r:.40}; there are {', '.join(self._operations)}")
            if self._offer.elsewhere and self._is_elsewhere(message):
                return False
            operation(message, now)
        except ValueError as error:
            self.say("error", str(error), message.get("id"))
        return True

    def put(self, topic: str, data: bytes, now: float) -> None:
        """A message of a topic, as it goes over the connection: send it if the client wants it, now or later."""
        if (wanted := self._subscribed.get(topic)) is None:
            return
        if now - wanted.sent >= wanted.period and not wanted.waiting:
            wanted.sent = now
            self._send(data)
        elif wanted.queue:
            wanted.waiting.append(data)
            while len(wanted.waiting) > wanted.queue:
                wanted.waiting.popleft()

    def look(self, now: float) -> None:
        """Send what has waited for its time."""
        for wanted in self._subscribed.values():
            if wanted.waiting and now - wanted.sent >= wanted.period:
                wanted.sent = now
                self._send(wanted.waiting.popleft())

    def say(self, level: str, words: str, id: object = None) -> None:
        """Send the client how something went, if it wants to know."""
        if LEVELS.index(level) <= self._level:
            about = {"id": id} if isinstance(id, str) else {}
            self._send(_ENCODE({"op": "status", "level": level, "msg": words, **about}))

    # ------------------------------------------------------------------------------------------ operations

    def _subscribe(self, message: Message, now: float) -> None:
        topic, type = self._name_in(message), self._text(message, "type", "")
        if (compression := self._text(message, "compression", "none")) != "none":
            raise Refused(f"{topic}: compression {compression!r:.20}: there is none")
        if message.get("fragment_size") is not None:
            self.say("warning", f"{topic}: fragment_size: messages are sent whole", message.get("id"))
        period, queue = self._number(message, "throttle_rate"), self._number(message, "queue_length")
        if (known := self._offer.told.get(topic)) is None:
            self.say("warning", f"{topic}: it has no publisher here", message.get("id"))
        elif type and full_name(type) != known.type:
            raise Refused(f"{topic} is {known.type}, and {type} was asked for")
        self._fits(len(self._subscribed))
        id = self._text(message, "id", "")
        wanted = self._subscribed.setdefault(topic, _Subscription())
        new = not wanted.wants
        if id not in wanted.wants:
            self._fits(len(wanted.wants), "subscriptions to a topic")
        wanted.wants[id] = period / 1000, min(int(queue), QUEUE)
        if new and known is not None and known.last:
            wanted.sent = now
            self._send(known.last)

    def _unsubscribe(self, message: Message, now: float) -> None:
        topic, id = self._name_in(message), message.get("id")
        if (wanted := self._subscribed.get(topic)) is None:
            raise Refused(f"{topic} is not subscribed to")
        if id is None:
            wanted.wants.clear()
        wanted.wants.pop(str(id), None)
        if not wanted.wants:
            del self._subscribed[topic]

    def _advertise(self, message: Message, now: float) -> None:
        topic, type = self._name_in(message), full_name(self._text(message, "type"))
        if type not in FORMS:
            raise Refused(f"{topic}: unknown type {message['type']!r:.60}")
        self._heard(topic, type)
        self._fits(len(self._advertised))
        self._advertised.add(topic)

    def _unadvertise(self, message: Message, now: float) -> None:
        topic = self._name_in(message)
        if topic not in self._advertised:
            raise Refused(f"{topic} is not advertised")
        self._advertised.remove(topic)

    def _publish(self, message: Message, now: float) -> None:
        topic = self._name_in(message)
        type, take = self._heard(topic)
        data = _ENCODE(message.get("msg", {}))
        try:
            self._messages.unpack(type, data)
        except ValueError as error:
            raise Refused(f"{topic}: no {type}: {error}") from None
        if why := self._too_early(topic, now) or take(data, self._name):
            raise Refused(why)

    def _call(self, message: Message, now: float) -> None:
        service = self._name_in(message, "service")
        about = {"id": message["id"]} if isinstance(message.get("id"), str) else {}
        answer: Message = {"op": "service_response", "service": service, **about}
        arguments = message.get("args") or {}
        known = self._offer.services.get(service)
        try:
            if known is None:
                raise Refused(f"no service {service}")
            if why := self._too_early(service, now):
                values: Message | Coroutine[Any, Any, Message] = {"success": False, "message": why}
            else:
                values = known(arguments if isinstance(arguments, dict) else {})
        except ValueError as error:
            self._send(_ENCODE({**answer, "values": str(error), "result": False}))
            return
        if isinstance(values, Coroutine):
            self._begin(self._answer(answer, values))
        else:
            self._send(_ENCODE({**answer, "values": values, "result": True}))

    async def _answer(self, answer: Message, values: Coroutine[Any, Any, Message]) -> None:
        """Answer a call later."""
        self._send(_ENCODE({**answer, "values": await values, "result": True}))

    def _set_level(self, message: Message, now: float) -> None:
        level = self._text(message, "level")
        if level not in LEVELS:
            raise Refused(f"level {level!r:.20}: {', '.join(LEVELS)}")
        self._level = LEVELS.index(level)

    # ------------------------------------------------------------------------------------------ parts of messages

    def _is_elsewhere(self, message: Message) -> bool:
        match message["op"]:
            case "advertise" | "unadvertise" | "publish":
                return True
            case "call_service":
                return self._name_in(message, "service") not in self._offer.services
        return False

    def _too_early(self, name: str, now: float) -> str:
        """Why a topic or service has no effect yet; empty: it has."""
        refuse, age = self._offer.early.get(name), now - self._connected
        if refuse is None or age >= SETTLED:
            return ""
        return refuse(f"dropped: sent {age:.2f} s after {self._name} connected, may be an old queued message")

    def _heard(self, topic: str, type: str = "") -> tuple[str, Callable[[bytes, str], str]]:
        if (known := self._offer.heard.get(topic)) is None:
            there = ", ".join(sorted(self._offer.heard)) or "none"
            raise Refused(f"{topic} is not accepted here; topics that are: {there}")
        if type and known[0] != type:
            raise Refused(f"{topic} is {known[0]}, and {type} was advertised")
        return known

    def _name_in(self, message: Message, key: str = "topic") -> str:
        """The absolute name that a client means; raises ValueError where ROS forbids it."""
        return absolute(check_name(self._text(message, key)))

    @staticmethod
    def _text(message: Message, key: str, default: str | None = None) -> str:
        value = message.get(key, default)
        if value is None and default is not None:
            return default
        if not isinstance(value, str):
            raise Refused(f"{key} is missing" if value is None else f"{key}: {value!r:.40} is no text")
        return value

    @staticmethod
    def _number(message: Message, key: str) -> float:
        value = message.get(key) or 0
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1e6:
            raise Refused(f"{key}: {value!r:.40} is no number from 0 to 1000000")
        return value

    @staticmethod
    def _fits(number: int, what: str = "topics") -> None:
        if number >= MOST_TOPICS:
            raise Refused(f"{MOST_TOPICS} {what} are the most")
