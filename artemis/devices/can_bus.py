"""Frames, and the bus that carries them. The only file that imports python-can."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol


class Frame(NamedTuple):
    """One classic CAN data frame with an 11-bit identifier (or a remote frame, `rtr`)."""

    id: int
    data: bytes = b""
    rtr: bool = False
    time: float = 0.0
    """When it was on the bus, in the loop's time [s]; 0 before it was sent."""


class FrameBus(Protocol):
    """A bus as one node sees it: own frames never come back."""

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire at once.

        Raises:
            DeviceLost: the adapter is gone or refuses (bus off, queue full).
        """

    def receive(self) -> list[Frame]:
        """Everything that arrived since the last call, oldest first; never waits.

        Raises:
            DeviceLost: the adapter is gone.
        """

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the running loop call `wake` when frames wait that may be urgent (anything but process data)."""

    def close(self) -> None:
        """Give the adapter back; harmless when repeated."""
