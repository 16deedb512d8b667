"""Somebody at a browser, as far as its words go, in a process of its own: presses Stop, floods the page, measures it.

Arguments: the page's address, a code to pair with, the file for what was found, how many presses, a finished run (its
report is made again and again meanwhile), and how long to flood [s].
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPResponse
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import Request, urlopen

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis.clock import stopwatch

PATIENCE = 30.0
NICE = 15
"""Of whoever makes reports."""
BURST, EVERY = 100, 0.01
"""So many frames at once, and so often [s]: 10,000 in a second."""
_PING = b'{"t":"ping","at":0}'
FRAME = bytes([0x81, 0x80 | len(_PING), 0, 0, 0, 0]) + _PING
"""A text frame with a mask of zeros (RFC 6455, 5.2)."""


class PageHand:
    """A paired browser."""

    def __init__(self, url: str, code: str) -> None:
        self._url, self._cookie = url, ""
        answer = self._first(code)
        self._cookie = str(answer.headers["set-cookie"]).split(";")[0]
        self._presses = self._sequence = 0
        self.state: dict[str, Any] = {}

    def _first(self, code: str) -> HTTPResponse:
        """Pair, as soon as the page answers."""
        begun = stopwatch()
        while True:
            try:
                return self._ask("/pair", {"code": code})
            except URLError:
                if stopwatch() - begun > PATIENCE:
                    raise
                _wait(0.1)

    def _ask(self, path: str, words: dict[str, Any] | None = None) -> HTTPResponse:
        headers = {"Origin": self._url, "Cookie": self._cookie, "Content-Type": "application/json"}
        data = None if words is None else json.dumps(words).encode()
        answer: HTTPResponse = urlopen(Request(self._url + path, data, headers), timeout=PATIENCE)
        return answer

    def link(self, path: str) -> ClientConnection:
        """A connection that is paired."""
        place = self._url.replace("http", "ws") + path
        return connect(place, origin=Origin(self._url), additional_headers={"cookie": self._cookie}, max_size=None)

    def size(self) -> int:
        """Bytes of the page with all that it loads."""
        found, waiting = dict[str, int](), ["/"]
        while waiting:
            path = waiting.pop()
            if path in found:
                continue
            with self._ask(path) as answer:
                content = answer.read()
            found[path] = len(content)
            if path == "/" or path.endswith(".js"):
                text = content.decode()
                waiting += re.findall(r'(?:href|src)="(/static/[^"]+)"', text)
                waiting += [f"/static/{name}" for name in re.findall(r"from '\./([^']+)'", text)]
        return sum(found.values())

    def presses(self, number: int) -> list[float]:
        """Press Stop so often, each time with the drives enabled; when [s by the stopwatch]."""
        found: list[float] = []
        with self.link("/control") as control, self.link("/telemetry") as telemetry:
            while not json.loads(control.recv(PATIENCE)).get("run"):
                pass
            control.send(json.dumps({"t": "take", "who": "bench"}))
            self._sequence = 0
            ready = 0
            while len(found) < number:
                told = json.loads(control.recv(PATIENCE))
                if told["t"] != "beat":
                    continue
                self._hear(telemetry)
                ready = ready + 1 if self.state.get("mode") == "teleop" else 0
                self._hold(control, told["n"], self._asked())
                if ready > 5 + len(found) % 7:
                    found.append(self._press(control))
                    ready = -20
            control.send(json.dumps({"t": "release"}))
        return found

    def end(self) -> None:
        """Have the run end."""
        with self.link("/control") as control, suppress(ConnectionClosed):
            control.send(json.dumps({"t": "take", "who": "bench"}))
            self._sequence = 0
            while True:
                if (told := json.loads(control.recv(PATIENCE)))["t"] == "beat":
                    self._hold(control, told["n"], ["end"])

    def flood(self, seconds: float) -> tuple[float, float]:
        """Send 10,000 messages in a second; from when to when."""
        begun = stopwatch()
        with self.link("/control") as control, suppress(OSError):
            while stopwatch() - begun < seconds:
                control.socket.sendall(FRAME * BURST)
                _wait(EVERY)
        return begun, stopwatch()

    def _asked(self) -> list[str]:
        phase, mode = self.state.get("phase", ""), self.state.get("mode")
        if mode == "fault" or "acknowledge" in phase:
            return ["acknowledge"]
        return ["arm"] if "arm" in phase or mode == "quickstop" else []

    def _hold(self, control: ClientConnection, beat: int, asked: list[str]) -> None:
        self._sequence += 1
        control.send(json.dumps({"t": "hold", "seq": self._sequence, "beat": beat, "ask": asked}))

    def _press(self, control: ClientConnection) -> float:
        """By both ways, as the page does."""
        self._presses += 1
        words = {"t": "stop", "id": f"bench {self._presses}"}
        pressed = stopwatch()
        control.send(json.dumps(words))
        self._ask("/stop", words).close()
        return pressed

    def _hear(self, telemetry: ClientConnection) -> None:
        with suppress(TimeoutError):
            while True:
                self.state = json.loads(telemetry.recv(0)).get("state", self.state)


def first_paint(url: str, code: str) -> float | None:
    """Until a browser has drawn the page for the first time [s]; None: there is no browser (`scripts/browser`)."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    if (chromium := shutil.which("chromium")) is None:
        return None
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(f"{url}/pair#{code}")
        page.wait_for_url(f"{url}/")
        page.reload()
        page.wait_for_selector("body[data-link=ok]")
        entries = page.evaluate("performance.getEntriesByName('first-contentful-paint').map(each => each.startTime)")
        browser.close()
    return float(entries[0]) / 1e3


@contextmanager
def reports(run: str) -> Iterator[None]:
    """The report of a run is made again and again meanwhile, by another process that gives way."""
    over = threading.Event()

    def work() -> None:
        while not over.is_set():
            command = [sys.executable, "-m", "artemis", "report", run]
            making = subprocess.Popen(command, stdout=subprocess.DEVNULL, preexec_fn=lambda: os.nice(NICE))
            while making.poll() is None and not over.wait(0.05):
                pass
            making.kill()
            making.wait()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _wait(seconds: float) -> None:
    threading.Event().wait(seconds)


def main() -> None:
    """Measure, and end the run."""
    url, code, second_code, out, presses, run, seconds = sys.argv[1:]
    hand = PageHand(url, code)
    told: dict[str, Any] = {"size": hand.size(), "quiet": hand.presses(int(presses))}
    with reports(run):
        told["report"] = hand.presses(int(presses))
    _wait(float(seconds))
    told["flood"] = hand.flood(float(seconds))
    told["paint"] = first_paint(url, second_code)
    Path(out).write_text(json.dumps(told))
    hand.end()


if __name__ == "__main__":
    main()
