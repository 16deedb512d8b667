"""Somebody at the terminal while a mission runs: single keys become requests."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import termios
import tty
from collections.abc import Callable
from contextlib import suppress

from artemis.values import Request

KEYS = {b" ": Request.QUICKSTOP, b"a": Request.ACKNOWLEDGE, b"r": Request.ARM, b"q": Request.END}
"""Space stops at once; a acknowledges, r arms again, q ends the run in order."""
HINT = "keys: space quick stop, a acknowledge, r arm again, q end"
_CONTROL_CHARACTERS = 6  # place in what termios.tcgetattr returns


def somebody_is_there() -> bool:
    """Whether standard input is a terminal whose keys come to us (not to a shell that runs us in the background)."""
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):  # no standard input, or not our terminal
        return False


def listen_to_keys(request: Callable[[Request], None]) -> Callable[[], None]:
    """Read keys from standard input on the running loop; returns how to stop and give the terminal back.

    A closed terminal (SIGHUP) counts as a quick stop and the end: the person who could have stopped the robot is
    gone. Ctrl-Z does nothing while a mission runs: a suspended process has no heartbeat, and every drive would fault.
    """
    loop, descriptor = asyncio.get_running_loop(), sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    settings = termios.tcgetattr(descriptor)
    settings[_CONTROL_CHARACTERS][termios.VSUSP] = os.fpathconf(descriptor, "PC_VDISABLE").to_bytes(1, "little")
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)

    def stop() -> None:
        loop.remove_reader(descriptor)
        loop.remove_signal_handler(signal.SIGHUP)
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(descriptor, termios.TCSANOW, before)

    def hang_up() -> None:
        loop.remove_reader(descriptor)
        request(Request.QUICKSTOP)
        request(Request.END)

    def read() -> None:
        try:
            typed = os.read(descriptor, 64)
        except OSError:
            typed = b""
        if not typed:
            hang_up()
        for key in typed:
            wanted = KEYS.get(bytes((key,)))
            if wanted is not None:
                request(wanted)

    loop.add_reader(descriptor, read)
    loop.add_signal_handler(signal.SIGHUP, hang_up)
    return stop
