"""A thread with an event loop of its own: no other thread waits for a peer."""

from __future__ import annotations

import asyncio
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

Data = TypeVar("Data")

END_TIME = 2.0
"""It has this long to end [s]; then it is left behind."""
MOST_WAITING = 64
"""Messages that may wait for the thread; a further sender waits, too."""
LOOK = 0.1
"""Between two looks whether the thread is still there [s]."""


class LoopThread(ABC):
    """One such thread, started by `start`."""

    def __init__(self, name: str) -> None:
        self._loop = asyncio.SelectorEventLoop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._end: asyncio.Event | None = None
        self._closed = False
        self._room = threading.Semaphore(MOST_WAITING)

    def start(self) -> None:
        """Take part."""
        self._end = asyncio.Event()
        self._thread.start()

    def close(self) -> None:
        """Leave; harmless when repeated."""
        if self._closed:
            return
        self._closed = True
        if self._end is None:
            self._give_back()
            self._loop.close()
            return
        self.soon(self._end.set)
        self._thread.join(END_TIME)

    def soon(self, callback: Callable[..., object], *arguments: Any) -> None:  # noqa: ANN401 (the callback's)
        """Have something called in the thread. Never waits."""
        with suppress(RuntimeError):  # the loop is closed: the thread has ended
            self._loop.call_soon_threadsafe(callback, *arguments)

    def hand_over(self, take: Callable[[Data], object], data: Data) -> None:
        """Have data taken in the thread; waits while `MOST_WAITING` lots wait there, unless it has ended."""
        while not self._room.acquire(timeout=LOOK):
            if not self._thread.is_alive():
                return
        self.soon(self._take_over, take, data)

    def _take_over(self, take: Callable[[Data], object], data: Data) -> None:
        self._room.release()
        take(data)

    def _run(self) -> None:
        assert self._end is not None
        try:
            with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
                runner.run(self._main(self._end))
        finally:
            self._give_back()

    @abstractmethod
    async def _main(self, end: asyncio.Event) -> None:
        """What it does, until `end` is set."""

    @abstractmethod
    def _give_back(self) -> None:
        """Close what was opened before the thread; also where that never began."""
