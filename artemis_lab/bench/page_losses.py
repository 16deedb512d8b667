"""What happens to a hand that drives at the page, or to the page itself: done on purpose, in a process of its own.

Arguments: the page's address, a code to pair with, the file for what was done, how often each. While the hand drives,
one event after the other happens, at any time between two ticks; the hand recovers from each.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from websockets.exceptions import ConnectionClosed

from artemis.clock import stopwatch
from artemis_lab.bench.page_hand import PATIENCE, PageHand, page_process
from artemis_lab.bench.ports import free_port

HAND_STOPS, HAND_DIES = "the hand's process is frozen", "the hand's process is killed"
OFFLINE = "the network passes nothing on"
PAGE_STOPS, PAGE_DIES = "the page's process is frozen", "the page's process is killed"
LOSSES = (HAND_STOPS, HAND_DIES, OFFLINE, PAGE_STOPS, PAGE_DIES)
OF_PAGE = (PAGE_STOPS, PAGE_DIES)
LASTS = 1.5
"""What is frozen stays so for so long [s], and what is seen so long after an event is of it."""
SPEED = 0.8
"""Share of the highest speed that the hand drives."""
_DRIVE = "from artemis_lab.bench.page_losses import drive; drive()"
_RELAY = "from artemis_lab.bench.page_losses import relay; relay()"


def drive() -> None:
    """In a process of its own: drive, and begin again where the connection ends. Arguments: the address, a cookie."""
    _, url, cookie = sys.argv
    while True:
        try:
            PageHand(url, cookie=cookie).drive(SPEED)
        except (OSError, ConnectionClosed, TimeoutError):
            threading.Event().wait(0.05)


def relay() -> None:
    """In a process of its own: pass on what comes at one port to another, and back. Arguments: both."""
    import asyncio

    here, there = map(int, sys.argv[1:])

    async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(65536):
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()

    async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        beyond, back = await asyncio.open_connection("127.0.0.1", there)
        await asyncio.gather(pump(reader, back), pump(beyond, writer))

    async def main() -> None:
        server = await asyncio.start_server(connected, "127.0.0.1", here)
        await server.serve_forever()

    asyncio.run(main())


@contextmanager
def program(code: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A part of this file in a process of its own, as long as it is needed."""
    running = subprocess.Popen([sys.executable, "-c", code, *arguments])
    try:
        yield running
    finally:
        running.kill()
        running.wait()


class Disturbances:
    """Waits until the hand drives, does what a loss is, and notes when."""

    def __init__(self, url: str, code: str) -> None:
        self._url, self._watching = url, PageHand(url, code)
        self._random = random.Random(1)
        self.events: list[tuple[str, float]] = []

    def do(self, loss: str, times: int) -> None:
        """So often."""
        if loss != OFFLINE:
            for _ in range(times):
                with program(_DRIVE, self._url, self._watching.cookie) as hand:
                    self._once(loss, hand.pid if loss in (HAND_STOPS, HAND_DIES) else None)
            return
        port = free_port()
        with program(_RELAY, str(port), self._url.rsplit(":", 1)[1]) as network:
            for _ in range(times):
                with program(_DRIVE, f"http://127.0.0.1:{port}", self._watching.cookie):
                    self._once(loss, network.pid)

    def _once(self, loss: str, process: int | None) -> None:
        self._wait_until_driven()
        _wait(self._random.uniform(0.0, 0.1))
        target = process or page_process()
        at = stopwatch()
        if loss in (HAND_DIES, PAGE_DIES):
            os.kill(target, signal.SIGKILL)
            self.events.append((loss, at))
            _wait(LASTS)
            return
        os.kill(target, signal.SIGSTOP)
        self.events.append((loss, at))
        try:
            _wait(LASTS)
        finally:
            os.kill(target, signal.SIGCONT)

    def _wait_until_driven(self) -> None:
        begun = stopwatch()
        while True:
            try:
                self._watching.wait_until_driven()
                return
            except (OSError, ConnectionClosed, TimeoutError):
                if stopwatch() - begun > 2 * PATIENCE:
                    raise
                _wait(0.1)

    def end(self) -> None:
        """Have the run end."""
        self._watching.end()


def _wait(seconds: float) -> None:
    threading.Event().wait(seconds)


def main() -> None:
    """All losses, and the run's end."""
    url, code, out, times = sys.argv[1:]
    trouble = Disturbances(url, code)
    for loss in LOSSES:
        trouble.do(loss, int(times))
    Path(out).write_text(json.dumps(trouble.events))
    trouble.end()


if __name__ == "__main__":
    main()
