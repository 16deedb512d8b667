"""A bus that does wrong what it is told to, around any other; the same seed makes the same trouble."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from heapq import heappop, heappush
from itertools import repeat

from msgspec.structs import replace

from artemis.devices.can_bus import Frame, FrameBus
from artemis.errors import DeviceError, DeviceLost
from artemis.sim.bus import SimBus

EVERYTHING, PROCESS_DATA = range(0x800), range(0x180, 0x580)
TX_PDO_1, RX_PDO_1 = range(0x180, 0x200), range(0x200, 0x280)
"""Identifiers of the predefined connection set (CiA 301 7.3.3), for `Rule.ids`: what a drive tells, and is told."""


class Direction(Enum):
    """Which way a frame goes."""

    FROM_HOST = "from the host"
    TO_HOST = "to the host"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rule:
    """Which frames, and what becomes of them. The first rule that hits a frame decides."""

    ids: range = EVERYTHING
    """Identifiers."""
    node: int | None = None
    """The identifier's lowest 7 bits; None: any."""
    direction: Direction | None = None
    """None: both."""
    count: int | None = None
    """It hits so many frames; None: no end."""
    duration: float = math.inf
    """It hits until so long after it was added [s]."""
    probability: float = 1.0
    """That it hits a frame that fits."""

    drop: bool = False
    """Nobody hears the frame."""
    copies: int = 0
    """It comes so many more times."""
    delay: float = 0.0
    """It comes later [s]."""
    behind: int = 0
    """So many later frames of its direction overtake it."""
    flip: int = 0
    """So many bits of its data are wrong."""
    length: int | None = None
    """Its data is cut, or filled with zeros, to so many bytes."""
    id: int | None = None
    """It comes with this identifier."""


@dataclass(slots=True)
class _Active:
    rule: Rule
    left: int | None
    until: float


class FaultBus:
    """A `FrameBus` around another. As long as nothing was asked for, frames pass as they are.

    What is lost, changed or added here nobody on the other side knows of: a frame dropped on its way to the host was on
    the wire all the same. However late a frame comes, its `time` stays that at which it was on the bus.
    """

    def __init__(self, bus: FrameBus, *, seed: int = 0) -> None:
        """Wrap `bus`, on the running loop; `seed` is of everything random."""
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._dice = random.Random(seed)
        self._rules: list[_Active] = []
        self._inbox: list[tuple[float, int, Frame]] = []
        """Heap of what the host gets: when [s], the number in order, what."""
        self._order = 0
        self._overtaken: dict[Direction, list[tuple[int, Frame]]] = {direction: [] for direction in Direction}
        self._send_errors: Iterator[Exception] = iter(())
        self._receive_errors: Iterator[Exception] = iter(())
        self._lost: str | None = None
        self._wake: Callable[[], None] | None = None
        self._error_frames = 0

    # ------------------------------------------------------------------------------------------ a frame bus

    @property
    def error_frames(self) -> int:
        """Error frames so far, those of the wrapped bus included."""
        return self._bus.error_frames + self._error_frames

    def send(self, frame: Frame) -> None:
        """Send what becomes of a frame.

        Raises:
            DeviceLost: told to, or the wrapped bus is lost.
            DeviceBusy: the wrapped bus has no room.
        """
        self._require()
        for error in self._send_errors:
            raise error
        for late, changed in self._become(frame, Direction.FROM_HOST):
            if late:
                self._loop.call_later(late, self._send_late, changed)
            else:
                self._bus.send(changed)

    def receive(self) -> list[Frame]:
        """What became of the frames that have arrived, in the order of their times.

        Raises:
            DeviceLost: told to, or the wrapped bus is lost.
        """
        self._require()
        for error in self._receive_errors:
            raise error
        for frame in self._bus.receive():
            for late, changed in self._become(frame, Direction.TO_HOST):
                self._deliver(changed, frame.time + late)
        now, frames = self._loop.time(), []
        while self._inbox and self._inbox[0][0] <= now:
            frames.append(heappop(self._inbox)[2])
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the loop call `wake` when frames wait that may be urgent, or when the bus is lost."""
        self._wake = wake
        self._bus.listen(self._tell)

    def close(self) -> None:
        """Close the wrapped bus."""
        self._wake = None
        self._bus.close()

    # ------------------------------------------------------------------------------------------ trouble

    def catch_up(self) -> None:
        """What is due by now has happened in a simulation; a real bus does not wait."""
        if isinstance(self._bus, SimBus):
            self._bus.catch_up()

    def add(self, rule: Rule) -> Rule:
        """Let a rule act from now on, after those that act already; returns it, for `remove`."""
        self._rules.append(_Active(rule, rule.count, self._loop.time() + rule.duration))
        return rule

    def remove(self, rule: Rule) -> None:
        """Let a rule no longer act; harmless when it does not."""
        self._rules = [active for active in self._rules if active.rule is not rule]

    def inject(self, frame: Frame, *, to_nodes: bool = True, to_host: bool = True) -> None:
        """Put a frame on the wire that none of the stations has sent."""
        if to_nodes:
            with suppress(DeviceError):
                self._bus.send(frame)
        if to_host and self._lost is None:
            self._deliver(replace(frame, time=self._loop.time()), self._loop.time())
            self._loop.call_soon(self._tell)

    def add_error_frames(self, count: int = 1) -> None:
        """Damage frames on the wire, so that they count as error frames."""
        self._error_frames += count

    def fail_send(self, error: Exception, count: int | None = 1) -> None:
        """Raise `error` in the next `count` calls of `send` (None: in all); each frame is lost."""
        self._send_errors = _times(error, count)

    def fail_receive(self, error: Exception, count: int | None = 1) -> None:
        """Raise `error` in the next `count` calls of `receive` (None: in all); frames wait."""
        self._receive_errors = _times(error, count)
        if self._wake is not None:
            self._loop.call_soon(self._tell)

    def lose(self, problem: str) -> None:
        """The adapter is gone (unplugged, bus off): `send` and `receive` raise DeviceLost, the nodes are alone."""
        self._lost = problem
        self._inbox.clear()
        self._overtaken = {direction: [] for direction in Direction}
        if self._wake is not None:
            self._loop.call_soon(self._wake)

    def restore(self) -> None:
        """The adapter is back; what was on the wire meanwhile is gone."""
        with suppress(DeviceError):
            self._bus.receive()
        self._lost = None

    # ------------------------------------------------------------------------------------------ what becomes of a frame

    def _require(self) -> None:
        if self._lost is not None:
            raise DeviceLost("CAN", self._lost)

    def _tell(self) -> None:
        if self._wake is not None and self._lost is None:
            self._wake()

    def _deliver(self, frame: Frame, when: float) -> None:
        """Let the host have a frame at the loop's time `when` [s]."""
        self._order += 1
        heappush(self._inbox, (when, self._order, frame))
        if when > self._loop.time() and frame.id not in PROCESS_DATA:
            self._loop.call_at(when, self._tell)

    def _send_late(self, frame: Frame) -> None:
        if self._lost is None:
            with suppress(DeviceError):  # nobody waits for it any more
                self._bus.send(frame)

    def _become(self, frame: Frame, direction: Direction) -> list[tuple[float, Frame]]:
        """The frames to which a frame gives way, each with how late it is [s]."""
        rule = self._hit(frame, direction) if self._rules else None
        if rule is None:
            passing = [(0.0, frame)]
        elif rule.drop:
            return []
        else:
            changed = self._changed(frame, rule)
            if rule.behind:
                self._overtaken[direction].append((rule.behind, changed))
                return []
            passing = [(rule.delay, changed)] * (1 + rule.copies)
        return passing + self._let_go(direction) if self._overtaken[direction] else passing

    def _let_go(self, direction: Direction) -> list[tuple[float, Frame]]:
        """Overtaken frames whose turn has come, now that one more frame has passed."""
        waiting = [(left - 1, frame) for left, frame in self._overtaken[direction]]
        self._overtaken[direction] = [(left, frame) for left, frame in waiting if left]
        return [(0.0, frame) for left, frame in waiting if not left]

    def _hit(self, frame: Frame, direction: Direction) -> Rule | None:
        now = self._loop.time()
        self._rules = [active for active in self._rules if active.left != 0 and now < active.until]
        for active in self._rules:
            rule = active.rule
            fits = frame.id in rule.ids and rule.node in (None, frame.id & 0x7F)
            if not fits or rule.direction not in (None, direction):
                continue
            if rule.probability < 1.0 and self._dice.uniform(0.0, 1.0) >= rule.probability:
                continue
            if active.left is not None:
                active.left -= 1
            return rule
        return None

    def _changed(self, frame: Frame, rule: Rule) -> Frame:
        data = frame.data
        if rule.flip and data:
            places = self._dice.sample(range(8 * len(data)), min(rule.flip, 8 * len(data)))
            wrong = int.from_bytes(data, "big") ^ sum(1 << place for place in places)
            data = wrong.to_bytes(len(data), "big")
        if rule.length is not None:
            data = data[: rule.length].ljust(rule.length, b"\0")
        return replace(frame, id=frame.id if rule.id is None else rule.id, data=data)


def _times(error: Exception, count: int | None) -> Iterator[Exception]:
    return repeat(error) if count is None else repeat(error, count)
