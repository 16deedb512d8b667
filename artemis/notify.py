"""Tells the service manager that started this process how it is (sd_notify(3), sd_watchdog_enabled(3)).

`artemis page` is one for the runs that it starts: it learns by the same words that they tick.
"""

from __future__ import annotations

import os
import socket
from collections.abc import MutableMapping
from contextlib import suppress
from math import inf

READY, STOPPING, WATCHDOG, STATUS = "READY=1", "STOPPING=1", "WATCHDOG=1", "STATUS="


class ServiceManager:
    """Who wants to know. Nothing is said where nobody does, or does not listen; it is never waited for."""

    def __init__(self, environment: MutableMapping[str, str] = os.environ) -> None:
        """Take its address out of the `environment`: processes that this one starts are not asked."""
        address = environment.pop("NOTIFY_SOCKET", "")
        period, process = environment.pop("WATCHDOG_USEC", ""), environment.pop("WATCHDOG_PID", "")
        asked = period.isdecimal() and process in ("", str(os.getpid()))
        self._every, self._next = (int(period) / 2e6, -inf) if asked else (inf, inf)
        self._link: socket.socket | None = None
        if address[:1] in ("/", "@") and address:
            self._link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._link.setblocking(False)
            self._address = "\0" + address[1:] if address[0] == "@" else address

    @property
    def is_there(self) -> bool:
        """Somebody wants to know."""
        return self._link is not None

    def tell(self, *words: str) -> None:
        """Say what changed."""
        if self._link is not None:
            with suppress(OSError):  # it is gone, or busy: the next word comes
                self._link.sendto("\n".join(words).encode(errors="replace"), self._address)

    def alive(self, now: float) -> None:
        """What matters works at `now` [s]: said twice in the time after which it would not be believed any more."""
        if now >= self._next:
            self._next = now + self._every
            self.tell(WATCHDOG)

    def close(self) -> None:
        """Say no more."""
        if self._link is not None:
            self._link.close()
            self._link = None
