"""A run as who started it sees it: a service manager, or the page that waits (`artemis page`)."""

from __future__ import annotations

import asyncio
import os
import signal
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from artemis.app import Watch
from artemis.attendance import Operator
from artemis.clock import stopwatch
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.notify import READY, STATUS, STOPPING, ServiceManager
from artemis.progress import Answer
from artemis.values import Request, Tick

STATUS_EVERY = 1.0
"""Between two words on what the robot does [s]."""


def told_to(manager: ServiceManager, watch: Watch) -> Watch:
    """`watch`, and the manager, which is told from the ticks themselves: a run that does not tick says nothing."""
    if not manager.is_there:
        return watch
    shown, shown_at = "", -STATUS_EVERY
    begun = False

    def both(tick: Tick, traffic: Traffic) -> None:
        nonlocal shown, shown_at, begun
        watch(tick, traffic)
        now, words = stopwatch(), f"{tick.mode.value}: {tick.wish.phase}".removesuffix(": ")
        if not begun:
            begun = True
            manager.tell(READY)
        if words != shown and now - shown_at >= STATUS_EVERY:
            shown, shown_at = words, now
            manager.tell(STATUS + words)
        manager.alive(now)
        if tick.wish.finished:
            manager.tell(STOPPING)

    return both


@contextmanager
def report_unbroken() -> Iterator[None]:
    """What ends a run in order from outside, or hangs up its terminal, does not break its report off; Ctrl-C does."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def page_that_started() -> Operator:
    """Listens to the page that started this process and holds the other end of standard input; ends the run with it.

    Raises:
        ConfigError: no page holds it.
    """
    descriptor = 0
    try:
        held = stat.S_ISFIFO(os.fstat(descriptor).st_mode)
    except OSError:  # it is closed
        held = False
    if not held:
        raise ConfigError("--started-by-page: only `artemis page` starts a run in this way")

    def listen(request: Callable[[Request | Answer], None], _typed: object) -> Callable[[], None]:
        loop = asyncio.get_running_loop()

        def read() -> None:
            if not os.read(descriptor, 1024):
                loop.remove_reader(descriptor)
                request(Request.END)

        def stop() -> None:
            loop.remove_reader(descriptor)

        loop.add_reader(descriptor, read)
        return stop

    return listen
