"""A serial port as one line of bytes. The only file that imports pyserial (the extra `serial`)."""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from artemis.build import install
from artemis.errors import DeviceLost

BAUD_RATES = (9600, 14400, 19200, 38400, 57600, 115200)
"""Rates of an EPOS [bit/s] (object 0x2002, EPOS firmware specification 2010, 14.34)."""


_MOST = 4096
"""Bytes that are read at once."""

_ADVICE = {
    errno.ENOENT: "is the adapter plugged in?",
    errno.EACCES: "may this user open it? On many systems: sudo usermod -aG dialout $USER, and log in again",
    errno.EBUSY: "does another program use it?",
    errno.EAGAIN: "does another program use it?",
}


def detected_ports() -> list[tuple[str, str]]:
    """Path and description of each port of this computer that some hardware stands behind; none without pyserial."""
    try:
        from serial.tools import list_ports
    except ImportError:
        return []
    return sorted((port.device, port.description) for port in list_ports.comports() if port.hwid != "n/a")


class SerialPort(Protocol):
    """A line of bytes to a drive. What arrives waits until it is read."""

    @property
    def name(self) -> str:
        """For people."""

    def write(self, data: bytes) -> None:
        """Send bytes; waits for nothing.

        Raises:
            DeviceLost: the port is gone.
        """

    def read(self) -> bytes:
        """Everything that arrived since the last call; never waits.

        Raises:
            DeviceLost: the port is gone.
        """

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the running loop call `wake` when bytes have arrived, or when the port is lost."""

    def close(self) -> None:
        """Give the port back; harmless when repeated."""


class TtyPort:
    """A `SerialPort` of this computer, for nobody else: 8 data bits, no parity, 1 stop bit; the loop reads it."""

    def __init__(self, path: str, baud: int) -> None:
        """Open it, and have its driver hand bytes on at once where it can: some hold them back for 16 ms.

        Raises:
            DeviceLost: it cannot be opened, or does not know the rate; or pyserial is not installed.
        """
        self.name = f"serial {path}"
        try:
            import serial
        except ImportError as error:
            raise DeviceLost(self.name, f"needs pyserial ({error}): {install('serial')}") from None
        self._loop = asyncio.get_running_loop()
        self._arrived = bytearray()
        self._problem: str | None = None
        self._wake: Callable[[], None] | None = None
        try:
            self._port = serial.Serial(path, baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # a SerialException is an OSError
            code = getattr(error, "errno", None)
            problem = os.strerror(code) if code else str(error)
            advice = _ADVICE.get(code or 0, "is it a serial port, and does it know this rate?")
            raise DeviceLost(self.name, f"cannot be opened: {problem}; {advice}") from error
        self._descriptor = self._port.fileno()
        with suppress(OSError, ValueError, AttributeError, NotImplementedError):  # of few drivers
            self._port.set_low_latency_mode(True)
        self._loop.add_reader(self._descriptor, self._take)

    def write(self, data: bytes) -> None:
        """Send bytes; waits for nothing. Raises DeviceLost: the port is gone, or takes no more."""
        if self._problem is not None:
            raise DeviceLost(self.name, self._problem)
        try:
            sent = os.write(self._descriptor, data)
        except OSError as error:
            self._lose(f"cannot be written to: {error.strerror}")
            raise DeviceLost(self.name, f"cannot be written to: {error.strerror}") from error
        if sent < len(data):
            raise DeviceLost(self.name, f"took {sent} of {len(data)} bytes")

    def read(self) -> bytes:
        """Everything that arrived since the last call; never waits. Raises DeviceLost: the port is gone."""
        arrived = bytes(self._arrived)
        self._arrived.clear()
        if not arrived and self._problem is not None:
            raise DeviceLost(self.name, self._problem)
        return arrived

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the running loop call `wake` when bytes have arrived, or when the port is lost."""
        self._wake = wake

    def close(self) -> None:
        """Give the port back; harmless when repeated."""
        self._wake = None
        self._lose("is closed")
        self._port.close()

    def _take(self) -> None:
        try:
            data = os.read(self._descriptor, _MOST)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(f"cannot be read: {error.strerror}")
        else:
            self._arrived += data
            if not data:  # its other end is gone
                self._lose("was unplugged")
        if self._wake is not None:
            self._wake()

    def _lose(self, problem: str) -> None:
        if self._problem is None:
            self._problem = problem
            self._loop.remove_reader(self._descriptor)
