"""Somebody at the terminal while a mission runs: single keys become requests."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import tty
from collections.abc import Callable, Mapping
from contextlib import suppress

from artemis.errors import ConfigError
from artemis.progress import Answer
from artemis.values import Request

KEYS = {b" ": Request.QUICKSTOP, b"a": Request.ACKNOWLEDGE, b"r": Request.ARM, b"q": Request.END}
"""Space stops at once; a acknowledges, r arms again, q ends the run in order."""
ANSWER_KEYS = {digit.encode(): digit for digit in "123456789"}
"""Number of an answer to a question of the mission."""
ACCEPT_KEYS = {b"\n": Request.ACCEPT, b"\r": Request.ACCEPT}
"""Enter."""
JOG_KEYS = {
    b"+": Request.LEFT_DEGREE,
    b"-": Request.RIGHT_DEGREE,
    b".": Request.LEFT_TENTH,
    b",": Request.RIGHT_TENTH,
    **ACCEPT_KEYS,
}
"""Turn a wheel by a degree or a tenth to the left or right; enter accepts."""
JOGGING = "+ - turn the wheel by a degree, . , by a tenth, enter accepts"
HINT = "keys: space quick stop, a acknowledge, r arm again, q end"
ANSWERING = "1 to 9 answer"
DRIVING = "arrow keys drive while held, + - speed range, p record path, d done"
_CONTROL_CHARACTERS = 6  # place in what termios.tcgetattr returns
_BEGIN, _END = b"\x1b[>2u\x1b[?u\x1b[?1004h", b"\x1b[?1004l\x1b[<u"
"""Tell when keys are released (kitty keyboard protocol: push flag 2, ask for the flags), and when the window loses the
focus (xterm, mode 1004); and neither any more."""
_ARE_YOU_THERE, _ASKED = b"\x1b[5n", 0.05
"""Device status report (ECMA-48, 8.3.35): any terminal answers. Asked so often [s]."""


def lose_output() -> None:
    """What is printed from now on goes nowhere: standard output cannot be written."""
    nowhere, output = os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
    if nowhere != output:  # the same number where standard output was closed
        os.dup2(nowhere, output)
        os.close(nowhere)


def somebody_is_there() -> bool:
    """Whether standard input is a terminal whose keys come to us (not to a shell that runs us in the background)."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):  # no standard input, or not our terminal
        return False


def confirmed(command: str, question: str) -> bool:
    """Whether a person says yes to a question of a command.

    Raises:
        ConfigError: nobody can.
    """
    if not sys.stdin.isatty():
        raise ConfigError(f"{command}: a person at a terminal is needed to answer, or --yes: {question}")
    sys.stdout.write(f"{question} [no/yes] ")
    sys.stdout.flush()
    try:
        answer = sys.stdin.readline().strip().lower()
    except KeyboardInterrupt:
        answer = ""
        sys.stdout.write("\n")
    return bool(answer) and "yes".startswith(answer)


def listen_to_keys(
    request: Callable[[Request | Answer], None],
    typed: Callable[[bytes], None] | None = None,
    keys: Mapping[bytes, Request | str] = KEYS,
) -> Callable[[], None]:
    """Read keys from standard input on the running loop; returns how to stop and give the terminal back.

    Where somebody drives by the keys, `typed` is called with all that comes, and with nothing once the terminal is
    closed; the terminal then also tells when keys are released, and is asked all the time whether it is there.
    A closed terminal counts as a quick stop and the end: the person who could have stopped the robot is gone. Ctrl-Z
    does nothing while a mission runs: a suspended process has no heartbeat, and every drive would fault.
    """
    loop, descriptor = asyncio.get_running_loop(), sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    settings = termios.tcgetattr(descriptor)
    settings[_CONTROL_CHARACTERS][termios.VSUSP] = os.fpathconf(descriptor, "PC_VDISABLE").to_bytes(1, "little")
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)

    asking = _Asking(loop, descriptor) if typed is not None else None

    def stop() -> None:
        if asking is not None:
            asking.stop()
        loop.remove_reader(descriptor)
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(descriptor, termios.TCSANOW, before)

    def hang_up() -> None:
        loop.remove_reader(descriptor)
        request(Request.QUICKSTOP)
        request(Request.END)

    def read() -> None:
        try:
            data = os.read(descriptor, 1024)
        except OSError:
            data = b""
        if typed is not None:
            typed(data)
        if not data:
            hang_up()
        for key in data:
            wanted = keys.get(bytes((key,)))
            if wanted is not None and not (isinstance(wanted, str) and b"\x1b" in data):  # a digit of another key
                request(wanted)

    loop.add_reader(descriptor, read)
    return stop


class _Asking:
    """Asks the terminal again and again whether it is there; never waits for one that was stopped with Ctrl-S."""

    def __init__(self, loop: asyncio.AbstractEventLoop, descriptor: int) -> None:
        self._loop = loop
        self._screen = os.open(os.ttyname(descriptor), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        self._write(_BEGIN)
        self._ask()

    def stop(self) -> None:
        """Ask no more."""
        self._next.cancel()
        self._write(_END)
        os.close(self._screen)

    def _ask(self) -> None:
        self._write(_ARE_YOU_THERE)
        self._next = self._loop.call_later(_ASKED, self._ask)

    def _write(self, data: bytes) -> None:
        with suppress(OSError):  # it is stopped, or gone: then it does not answer, and that is what counts
            os.write(self._screen, data)
