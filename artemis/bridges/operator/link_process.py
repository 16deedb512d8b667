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
from msgspec import Struct

from artemis.bridges.child_process import ChildProcess
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
    """The run's side of the process."""

    def __init__(self, listening: socket.socket, settings: LinkSettings) -> None:
        """Begin it; the socket is its own from now on."""
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ours.setblocking(False)
        self._loop: asyncio.AbstractEventLoop | None = None
        with theirs, listening:
            self._process = ChildProcess(["-m", __name__], [theirs.fileno(), listening.fileno()])
        self._ours.send(_ENCODER.encode(settings))

    def watch(self, news: Callable[[], None]) -> None:
        """Have `news` called on the running loop when there are reports."""
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._ours, news)

    def take(self) -> list[LinkReport]:
        """Reports since the last call, oldest first, not more than a tick has time for; what is left comes next.

        Raises:
            DeviceLost: the process has ended, and its last reports were taken.
        """
        reports: list[LinkReport] = []
        for _ in range(AT_ONCE):
            try:
                message = self._ours.recv(LARGEST)
            except BlockingIOError:
                return reports
            except OSError:
                message = b""
            if not message:
                self._forget()
                if reports:
                    return reports
                raise DeviceLost("operator link", f"its process has ended: {self._process.end()}")
            reports.append(_DECODER.decode(message))
        return reports

    def tell(self, status: bytes) -> None:
        """What the robot does, for the operator; dropped where the process does not keep up."""
        self._process.trim()
        with suppress(OSError):
            self._ours.send(status)

    def close(self) -> None:
        """End it; harmless when repeated."""
        self._forget()
        self._ours.close()
        self._process.wait(END_TIME)
        self._process.end()

    def _forget(self) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.remove_reader(self._ours)
        self._loop = None


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
    await over.wait()
    await server.close(RUN_OVER)


def main(port: int, listening: int) -> None:
    """Be the process: file descriptors of the pair of sockets and of the one that listens."""
    with socket.socket(fileno=port) as pair, socket.socket(fileno=listening) as bound:
        pair.setblocking(False)
        asyncio.run(serve(bound, pair))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
