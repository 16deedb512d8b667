"""A server of rosbridge in a thread of its own."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from artemis.bridges.background import BackgroundTasks
from artemis.bridges.json_messages import JsonMessages
from artemis.bridges.loop_thread import END_TIME, LoopThread
from artemis.bridges.rosbridge.session import QUEUE, ClientSession, Offer
from artemis.bridges.rosbridge.settings import ServerConfig

if TYPE_CHECKING:
    from socket import socket

    from websockets.asyncio.client import ClientConnection
    from websockets.asyncio.server import ServerConnection

MOST_CLIENTS = 32
"""Of a server; one that observers relay their clients to takes as many relays besides."""
MOST_MESSAGE = 1 << 12
"""Bytes of a client's message: commands are small."""
RATE, BURST = 200.0, 200.0
"""Messages of a client in a second, and at once: a client that sends more is disconnected."""
KEPT_OUT = 1.0
"""Its address is refused for this time then [s]."""
ALIVE = 5.0
"""A client without an answer for this time is regarded as gone [s]."""
_TRY_AGAIN, _TOO_MUCH = 1013, 1008


class RosbridgeServer(LoopThread):
    """One server; it answers from `start` on."""

    def __init__(
        self,
        plugin: str,
        listening: socket,
        offer: Offer,
        config: ServerConfig,
        *,
        queue: int = QUEUE,
        inputs: str = "",
        relayed: bool = False,
    ) -> None:
        """Have a socket that listens.

        Args:
            plugin: its name in the mission.
            listening: the socket; it is closed at the end.
            offer: what it has for its clients.
            config: its keys.
            queue: messages that wait for a slow client; then the oldest are dropped.
            inputs: URL of another server that takes what this one does not.
            relayed: it is such a server: each client of the other one is connected to it, too.
        """
        self._most = MOST_CLIENTS * (2 if relayed else 1)
        self._config, self._offer, self._queue, self._inputs = config, offer, queue, inputs
        self._messages = JsonMessages(config.ros)
        self._socket = listening
        self.port: int = listening.getsockname()[1]
        self._gone = 0
        self._sessions: dict[ClientSession, _Outbox] = {}
        self._number = 0
        self._kept_out: dict[str, float] = {}
        self._tasks = BackgroundTasks()
        super().__init__(plugin)

    def put(self, told: Sequence[tuple[str, bytes]]) -> None:
        """Publish to clients: absolute names of topics, and messages' JSON. Waits for no client."""
        self.hand_over(self._put, told)

    @property
    def wanted(self) -> set[str]:
        """Topics that a client is subscribed to."""
        return set().union(*(session.subscribed for session in tuple(self._sessions)))

    @property
    def problem(self) -> str:
        """Why no client is answered; empty: they are."""
        return "" if self._end is None or self._closed or self._thread.is_alive() else "its server has ended"

    @property
    def dropped(self) -> int:
        """Messages that clients did not take in time."""
        return self._gone + sum(outbox.dropped for outbox in tuple(self._sessions.values()))

    # ------------------------------------------------------------------------------------------ in the thread

    def _put(self, told: Sequence[tuple[str, bytes]]) -> None:
        now = self._loop.time()
        for session in self._sessions:
            session.look(now)
        for topic, data in told:
            message = b'{"op":"publish","topic":"' + topic.encode() + b'","msg":' + data + b"}"
            if (known := self._offer.told.get(topic)) is not None and known.latched:
                known.last = message
            for session in self._sessions:
                session.put(topic, message, now)

    def _give_back(self) -> None:
        self._socket.close()

    async def _main(self, end: asyncio.Event) -> None:
        from websockets.asyncio.server import ServerConnection, serve
        from websockets.typing import Origin

        connections = 2 * self._most

        class Bounded(ServerConnection):
            """Closed at once where too many are no clients yet, or one from there has just sent too much."""

            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                many = len(self.server.handler_tasks) > connections
                if (many or is_kept_out(transport)) and isinstance(transport, asyncio.Transport):
                    transport.abort()

        def is_kept_out(transport: asyncio.BaseTransport) -> bool:
            return self._kept_out.get(_address(transport), 0.0) > self._loop.time()

        origins = [None, *map(Origin, self._config.origins)]
        options: dict[str, Any] = {"compression": None, "max_size": MOST_MESSAGE, "close_timeout": END_TIME / 4}
        options |= {"ping_interval": ALIVE, "ping_timeout": ALIVE, "logger": _silent()}
        options |= {"create_connection": Bounded}
        async with serve(self._serve, sock=self._socket, origins=origins, **options):
            await end.wait()

    async def _serve(self, connection: ServerConnection) -> None:
        """One client, until it leaves."""
        from websockets.exceptions import ConnectionClosed

        if len(self._sessions) >= self._most:
            await connection.close(_TRY_AGAIN, f"{self._most} clients are the most")
            return
        self._number += 1
        outbox, now = _Outbox(self._queue), self._loop.time()
        name = f"client {self._number}"
        session = ClientSession(self._offer, name, outbox.put, self._messages, now, self._tasks.begin)
        relay = _Relay(self._inputs, outbox)
        self._sessions[session] = outbox
        beside = [asyncio.ensure_future(work) for work in (outbox.send(connection), relay.begin())]
        tokens, filled = BURST, now
        try:
            async for text in connection:
                now = self._loop.time()
                tokens, filled = min(tokens + (now - filled) * RATE, BURST) - 1.0, now
                if tokens < 0.0:
                    self._keep_out(_address(connection.transport), now)
                    await connection.close(_TOO_MUCH, f"more than {RATE:g} messages in a second")
                    return
                if not session.take(text, now):
                    await relay.take(text, session)
        except ConnectionClosed:
            pass
        finally:
            del self._sessions[session]
            self._gone += outbox.dropped
            for task in beside:
                task.cancel()
            await asyncio.gather(*beside, relay.close(), return_exceptions=True)

    def _keep_out(self, address: str, now: float) -> None:
        self._kept_out = {other: until for other, until in self._kept_out.items() if until > now}
        self._kept_out[address] = now + KEPT_OUT


def _address(transport: asyncio.BaseTransport) -> str:
    peer = transport.get_extra_info("peername")
    return str(peer[0]) if peer else ""


class _Outbox:
    """What waits for one client."""

    def __init__(self, queue: int) -> None:
        self.dropped = 0
        self._waiting, self._news = deque[bytes](maxlen=queue), asyncio.Event()

    def put(self, data: bytes) -> None:
        """Send it as soon as there is room."""
        self.dropped += len(self._waiting) == self._waiting.maxlen
        self._waiting.append(data)
        self._news.set()

    async def send(self, connection: ServerConnection) -> None:
        """Send what is put, until the connection ends."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                await connection.send(self._waiting.popleft().decode())


class _Relay:
    """A client's second connection, to the server of an input, if there is one: made as soon as the first."""

    def __init__(self, url: str, outbox: _Outbox) -> None:
        self._url, self._outbox = url, outbox
        self._link: ClientConnection | None = None
        self._hearing: asyncio.Task[None] | None = None
        self._one = asyncio.Lock()

    async def begin(self) -> None:
        """Connect; if that fails, it is tried again for the first command."""
        from websockets.exceptions import WebSocketException

        if self._url:
            with suppress(OSError, TimeoutError, WebSocketException):
                await self._connect()

    async def take(self, text: str | bytes, session: ClientSession) -> None:
        """Pass on the messages of a client."""
        from websockets.exceptions import WebSocketException

        try:
            link = await self._connect()
            await link.send(text)
        except (OSError, TimeoutError, WebSocketException) as error:
            self._link = None
            session.say("error", f"the input at {self._url} does not take commands: {error}")

    async def _connect(self) -> ClientConnection:
        from websockets.asyncio.client import connect

        async with self._one:
            if self._link is None:
                options: dict[str, Any] = {"compression": None, "close_timeout": END_TIME / 4, "proxy": None}
                self._link = await connect(self._url, open_timeout=1.0, **options)
                self._hearing = asyncio.ensure_future(self._hear(self._link))
            return self._link

    async def close(self) -> None:
        """Harmless when repeated."""
        if self._link is not None and self._hearing is not None:
            await self._link.close()
            await asyncio.gather(self._hearing, return_exceptions=True)

    async def _hear(self, link: ClientConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        with suppress(ConnectionClosed):
            async for text in link:
                self._outbox.put(text if isinstance(text, bytes) else text.encode())
        self._link = None


def _silent() -> Any:  # noqa: ANN401 (a logger)
    """Clients that break off are no news."""
    import logging

    logger = logging.getLogger("artemis.rosbridge")
    logger.disabled = True
    return logger
