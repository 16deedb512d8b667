"""What every server of pages has: pairing, files, checks of where a request comes from; and how it is run."""

from __future__ import annotations

import asyncio
import re
import socket
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from hashlib import sha256
from pathlib import Path

import msgspec
import segno
import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp, Receive, Scope
from starlette.types import Send as AsgiSend
from starlette.websockets import WebSocket
from uvicorn.protocols.http.h11_impl import H11Protocol

from artemis.bridges.operator.server import tls_context
from artemis.errors import ConfigError
from artemis.page.access import PAIRED_TIME, Access, grouped, new_code

MOST_BODY = 512
MOST_CONNECTIONS, FIRST_REQUEST = 256, 3.0
"""Connections at the same time; and the time for a first request [s]."""
PING = 5.0
"""Interval of pings of a WebSocket, and time to answer one [s]."""
STATIC, SHARED = Path(__file__).with_name("static"), Path(__file__).parents[1] / "static"
"""The page's own files, and those that the reports of runs have, too."""
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_PART = re.compile(rb"<!-- (part_\w+\.html) -->\n")
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
GONE, REFUSED, BUSY = 1001, 4403, 4429
"""Why a WebSocket is closed."""


@cache
def _static_files() -> Mapping[str, tuple[bytes, str, str]]:
    """All files of the page by name: content, type and tag. Read once: what browsers ask for is only looked up.

    What pages have in common is in files of its own, for which a line of theirs stands.
    """
    files = [(file.name, file) for file in STATIC.iterdir()]
    files += [(f"uplot/{file.name}", file) for file in (SHARED / "uplot").iterdir()]
    read = {name: file.read_bytes() for name, file in files if file.suffix in TYPES}
    whole = {name: _PART.sub(lambda part: read[part[1].decode()], content) for name, content in read.items()}
    return {
        name: (content, TYPES[Path(name).suffix], f'"{sha256(content).hexdigest()[:16]}"')
        for name, content in whole.items()
    }


class AccessCheck:
    """Lets nothing pass that another site has a browser ask for."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: AsgiSend) -> None:
        """Answer, or pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        seen = HTTPConnection(scope)
        host, origin = seen.headers.get("host", ""), seen.headers.get("origin")
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        ours = self._access.is_our_host(host)
        if not ours or ((changes or origin) and not self._access.is_our_origin(origin, host)):
            if scope["type"] == "websocket":
                await WebSocket(scope, receive, send).close(REFUSED)
            else:
                await Response("not for pages of other sites\n", 403, HEADERS)(scope, receive, send)
            return
        await self._app(scope, receive, send)


class PairedServer:
    """Routes that every page has: they pair a browser, and give the page's files."""

    def __init__(self, access: Access, key: bytes, url: str, start: str, routes: Sequence[BaseRoute]) -> None:
        """`url`: how other computers reach it; `start`: the file that it begins with; `routes`: its own."""
        self._access, self._key, self._url, self._start = access, key, url, start
        shared = [
            Route("/", self._index),
            Route("/pair", self._pair_page),
            Route("/pair", self._pair, methods=["POST"]),
            Route("/invite", self._invite, methods=["POST"]),
            Route("/static/{name:path}", self._static),
        ]
        self.app = AccessCheck(Starlette(routes=[*shared, *routes]), access)

    def _refused(self, peer: str) -> None:
        """A wrong code was given."""

    def is_paired(self, connection: HTTPConnection) -> bool:
        """Whether its browser is."""
        return self._access.is_paired(connection.cookies.get(self._access.cookie))

    async def _index(self, request: Request) -> Response:
        if not self.is_paired(request):
            return RedirectResponse("/pair", 303, HEADERS)
        return file_answer(request, self._start)

    async def _pair_page(self, request: Request) -> Response:
        return file_answer(request, "pair.html")

    async def _static(self, request: Request) -> Response:
        return file_answer(request, request.path_params["name"])

    async def _pair(self, request: Request) -> Response:
        try:
            given = msgspec.json.decode(await body_of(request), type=dict[str, str])
            cookie = await self._access.pair(given.get("code", ""))
        except (ValueError, msgspec.DecodeError):
            cookie = None
        except ConfigError as error:
            return JSONResponse({"paired": False, "problem": str(error)}, 503, HEADERS)
        if cookie is None:
            self._refused(peer_of(request))
            return JSONResponse({"paired": False}, 403, HEADERS)
        paired = JSONResponse({"paired": True}, headers=HEADERS)
        secure = request.url.scheme == "https"
        paired.set_cookie(
            self._access.cookie, cookie, httponly=True, samesite="strict", secure=secure, max_age=PAIRED_TIME
        )
        return paired

    async def _invite(self, request: Request) -> Response:
        """A code for another browser, as an address and as rows of a QR code."""
        if not self.is_paired(request):
            return JSONResponse({}, 403, HEADERS)
        code = new_code(self._key)
        url = f"{self._url}/pair#{code}"
        rows = ["".join("1" if dark else "0" for dark in row) for row in segno.make(url, error="m").matrix]
        return JSONResponse({"url": url, "code": grouped(code), "rows": rows}, headers=HEADERS)


def peer_of(connection: HTTPConnection) -> str:
    """The address of the client."""
    return connection.client.host if connection.client else "unknown"


async def body_of(request: Request) -> bytes:
    """A short body. Raises ValueError: it is long."""
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MOST_BODY:
            raise ValueError
    return body


def file_answer(request: Request, name: str) -> Response:
    """A file of the page, unless the browser has it; 404 where there is none."""
    if (found := _static_files().get(name)) is None:
        return Response(status_code=404, headers=HEADERS)
    content, kind, tag = found
    headers = {**HEADERS, "Cache-Control": "no-cache", "ETag": tag}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return Response(content, headers=headers, media_type=kind)


class TimedProtocol(H11Protocol):
    """HTTP whose clients have a time for their first request: silent connections are closed, so that Stop has room."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait."""
        super().connection_made(transport)
        self._patience = self.loop.call_later(FIRST_REQUEST, transport.close)

    def data_received(self, data: bytes) -> None:
        """A whole request ends the wait, also one that makes a WebSocket of it."""
        super().data_received(data)
        if self.cycle is not None or self.transport.get_protocol() is not self:
            self._patience.cancel()

    def connection_lost(self, exc: Exception | None) -> None:
        """Do not wait for clients any more."""
        self._patience.cancel()
        super().connection_lost(exc)


class _Uvicorn(uvicorn.Server):
    """Signals are the business of the process."""

    def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
        """Take none."""
        return nullcontext()


async def serve(
    server: PairedServer, listening: socket.socket, end: asyncio.Event, tls: tuple[Path, Path] | None
) -> None:
    """Answer until `end` is set."""
    config = uvicorn.Config(
        server.app,
        http=TimedProtocol,
        ws="websockets-sansio",
        ws_max_size=2048,
        ws_per_message_deflate=False,
        ws_ping_interval=PING,
        ws_ping_timeout=PING,
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=1,
    )
    config.load()
    if tls is not None:
        config.ssl_certfile, config.ssl_keyfile = str(tls[0]), str(tls[1])
        config.ssl = tls_context(*tls)
    inner = _Uvicorn(config)
    answering = asyncio.create_task(inner.serve(sockets=[listening]))
    ending = asyncio.create_task(end.wait())
    await asyncio.wait((answering, ending), return_when=asyncio.FIRST_COMPLETED)
    inner.should_exit = True
    ending.cancel()
    await answering
