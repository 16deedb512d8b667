"""Simulated drives on a real bus that are watched: what they heard of the host, when they tripped, when they stood."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Container
from dataclasses import dataclass

from artemis.devices.can_bus import CanBus, Frame
from artemis.drive_states import DriveState
from artemis.sim.epos import SimEpos
from artemis.sim.world import World

EMCY, HEARTBEAT = 0x080, 0x700
HEARTBEAT_LOST = b"\x30\x81"
REACTING = {DriveState.FAULT_REACTION_ENABLED, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trip:
    """A drive went to fault. Times are the drive's own [s]."""

    time: float
    heard: float
    """When the drive heard the host's last heartbeat."""
    beats: int
    """How many it had heard."""
    before: DriveState
    rpm: float
    """Speed of the motor."""
    ramp: float
    """Deceleration of the quick stop that begins [rpm/s]."""

    @property
    def latency(self) -> float:
        """From the last heartbeat to the quick stop [s]."""
        return self.time - self.heard


class WatchedDrive:
    """A simulated drive as the wire meets it."""

    def __init__(self, node: SimEpos, host: int) -> None:
        self.name = node.name
        self.outbox = node.outbox
        self.trips: list[Trip] = []
        self.enabled = 0.0
        """When its power stage last began to obey set-points."""
        self.stands_from: float | None = None
        """Since when the motor stands; None: it turns."""
        self._node = node
        self._heartbeat = HEARTBEAT + host
        self._heard, self._beats = 0.0, 0
        self._state = node.state

    @property
    def next_due(self) -> float:
        return self._node.next_due

    @property
    def hears(self) -> Container[int]:
        return self._node.hears

    def receive(self, frame: Frame, now: float) -> None:
        self._node.receive(frame, now)
        self._look(now)
        if frame.id == self._heartbeat:
            self._heard = now
            self._beats += 1

    def advance(self, now: float) -> None:
        self._node.advance(now)
        self._look(now)

    def look_at_motor(self, now: float) -> None:
        if self._node.axis.velocity != 0.0:
            self.stands_from = None
        elif self.stands_from is None:
            self.stands_from = now

    def _look(self, now: float) -> None:
        before, self._state = self._state, self._node.state
        if self._state is before:
            return
        if self._state is DriveState.OPERATION_ENABLE:
            self.enabled = now
        if self._state in REACTING and before not in REACTING:
            axis = self._node.axis
            self.trips.append(
                Trip(
                    time=now,
                    heard=self._heard,
                    beats=self._beats,
                    before=before,
                    rpm=axis.velocity,
                    ramp=axis.deceleration,
                )
            )


class WatchedWorld:
    """The simulated robot with its watched drives."""

    def __init__(self, world: World, host: int) -> None:
        self.nodes = [WatchedDrive(node, host) for node in world.nodes]
        self._world = world

    def advance(self, now: float) -> None:
        self._world.advance(now)
        for node in self.nodes:
            node.look_at_motor(now)


class WatchedBus:
    """A bus that keeps when heartbeats and reports were on it, whenever the drives came to hear and send them."""

    def __init__(self, words: dict[str, object], host: int) -> None:
        self.beats: list[float] = []
        """When the kernel took in each heartbeat of the host, on the loop's clock [s]."""
        self.reports: list[float] = []
        """When drives reported that they miss the host."""
        self._bus = CanBus(words)
        self._heartbeat = HEARTBEAT + host
        self._loop = asyncio.get_running_loop()

    @property
    def error_frames(self) -> int:
        return self._bus.error_frames

    def send(self, frame: Frame) -> None:
        self._bus.send(frame)
        if EMCY < frame.id < EMCY + 0x80 and frame.data[:2] == HEARTBEAT_LOST:
            self.reports.append(self._loop.time())

    def receive(self) -> list[Frame]:
        frames = self._bus.receive()
        self.beats += (frame.time for frame in frames if frame.id == self._heartbeat)
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        self._bus.listen(wake)

    def close(self) -> None:
        self._bus.close()
