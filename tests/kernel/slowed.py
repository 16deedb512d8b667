"""`artemis` under libfaketime, which does not know the call in which threads wait for an event (sem_clockwait)."""

from __future__ import annotations

import threading
import time

from artemis.cli import main

SLICE = 0.02
"""[s]."""


def wait(event: threading.Event, timeout: float | None = None) -> bool:
    """As `Event.wait`, by sleeping."""
    deadline = None if timeout is None else time.monotonic() + timeout
    while not event.is_set() and (deadline is None or time.monotonic() < deadline):
        time.sleep(SLICE)
    return event.is_set()


threading.Event.wait = wait  # type: ignore[assignment,method-assign]
main()
