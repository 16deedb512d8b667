"""A simulated LMS100 as a TCP server, for any client that speaks its protocol."""

from __future__ import annotations

import asyncio

from artemis.sim.lms100 import Lms100

MOST_WAITING = 1 << 20
"""Bytes that wait for a client which does not read; then it is hung up on."""


async def serve_lms100(device: Lms100, host: str, port: int) -> asyncio.Server:
    """Take connections at a port, 0: a free one, until the server is closed. Raises OSError: it cannot be had."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        def send(data: bytes) -> None:
            if writer.transport.get_write_buffer_size() > MOST_WAITING:
                writer.transport.abort()
            elif not writer.is_closing():
                writer.write(data)

        try:
            line = device.connect(send, writer.close)
        except ConnectionRefusedError:
            writer.close()
            return
        try:
            while data := await reader.read(4096):
                line.receive(data)
        except ConnectionError:
            pass
        finally:
            device.leave(line)
            writer.close()

    return await asyncio.start_server(talk, host, port)
