"""Between a run and the browsers: the newest of everything, sessions, and what goes to the run. On one running loop.

A sender takes the newest state when its browser is ready: a slow browser loses states, and costs no memory.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import msgspec

from artemis.bridges.background import BackgroundTasks
from artemis.bridges.operator.session import BEAT_EVERY
from artemis.bridges.page.port import connected_to
from artemis.bridges.page.session import PageSeats, PageSession, Send, ZoneChange
from artemis.errors import ArtemisError
from artemis.page.zones import ZoneFiles

KEPT_LOG = 400
_ENCODE = msgspec.msgpack.Encoder().encode
_JSON = msgspec.json.Encoder().encode

Update = Mapping[str, Any]


class Hub:
    """All that the connections share."""

    def __init__(self, runs: tuple[int, ...], plugin: str, zones: ZoneFiles | None = None) -> None:
        """`runs`: processes of which one may be the run; `plugin`: the name of its input; `zones` of its maps."""
        self._loop = asyncio.get_running_loop()
        self.seats = PageSeats(self._seat_changed)
        self.sessions: set[PageSession] = set()
        self.about: bytes = b"null"
        self.state: bytes | None = None
        self.seen_at = self._loop.time()
        """When the newest state came."""
        self.parts: dict[str, tuple[int, bytes]] = {}
        self.news = asyncio.Event()
        """Set when anything is new for browsers; another one takes its place."""
        self.log: deque[tuple[int, bytes]] = deque(maxlen=KEPT_LOG)
        self.trail: Callable[[], bytes] = lambda: b"[]"
        self.history: Callable[[], bytes] = lambda: b"[]"
        self.over = False
        self._lines = 0
        self._runs, self._plugin = runs, plugin
        self._run: socket.socket | None = None
        self._zones = zones
        self._disk = asyncio.Lock()
        self._changing = BackgroundTasks()
        self.seats.change_zones = self._order_change
        self._next = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self.seats.lose_run(self._loop.time())
        self._seat_changed()

    @property
    def now(self) -> float:
        """The loop's time [s]."""
        return self._loop.time()

    @property
    def reaches_run(self) -> bool:
        """What operators want can be passed on."""
        return self._run is not None

    def begin(self) -> None:
        """Beat, and look for the run."""
        self._look()
        self._beat()
        self._changing.begin(self._tell_zones())

    def close(self) -> None:
        """End what `begin` began."""
        if self._timer is not None:
            self._timer.cancel()
        if self._run is not None:
            self._loop.remove_reader(self._run)
            self._run.close()
            self._run = None

    def put(self, update: Update) -> None:
        """Take what is new of the run."""
        if "state" in update:
            self.state, self.seen_at = update["state"], self._loop.time()
        self.parts.update(update.get("parts", {}))
        for line in update.get("log", ()):
            self._lines += 1
            self.log.append((self._lines, line))
        self.over = self.over or bool(update.get("over"))
        self._wake()

    def connected(self, who: str, send: Send) -> PageSession:
        """A browser's connection for commands."""
        session = PageSession(self.seats, who, self._loop.time(), send)
        self.sessions.add(session)
        return session

    def disconnected(self, session: PageSession) -> None:
        """It is gone."""
        self.sessions.discard(session)
        session.left(self._loop.time())
        self.flush()

    def flush(self) -> None:
        """Report to the run what is new."""
        if self._run is None or not self.seats.has_news:
            return
        try:
            self._run.send(_ENCODE(self.seats.report))
        except BlockingIOError:  # the run is busy: reports are joined until it reads
            return
        except OSError:
            self._lose()
            return
        self.seats.begin_report()

    def seat(self, session: PageSession | None) -> dict[str, Any]:
        """The message to this browser about who has control."""
        owner = self.seats.owner
        return {
            "t": "seat",
            "who": "" if owner is None else owner.who,
            "mine": owner is not None and owner is session,
            "run": self.reaches_run,
        }

    def _seat_changed(self) -> None:
        owner = self.seats.owner
        self._put_part("seat", _JSON({"who": "" if owner is None else owner.who, "run": self.reaches_run}))
        for session in self.sessions:
            session.tell(self.seat(session))

    def _put_part(self, name: str, content: bytes) -> None:
        self.parts[name] = self.parts.get(name, (0, b""))[0] + 1, content
        self._wake()

    def _wake(self) -> None:
        news, self.news = self.news, asyncio.Event()
        news.set()

    # ------------------------------------------------------------------------------------------ zones

    def _order_change(self, change: ZoneChange, told: Callable[[str], None]) -> None:
        self._changing.begin(self._change(change, told))

    async def _change(self, change: ZoneChange, told: Callable[[str], None]) -> None:
        """In another thread: a disk takes longer than Stop may wait."""
        if self._zones is None:
            told("this run plans no routes: it has no zones")
            return
        try:
            async with self._disk:
                await asyncio.to_thread(self._zones.change, change)
            told("")
        except ArtemisError as error:
            told(str(error))
        await self._tell_zones()

    async def _tell_zones(self) -> None:
        if self._zones is not None:
            self._put_part("zones", _JSON(await asyncio.to_thread(self._zones.told)))

    # ------------------------------------------------------------------------------------------ the run

    def _beat(self) -> None:
        self._next = max(self._next + BEAT_EVERY, self._loop.time())
        self._timer = self._loop.call_at(self._next, self._beat)
        self._look()
        self.seats.beat(self._loop.time())
        self.flush()

    def _look(self) -> None:
        """Connect to the run where it listens."""
        if self._run is not None:
            return
        for run in self._runs:
            if (found := connected_to(run, self._plugin)) is not None:
                self._run = found
                self._loop.add_reader(found, self._heard)
                self.seats.has_news = self.seats.reached = True
                self._seat_changed()
                self.flush()
                return

    def _heard(self) -> None:
        """No report of the run arrives: it has ended, or its input was closed."""
        assert self._run is not None
        with suppress(BlockingIOError):
            try:
                if self._run.recv(1024):
                    return
            except ConnectionError:
                pass
            self._lose()

    def _lose(self) -> None:
        assert self._run is not None
        self._loop.remove_reader(self._run)
        self._run.close()
        self._run = None
        self.seats.lose_run(self._loop.time())
        self._seat_changed()
