"""`artemis` under libfaketime, which does not know the call in which threads wait for so long (sem_clockwait)."""

from __future__ import annotations

import threading
import time
from typing import Any

from artemis.cli import main

SLICE = 0.02
"""[s]."""
_forever = threading.Condition.wait


def wait(condition: Any, timeout: float | None = None) -> bool:  # noqa: ANN401 (attributes that have no types)
    """As `Condition.wait`, on which `Event.wait` is built, by sleeping."""
    if timeout is None:
        return _forever(condition)
    waiter = threading.Lock()
    waiter.acquire()
    condition._waiters.append(waiter)
    saved, deadline = condition._release_save(), time.monotonic() + timeout
    try:
        while not (woken := waiter.acquire(False)) and time.monotonic() < deadline:
            time.sleep(min(SLICE, timeout))
    finally:
        condition._acquire_restore(saved)
    if not woken and waiter in condition._waiters:
        condition._waiters.remove(waiter)
    return woken


threading.Condition.wait = wait  # type: ignore[assignment,method-assign]
main()
