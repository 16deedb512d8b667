"""A pseudo-terminal with the `artemis` command in it."""

from __future__ import annotations

import codecs
import contextlib
import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from command_line import ARTEMIS, PATIENCE
from lateness import skip_if_late

_LOOK = 0.1
"""After this time without output [s], whether the process still runs."""
_READS = 2000
"""So often something new is read while other words are awaited: for a minute or two."""


class Terminal:
    """What a person has before them: a screen of `columns`, and keys."""

    def __init__(self, command: Sequence[str], columns: int, no_colour: bool) -> None:
        self.host, device = pty.openpty()
        self.device = device
        self.resize(columns)
        self.before = termios.tcgetattr(device)
        self.shown = self.everything = ""
        self.hear: Callable[[Terminal, str], None] | None = None
        """Is called with what comes, as a terminal that answers questions."""
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES", "NO_COLOR")}
        self.process = subprocess.Popen(
            [*ARTEMIS, *command],
            stdin=device,
            stdout=device,
            stderr=device,
            env={**environment, "TERM": "xterm", **({"NO_COLOR": "1"} if no_colour else {})},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # the terminal's keys send it signals
        )

    def resize(self, columns: int) -> None:
        """Make the screen so wide."""
        fcntl.ioctl(self.device, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))

    def see(self, pattern: str) -> str:
        """Wait for words that were not seen before; what came up to them."""
        for _ in range(_READS):
            if found := re.search(pattern, self.shown):
                break
            self._read(f"{pattern!r} in {self.shown!r}")
        else:
            raise AssertionError(f"{pattern!r} is not in {self.shown!r}")
        seen, self.shown = self.shown[: found.start()], self.shown[found.end() :]
        return seen

    def see_driving(self) -> None:
        """Wait until the robot has gone some way."""
        self.see(r" (?!0\.[0-2])\d+\.\d of \d")

    def press(self, key: bytes) -> None:
        os.write(self.host, key)

    def press_until(self, key: bytes, pattern: str) -> None:
        """Press a key, and again where it was not taken, until these words are seen."""
        for _ in range(20):
            self.press(key)
            for _ in range(10):
                if re.search(pattern, self.shown):
                    self.see(pattern)
                    return
                self._read(repr(pattern))
        raise AssertionError(f"{key!r} does not lead to {pattern!r}")

    def end(self) -> int:
        """Wait for the end; the exit status."""
        with contextlib.suppress(AssertionError):
            while True:
                self._read("the end")
        return self.process.wait(timeout=PATIENCE)

    def _read(self, wanted: str) -> None:
        for _ in range(round(PATIENCE / _LOOK)):
            if select.select([self.host], [], [], _LOOK)[0]:
                text = self._decoder.decode(os.read(self.host, 65536))
                self.shown, self.everything = self.shown + text, self.everything + text
                if self.hear is not None:
                    self.hear(self, text)
                skip_if_late(self.shown, *(["INP-03"] if self.hear else []))  # this terminal may answer too late
                assert self.hear is None or "FAULT      INP-03" not in self.shown, f"stopped, waited for {wanted}"
                return
            assert self.process.poll() is None, f"ended without {wanted}"
        raise AssertionError(f"nothing more comes; waited for {wanted}")


@contextlib.contextmanager
def terminal(
    mission: Path, columns: int = 110, *, no_colour: bool = False, command: Sequence[str] = ("run",)
) -> Iterator[Terminal]:
    """A person who has started the mission, or another command with it; killed at the end if it still runs."""
    screen = Terminal([*command, str(mission)], columns, no_colour)
    try:
        yield screen
    finally:
        screen.process.kill()
        screen.process.wait()
        for descriptor in (screen.host, screen.device):
            with contextlib.suppress(OSError):
                os.close(descriptor)
