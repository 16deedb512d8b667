"""A process beside the ticks for what takes longer than one: it computes, and has nothing else of the run."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection, wait
from typing import TypeVar

from artemis.values import Job, JobResult

Done = TypeVar("Done")


ENDED = "PTH-10"


class WorkerEnded(Exception):
    """The process ended while it worked, and so did the one that replaced it."""

    def result(self, job: Job) -> JobResult:
        """Of the job that was to be done."""
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail=str(self), fault=ENDED)


class Worker:
    """Has work done in another process, one piece after the other; on virtual time at once, in this one."""

    def __init__(self, *, virtual: bool) -> None:
        """The process is started: that holds up this one, so it is done before there are ticks."""
        self._virtual, self._pool = virtual, None if virtual else _Pool()

    async def do(self, work: Callable[..., Done], *given: object) -> Done:
        """The result of `work`, a function of a module; what it is given and returns goes to the process and back.

        Raises:
            WorkerEnded: as it says. The next piece of work gets a process again.
        """
        if self._pool is None:
            return work(*given)
        try:
            return await self._pool.do(work, *given)
        except BrokenProcessPool:
            self._pool.close()
            self._pool = _Pool()
        try:
            return await self._pool.do(work, *given)
        except BrokenProcessPool:
            raise WorkerEnded("so did the one that replaced it") from None

    def close(self) -> None:
        """End the process, whatever it is at."""
        if self._pool is not None:
            self._pool.close()


class _Pool:
    """One process, which ends as soon as the other end of its pipe is closed, by this process or by its end."""

    def __init__(self) -> None:
        fresh = multiprocessing.get_context("spawn")
        self._told, self._over = fresh.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(1, fresh, initializer=end_with_the_run, initargs=(self._told,))
        self._executor.submit(os.getpid)  # it starts its process with its first work

    async def do(self, work: Callable[..., Done], *given: object) -> Done:
        return await asyncio.get_running_loop().run_in_executor(self._executor, work, *given)

    def close(self) -> None:
        self._over.close()
        self._executor.shutdown(cancel_futures=True)
        self._told.close()


def end_with_the_run(over: Connection) -> None:
    """Signals to all processes of a terminal or a service are for the run, with which this one ends in any case.

    Args:
        over: its other end is closed when the run has no more work.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    run = multiprocessing.parent_process()
    assert run is not None
    ends: list[int | Connection] = [run.sentinel, over]

    def leave() -> None:
        wait(ends)
        os._exit(0)

    threading.Thread(target=leave, daemon=True).start()
