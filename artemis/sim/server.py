"""The simulated robot on a real bus, in real time: the core of `artemis sim`."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from heapq import heappop, heappush

from artemis.devices.can_bus import Frame, FrameBus
from artemis.sim.bus import Surroundings

PERIOD = 2e-3
"""The world moves, and the bus is looked at, at least this often [s]."""


class _Exchange:
    """Frames between the nodes, and between them and a bus that only knows the outside."""

    def __init__(self, world: Surroundings, bus: FrameBus, now: float) -> None:
        self._nodes = list(world.nodes)
        self._bus = bus
        self._seen = now
        self._waiting: list[tuple[float, int, int, Frame]] = []
        self._order = 0

    def take(self, now: float) -> None:
        """Give the nodes what has arrived on the bus, at the time at which it did."""
        for frame in self._bus.receive():
            arrived = max(self._seen, min(frame.time or now, now))
            for node in self._nodes:
                node.receive(frame, arrived)
        self._seen = now

    def give(self, now: float) -> None:
        """Send what is ready; the other nodes see it too, and may have an answer."""
        self._collect()
        while self._waiting and self._waiting[0][0] <= now:
            _, _, sender, frame = heappop(self._waiting)
            self._bus.send(frame)
            for index, node in enumerate(self._nodes):
                if index != sender:
                    node.receive(frame, now)
            self._collect()

    @property
    def next_due(self) -> float:
        """When a timer runs out or a frame gets ready [s]."""
        due = min((node.next_due for node in self._nodes), default=math.inf)
        return min(due, self._waiting[0][0]) if self._waiting else due

    def _collect(self) -> None:
        for sender, node in enumerate(self._nodes):
            for ready, frame in node.outbox:
                self._order += 1
                heappush(self._waiting, (ready, self._order, sender, frame))
            node.outbox.clear()


async def serve(
    world: Surroundings,
    bus: FrameBus,
    until: float | None = None,
    *,
    status: Callable[[], None] | None = None,
) -> None:
    """Run the world's nodes on `bus`, on the time of the running loop, until cancelled.

    Args:
        world: Powered on at the loop's present time.
        bus: Where the host and any other CANopen tool are; stays open afterwards.
        until: Time on the loop's clock at which to end instead [s].
        status: Called once a second, to tell people how it goes.

    Raises:
        DeviceLost: The bus is gone.
    """
    loop = asyncio.get_running_loop()
    woken = asyncio.Event()
    bus.listen(woken.set)
    next_status = loop.time()
    exchange = _Exchange(world, bus, next_status)
    while True:
        woken.clear()
        now = loop.time()
        world.advance(now)
        exchange.take(now)
        for node in world.nodes:
            node.advance(now)
        exchange.give(now)
        if status is not None and now >= next_status:
            status()
            next_status = now + 1.0
        if until is not None and now >= until:
            return
        timer = loop.call_at(max(now, min(now + PERIOD, exchange.next_due)), woken.set)
        try:
            await woken.wait()
        finally:
            timer.cancel()
