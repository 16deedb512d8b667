"""What this process takes of its computer: memory, threads, open files. Growth means that something leaks."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path

SETTLED = 30.0
"""What is there after this time [s] is what a run needs."""
PERIOD = 1.0
"""Between two looks [s]."""
MORE_MEMORY, MORE_THREADS, MORE_FILES = 200_000_000, 20, 50
"""Growth beyond this is a leak [bytes, number, number]."""

MOST_MEMORY = 1_000_000_000
"""A process that grows and takes more than this [bytes] has to stop before the system ends it (PLG-05)."""

Usage = tuple[int, int, int]
"""Resident memory [bytes], threads, open files."""


def usage() -> Usage:
    """What this process takes now; 0 for what the system does not tell."""
    memory = files = 0
    statistics, descriptors = Path("/proc/self/statm"), Path("/proc/self/fd")
    if statistics.exists():
        memory = int(statistics.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        files = len(os.listdir(descriptors))
    return memory, threading.active_count(), files


class HostWatch:
    """Compares what the process takes with what it took when the run had settled."""

    def __init__(self, measure: Callable[[], Usage] = usage) -> None:
        self._measure = measure
        self._settled: Usage | None = None
        self._next = SETTLED

    def look(self, time: float) -> str | None:
        """At run time `time` [s]: what grew too much, in words. Cheap between two looks."""
        if time < self._next:
            return None
        self._next = time + PERIOD
        now = self._measure()
        if self._settled is None:
            self._settled = now
        grown = [after - before for after, before in zip(now, self._settled, strict=True)]
        if grown[0] > MORE_MEMORY:
            return f"{grown[0] / 1e6:.0f} MB more memory than at {SETTLED:g} s"
        if grown[1] > MORE_THREADS:
            return f"{grown[1]} more threads than at {SETTLED:g} s"
        return f"{grown[2]} more open files than at {SETTLED:g} s" if grown[2] > MORE_FILES else None
