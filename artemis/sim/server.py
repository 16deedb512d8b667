"""The simulated robot on a real bus, in real time: the core of `artemis sim`.

What happened since the last look is gone through in the order of time, and only after the bus was read empty: the time
at which the kernel took a frame in counts, not the time at which this process came to read it. So a drive never misses
a heartbeat that lies unread in the socket, however late this process is.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from heapq import heappop, heappush

from artemis.devices.can_bus import Frame, FrameBus
from artemis.errors import DeviceBusy
from artemis.sim.bus import RESOLUTION, Surroundings
from artemis.sim.wire import frame_bits

PERIOD = 4e-3
"""The world moves, and the bus is looked at, at least this often [s]."""

LONGEST_GAP = 0.1
"""When this process was held up for longer (stopped, asleep), the world stood still for the rest of it [s]: buffers
between the host and us run over, and a drive must not miss heartbeats that nobody could give it."""

BURST = 500
"""When this process was late, so much leaves at once at most, and the rest at the wire's pace [bits]: five frames, as
much as the receiving buffer of a CAN controller holds."""

ROUNDING = 1e-6
"""Sums of times are rounded: what is due may be due only this much later [s]."""


class _Exchange:
    """Nodes on one wire: with each other, and with a bus that only knows the outside."""

    def __init__(self, world: Surroundings, bus: FrameBus, bitrate: int, now: float) -> None:
        self._world = world
        self._nodes = list(world.nodes)
        self._bus = bus
        self._clock = asyncio.get_running_loop().time
        self._bit_time = 1.0 / bitrate
        self._now = self._world_time = self._wire_free = now
        self._stood = 0.0
        self._waiting: list[tuple[float, int, int, int, Frame]] = []
        self._order = 0

    @property
    def next_due(self) -> float:
        """When a timer runs out or a frame has left, on the loop's clock [s]."""
        return self._next() + self._stood

    def run(self, loop_time: float) -> None:
        """Let everything happen up to `loop_time`, in the order of time.

        Raises:
            DeviceLost: The bus is gone.
        """
        self._stood += max(0.0, loop_time - self._stood - self._now - LONGEST_GAP)
        now = loop_time - self._stood
        while frames := self._bus.receive():
            for frame in frames:
                arrived = max(self._now, min(frame.time - self._stood, now))
                self._advance(arrived)
                self._wire_free = max(self._wire_free, arrived)
                self._hear(frame, arrived)
            if frames[-1].time >= loop_time:
                break  # a flood
        self._advance(now)

    def _next(self) -> float:
        due = min((node.next_due for node in self._nodes), default=math.inf)
        return min(due, self._leaving()) if self._waiting else due

    def _leaving(self) -> float:
        """When the first waiting frame has left: it waits for the wire, and takes its length."""
        ready, _, _, _, frame = self._waiting[0]
        return max(ready, self._wire_free) + frame_bits(frame) * self._bit_time

    def _advance(self, until: float) -> None:
        """Timers, and frames that leave, up to `until`."""
        while (due := self._next()) <= until:
            self._now = max(due, self._now)
            if self._waiting and self._leaving() <= self._now:
                self._give()
            else:
                self._run_timers()
        self._now = until
        if until - self._world_time >= RESOLUTION:
            self._run_timers()

    def _run_timers(self) -> None:
        """What is due in the drives, on a world that is up to date."""
        if self._now - self._world_time >= RESOLUTION:
            self._world_time = self._now
            self._world.advance(self._now)
        for node in self._nodes:
            node.advance(self._now)
        self._collect()

    def _give(self) -> None:
        """The first waiting frame has left: everybody hears it."""
        _, _, _, sender, frame = heappop(self._waiting)
        self._wire_free = max(self._now, self._clock() - self._stood - BURST * self._bit_time)
        with suppress(DeviceBusy):  # no operator acknowledges what we send: a drive's mailbox is overwritten, too
            self._bus.send(frame)
        self._hear(frame, self._now, sender)

    def _hear(self, frame: Frame, now: float, sender: int | None = None) -> None:
        for index, node in enumerate(self._nodes):
            if index != sender:
                node.receive(frame, now)
        self._collect()

    def _collect(self) -> None:
        for sender, node in enumerate(self._nodes):
            for ready, frame in node.outbox:
                self._order += 1
                heappush(self._waiting, (ready, frame.id, self._order, sender, frame))
            node.outbox.clear()


async def serve(
    world: Surroundings,
    bus: FrameBus,
    bitrate: int,
    until: float | None = None,
    *,
    status: Callable[[], None] | None = None,
) -> None:
    """Run the world's nodes on `bus`, on the time of the running loop, until cancelled.

    Args:
        world: Powered on at the loop's present time.
        bus: Where the host and any other CANopen tool are; stays open afterwards.
        bitrate: Of the wire between the nodes and the bus [bit/s]: no node sends faster.
        until: Time on the loop's clock at which to end instead [s].
        status: Called once a second, to tell people how it goes.

    Raises:
        DeviceLost: The bus is gone.
    """
    loop = asyncio.get_running_loop()
    woken = asyncio.Event()
    bus.listen(woken.set)
    next_status = loop.time()
    exchange = _Exchange(world, bus, bitrate, next_status)
    while True:
        woken.clear()
        now = loop.time()
        exchange.run(now)
        if status is not None and now >= next_status:
            status()
            next_status = now + 1.0
        if until is not None and now >= until:
            return
        soon = max(now + ROUNDING, min(now + PERIOD, exchange.next_due))
        timer = loop.call_at(soon, woken.set)
        try:
            await woken.wait()
        finally:
            timer.cancel()
