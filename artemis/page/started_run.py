"""A run as the page that started it sees it: a process, its messages to the service manager, its last lines.

Its standard input ends with this process, and then so does the run. Its output goes to a file, so that a page that
hangs never holds it up.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

from artemis.notify import READY, STATUS, STOPPING, WATCHDOG

FED_EVERY = 3.0
"""The run reports twice within this time that it ticks [s]."""
HANG = 8.0
"""A run without a tick for this time is killed [s]: its drives stand by then, and it would have ended itself."""
CANCEL_TIME = 10.0
"""Time to end before its first tick, or after its last if it is no longer waited for [s]; then it is killed."""
END_TIME = 90.0
"""Time to end in order, and to write its report [s]; then it is killed."""
MOST_OUTPUT, MOST_LINES, LONGEST_LINE = 1 << 20, 40, 300
ENDINGS = {
    0: "done",
    1: "failed, or stopped by a fault or an operator",
    2: "refused; nothing has moved",
    70: "ended by a bug of artemis; the drives were commanded to stop",
    71: "ended because a plugin did not return; the drives stopped by themselves",
}
"""What the exit statuses of `artemis run` mean (docs/commands.md)."""


def ending(status: int) -> str:
    """Meaning of an exit status."""
    if status < 0:
        return f"killed by {signal.Signals(-status).name}; the drives stop by themselves"
    with suppress(ValueError):
        released = "the drives were stopped and released"
        return ENDINGS.get(status) or f"ended by {signal.Signals(status - 128).name}; {released}"
    return f"ended with status {status}"


class StartedRun:
    """One run, from its start to its end. `look` is called all the time."""

    def __init__(self, command: Sequence[str], folder: Path, kept: Sequence[int], now: float) -> None:
        """Begin `command` in a folder, at `now` [s]; file descriptors that are `kept` are not closed before it ends.

        Raises:
            OSError: the system has no room for another process.
        """
        self.is_ready = self.is_stopping = False
        """It ticks; its last tick was executed."""
        self.status = ""
        """What it does, as it reports that; after its last tick, its result."""
        self.killed_at = inf
        """When it is killed if it has not ended [s]."""
        self._heard, self._why = now, ""
        self._place = TemporaryDirectory(prefix="artemis-page-")  # only its owner may open it
        self._output, self._last = TemporaryFile("a+b"), b""
        self._notices = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        address = os.path.join(self._place.name, "notify")
        try:
            self._notices.bind(address)
            self._notices.setblocking(False)
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=self._output,
                stderr=subprocess.STDOUT,
                pass_fds=kept,
                start_new_session=True,  # a terminal's signals are for the page, which then ends it
                env={**os.environ, "NOTIFY_SOCKET": address, "WATCHDOG_USEC": f"{FED_EVERY * 1e6:.0f}"},
            )
        except OSError:
            self._forget()
            raise
        self.pid = self._process.pid
        assert self._process.stdin is not None
        self._stdin = self._process.stdin

    def look(self, now: float) -> int | None:
        """Read its messages; its exit status once it has ended. One that hangs is killed."""
        status = self._process.poll()  # first: what it said last is there then
        for words in self._said():
            if words == READY:
                self.is_ready, self._heard, self.killed_at = True, now, inf
            elif words == STOPPING:
                self.is_stopping, self.status = True, ""
            elif words == WATCHDOG:
                self._heard = now
            elif words.startswith(STATUS):
                self.status = words.removeprefix(STATUS)[:LONGEST_LINE]
        if os.fstat(self._output.fileno()).st_size > MOST_OUTPUT:
            self._last = self._tail()
            os.ftruncate(self._output.fileno(), 0)
        if self.is_ready and not self.is_stopping and now - self._heard > HANG:
            self._kill(f"it did not tick for {HANG:g} s: ")
        if now > self.killed_at:
            self._kill(f"it did not end within {CANCEL_TIME:g} s: ")
        return status

    @property
    def outcome(self) -> str:
        """How it ended."""
        status = self._process.returncode
        words = ending(status)
        if self.is_stopping and status in (0, 1):
            words = re.sub("^FAILED", "failed", self.status) or words
        if status < 0 and not self.is_ready:
            words = f"killed by {signal.Signals(-status).name} before its first tick; "
            words += "it had enabled no drive, and one that was enabled stops by its own watchdog"
        elif self.is_stopping and (status < 0 or self.killed_at < inf):
            words = (
                "it was not waited for after its last tick; the drives were released before, its report may be missing"
            )
        return self._why + words

    def lines(self) -> list[str]:
        """Its last lines."""
        text = (self._last + self._tail()).decode(errors="replace")
        lines = ["".join(sign for sign in line if sign.isprintable())[:LONGEST_LINE] for line in text.splitlines()]
        return [line for line in lines if line.strip()][-MOST_LINES:]

    def end(self, now: float) -> None:
        """Have it end in order; asked again it stops quickly. Its report is made all the same.

        A run that ticks notices the end of its standard input. A service manager sends it SIGTERM, too; a second
        one is a quick stop; SIGHUP is one at once, as that of a terminal with an operator.
        """
        if self._process.poll() is not None:
            return
        if not self.is_ready:
            self.killed_at = min(self.killed_at, now + CANCEL_TIME)
            self._process.terminate()
        elif self._stdin.closed:
            self._process.send_signal(signal.SIGHUP)
        self._stdin.close()

    def cancel(self, now: float) -> None:
        """End a run that has not ticked yet, or whose last tick was executed and whose drives are released."""
        if self.is_stopping and self._process.poll() is None:
            self.killed_at = min(self.killed_at, now + CANCEL_TIME)
            self._process.send_signal(signal.SIGINT)
        elif not self.is_ready:
            self.end(now)

    def kill(self) -> None:
        """End it at once: the drives stop by themselves."""
        self._kill("")

    def _kill(self, why: str) -> None:
        if self._process.poll() is None:
            self._why = why
            self._process.kill()

    def close(self) -> None:
        """Let go of one that has ended."""
        self._stdin.close()
        self._forget()

    def _forget(self) -> None:
        self._notices.close()
        self._output.close()
        self._place.cleanup()

    def _said(self) -> list[str]:
        words: list[str] = []
        with suppress(BlockingIOError):
            for _ in range(1000):
                words += self._notices.recv(4096).decode(errors="replace").splitlines()
        return words

    def _tail(self) -> bytes:
        most = MOST_LINES * LONGEST_LINE
        size = os.fstat(self._output.fileno()).st_size
        return os.pread(self._output.fileno(), most, max(0, size - most))
