"""What a test of a run in real time may not be failed for."""

from __future__ import annotations

import os
import time
from collections import deque
from threading import Thread

import pytest

SYS_01 = 0.08
"""A tick that is so late [s] stops a robot."""
LATE_ROWS = ("SYS-01", "COM-08", "COM-11", "COM-28", "COM-29", "DRV-20")
"""Faults of runs whose host, or drives in another process, are late."""
_PERIOD = 0.02
_late: deque[tuple[float, float]] = deque(maxlen=10_000)
"""When this process woke up too late, on the clock of `time.time` [s], and how late it was [s]."""


def watch() -> None:
    """Begin to measure how late this process wakes up: as late as a control loop in its place."""
    Thread(target=_watch, name="lateness", daemon=True).start()


def _watch() -> None:
    while True:
        due = time.perf_counter() + _PERIOD
        time.sleep(_PERIOD)
        if (late := time.perf_counter() - due) > SYS_01:
            _late.append((time.time(), late))


def excuse(begun: float, ended: float, shown: str) -> str:
    """Why a failure in real time between two dates [s] proves nothing; empty: it does prove something.

    A run that it shows may have stopped itself, as the host, or drives in another process, were late. That this is no
    defect is shown by `--late`, which repeats the test alone.
    """
    if row := next((row for row in LATE_ROWS if f"{row} " in shown), None):
        return shown[shown.index(row) :].splitlines()[0]
    if late := max((late for at, late in _late if begun < at < ended + SYS_01), default=0.0):
        return f"{1000 * late:.0f} ms late"
    return "more than twice as many programs want to run as there are processors" if _is_busy() else ""


def skip_if_late(shown: str, *others: str) -> None:
    """A machine that is busy with something else stops a real-time run, rightly: then there is nothing to test.

    A late host says so itself. Drives in another process that answer too late (and `others`, which are faults too) are
    only believed to be late where more than twice as many programs want to run as there are processors.
    """
    for fault in (*LATE_ROWS, *others) if _is_busy() else ("SYS-01",):
        if fault in shown:
            pytest.skip(f"this machine is too busy for real time: {shown[shown.index(fault) :].splitlines()[0]}")


def _is_busy() -> bool:
    return os.getloadavg()[0] > 2 * (os.cpu_count() or 1)
