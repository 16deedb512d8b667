"""A bus that is opened again after its adapter was lost: plugged in again, or back from bus off."""

from __future__ import annotations

from collections.abc import Callable

from artemis.devices.can_bus import Frame, FrameBus
from artemis.errors import DeviceLost

AGAIN = 1.0
"""Between two attempts to open the adapter again [s]."""


class ReopeningBus:
    """A `FrameBus` on an adapter that may come and go. While it is gone, sending and receiving raise DeviceLost."""

    def __init__(self, open: Callable[[], FrameBus], clock: Callable[[], float]) -> None:
        """Open the adapter; `open` is called again when it was lost, `clock` tells when [s].

        Raises:
            ConfigError, DeviceLost: as `open` does.
        """
        self._open, self._clock = open, clock
        self._bus: FrameBus | None = open()
        self._lost: DeviceLost | None = None
        self._next = 0.0
        self._wake: Callable[[], None] | None = None
        self._error_frames = 0
        self._closed = False

    @property
    def error_frames(self) -> int:
        """Error frames so far, over all adapters."""
        return self._error_frames + (0 if self._bus is None else self._bus.error_frames)

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire at once. Raises as the adapter does, and DeviceLost while it is gone."""
        self._present().send(frame)

    def receive(self) -> list[Frame]:
        """Everything that arrived since the last call; looks for the adapter now and then while it is gone.

        Raises:
            DeviceLost: the adapter is gone.
        """
        if self._bus is None and self._clock() >= self._next and not self._closed:
            self._try_again()
        bus = self._present()
        try:
            return bus.receive()
        except DeviceLost as error:
            self._lose(bus, error)
            raise

    def listen(self, wake: Callable[[], None]) -> None:
        """Have `wake` called when anything but process data arrived, or when the bus is lost."""
        self._wake = wake
        if self._bus is not None:
            self._bus.listen(wake)

    def close(self) -> None:
        """Give the adapter back; harmless when repeated."""
        self._closed = True
        if self._bus is not None:
            self._bus.close()

    def _present(self) -> FrameBus:
        if self._bus is None:
            assert self._lost is not None
            raise DeviceLost(self._lost.device, self._lost.problem)
        return self._bus

    def _lose(self, bus: FrameBus, error: DeviceLost) -> None:
        self._error_frames += bus.error_frames
        self._bus, self._lost, self._next = None, error, self._clock() + AGAIN
        bus.close()

    def _try_again(self) -> None:
        self._next = self._clock() + AGAIN
        try:
            self._bus = self._open()
        except DeviceLost as error:
            self._lost = error
            return
        if self._wake is not None:
            self._bus.listen(self._wake)
