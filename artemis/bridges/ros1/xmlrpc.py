"""XML-RPC (xmlrpc.com/spec) over HTTP on the running loop: a small server, and calls that give up in time."""

from __future__ import annotations

import asyncio
import os
import xmlrpc.client
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from artemis.bridges.ros1.connections import Connections

PATIENCE = 5.0
"""A peer has this long for an answer, and for the whole of a request once it is connected [s]."""
MOST_HEAD, MOST_BODY = 1 << 14, 1 << 22
"""Bytes of an HTTP head and of a body."""
Methods = Mapping[str, Callable[..., Any]]
BROKEN = (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError, ValueError)
"""What a connection raises that breaks, or carries something else."""


class CallError(Exception):
    """A call without an answer, with the reason."""


async def call(uri: str, method: str, *arguments: Any) -> Any:  # noqa: ANN401 (whatever the other end says)
    """The value that the method of the server at `uri` returns.

    Raises:
        CallError: there is no answer in time, or a fault.
    """
    try:
        async with asyncio.timeout(PATIENCE):
            return await _call(uri, method, arguments)
    except TimeoutError:
        raise CallError(f"{uri}: no answer within {PATIENCE:g} s") from None
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise CallError(f"{uri}: {reason.lower()}") from error
    except xmlrpc.client.Fault as error:
        raise CallError(f"{uri}: {method}: {error.faultString}") from error
    except (ExpatError, xmlrpc.client.Error, *BROKEN) as error:
        raise CallError(f"{uri}: {method}: no answer in XML-RPC: {error}") from error


async def _call(uri: str, method: str, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
    parts = urlsplit(uri)
    host, port = parts.hostname or "", parts.port or 80
    body = xmlrpc.client.dumps(arguments, method, allow_none=True).encode()
    head = f"POST {parts.path or '/'} HTTP/1.0\r\nHost: {host}:{port}\r\nContent-Type: text/xml\r\n"
    reader, writer = await asyncio.open_connection(host, port, limit=MOST_HEAD)
    try:
        writer.write(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
        status, headers = await _head(reader)
        if status.split(" ")[1:2] != ["200"]:
            raise ValueError(status)
        length = headers.get("content-length")
        answer = await reader.readexactly(_length(length)) if length else await _rest(reader)
    finally:
        writer.close()
    return xmlrpc.client.loads(answer)[0][0]


class XmlRpcServer:
    """Answers calls of methods."""

    def __init__(self, methods: Methods) -> None:
        self._methods = methods
        self.connections = Connections(self._serve, BROKEN)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await self._answer(reader, writer):
            pass

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Answer one request; whether another may follow."""
        async with asyncio.timeout(PATIENCE):
            request, headers = await _head(reader)
            body = await reader.readexactly(_length(headers.get("content-length", "0")))
        verb, _, version = request.partition(" ")[0], "", request.rpartition(" ")[2]
        if verb != "POST":
            writer.write(b"HTTP/1.0 501 Only POST\r\nContent-Length: 0\r\n\r\n")
            return False
        answer = self._result(body)
        lasts = version == "HTTP/1.1" and headers.get("connection", "").lower() != "close"
        head = f"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {len(answer)}\r\n"
        writer.write(f"{head}Connection: {'keep-alive' if lasts else 'close'}\r\n\r\n".encode() + answer)
        async with asyncio.timeout(PATIENCE):
            await writer.drain()
        return lasts

    def _result(self, body: bytes) -> bytes:
        """What is returned, or a fault, as a document."""
        try:
            arguments, name = xmlrpc.client.loads(body)
            value = self._methods[name or ""](*arguments)
        except (ExpatError, xmlrpc.client.Error, ValueError) as error:
            return _fault(f"no call in XML-RPC: {error}")
        except KeyError:
            return _fault(f"no method {name}")
        except TypeError:
            return _fault(f"{name}: wrong arguments")
        return xmlrpc.client.dumps((value,), methodresponse=True, allow_none=True).encode()


def _fault(text: str) -> bytes:
    return xmlrpc.client.dumps(xmlrpc.client.Fault(-1, text), methodresponse=True).encode()


async def _head(reader: asyncio.StreamReader) -> tuple[str, dict[str, str]]:
    """The first line of an HTTP message, and its headers by their names in small letters."""
    first, *lines = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
    pairs = (line.partition(":") for line in lines if line)
    return first, {name.strip().lower(): value.strip() for name, _, value in pairs}


def _length(text: str) -> int:
    if not text.isdigit() or int(text) > MOST_BODY:
        raise ValueError(f"a body of {text[:20]} bytes")
    return int(text)


async def _rest(reader: asyncio.StreamReader) -> bytes:
    data = b""
    while part := await reader.read(1 << 16):
        data += part
        if len(data) > MOST_BODY:
            raise ValueError(f"a body of more than {MOST_BODY} bytes")
    return data
