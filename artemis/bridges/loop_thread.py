"""A thread with an event loop of its own: nobody else waits for a peer, whatever that does."""

from __future__ import annotations

import asyncio
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import Any

END_TIME = 2.0
"""It has this long to end [s]; then it is left behind."""


class LoopThread(ABC):
    """One such thread, begun by `start`."""

    def __init__(self, name: str) -> None:
        self._loop = asyncio.SelectorEventLoop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._end: asyncio.Event | None = None
        self._closed = False

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
        self._soon(self._end.set)
        self._thread.join(END_TIME)

    def _soon(self, callback: Callable[..., object], *arguments: Any) -> None:  # noqa: ANN401 (the callback's)
        """Have something called in the thread. Never waits."""
        with suppress(RuntimeError):  # the loop is closed: the thread has ended
            self._loop.call_soon_threadsafe(callback, *arguments)

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
