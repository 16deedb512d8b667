"""The process in which a robot's end of operators' links runs: whatever comes from the network, no tick waits for it.

Both processes share a pair of sockets that keeps messages apart: settings and states go in, reports come out. It is
also how each notices that the other is gone.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec import Struct, structs

from artemis.bridges.child_process import ENDED, ChildProcess, Restarts
from artemis.bridges.operator.frames import RUN_OVER
from artemis.bridges.operator.robot_end import RobotEnd
from artemis.bridges.operator.server import OperatorServer, tls_context
from artemis.bridges.operator.session import AT_ONCE, LinkReport
from artemis.errors import DeviceLost
from artemis.values import Request

LARGEST = 65536
"""Longest message between the processes [bytes]."""
END_TIME = 2.0
"""The process has this long to end [s]."""
WORKS = b"works"
"""Message of the process once operators can connect."""
_DECODER, _ENCODER = msgspec.msgpack.Decoder(LinkReport), msgspec.msgpack.Encoder()


class LinkSettings(Struct, frozen=True):
    """What the process has to know."""

    secret: bytes
    welcome: bytes
    allow: tuple[Request, ...]
    certificate: str = ""
    key: str = ""
    """Files of TLS; empty: without."""


class LinkProcess:
    """The run's side of the process. One that ends is restarted, on the same socket, with no operator in the seat."""

    def __init__(self, listening: socket.socket, settings: LinkSettings) -> None:
        """Begin it; the socket is open as long as this is."""
        self._listening, self._first = listening, _ENCODER.encode(settings)
        self._news: Callable[[], None] = lambda: None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._last, self._why = LinkReport(), ""
        self._restarts = Restarts()
        self._ours: socket.socket | None = None
        self._begin()

    def watch(self, news: Callable[[], None]) -> None:
        """Have `news` called on the running loop when there are reports."""
        self._loop, self._news = asyncio.get_running_loop(), news
        if self._ours is not None:
            self._loop.add_reader(self._ours, news)

    def take(self) -> list[LinkReport]:
        """Reports since the last call, oldest first, not more than a tick has time for; what is left comes next.

        Raises:
            DeviceLost: no process can be started, and the last reports of the one that ended were taken.
        """
        reports: list[LinkReport] = []
        if self._ours is None and self._restarts.due:
            self._begin_again()
        while self._ours is not None and len(reports) < AT_ONCE:
            try:
                message = self._ours.recv(LARGEST)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if not message:
                reports.append(self._ended(self._ours))
                break
            self._restarts.works()
            if message != WORKS:
                self._last = _DECODER.decode(message)
                reports.append(self._last)
        if words := self._restarts.take():
            problems = [(ENDED, each) for each in words]
            reports.append(structs.replace(self._last, problems=problems, requests=[], given=[], late=None))
        if self._restarts.fails and not reports:
            raise DeviceLost("operator link", f"its process has ended: {self._why}")
        return reports

    def tell(self, status: bytes) -> None:
        """What the robot does, for the operator; dropped where the process does not keep up."""
        if self._ours is not None:
            self._process.trim()
            with suppress(OSError):
                self._ours.send(status)

    def close(self) -> None:
        """End it; harmless when repeated."""
        if self._ours is not None:
            self._forget(self._ours)
            self._process.wait(END_TIME)
        self._process.end()
        self._listening.close()

    def _begin(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        try:
            with theirs:
                self._process = ChildProcess(["-m", __name__], [theirs.fileno(), self._listening.fileno()])
        except OSError:
            ours.close()
            raise
        ours.send(self._first)
        self._ours = ours
        if self._loop is not None:
            self._loop.add_reader(ours, self._news)

    def _begin_again(self) -> None:
        self._restarts.begin()
        try:
            self._begin()
        except OSError as error:
            self._why = f"it cannot be started: {error.strerror}"
            self._restarts.ended(self._why)

    def _ended(self, ours: socket.socket) -> LinkReport:
        """The process has ended: start another one, and report the loss of the seat."""
        self._forget(ours)
        self._why = self._process.end()
        self._restarts.ended(f"the link's process: {self._why}")
        if self._last.seat == "held":
            assert self._loop is not None
            self._last = LinkReport("lost", self._last.who, self._loop.time(), f"the link's process: {self._why}")
        else:
            self._last = structs.replace(self._last, problems=[], requests=[], given=[])
        if self._restarts.due:
            self._begin_again()
        return self._last

    def _forget(self, ours: socket.socket) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.remove_reader(ours)
        ours.close()
        self._ours = None


async def serve(listening: socket.socket, port: socket.socket) -> None:
    """Be the process, until the other end of `port` is closed."""
    loop, over = asyncio.get_running_loop(), asyncio.Event()
    settings = msgspec.msgpack.decode(await loop.sock_recv(port, LARGEST), type=LinkSettings)
    end = RobotEnd(settings.secret, settings.welcome, settings.allow)

    def reported() -> None:
        if end.has_news and not over.is_set():
            try:
                port.send(_ENCODER.encode(end.report))
            except BlockingIOError:  # the run is busy: reports are joined until it reads
                return
            except OSError:
                over.set()
                return
            end.begin_report()

    def told() -> None:
        try:
            message = port.recv(LARGEST)
        except BlockingIOError:
            return
        except OSError:
            message = b""
        if not message:
            loop.remove_reader(port)
            over.set()
        else:
            end.status = message

    server = OperatorServer(end, reported)
    tls = tls_context(Path(settings.certificate), Path(settings.key)) if settings.certificate else None
    await server.begin(listening, tls)
    loop.add_reader(port, told)
    with suppress(BlockingIOError):
        port.send(WORKS)
    await over.wait()
    await server.close(RUN_OVER)


def main(port: int, listening: int) -> None:
    """Be the process: file descriptors of the pair of sockets and of the one that listens."""
    with socket.socket(fileno=port) as pair, socket.socket(fileno=listening) as bound:
        pair.setblocking(False)
        asyncio.run(serve(bound, pair))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
