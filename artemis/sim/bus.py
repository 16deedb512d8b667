"""The simulated CAN bus: one wire, the nodes of a world on it, and the host as one more station.

It has the wire's physics: a frame takes its exact length at the bit rate, the lowest identifier wins the wire, and
everybody hears a frame when it ends. Nothing is computed until time matters: the host's `send` and `receive` first let
everything happen that is due, strictly in the order of time. The loop is woken only while something urgent is under
way (SDO, NMT, EMCY, boot-up), and now and then to notice what arises inside a drive.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable, Container, Sequence
from heapq import heappop, heappush
from typing import Protocol

from artemis.devices.can_bus import Frame
from artemis.errors import DeviceLost
from artemis.sim.wire import frame_bits

RESOLUTION = 1e-3
"""The world is brought up to date where it lags more than this [s]: an EPOS regulates and samples at 1 kHz."""

SYNC, PROCESS_DATA, ERROR_CONTROL = 0x080, range(0x180, 0x580), 0x700
"""Identifiers of the predefined connection set (CiA 301, 7.3.3)."""

HOST = -1
"""The host's station number; nodes count from 0, and the host stands behind the last."""

Disturb = Callable[[Frame, float], tuple[Frame | None, float]]
"""What happens to a frame that gets ready at some time [s]: what the others hear of it (None: nothing), and by how
many seconds its sender is late."""


class Node(Protocol):
    """A station that is only frames in, frames out and time."""

    outbox: list[tuple[float, Frame]]

    @property
    def next_due(self) -> float:
        """Time of its next timer [s], infinite if none runs."""

    @property
    def hears(self) -> Container[int]:
        """Identifiers that mean something to it now; other frames pass it by."""

    def receive(self, frame: Frame, now: float) -> None:
        """Take a frame off the wire."""

    def advance(self, now: float) -> None:
        """Do everything that is due up to `now`."""


class Surroundings(Protocol):
    """What the nodes are parts of, and what moves when time passes."""

    @property
    def nodes(self) -> Sequence[Node]:
        """Every simulated station."""

    def advance(self, now: float) -> None:
        """Let the world move up to `now` [s]."""


def is_urgent(frame: Frame) -> bool:
    """Whether a host wants to see `frame` before its next tick: NMT, EMCY, SDO, boot-up."""
    identifier = frame.id
    if identifier in PROCESS_DATA:
        return False
    return frame.data == b"\x00" if identifier >= ERROR_CONTROL else identifier != SYNC


class SimBus:
    """The host's end of the simulated bus: a `FrameBus` on the loop's time, virtual or real.

    The host's frames leave in the order in which they were sent (the queue of an adapter); a node's in the order of
    their identifiers (a drive has a mailbox for each).
    """

    def __init__(
        self,
        world: Surroundings,
        bitrate: int,
        loop: asyncio.AbstractEventLoop,
        *,
        disturb: Disturb | None = None,
        patrol_s: float = 0.01,
        speaker: Node | None = None,
    ) -> None:
        """`speaker`: the node whose controller sends the host's frames, as a gateway does; it does not hear them."""
        self.disturb = disturb
        self.error_frames = 0
        """None ever: this wire damages no frame."""
        self.frames = 0
        """Frames that were on the wire."""
        self.bits = 0
        """Bits that were on the wire, interframe spaces included."""
        self._world = world
        self._nodes = list(world.nodes)
        self._others = [[other for other in self._nodes if other is not node] for node in self._nodes]
        self._others.append([node for node in self._nodes if node is not speaker])  # station HOST
        self._loop = loop
        self._bit_time = 1.0 / bitrate
        self._patrol = patrol_s
        self._wake: Callable[[], None] | None = None
        self._handle: asyncio.TimerHandle | None = None
        self._now = loop.time()
        self._bus_off = False
        self._world_time = -math.inf
        self._order = 0
        self._from_host: deque[tuple[float, _Queued]] = deque()
        self._later: list[tuple[float, _Queued]] = []
        self._ready: list[_Queued] = []
        self._on_wire: _Queued | None = None
        self._wire_free = self._now
        self._urgent_under_way = 0
        self._urgent_arrived = False
        self._inbox: list[Frame] = []
        self._timers_due = math.inf
        self._collect(self._now)

    @property
    def busy(self) -> float:
        """How long the wire has been busy so far [s]."""
        return self.bits * self._bit_time

    @property
    def bus_off(self) -> bool:
        """The host's controller is off the bus: `send` and `receive` raise, the nodes go on among themselves."""
        return self._bus_off

    @bus_off.setter
    def bus_off(self, off: bool) -> None:
        self._advance(self._loop.time())  # what was sent in time is on the wire
        self._bus_off = off
        self._urgent_under_way -= len([frame for _, (_, _, _, frame, _) in self._from_host if is_urgent(frame)])
        self._from_host.clear()

    # ------------------------------------------------------------------------------------------ the host's side

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire.

        Raises:
            DeviceLost: the host's controller is bus off.
        """
        if self._bus_off:
            raise _bus_off()
        now = self._loop.time()
        if now > self._now:
            self._advance(now)
        heard, late = (frame, 0.0) if self.disturb is None else self.disturb(frame, self._now)
        self._order += 1
        self._from_host.append((self._now + late, (_rank(frame), self._order, HOST, frame, heard)))
        if frame.id not in PROCESS_DATA and is_urgent(frame):
            self._urgent_under_way += 1
            self._advance(self._now)
            self._schedule()

    def receive(self) -> list[Frame]:
        """Everything that has reached the host since the last call, oldest first.

        Raises:
            DeviceLost: the host's controller is bus off.
        """
        if self._bus_off:
            raise _bus_off()
        self._advance(self._loop.time())
        frames, self._inbox = self._inbox, []
        self._urgent_arrived = False
        self._schedule()
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        """Call `wake` on the loop when urgent frames have arrived that `receive` has not yet given out."""
        self._wake = wake
        self._schedule()

    def close(self) -> None:
        """Stop waking anybody. What was sent still leaves: an adapter needs no host for that."""
        while self._from_host or self._on_wire is not None:
            self._advance(self._next_on_wire())
        self._wake = None
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def catch_up(self) -> None:
        """Let everything happen on the wire that is due by now: time passes here only when somebody looks."""
        self._advance(self._loop.time())

    def settle(self) -> None:
        """The same, and see to what a node was given past this wire."""
        self._advance(self._loop.time())
        self._catch_up(self._now)
        self._collect(self._now)
        self._schedule()

    # ------------------------------------------------------------------------------------------ waking the host

    def _schedule(self) -> None:
        """Look again when something urgent may have arrived, else a patrol after the host or we have looked."""
        if self._wake is None:
            return
        if self._urgent_arrived:
            when = self._now
        elif self._urgent_under_way:
            when = min(self._next_on_wire(), self._now + self._patrol)
        else:
            when = self._now + self._patrol
        if self._handle is not None:
            planned = self._handle.when()
            if planned == when or (self._urgent_under_way and planned < when):
                return  # it will look again then
            self._handle.cancel()
        self._handle = self._loop.call_at(when, self._look, when)

    def _look(self, when: float) -> None:
        self._handle = None
        self._advance(max(when, self._loop.time()))
        self._move_world(self._now)
        self._collect(self._now)
        if self._urgent_arrived and self._wake is not None:
            self._urgent_arrived = False
            self._wake()
        self._schedule()

    # ------------------------------------------------------------------------------------------ time

    def _advance(self, now: float) -> None:
        """Let everything happen that is due up to `now`, in the order of time; timers before the wire."""
        while True:
            wire = self._next_on_wire()
            due = self._timers_due
            if due <= wire:
                if due > now:
                    break
                self._run_timers(due)
            elif wire > now:
                break
            elif self._on_wire is not None:
                self._end_frame(wire)
            elif self._begin_frame(wire) <= now and self._wire_free < due:
                self._end_frame(self._wire_free)
        if now > self._now:
            self._now = now

    def _next_on_wire(self) -> float:
        """When the present frame ends, or the next begins."""
        if self._on_wire is not None or self._ready:
            return self._wire_free
        first = self._from_host[0][0] if self._from_host else math.inf
        if self._later and self._later[0][0] < first:
            first = self._later[0][0]
        return first if first > self._wire_free else self._wire_free

    def _begin_frame(self, now: float) -> float:
        """Arbitration: the lowest identifier among the frames that are ready takes the wire. Returns its end."""
        later, ready, from_host = self._later, self._ready, self._from_host
        while later and later[0][0] <= now:
            heappush(ready, heappop(later)[1])
        # The host's stand in a queue of their own: of the same rank, its frame is first.
        if from_host and from_host[0][0] <= now and (not ready or from_host[0][1][0] <= ready[0][0]):
            self._on_wire = winner = from_host.popleft()[1]
        else:
            self._on_wire = winner = heappop(ready)
        bits = frame_bits(winner[3])
        self.frames += 1
        self.bits += bits
        self._wire_free = end = now + bits * self._bit_time
        return end

    def _end_frame(self, now: float) -> None:
        """Every other station hears the frame."""
        assert self._on_wire is not None
        _, _, station, frame, heard = self._on_wire
        self._on_wire = None
        if self._urgent_under_way and is_urgent(frame):
            self._urgent_under_way -= 1
        if heard is None:
            return
        identifier = heard.id
        process_data = identifier in PROCESS_DATA
        if station == HOST:
            if identifier < ERROR_CONTROL:  # a heartbeat moves nothing
                self._catch_up(now)
        elif not self._bus_off:
            self._inbox.append(Frame(identifier, heard.data, heard.rtr, now))
            if not process_data and is_urgent(heard):
                self._urgent_arrived = True
        for node in self._others[station]:
            if identifier in node.hears:
                node.receive(heard, now)
        if station == HOST or not process_data:
            self._collect(now)
            return
        for node in self._nodes:  # what a drive says of itself starts no timer in another
            if node.outbox:
                self._collect(now)
                return

    def _run_timers(self, due: float) -> None:
        now = max(due, self._world_time)  # what an axis step caused was due "at once", before the world moved on
        self._catch_up(now)
        for node in self._nodes:
            if node.next_due <= now:
                node.advance(now)
        self._collect(now)

    def _catch_up(self, now: float) -> None:
        """Bring the world, and what the drives make of it, up to date."""
        if now - self._world_time >= RESOLUTION:
            self._move_world(now)

    def _move_world(self, now: float) -> None:
        self._world_time = now
        self._world.advance(now)
        for node in self._nodes:
            if node.next_due <= now:
                node.advance(now)

    def _collect(self, now: float) -> None:
        """Take over what the nodes want to send, and their next timer."""
        timers_due = math.inf
        for station, node in enumerate(self._nodes):
            if node.outbox:
                self._take_over(station, node.outbox, now)
            due = node.next_due
            if due < timers_due:
                timers_due = due
        self._timers_due = timers_due

    def _take_over(self, station: int, outbox: list[tuple[float, Frame]], now: float) -> None:
        for ready, frame in outbox:
            heard, late = (frame, 0.0) if self.disturb is None else self.disturb(frame, ready)
            if frame.id not in PROCESS_DATA and is_urgent(frame):
                self._urgent_under_way += 1
            self._order += 1
            queued = _rank(frame), self._order, station, frame, heard
            if ready + late <= now:
                heappush(self._ready, queued)
                self._wire_free = max(self._wire_free, now)
            else:
                heappush(self._later, (ready + late, queued))
        outbox.clear()


_Queued = tuple[int, int, int, Frame, Frame | None]
"""A frame that wants the wire: rank, number in the order of sending, station, the frame, and what the others hear."""


def _rank(frame: Frame) -> int:
    """Who wins the wire: the lower identifier, and data before a remote frame of the same (ISO 11898-1, 10.4.2.2)."""
    return frame.id << 1 | frame.rtr


def _bus_off() -> DeviceLost:
    return DeviceLost("CAN", "the simulated adapter is bus off; set bus_off to False to bring it back")
