"""Operators' links over TCP: the sockets around `RobotEnd`, on the running loop."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from pathlib import Path

from artemis.bridges.operator.robot_end import CLAIM_TIME, RobotEnd, RobotLink
from artemis.bridges.operator.session import BEAT_EVERY
from artemis.config import Config
from artemis.errors import ConfigError

MOST_UNSENT = 32768
"""Bytes that may wait for an operator who does not read; more are dropped, whole frames at a time."""
LINGER = 0.5
"""Time for the last frame of a connection that is closed [s]."""
BACKLOG = 16


class OperatorServer:
    """Takes connections and lets the robot's end talk."""

    def __init__(self, end: RobotEnd, reported: Callable[[], None]) -> None:
        """`reported` is called when there may be news."""
        self.end, self._reported = end, reported
        self._loop = asyncio.get_running_loop()
        self._links: dict[_LinkProtocol, RobotLink] = {}
        self._server: asyncio.Server | None = None
        self._beating: asyncio.TimerHandle | None = None

    async def begin(self, listening: socket.socket, tls: ssl.SSLContext | None) -> None:
        """Take connections on a socket that is bound."""
        limit = None if tls is None else CLAIM_TIME
        self._server = await self._loop.create_server(
            lambda: _LinkProtocol(self), sock=listening, ssl=tls, ssl_handshake_timeout=limit, backlog=BACKLOG
        )
        self._next = self._loop.time()
        self._beat()

    async def close(self, words: str) -> None:
        """Send a last frame and close everything."""
        if self._beating is not None:
            self._beating.cancel()
        if self._server is not None:
            self._server.close()
        self.end.end(words)
        self._flush()
        for _ in range(int(LINGER / BEAT_EVERY)):
            if not self._links:
                break
            await asyncio.sleep(BEAT_EVERY)
        for protocol in list(self._links):
            protocol.abort()
        await asyncio.sleep(0)

    def made(self, protocol: _LinkProtocol, peer: str) -> None:
        """A client connected."""
        self._links[protocol] = self.end.connected(peer, self._loop.time())
        self._flush()

    def received(self, protocol: _LinkProtocol, data: bytes) -> None:
        """Bytes came."""
        self._links[protocol].receive(data, self._loop.time())
        self._flush()

    def lost(self, protocol: _LinkProtocol) -> None:
        """A connection is gone."""
        self.end.disconnected(self._links.pop(protocol), self._loop.time())
        self._reported()

    def _beat(self) -> None:
        self._next = max(self._next + BEAT_EVERY, self._loop.time())
        self._beating = self._loop.call_at(self._next, self._beat)
        self.end.beat(self._loop.time())
        self._flush()

    def _flush(self) -> None:
        for protocol, link in list(self._links.items()):
            if link.output:
                protocol.send(bytes(link.output))
                link.output.clear()
            if link.closing:
                protocol.part()
        self._reported()


class _LinkProtocol(asyncio.Protocol):
    """One connection."""

    def __init__(self, server: OperatorServer) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._parting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        peer = transport.get_extra_info("peername")
        self._server.made(self, str(peer[0]) if peer else "nowhere")

    def data_received(self, data: bytes) -> None:
        self._server.received(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._parting is not None:
            self._parting.cancel()
        self._server.lost(self)

    def send(self, data: bytes) -> None:
        """Send whole frames, or drop them where others wait."""
        assert self._transport is not None
        if self._transport.get_write_buffer_size() <= MOST_UNSENT:
            self._transport.write(data)

    def part(self) -> None:
        """Close once all is sent, or soon."""
        assert self._transport is not None
        if self._parting is None:
            self._transport.close()
            self._parting = asyncio.get_running_loop().call_later(LINGER, self._transport.abort)

    def abort(self) -> None:
        """Close now."""
        assert self._transport is not None
        self._transport.abort()


class TlsFiles(Config):
    """A certificate and its key, in files (PEM), relative to the mission's folder."""

    certificate: str
    key: str
    """Not encrypted, and readable by its owner alone."""


def files_of_tls(tls: TlsFiles | None, folder: Path, name: str) -> tuple[Path, Path] | None:
    """Certificate and key of the plugin `name`, by names that are relative to a folder; None: it needs none.

    Raises:
        ConfigError: one of them is bad.
    """
    if tls is None:
        return None
    files = folder / tls.certificate, folder / tls.key
    try:
        tls_context(*files)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None
    return files


def tls_context(certificate: Path, key: Path) -> ssl.SSLContext:
    """A server's TLS, version 1.3.

    Raises:
        ConfigError: the files are none of a certificate and its key.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ValueError) as error:  # an SSLError is an OSError
        raise ConfigError(f"tls: {certificate}, {key}: {getattr(error, 'strerror', None) or error}") from None
    return context


def _no_password() -> str:
    raise ValueError("the key is encrypted, and artemis asks for no password: store it unencrypted")
