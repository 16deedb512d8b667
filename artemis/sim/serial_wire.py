"""A simulated serial cable between a computer's adapter and a drive: every byte takes its time, on the loop's time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Annotated

from pydantic import Field

from artemis.config import Config
from artemis.errors import DeviceLost

BITS = 10
"""Of a byte: start, 8 data bits, stop (communication guide 6.1)."""
ADAPTER_BUFFER = 62
"""So many bytes leave a USB adapter at once, be its timer run out or not (FTDI, AN232B-04, chapter 3.1)."""

Seconds = Annotated[float, Field(ge=0)]
Take = Callable[[bytes], None]


class SerialSettings(Config):
    """What differs from line to line."""

    baud: Annotated[int, Field(gt=0)] = 115200
    """Of the drive [bit/s]."""
    latency_s: Seconds = 0.0
    """A USB adapter hands over what came when so much has passed since it last did; 0: at once. Of FTDI's: 16 ms."""
    ready_time_s: Seconds = 0.0001
    """From the end of a byte or a frame to the drive's confirmation: an assumption."""
    time_limit_s: Seconds = 0.5
    """The drive waits so long for the next part of an exchange (object 0x2005)."""
    node_time_s: Seconds = 0.2
    """Its gateway waits so long for a node: an assumption. After the time limit nobody would hear of it."""


class SerialWire:
    """Both directions. Bytes in one write follow each other without a gap; they arrive together, with the last."""

    def __init__(self, settings: SerialSettings) -> None:
        self._loop = asyncio.get_running_loop()
        self._byte_time = BITS / settings.baud
        self._latency = settings.latency_s
        self.drive: Take = lambda data: None
        """Takes what arrives at the drive."""
        self.host: Take = lambda data: None
        """Takes what arrives at the computer."""
        self.busy = 0.0
        """So long the wire has carried bytes [s]."""
        self._free = [self._loop.time(), self._loop.time()]
        self._adapter = bytearray()
        self._handed_over = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None

    def to_drive(self, data: bytes) -> None:
        """The computer writes."""
        self._later(0, data, lambda data: self.drive(data))

    def to_host(self, data: bytes) -> None:
        """The drive writes."""
        self._later(1, data, self._reach_adapter)

    def _later(self, direction: int, data: bytes, take: Take) -> None:
        duration = len(data) * self._byte_time
        self.busy += duration
        self._free[direction] = end = max(self._loop.time(), self._free[direction]) + duration
        self._loop.call_at(end, take, data)

    def _reach_adapter(self, data: bytes) -> None:
        self._adapter += data
        now = self._loop.time()
        if not self._latency or len(self._adapter) >= ADAPTER_BUFFER:
            self._hand_over()
        elif self._timer is None:  # its timer runs all the time, and begins anew when it hands over
            periods = max(1, math.ceil((now - self._handed_over) / self._latency))
            self._timer = self._loop.call_at(self._handed_over + periods * self._latency, self._hand_over)

    def _hand_over(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        data, self._adapter = bytes(self._adapter), bytearray()
        self._handed_over = self._loop.time()
        self.host(data)


class SimSerialPort:
    """The computer's end of such a cable: a `SerialPort`."""

    def __init__(self, wire: SerialWire) -> None:
        self.name = "simulated serial line"
        self._wire, self._arrived = wire, bytearray()
        self._lost = ""
        self._wake: Callable[[], None] | None = None
        wire.host = self._take

    def write(self, data: bytes) -> None:
        """Send bytes. Raises DeviceLost: the port is gone."""
        if self._lost:
            raise DeviceLost(self.name, self._lost)
        self._wire.to_drive(data)

    def read(self) -> bytes:
        """Everything that arrived since the last call. Raises DeviceLost: the port is gone."""
        arrived = bytes(self._arrived)
        self._arrived.clear()
        if not arrived and self._lost:
            raise DeviceLost(self.name, self._lost)
        return arrived

    def listen(self, wake: Callable[[], None]) -> None:
        """Have `wake` called when bytes have arrived, or when the port is lost."""
        self._wake = wake

    def lose(self, problem: str) -> None:
        """From now on the port is gone."""
        self._lost = self._lost or problem
        if self._wake is not None:
            self._wake()

    def close(self) -> None:
        """Give the port back."""
        self._wake = None
        self.lose("is closed")

    def _take(self, data: bytes) -> None:
        if self._lost:
            return
        self._arrived += data
        if self._wake is not None:
            self._wake()
