"""A simulated serial line on a pseudo-terminal: any program that speaks with serial ports can open it (POSIX only)."""

from __future__ import annotations

import asyncio
import os
import tty
from contextlib import suppress

from artemis.sim.serial_wire import SerialWire

_MOST = 4096


class PseudoTerminal:
    """The computer's end of a simulated cable as a terminal of the system; needs a running loop."""

    def __init__(self, wire: SerialWire) -> None:
        """Make it. Raises OSError: the system has none left."""
        self._wire = wire
        self._master, self._slave = os.openpty()  # ours stays open, so that others may come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        """Its name for others."""
        wire.host = self._write
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._master, self._read)

    def close(self) -> None:
        """It is gone: who has it open sees its port lost."""
        self._loop.remove_reader(self._master)
        os.close(self._slave)
        os.close(self._master)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            self._wire.to_drive(os.read(self._master, _MOST))

    def _write(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # nobody reads: the computer's buffer runs over
            os.write(self._master, data)
