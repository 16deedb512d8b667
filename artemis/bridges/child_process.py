"""Another Python process of a run, seen from the run: started, supervised, ended, restarted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from math import inf
from tempfile import TemporaryFile
from threading import Lock

from artemis.clock import stopwatch

ENDED = "NET-13"
"""Row of the fault table: that a process ended, and that it is back."""
MOST_ERRORS = 1 << 16
"""Bytes on its standard error that are kept; of more the last."""
_WORDS = 200
"""Reported part of its last line [characters]."""
SOONEST = 1.0
"""From one start to the next of a process that worked [s]; one that worked for longer is restarted at once."""
LONGEST_PAUSE = 4.0
"""Before the next start of one that never works [s]."""
APART = 1.2
"""That it works again is reported this long after its end was reported [s]: the first warning is cleared by then."""


class ChildProcess:
    """One process, from its start to its end. What it prints is not shown, but for the last line of its errors."""

    def __init__(self, arguments: Sequence[str], fds: Sequence[int]) -> None:
        """Begin: `arguments` of the interpreter, and file descriptors that it takes over as the last ones.

        SIGTERM, which a service manager sends to all processes of a service, is for the run, which then ends this one.

        Raises:
            OSError: the system has no room for another process.
        """
        self._errors, self._last = TemporaryFile("a+b"), b""  # appended to: it may be cut while another one writes
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])  # a new process begins with it (exec(3p))
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", *arguments, *map(str, fds)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                pass_fds=fds,
                start_new_session=True,  # a terminal's signals are for the run, which then ends it
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        except OSError:
            self._errors.close()
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self.pid = self._process.pid

    def trim(self) -> None:
        """Keep no more of its errors than the last ones. To be called now and then."""
        if not self._errors.closed and os.fstat(self._errors.fileno()).st_size > MOST_ERRORS:
            self._last = self._tail()
            os.ftruncate(self._errors.fileno(), 0)

    def wait(self, patience: float) -> bool:
        """Whether it ends within this time [s]."""
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            return False
        return True

    def end(self) -> str:
        """How it ended; it is made to, if it has not. Harmless when repeated."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        if not self._errors.closed:
            self._last = self._tail() or self._last
            self._errors.close()
        lines = self._last.decode(errors="replace").strip().splitlines()
        last = f": {lines[-1][:_WORDS]}" if lines else ""
        if (status := self._process.returncode) < 0:
            return f"killed by {signal.Signals(-status).name}{last}"
        return f"ended with status {status}{last}"

    def _tail(self) -> bytes:
        size = os.fstat(self._errors.fileno()).st_size
        return os.pread(self._errors.fileno(), 10 * _WORDS, max(0, size - 10 * _WORDS))


class Restarts:
    """When a process that ended is restarted, and what is reported: once that it ended, and that it works again.

    One that worked is restarted at once, at most every `SOONEST`; one that never works after longer pauses each time.
    """

    def __init__(self, clock: Callable[[], float] = stopwatch) -> None:
        """A process begins now, by this clock [s]."""
        self._clock = clock
        self._begun, self._again = clock(), -inf
        self._works = False
        self.fails = False
        """The last one ended before it worked."""
        self._pause = 0.0
        self._ended: float | None = None
        self._lock = Lock()
        """Reports may be taken in another thread."""
        self._words: list[tuple[float, str]] = []

    @property
    def due(self) -> bool:
        """It is time to begin it again."""
        return self._clock() >= self._again

    def begin(self) -> None:
        """It begins again."""
        self._begun, self._works = self._clock(), False

    def works(self, missed: str = "") -> None:
        """It does its work now; harmless when repeated. `missed`: a text with what was lost meanwhile."""
        if self._works:
            return
        now = self._clock()
        if self._ended is not None:
            with self._lock:
                self._words.append((self._ended + APART, f"it is back after {now - self._ended:.1f} s{missed}"))
        self._works, self.fails, self._pause, self._ended = True, False, 0.0, None

    def ended(self, why: str) -> None:
        """It has ended, or could not be started."""
        now = self._clock()
        if self._ended is None:
            self._ended = now
            with self._lock:
                self._words = [(now, f"{why}; it is started again")]
        if self._works:
            self._again = max(now, self._begun + SOONEST)
        else:
            self._again = now + self._pause
            self._pause = min(max(2 * self._pause, SOONEST / 2), LONGEST_PAUSE)
        self._works, self.fails = False, not self._works

    def take(self) -> list[str]:
        """Reports since the last call."""
        now = self._clock()
        with self._lock:
            due = [words for at, words in self._words if now >= at]
            self._words = [(at, words) for at, words in self._words if now < at]
        return due
