"""A process that connects a run with other programs: started, read in a thread, restarted if it ends or hangs."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection

from artemis.bridges.child_process import ChildProcess, Restarts

BEGIN, SILENCE = 10.0, 3.0
"""Time to its first message, and between two messages [s]; then it is ended."""
LOOK = 0.1
"""It sends a message at least this often [s]."""
END_TIME = 2.0
"""It has this long to leave at the end [s]."""


class KeptProcess(ABC):
    """One such process. Both ends have a connection on which blocks of bytes go over.

    Attributes:
        problem: Why it does not work at present; empty: it does, or it has just started.
        pid: Of the process; None: there was none yet.
    """

    module: str
    """What it runs: its arguments are the numbers of the file descriptors `fds`, and of the connection."""

    def __init__(self, name: str, fds: Sequence[int] = ()) -> None:
        """`name` of the plugin; `fds` are passed to each process."""
        self.problem = ""
        self.pid: int | None = None
        self._fds = fds
        self._new = False
        """It is ready, and has been sent nothing yet: cleared by the sender of lasting data."""
        self._connection: Connection | None = None
        self._sending = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._restarts = Restarts()

    def start(self) -> None:
        """Begin it."""
        self._thread.start()

    def take_words(self) -> list[str]:
        """That it ended, and that it works again: what was not reported yet."""
        return self._restarts.take()

    def close(self) -> None:
        """End it; harmless when repeated."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join(2 * END_TIME)

    # ------------------------------------------------------------------------------------------ of each kind

    @abstractmethod
    def _first(self) -> bytes:
        """What is sent to a new process first."""

    @abstractmethod
    def _hear(self, block: bytes) -> str:
        """Take its message, in the thread. Returns why it must be ended; empty: it works."""

    # ------------------------------------------------------------------------------------------ its life

    def _send(self, block: bytes) -> None:
        """Send it something; waits for one that is slow, until that is ended."""
        with self._sending:
            if self._connection is not None:
                with suppress(OSError):  # it has ended; the thread finds that
                    self._connection.send_bytes(block)

    def _run(self) -> None:
        first = self._first()
        while not self._end.is_set():
            self._restarts.begin()
            failure = self._live(first)
            if self._end.is_set():
                return
            self.problem = failure
            self._restarts.ended(failure)
            while not self._restarts.due and not self._end.wait(LOOK):
                pass

    def _live(self, first: bytes) -> str:
        """Have a process until it ends; returns why it did."""
        ours: Connection | None = None
        try:
            ours, its = Pipe()
            with its:
                process = ChildProcess(["-m", self.module], [*self._fds, its.fileno()])
        except OSError as error:
            if ours is not None:
                ours.close()
            return f"its process cannot be started: {error.strerror}"
        self.pid = process.pid
        failure = self._talk(ours, first, process)
        if failure:
            process.end()  # the sender continues
        with self._sending:
            self._connection = None
            ours.close()
        process.wait(END_TIME)
        words = process.end()
        return failure or f"its process: {words}"

    def _talk(self, ours: Connection, first: bytes, process: ChildProcess) -> str:
        """Send the process its settings, and read it until it ends; returns why it must be ended, if it has not."""
        patience, silent = BEGIN, 0.0
        with suppress(EOFError, OSError):
            ours.send_bytes(first)
            with self._sending:
                self._connection, self._new = ours, True
            while not self._end.is_set():
                if not ours.poll(LOOK):
                    silent += LOOK
                    if silent >= patience:
                        return "its process does not answer"
                    continue
                if failure := self._hear(ours.recv_bytes()):
                    return failure
                self._restarts.works()
                process.trim()
                self.problem, silent, patience = "", 0.0, SILENCE
        return ""
