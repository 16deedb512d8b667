"""Processes that do many runs."""

from __future__ import annotations

import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor


def fresh_workers(number: int) -> ProcessPoolExecutor:
    """So many processes that inherit nothing, and leave Ctrl-C to the one that started them."""
    fresh = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(number, mp_context=fresh, initializer=_leave_interrupts_alone)


def _leave_interrupts_alone() -> None:
    """Ctrl-C at a terminal reaches every process of the group. Blocked, as a run has a handler of its own for it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
