"""Another Python process of a run, as the run sees it: begun, looked after, ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from tempfile import TemporaryFile

MOST_ERRORS = 1 << 16
"""Bytes on its standard error that are kept; of more the last."""
_WORDS = 200
"""So much of the last line is told."""


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
        """Whether it ends within so long [s]."""
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
