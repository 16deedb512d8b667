"""What a plugin may do to the whole process, unseen by exceptions: block it, end it, flood its output, keep it alive.

A blocked main thread answers nobody: signals wait for it, and no heartbeat leaves, so the drives stop by themselves. A
thread beside it then says where it is, and ends the process.
"""

from __future__ import annotations

import os
import sys
import termios
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any, NoReturn

BLOCKED_STATUS = 71
"""Exit status of a run that a plugin has blocked."""
BLOCKED = 5.0
"""A plugin that does not answer for so long has blocked the run [s]; without our heartbeat the drives stand by then."""
_LOOK = 0.25
"""Between two looks [s]. They are counted: a process that was suspended has not been looked at."""
_WRITING = 1.0
"""The journal has this long to write the last line [s]."""
_FRAMES = 5
"""So much of the stack is shown, its innermost."""
LINES = 10
"""So many lines that a plugin prints are shown."""
LEAVE_TIME = 2.0
"""Threads that a plugin leaves behind have this long to end [s]."""

_exit = os._exit


class AskedPlugin:
    """Which plugin the run's thread waits for at present (empty: none), and how often it has asked one."""

    __slots__ = ("name", "number")

    def __init__(self) -> None:
        self.name, self.number = "", 0

    def begin(self, name: str) -> None:
        """The plugin `name` is asked from now on."""
        self.name, self.number = name, self.number + 1

    def end(self) -> None:
        """It has answered."""
        self.name = ""


@contextmanager
def plugins_watched(
    asked: AskedPlugin,
    ours: Container[str],
    note: Callable[[str], None],
    patient: Callable[[], bool] | None,
    origin: Callable[[str], str],
) -> Iterator[None]:
    """All of the next, for the time of a run."""
    with folder_kept(), prints_named(asked, ours), ended_if_blocked(asked, note, patient, origin):
        yield


@contextmanager
def folder_kept() -> Iterator[None]:
    """Come back to the working folder, where a plugin has left it: files of the run are written relative to it."""
    here = os.open(".", os.O_PATH)
    try:
        yield
    finally:
        os.fchdir(here)
        os.close(here)


@contextmanager
def ended_if_blocked(
    asked: AskedPlugin,
    note: Callable[[str], None],
    patient: Callable[[], bool] | None = None,
    origin: Callable[[str], str] = lambda name: "",
    blocked: float = BLOCKED,
) -> Iterator[None]:
    """End the process where a plugin that the present thread asks does not answer for `blocked` [s].

    Args:
        asked: Who is asked.
        note: Is told what happened, before the end.
        patient: Whether it is waited for all the same; None: never.
        origin: Which plugin of which package has a name.
        blocked: Longest time [s].
    """
    over, thread = threading.Event(), threading.get_ident()
    terminal = None
    with suppress(AttributeError, OSError, ValueError, termios.error):  # no standard input, or no terminal
        terminal = termios.tcgetattr(sys.stdin.fileno())

    def watch() -> None:
        looks, last = 0, 0
        while not over.wait(_LOOK):
            looks = looks + 1 if asked.name and asked.number == last else 0
            last = asked.number
            if looks * _LOOK >= blocked and not (patient is not None and patient()):
                end()

    def end() -> None:
        try:
            teller = threading.Thread(target=tell, daemon=True)  # whoever reads our output may be blocked, too
            teller.start()
            teller.join(_WRITING)
            over.wait(_WRITING)
        finally:
            _exit(BLOCKED_STATUS)

    def tell() -> None:
        name = asked.name
        which = f"'{name}' ({found})" if (found := origin(name)) else f"'{name}'"
        words = f"plugin {which} has not answered for {blocked:g} s: the run is ended"
        note(words)
        with suppress(OSError, termios.error):  # the terminal may be gone, as its connection
            in_front = terminal is not None and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
            if terminal is not None and in_front:
                termios.tcsetattr(sys.stdin.fileno(), termios.TCSANOW, terminal)
        told = f"\nartemis: {words}; the drives missed the heartbeat and stopped by themselves. It is here:\n"
        with suppress(OSError):
            os.write(2, (told + _stack(thread)).encode(errors="replace"))

    watcher = threading.Thread(target=watch, name="plugin watch", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def _stack(thread: int) -> str:
    """The innermost frames of a thread, as in a traceback."""
    frame = sys._current_frames().get(thread)  # noqa: SLF001  (documented; there is no other way to another thread)
    return "".join(traceback.format_stack(frame)[-_FRAMES:]) if frame is not None else "  nowhere: it has ended\n"


@contextmanager
def prints_named(asked: AskedPlugin, ours: Container[str]) -> Iterator[None]:
    """Show what plugins print behind their name, and not much of it; threads named in `ours` are no plugin's."""
    real = sys.stdout
    sys.stdout = shown = _Prints(real, asked, ours, threading.get_ident())
    try:
        yield
    finally:
        sys.stdout = real
        shown.conclude()


class _Prints:
    """Standard output during a run."""

    def __init__(self, real: IO[str], asked: AskedPlugin, ours: Container[str], thread: int) -> None:
        self._real, self._asked, self._ours, self._thread = real, asked, ours, thread
        self._lines: Counter[str] = Counter()
        self._begun: dict[str, str] = {}

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401  (whatever a stream has)
        return getattr(self._real, name)

    def write(self, text: str) -> int:
        """Write what is ours; of what plugins write, the first lines."""
        if not (name := self._plugin()):
            return self._real.write(text)
        *lines, self._begun[name] = (self._begun.get(name, "") + text).split("\n")
        for line in lines:
            self._show(name, line)
        return len(text)

    def _show(self, name: str, line: str) -> None:
        self._lines[name] += 1
        if self._lines[name] <= LINES:
            self._say(f"{name} prints: {line}")

    def conclude(self) -> None:
        """Show lines that were not ended, and say how much was not shown."""
        for name, begun in self._begun.items():
            if begun:
                self._show(name, begun)
        for name, lines in self._lines.items():
            if lines > LINES:
                self._say(f"{name} printed {lines - LINES} more lines")

    def _plugin(self) -> str:
        thread = threading.current_thread()
        if thread.ident == self._thread:
            return self._asked.name
        return "" if thread.name in self._ours else thread.name

    def _say(self, line: str) -> None:
        wipe = "\r\x1b[2K" if self._real.isatty() else ""
        with suppress(OSError):  # nobody reads any more
            self._real.write(f"{wipe}{line}\n")
            self._real.flush()


@contextmanager
def exit_refused() -> Iterator[None]:
    """While it lasts, `os._exit` raises in this process: it would end a run without a word, as if all were well."""
    process = os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # a child ends as it likes
            _exit(status)
        raise RuntimeError(f"os._exit({status}): nothing but artemis may end its process")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = _exit


def leave_threads(before: set[threading.Thread], status: int) -> None:
    """End the process with `status` where threads still run that were not there `before`; it would wait for them."""
    left = [thread for thread in threading.enumerate() if thread not in before and not thread.daemon]
    for thread in left:
        thread.join(LEAVE_TIME / len(left))
    left = [thread for thread in left if thread.is_alive()]
    if not left:
        return
    for thread in left:
        told = f"artemis: thread '{thread.name}' was left running; artemis ends without it. It is here:\n"
        sys.stderr.write(told + _stack(thread.ident or 0))
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    _exit(status)
