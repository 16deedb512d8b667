"""Real and simulated event loops. Everything else asks the loop for the time; nothing else imports `time`."""

from __future__ import annotations

import asyncio
import gc
import selectors
import time
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from typing import Any, TypeVar

Result = TypeVar("Result")


POLL_EVERY = 16
"""On virtual time descriptors (signals, keys) are looked at in every so many turns of the loop: a look costs 1.5 us."""


class _JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting for the next timer, moves the loop's time there. Real descriptors are still polled."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0
        self._turns = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Poll descriptors now and then; when none is ready, jump `timeout` seconds ahead instead of sleeping."""
        if timeout is None:
            return super().select(None)  # nothing scheduled: only a descriptor (a signal) can wake us
        self._turns += 1
        ready = super().select(0) if self._turns % POLL_EVERY == 0 else []
        if not ready and timeout > 0:
            self.now += timeout
        return ready


class SimulatedLoop(asyncio.SelectorEventLoop):
    """An asyncio loop on virtual time: starts at 0 s and jumps to the next timer."""

    def __init__(self) -> None:
        self._selector_with_time = _JumpingSelector()
        super().__init__(self._selector_with_time)

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._selector_with_time.now

    def skip(self, seconds: float) -> None:
        """Let time pass in which nothing runs: every timer that falls into it is late."""
        self._selector_with_time.now += seconds


class RealTimeLoop(asyncio.SelectorEventLoop):
    """An asyncio loop on real time. What is loaded before it is made takes no part in garbage collections.

    A full collection of all that artemis imports holds every thread up for 30 to 150 ms: longer than a robot may be
    without commands (SYS-01). One of what a run itself makes takes a few milliseconds.
    """

    def __init__(self) -> None:
        super().__init__()
        gc.unfreeze()  # what an earlier loop kept, and is garbage by now
        gc.collect()
        gc.freeze()


def run(main: Coroutine[Any, Any, Result], *, simulated: bool) -> Result:
    """Run `main` to its end on virtual (`simulated`) or real time."""
    factory: Callable[[], asyncio.AbstractEventLoop] = SimulatedLoop if simulated else RealTimeLoop
    with asyncio.Runner(loop_factory=factory) as runner:
        return runner.run(main)


async def until(deadline: float) -> None:
    """Wait until the running loop's time is `deadline`; returns at once if that is past."""
    loop = asyncio.get_running_loop()
    delay = deadline - loop.time()
    if delay <= 0:
        return
    reached = loop.create_future()
    handle = loop.call_at(deadline, _finish, reached)
    try:
        await reached
    finally:
        handle.cancel()


def _finish(future: asyncio.Future[None]) -> None:
    if not future.done():  # cancelled in the very turn in which its time came
        future.set_result(None)


def stall(seconds: float) -> None:
    """Hold the running loop up, as code does that takes too long; without a loop nothing is held up."""
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        return
    hold = loop.skip if isinstance(loop, SimulatedLoop) else time.sleep  # on virtual time nothing is waited for
    hold(seconds)


def wall_date() -> datetime:
    """The date and time on the wall, in UTC: for names of files and for people."""
    return datetime.now(UTC)


cpu_time = time.process_time
"""Seconds that the processors have spent on this process, in all its threads (for statistics, likewise)."""
stopwatch = time.perf_counter
"""Seconds on a clock that only measures durations (for statistics, never for control)."""
