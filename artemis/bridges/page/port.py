"""The local socket between a run and the process of its page: that one reports what operators want.

The run listens under a name that only Linux's abstract namespace has, so nothing is left behind in a file system; who
connects must be the same user (SO_PEERCRED, unix(7)). Should the page's process be started again, it connects anew.
"""

from __future__ import annotations

import asyncio
import os
import socket
import struct
from collections.abc import Callable
from contextlib import suppress

import msgspec

from artemis.bridges.operator.session import AT_ONCE, LinkReport
from artemis.errors import ConfigError

LARGEST = 65536
"""Longest report [bytes]."""
ENDED = "the page's process has ended"
_DECODER = msgspec.msgpack.Decoder(LinkReport)


def name_of(run: int, plugin: str) -> str:
    """The socket's name: of the process `run` and the input `plugin`."""
    return f"\0artemis page {run} {plugin}"


def is_ours(connected: socket.socket) -> bool:
    """Whether the program at the other end runs for the same user, or for root."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    _, user, _ = struct.unpack("3i", credentials)
    return user in (os.getuid(), 0)


def connected_to(run: int, plugin: str) -> socket.socket | None:
    """A connection to that run; None: it does not listen yet."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        made.connect(name_of(run, plugin))
        if is_ours(made):
            made.setblocking(False)
            return made
    except OSError:
        pass
    made.close()
    return None


class PagePort:
    """The run's end. It never waits."""

    def __init__(self, plugin: str) -> None:
        """Listen.

        Raises:
            ConfigError: another process has the name.
        """
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listening.setblocking(False)
        try:
            self._listening.bind(name_of(os.getpid(), plugin))
        except OSError as error:
            self._listening.close()
            raise ConfigError(f"{plugin}: local socket: {error.strerror}") from None
        self._listening.listen(1)
        self._connection: socket.socket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._news: Callable[[], None] = lambda: None
        self._last = LinkReport()

    def watch(self, news: Callable[[], None]) -> None:
        """Have `news` called on the running loop when there are reports."""
        self._loop, self._news = asyncio.get_running_loop(), news
        self._loop.add_reader(self._listening, self._accept)

    def take(self) -> list[LinkReport]:
        """Reports since the last call, oldest first, not more than a tick has time for; what is left comes next.

        A page that is gone has left the seat without a word.
        """
        reports: list[LinkReport] = []
        for _ in range(AT_ONCE):
            if self._connection is None:
                break
            try:
                message = self._connection.recv(LARGEST)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if message:
                self._last = _DECODER.decode(message)
                reports.append(self._last)
                continue
            self._forget()
            if self._last.seat == "held":
                assert self._loop is not None
                self._last = LinkReport("lost", self._last.who, self._loop.time(), ENDED)
                reports.append(self._last)
        return reports

    def tell(self, status: bytes) -> None:
        """The page sees all ticks: nothing is published here."""

    def close(self) -> None:
        """End it; harmless when repeated."""
        self._forget()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.remove_reader(self._listening)
        self._loop = None
        self._listening.close()

    def _accept(self) -> None:
        with suppress(OSError):
            made, _ = self._listening.accept()
            if not is_ours(made):
                made.close()
                return
            self._news()  # what the last one sent goes first
            self._forget()
            made.setblocking(False)
            self._connection = made
            assert self._loop is not None
            self._loop.add_reader(made, self._news)

    def _forget(self) -> None:
        if self._connection is not None:
            if self._loop is not None and not self._loop.is_closed():
                self._loop.remove_reader(self._connection)
            self._connection.close()
        self._connection = None
