"""The server of a page that waits: its messages to browsers, and theirs."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from math import inf
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from artemis.bridges.operator.frames import MalformedFrame
from artemis.page.access import Access
from artemis.page.mission_folder import MissionFolder, as_shown
from artemis.page.paired import BUSY, HEADERS, REFUSED, PairedServer, peer_of
from artemis.page.runs_server import PastRuns
from artemis.page.started_run import CANCEL_TIME, StartedRun
from artemis.page.waiting import Waiting, Watcher, wanted

MOST_WATCHING = 16
SLOW = 5.0
"""A browser that does not take a message within this time is disconnected [s]."""
PAUSE = 0.1
"""Shortest time between two messages to a browser [s]."""


class WaitingServer(PairedServer):
    """Routes and connections."""

    def __init__(self, waiting: Waiting, folder: MissionFolder, access: Access, key: bytes, url: str) -> None:
        """`url`: how other computers reach it."""
        self._waiting, self._folder = waiting, folder
        self.run: StartedRun | None = None
        """What was started."""
        self._watching: dict[Watcher, asyncio.Event] = {}
        routes = [
            Route("/missions", self._missions),
            PastRuns([folder.folder / "runs"], self.is_paired).routes,
            WebSocketRoute("/waiting", self._wait),
        ]
        super().__init__(access, key, url, "waiting.html", routes)

    def tell(self) -> None:
        """Send to every browser what is new."""
        for news in self._watching.values():
            news.set()

    def told(self) -> dict[str, Any]:
        """The message to every browser."""
        waiting, run = self._waiting, self.run
        started: dict[str, Any] | None = None
        if run is not None and waiting.chosen is not None:
            started = {"mission": waiting.chosen.mission, "file": waiting.chosen.file, "who": waiting.started_by}
            started |= {"status": run.status, "lines": run.lines()}
            started["cancelled"] = CANCEL_TIME if run.killed_at < inf else None
        return {
            "folder": self._folder.folder.name,
            "note": self._folder.note,
            "state": waiting.state,
            "missions": as_shown(self._folder.missions),
            "run": started,
            "last": waiting.last,
        }

    async def _missions(self, request: Request) -> Response:
        if not self.is_paired(request):
            return JSONResponse({}, 403, HEADERS)
        return Response(msgspec.json.encode(self.told()), headers=HEADERS, media_type="application/json")

    async def _wait(self, link: WebSocket) -> None:
        if not self.is_paired(link):
            await link.close(REFUSED)
            return
        if len(self._watching) >= MOST_WATCHING:
            await link.close(BUSY)
            return
        await link.accept()
        watcher, news = Watcher(peer_of(link)), asyncio.Event()
        self._watching[watcher] = news
        news.set()
        loop = asyncio.get_running_loop()
        telling = asyncio.create_task(self._tell(link, watcher, news))
        try:
            while watcher.may_say(loop.time()):
                self._waiting.obey(watcher, wanted(await link.receive_text()), loop.time())
            await link.close(BUSY)
        except MalformedFrame:
            await link.close(REFUSED)
        except (WebSocketDisconnect, KeyError):  # KeyError: bytes, where only text is valid
            pass
        finally:
            telling.cancel()
            del self._watching[watcher]
            self._waiting.left(watcher)

    async def _tell(self, link: WebSocket, watcher: Watcher, news: asyncio.Event) -> None:
        """Send what is newest, as long as it is taken."""
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await news.wait()
                news.clear()
                text = msgspec.json.encode({**self.told(), "seat": self._waiting.seat(watcher)}).decode()
                try:
                    await asyncio.wait_for(link.send_text(text), SLOW)
                except TimeoutError:
                    await link.close(BUSY)
                    return
                await asyncio.sleep(PAUSE)
