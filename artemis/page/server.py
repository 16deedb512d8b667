"""The page's server: HTTP and WebSockets on a socket that is bound, for browsers that have paired."""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import segno
import uvicorn
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope
from starlette.types import Send as AsgiSend
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from artemis.bridges.operator.frames import MalformedFrame
from artemis.bridges.operator.server import tls_context
from artemis.bridges.page.session import StopPress, said
from artemis.page.access import Access, grouped, new_code
from artemis.page.hub import Hub
from artemis.page.runs_server import PastRuns

RATE = 20.0
"""States that a browser is sent in a second, at most."""
QUIET = 0.4
"""Without a new state a browser is told so often that the page itself is there [s]."""
SLOW = 2.0
"""A browser that does not take a message for so long is let go [s]."""
MOST_WATCHING, MOST_WAITING = 16, 64
MOST_BODY = 512
MOST_CONNECTIONS, FIRST_REQUEST = 256, 3.0
"""At once; and how long one may say nothing at first [s]."""
STATIC, SHARED = Path(__file__).with_name("static"), Path(__file__).parents[1] / "static"
"""The page's own files, and those that the reports of runs have, too."""
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
_GONE, _REFUSED, _BUSY = 1001, 4403, 4429


@cache
def static_file(name: str) -> tuple[bytes, str, str] | None:
    """Content, type and tag of a file of the page; None: there is none."""
    path = (SHARED if name.startswith("uplot/") else STATIC) / name
    inside = ".." not in name and any(path.is_relative_to(folder) for folder in (STATIC, SHARED))
    if not inside or path.suffix not in TYPES or not path.is_file():
        return None
    content = path.read_bytes()
    return content, TYPES[path.suffix], f'"{sha256(content).hexdigest()[:16]}"'


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
                await WebSocket(scope, receive, send).close(_REFUSED)
            else:
                await Response("not for pages of other sites\n", 403, HEADERS)(scope, receive, send)
            return
        await self._app(scope, receive, send)


class PageServer:
    """Routes and connections."""

    def __init__(self, hub: Hub, access: Access, key: bytes, url: str, runs: Sequence[Path] = ()) -> None:
        """`url`: how other computers reach it; `runs`: the folders whose past runs it shows."""
        self._hub, self._access, self._key, self._url = hub, access, key, url
        self._watching = 0
        routes = [
            Route("/", self._index),
            Route("/pair", self._pair_page),
            Route("/pair", self._pair, methods=["POST"]),
            Route("/stop", self._stop, methods=["POST"]),
            Route("/invite", self._invite, methods=["POST"]),
            Route("/history", self._history),
            Route("/static/{name:path}", self._static),
            PastRuns(runs, self._is_paired, _file, HEADERS).routes,
            WebSocketRoute("/telemetry", self._telemetry),
            WebSocketRoute("/control", self._control),
        ]
        self.app = AccessCheck(Starlette(routes=routes), access)

    # ------------------------------------------------------------------------------------------ pages

    def _is_paired(self, connection: HTTPConnection) -> bool:
        return self._access.is_paired(connection.cookies.get(self._access.cookie))

    async def _index(self, request: Request) -> Response:
        if not self._is_paired(request):
            return RedirectResponse("/pair", 303, HEADERS)
        return _file(request, "index.html")

    async def _pair_page(self, request: Request) -> Response:
        return _file(request, "pair.html")

    async def _static(self, request: Request) -> Response:
        return _file(request, request.path_params["name"])

    async def _pair(self, request: Request) -> Response:
        with suppress(ValueError, msgspec.DecodeError):
            given = msgspec.json.decode(await _body(request), type=dict[str, str])
            if (cookie := self._access.pair(given.get("code", ""))) is not None:
                paired = JSONResponse({"paired": True}, headers=HEADERS)
                secure = request.url.scheme == "https"
                paired.set_cookie(
                    self._access.cookie, cookie, httponly=True, samesite="strict", secure=secure, max_age=90 * 86400
                )
                return paired
        peer = request.client.host if request.client else "somebody"
        self._hub.seats.tell("NET-07", f"{peer} gave a wrong or used code to pair", self._hub.now)
        return JSONResponse({"paired": False}, 403, HEADERS)

    async def _invite(self, request: Request) -> Response:
        """A code for another browser, as an address and as rows of a QR code."""
        if not self._is_paired(request):
            return JSONResponse({}, 403, HEADERS)
        code = new_code(self._key)
        url = f"{self._url}/pair#{code}"
        rows = ["".join("1" if dark else "0" for dark in row) for row in segno.make(url, error="m").matrix]
        return JSONResponse({"url": url, "code": grouped(code), "rows": rows}, headers=HEADERS)

    async def _history(self, request: Request) -> Response:
        if not self._is_paired(request):
            return JSONResponse([], 403, HEADERS)
        return Response(self._hub.history(), headers=HEADERS, media_type="application/json")

    async def _stop(self, request: Request) -> Response:
        """Stop: whoever is paired, with or without control."""
        if not self._is_paired(request):
            return JSONResponse({}, 403, HEADERS)
        try:
            press = said(await _body(request))
        except (MalformedFrame, ValueError):
            press = None
        if not isinstance(press, StopPress):
            return JSONResponse({}, 400, HEADERS)
        peer = request.client.host if request.client else "somebody"
        self._hub.seats.stop(peer, press, self._hub.now)
        self._hub.flush()
        return JSONResponse({"id": press.id}, 202 if self._hub.reaches_run else 503, HEADERS)

    # ------------------------------------------------------------------------------------------ what it tells

    async def _telemetry(self, link: WebSocket) -> None:
        if not self._is_paired(link):
            await link.close(_REFUSED)
            return
        if self._watching >= MOST_WATCHING:
            await link.close(_BUSY)
            return
        await link.accept()
        self._watching += 1
        sending = asyncio.create_task(self._tell(link))
        try:
            while (await link.receive())["type"] != "websocket.disconnect":
                pass
        finally:
            self._watching -= 1
            sending.cancel()

    async def _tell(self, link: WebSocket) -> None:
        """Send what is new, as long as it is taken."""
        hub, known, line = self._hub, dict[str, int](), 0
        state: bytes | None = None
        begin = [b'"about":' + hub.about, b'"trail":' + hub.trail()]
        told = 0.0
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                pieces, begin = begin, []
                for name, (version, content) in hub.parts.items():
                    if known.get(name) != version:
                        known[name] = version
                        pieces.append(f'"{name}":'.encode() + content)
                if hub.log and hub.log[-1][0] > line:
                    new = [content for number, content in hub.log if number > line]
                    line = hub.log[-1][0]
                    pieces.append(b'"log":[' + b",".join(new) + b"]")
                if hub.state is not state and hub.state is not None:
                    state = hub.state
                    pieces.append(b'"state":' + state)
                if pieces or hub.now - told >= QUIET:
                    told = hub.now
                    pieces.append(b'"age":%.3f' % (hub.now - hub.seen_at))
                    text = (b"{" + b",".join(pieces) + b"}").decode()
                    try:
                        await asyncio.wait_for(link.send_text(text), SLOW)
                    except TimeoutError:
                        await link.close(_BUSY)
                        return
                await asyncio.sleep(1 / RATE)

    # ------------------------------------------------------------------------------------------ what it hears

    async def _control(self, link: WebSocket) -> None:
        if not self._is_paired(link):
            await link.close(_REFUSED)
            return
        if len(self._hub.sessions) >= MOST_WATCHING:
            await link.close(_BUSY)
            return
        await link.accept()
        waiting: deque[bytes] = deque(maxlen=MOST_WAITING)
        fresh = asyncio.Event()

        def send(message: dict[str, Any]) -> None:
            waiting.append(msgspec.json.encode(message))
            fresh.set()

        async def pass_on() -> None:
            with suppress(WebSocketDisconnect, RuntimeError):
                while True:
                    await fresh.wait()
                    fresh.clear()
                    while waiting:
                        await link.send_text(waiting.popleft().decode())

        hub = self._hub
        session = hub.connected(link.client.host if link.client else "somebody", send)
        send(hub.seat(session))
        sending = asyncio.create_task(pass_on())
        try:
            while not session.closing:
                session.receive(await link.receive_text(), hub.now)
                hub.flush()
            await asyncio.sleep(0)  # its last words
            await link.close(_REFUSED)
        except (WebSocketDisconnect, KeyError):  # KeyError: bytes, where only text is said
            pass
        finally:
            sending.cancel()
            hub.disconnected(session)


async def _body(request: Request) -> bytes:
    """A short body. Raises ValueError: it is long."""
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MOST_BODY:
            raise ValueError
    return body


def _file(request: Request, name: str) -> Response:
    if (found := static_file(name)) is None:
        return Response(status_code=404, headers=HEADERS)
    content, kind, tag = found
    headers = {**HEADERS, "Cache-Control": "no-cache", "ETag": tag}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return Response(content, headers=headers, media_type=kind)


class TimedProtocol(H11Protocol):
    """HTTP whose clients have a time for their first request: connections that say nothing leave room for Stop."""

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
        """Nobody is waited for any more."""
        self._patience.cancel()
        super().connection_lost(exc)


async def serve(
    server: PageServer, listening: socket.socket, end: asyncio.Event, tls: tuple[Path, Path] | None
) -> None:
    """Answer until `end` is set."""
    config = uvicorn.Config(
        server.app,
        http=TimedProtocol,
        ws="websockets-sansio",
        ws_max_size=2048,
        ws_per_message_deflate=False,
        ws_ping_interval=5.0,
        ws_ping_timeout=5.0,
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
    inner = uvicorn.Server(config)
    answering = asyncio.create_task(inner.serve(sockets=[listening]))
    ending = asyncio.create_task(end.wait())
    await asyncio.wait((answering, ending), return_when=asyncio.FIRST_COMPLETED)
    inner.should_exit = True
    ending.cancel()
    await answering
