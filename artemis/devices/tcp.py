"""Connections that carry bytes, and those over TCP."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

MOST = 1 << 16
"""Bytes that are read at once."""


class ByteStream(Protocol):
    """A connection that was made."""

    async def read(self) -> bytes:
        """What has come, as soon as there is something; nothing: the other end has closed. Raises OSError."""

    def write(self, data: bytes) -> None:
        """Have it sent; nothing waits for that. Raises OSError."""

    def close(self) -> None:
        """Harmless when repeated."""


Dial = Callable[[str, int], Awaitable[ByteStream]]
"""Connects to a host's port. Raises OSError."""


class TcpStream:
    """A connection over the network, on the running loop."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def read(self) -> bytes:
        """What has come, as soon as there is something; nothing: the other end has closed. Raises OSError."""
        return await self._reader.read(MOST)

    def write(self, data: bytes) -> None:
        """Have it sent; nothing waits for that. An error shows in the next `read`."""
        self._writer.write(data)

    def close(self) -> None:
        """Harmless when repeated."""
        self._writer.close()


async def dial(host: str, port: int) -> TcpStream:
    """Connect to a host's port. Raises OSError."""
    return TcpStream(*await asyncio.open_connection(host, port))
