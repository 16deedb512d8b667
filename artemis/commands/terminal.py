"""Somebody at the terminal while a mission runs: single keys become requests."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import tty
from collections.abc import Callable

from artemis.values import Request

KEYS = {b" ": Request.QUICKSTOP, b"a": Request.ACKNOWLEDGE, b"r": Request.ARM, b"q": Request.END}
"""Space stops at once; a acknowledges, r arms again, q ends the run in order."""


def listen_to_keys(request: Callable[[Request], None]) -> Callable[[], None]:
    """Read keys from standard input on the running loop; returns how to stop and give the terminal back.

    A closed terminal counts as a quick stop: the person who could have stopped the robot is gone.
    """
    loop, descriptor = asyncio.get_running_loop(), sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)

    def stop() -> None:
        loop.remove_reader(descriptor)
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)

    def read() -> None:
        try:
            typed = os.read(descriptor, 64)
        except OSError:
            typed = b""
        if not typed:
            loop.remove_reader(descriptor)
            request(Request.QUICKSTOP)
            request(Request.END)
        for key in typed:
            wanted = KEYS.get(bytes((key,)))
            if wanted is not None:
                request(wanted)

    loop.add_reader(descriptor, read)
    return stop
