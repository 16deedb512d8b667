"""The keys of the terminal: arrows drive while they are held; whoever lets go, or goes away, stops the robot.

A terminal that knows the kitty keyboard protocol tells when a key is released. Any other only repeats the last key
that is held: there a key counts as held from its first repetition on, and one key works at a time. Either way the
terminal is asked every few ticks whether it is there (DSR, ECMA-48 8.3.35): without an answer the sample grows old.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.joystick import Momentum, step_range
from artemis.values import OperatorInput, Request
from artemis.vehicle import WishedSpeed

FIRST_REPEAT = 0.7
"""A terminal repeats a held key at the latest after this time [s]; later it was pressed again."""
REPEATS = 0.15
"""And then at least once in this time [s]."""
LONGEST = 64
"""Bytes of an unfinished escape sequence that are kept."""
ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
REQUESTS = {"p": Request.RECORD, "d": Request.DONE}
_PRESS, _REPEAT, _RELEASE = 1, 2, 3
_SEQUENCE = re.compile(
    rb"\x1b\[(?:1;\d+(?::(?P<event>[123]))?)?(?P<arrow>[ABCD])"
    rb"|\x1bO(?P<application>[ABCD])"
    rb"|(?P<focus_lost>\x1b\[O)"
    rb"|\x1b\[\?(?P<flags>\d+)u"
    rb"|\x1b(?:\[[0-?]*[ -/]*[^ -?]|O[^ABCD]|[^\[O])"  # any other sequence, or a key with Alt
    rb"|(?P<key>[^\x1b])",
    re.DOTALL,
)
"""Arrow keys and reports of the kitty keyboard protocol ("functional keys", "event types"), focus (xterm, 1004)."""


class Keys:
    """Which arrow keys are held, from the bytes that a terminal sends."""

    def __init__(self) -> None:
        self.tells_release = False
        """The terminal tells when a key is released."""
        self._rest = b""
        self._pressed: dict[str, float] = {}
        self._repeated: set[str] = set()

    def type(self, data: bytes, now: float) -> list[str]:
        """Take what came in at `now` [s]; the keys that are no arrows, once each time they were typed."""
        data, others, end = self._rest + data, [], 0
        while (found := _SEQUENCE.match(data, end)) is not None:
            end = found.end()
            match found.lastgroup:
                case "arrow" | "event":
                    self._arrow(ARROWS[found["arrow"].decode()], int(found["event"] or _PRESS), now)
                case "application":
                    self._arrow(ARROWS[found["application"].decode()], _PRESS, now)
                case "focus_lost":
                    self.release()
                case "flags":
                    self.tells_release = bool(int(found["flags"]) & 2)
                case "key":
                    others.append(found["key"].decode("latin-1"))
        self._rest = data[end:] if len(data) - end <= LONGEST else b""
        return others

    def release(self) -> None:
        """No key is held any more."""
        self._pressed.clear()
        self._repeated.clear()

    def held(self, now: float) -> frozenset[str]:
        """The arrow keys that are held at `now` [s]."""
        if self.tells_release:
            return frozenset(self._pressed)
        return frozenset(key for key in self._repeated if now - self._pressed[key] <= REPEATS)

    def _arrow(self, key: str, event: int, now: float) -> None:
        if event == _RELEASE:
            self._pressed.pop(key, None)
            self._repeated.discard(key)
            return
        if event == _REPEAT or now - self._pressed.get(key, -math.inf) <= FIRST_REPEAT:
            self._repeated.add(key)
        else:
            self._repeated.discard(key)
        self._pressed[key] = now


class KeyboardConfig(Config):
    """Keys of an input with `plugin: keyboard`."""

    max_speed_m_s: WishedSpeed | None = None
    """Speed while an arrow is held; nothing: the robot's limit."""
    speed_range: Annotated[float, Field(ge=0.2, le=1)] = 0.4
    """Share of it to begin with; the keys + and - change it by 0.1."""
    steering_deg_s: Annotated[float, Field(gt=0, le=90)] = 30.0
    """How fast the angle grows while an arrow is held, and goes back when it is released."""


class KeyboardInput:
    """Arrow keys: up and down drive, left and right steer; + and - speed range, p path recording, d done."""

    Config: ClassVar[type[Config]] = KeyboardConfig
    contract: ClassVar[int] = 1
    live: bool = True
    enable: ClassVar[str] = "an arrow key"

    def __init__(self, config: KeyboardConfig, context: PluginContext) -> None:
        """Listen to the run's terminal.

        Raises:
            ConfigError: more speed than the robot has.
        """
        limits = context.robot.limits
        self._name, self._top_speed = context.name, context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._limit, self._rate = math.radians(limits.steering_deg), math.radians(config.steering_deg_s)
        self._momentum, self._range = Momentum(limits.deceleration_m_s2), config.speed_range
        self._keys, self._waiting, self._closed = Keys(), bytearray(), False
        self._heard: float | None = None
        self._last_read: float | None = None
        self._steering = 0.0
        self.live = context.typed(self._listen)

    @staticmethod
    def may_share(_one: KeyboardConfig, _other: KeyboardConfig, _files: Mapping[str, bytes]) -> bool:
        """There is one terminal."""
        return True

    def read(self, now: float) -> OperatorInput:
        """The keys that are held at run time `now` [s].

        Raises:
            DeviceLost: there is no terminal, or it was closed.
        """
        if self._closed or not self.live:
            self._keys.release()
            raise DeviceLost(
                "terminal", "it was closed" if self._closed else "there is no terminal: run artemis in one"
            )
        passed = 0.0 if self._last_read is None else max(now - self._last_read, 0.0)
        self._last_read = now
        requests = self._take(now)
        held = self._keys.held(now)
        right, forward = ("right" in held) - ("left" in held), ("up" in held) - ("down" in held)
        return OperatorInput(
            source=self._name,
            speed=self._speed(forward, passed),
            steering=self._steer(-right * self._limit, passed),
            enabled=bool(held),
            neutral=not held,
            requests=tuple(requests),
            age=None if self._heard is None else now - self._heard,
            axes=(float(right), float(forward)),
            buttons=tuple(key in held for key in ARROWS.values()),
        )

    def close(self) -> None:
        """Nothing to give back: the terminal belongs to the run."""

    def _listen(self, data: bytes) -> None:
        self._waiting += data
        self._closed = self._closed or not data

    def _take(self, now: float) -> Iterable[Request]:
        if not self._waiting:
            return []
        others = self._keys.type(bytes(self._waiting), now)
        self._waiting.clear()
        self._heard = now
        for key in others:
            self._range = step_range(self._range, key == "+", key == "-")
        return [REQUESTS[key] for key in others if key in REQUESTS]

    def _speed(self, forward: int, passed: float) -> float:
        self._momentum.brake(passed)
        return self._momentum.follow(forward * self._range * self._top_speed)

    def _steer(self, wished: float, passed: float) -> float:
        step = self._rate * passed
        self._steering += min(max(wished - self._steering, -step), step)
        return self._steering
