"""TCPROS (wiki.ros.org/ROS/TCPROS): connection headers, blocks of bytes, and a link to one subscriber."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections import deque
from collections.abc import Mapping

MOST_HEADER = 1 << 18
"""Bytes of a connection header: the definition of a type is in it."""
QUEUE = 64
"""Messages that may wait for a slow subscriber, by default; then the oldest is dropped."""
BUFFER = 1 << 16
"""Bytes that may wait in the connection before messages wait in the queue; the kernel has a buffer of its own."""
_LENGTH = struct.Struct("<I")


def pack_header(fields: Mapping[str, str]) -> bytes:
    """A connection header with its length."""
    items = [f"{name}={value}".encode() for name, value in fields.items()]
    return framed(b"".join(_LENGTH.pack(len(item)) + item for item in items))


def parse_header(data: bytes) -> dict[str, str]:
    """The fields of a connection header, without its length.

    Raises:
        ValueError: it is none.
    """
    fields: dict[str, str] = {}
    at = 0
    while at < len(data):
        if at + 4 > len(data):
            raise ValueError("a header that ends within a length")
        (length,) = _LENGTH.unpack_from(data, at)
        item = data[at + 4 : at + 4 + length]
        at += 4 + length
        name, equals, value = item.decode().partition("=")
        if len(item) < length or not equals:
            raise ValueError("a header with a field that is none")
        fields[name] = value
    return fields


def framed(data: bytes) -> bytes:
    """Bytes with their length in front."""
    return _LENGTH.pack(len(data)) + data


async def read_block(reader: asyncio.StreamReader, most: int) -> bytes:
    """Bytes preceded by their length.

    Raises:
        ValueError: they are more than `most`.
        IncompleteReadError: the other end has closed.
    """
    (length,) = _LENGTH.unpack(await reader.readexactly(4))
    if length > most:
        raise ValueError(f"a block of {length} bytes; at most {most} are expected")
    return await reader.readexactly(length)


class NewestBlock:
    """The newest of the blocks in a stream of bytes: of a thousand in a moment one is read."""

    def __init__(self, most: int) -> None:
        """`most`: longest block [bytes]."""
        self._most, self._rest = most, b""
        self.count = 0
        """Blocks that were whole so far."""

    def feed(self, data: bytes) -> bytes | None:
        """The newest block that is whole now; None: none is.

        Raises:
            ValueError: a block is longer than that; nothing after it can be read.
        """
        data, at, newest = self._rest + data, 0, None
        while len(data) - at >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(data, at)
            if length > self._most:
                raise ValueError(f"a block of {length} bytes; at most {self._most} are expected")
            if len(data) - at - _LENGTH.size < length:
                break
            newest, at = (at + _LENGTH.size, at + _LENGTH.size + length), at + _LENGTH.size + length
            self.count += 1
        self._rest = data[at:]
        return None if newest is None else data[newest[0] : newest[1]]


def set_up(writer: asyncio.StreamWriter) -> None:
    """Small messages leave at once, and a host that is gone is noticed."""
    connection: socket.socket = writer.get_extra_info("socket")
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)


class SubscriberLink:
    """The connection to one subscriber. It never waits: what it cannot take is queued, and then the oldest dropped."""

    def __init__(self, writer: asyncio.StreamWriter, name: str, queue: int = QUEUE) -> None:
        """`name` of the node at the other end."""
        self.name, self.dropped, self.sent = name, 0, 0
        self._writer, self._waiting = writer, deque[bytes](maxlen=queue)
        self._news = asyncio.Event()
        writer.transport.set_write_buffer_limits(high=BUFFER)

    def put(self, data: bytes) -> None:
        """Send framed bytes as soon as there is room."""
        self.dropped += len(self._waiting) == self._waiting.maxlen
        self._waiting.append(data)
        self._news.set()

    async def send(self) -> None:
        """Send what is put, until the connection breaks (OSError)."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                self._writer.write(self._waiting.popleft())
                self.sent += 1
                await self._writer.drain()

    def close(self) -> None:
        """Harmless when repeated; what waits is not sent."""
        self._writer.transport.abort()
