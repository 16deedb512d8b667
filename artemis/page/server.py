"""The page's server: HTTP and WebSockets on a socket that is bound, for browsers that have paired."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from artemis.bridges.operator.frames import MalformedFrame
from artemis.bridges.page.session import StopPress, said
from artemis.page.access import Access
from artemis.page.hub import Hub
from artemis.page.paired import BUSY, HEADERS, REFUSED, PairedServer, body_of, peer_of
from artemis.page.runs_server import PastRuns

PAUSE = 0.02
"""Shortest time between two messages to a browser [s]."""
QUIET = 0.4
"""Interval of messages to a browser while nothing is new [s]."""
SLOW = 2.0
"""A browser that does not take a message within this time is disconnected [s]."""
MOST_WATCHING, MOST_WAITING = 16, 64


class PageServer(PairedServer):
    """Routes and connections of a run."""

    def __init__(self, hub: Hub, access: Access, key: bytes, url: str, runs: Sequence[Path] = ()) -> None:
        """`url`: how other computers reach it; `runs`: the folders whose past runs it shows."""
        self._hub = hub
        self._watching = 0
        routes = [
            Route("/stop", self._stop, methods=["POST"]),
            Route("/history", self._history),
            PastRuns(runs, self.is_paired).routes,
            WebSocketRoute("/telemetry", self._telemetry),
            WebSocketRoute("/control", self._control),
        ]
        super().__init__(access, key, url, "index.html", routes)

    def _refused(self, peer: str) -> None:
        self._hub.seats.tell("NET-07", f"{peer} gave a wrong or used code to pair", self._hub.now)

    # ------------------------------------------------------------------------------------------ pages

    async def _history(self, request: Request) -> Response:
        if not self.is_paired(request):
            return JSONResponse([], 403, HEADERS)
        return Response(self._hub.history(), headers=HEADERS, media_type="application/json")

    async def _stop(self, request: Request) -> Response:
        """Stop: from any paired browser, with or without control."""
        if not self.is_paired(request):
            return JSONResponse({}, 403, HEADERS)
        try:
            press = said(await body_of(request))
        except (MalformedFrame, ValueError):
            press = None
        if not isinstance(press, StopPress):
            return JSONResponse({}, 400, HEADERS)
        self._hub.seats.stop(peer_of(request), press, self._hub.now)
        self._hub.flush()
        return JSONResponse({"id": press.id}, 202 if self._hub.reaches_run else 503, HEADERS)

    # ------------------------------------------------------------------------------------------ what it sends

    async def _telemetry(self, link: WebSocket) -> None:
        if not self.is_paired(link):
            await link.close(REFUSED)
            return
        if self._watching >= MOST_WATCHING:
            await link.close(BUSY)
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
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                news, pieces, begin = hub.news, begin, []
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
                pieces.append(b'"age":%.3f' % (hub.now - hub.seen_at))
                text = (b"{" + b",".join(pieces) + b"}").decode()
                try:
                    await asyncio.wait_for(link.send_text(text), SLOW)
                except TimeoutError:
                    await link.close(BUSY)
                    return
                await asyncio.sleep(PAUSE)
                with suppress(TimeoutError):
                    await asyncio.wait_for(news.wait(), QUIET)

    # ------------------------------------------------------------------------------------------ what it receives

    async def _control(self, link: WebSocket) -> None:
        if not self.is_paired(link):
            await link.close(REFUSED)
            return
        if len(self._hub.sessions) >= MOST_WATCHING:
            await link.close(BUSY)
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
        session = hub.connected(peer_of(link), send)
        send(hub.seat(session))
        sending = asyncio.create_task(pass_on())
        try:
            while not session.closing:
                session.receive(await link.receive_text(), hub.now)
                hub.flush()
            await asyncio.sleep(0)  # its last message
            await link.close(REFUSED)
        except (WebSocketDisconnect, KeyError):  # KeyError: bytes, where only text is valid
            pass
        finally:
            sending.cancel()
            hub.disconnected(session)
