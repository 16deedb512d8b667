"""Connections that others make to us: bounded in number, and every one closed at the end."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress

MOST = 64
"""Connections at once, by default; of more the newest is closed."""
_ACCEPTED = 3
"""Turns of the loop until a connection that was accepted last is known here."""


class Connections:
    """Runs a coroutine for each connection; `accept` is what `asyncio.start_server` calls."""

    def __init__(
        self,
        serve: Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]],
        expected: tuple[type[Exception], ...],
        most: int = MOST,
    ) -> None:
        """`serve` may raise what is `expected` of connections that break."""
        self._serve, self._expected, self._most = serve, expected, most
        self._open: dict[asyncio.StreamWriter, asyncio.Task[None]] = {}

    def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a connection until it ends."""
        if len(self._open) >= self._most:
            writer.transport.abort()
            return
        self._open[writer] = asyncio.get_running_loop().create_task(self._run(reader, writer))

    async def close(self, server: asyncio.Server) -> None:
        """Close the server that listens, and every connection, also one that was accepted a moment ago.

        asyncio fails for a connection that it is about to accept when its server is closed, and leaves the socket open:
        so nothing is accepted any more first, then what was is taken in, then the server is closed.
        """
        for listening in server.sockets:
            asyncio.get_running_loop().remove_reader(listening)
        for _ in range(_ACCEPTED):
            await asyncio.sleep(0)
        server.close()
        ending = dict(self._open)
        for writer, task in ending.items():
            task.cancel()
            writer.transport.abort()  # here: a task that is cancelled before it began runs no line
        await asyncio.gather(*ending.values(), return_exceptions=True)
        await asyncio.sleep(0)  # what was aborted is given back
        self._open.clear()

    async def _run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            with suppress(*self._expected):
                await self._serve(reader, writer)
        finally:
            self._open.pop(writer, None)
            writer.close()
