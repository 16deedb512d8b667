"""Somebody at a browser, as far as its words go, in a process of its own: presses Stop, floods the page, measures it.

Arguments: the page's address, a code to pair with, the file for what was found, how many presses, a finished run (its
report is made again and again meanwhile), and how long to flood, and to count the processor's time [s].
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
CLIENTS = 4
"""Browsers that watch while the processor's time is counted."""
_PING = b'{"t":"ping","at":0}'
FRAME = bytes([0x81, 0x80 | len(_PING), 0, 0, 0, 0]) + _PING
"""A text frame with a mask of zeros (RFC 6455, 5.2)."""


class PageHand:
    """A paired browser: by a code, or by the cookie of one that is paired already."""

    def __init__(self, url: str, code: str = "", cookie: str = "") -> None:
        self._url, self.cookie = url, cookie
        if not cookie:
            answer = self._first(code)
            self.cookie = str(answer.headers["set-cookie"]).split(";")[0]
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
        headers = {"Origin": self._url, "Cookie": self.cookie, "Content-Type": "application/json"}
        data = None if words is None else json.dumps(words).encode()
        answer: HTTPResponse = urlopen(Request(self._url + path, data, headers), timeout=PATIENCE)
        return answer

    def link(self, path: str) -> ClientConnection:
        """A connection that is paired."""
        place = self._url.replace("http", "ws") + path
        return connect(place, origin=Origin(self._url), additional_headers={"cookie": self.cookie}, max_size=None)

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
            self._take(control)
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
            self._take(control)
            while True:
                if (told := json.loads(control.recv(PATIENCE)))["t"] == "beat":
                    self._hold(control, told["n"], ["end"])

    def drive(self, speed: float) -> None:
        """Drive forward by this share of the highest speed as long as the connection lasts; recover from each stop."""
        with self.link("/control") as control, self.link("/telemetry") as telemetry:
            self._take(control)
            ready = 0
            while True:
                told = json.loads(control.recv(PATIENCE))
                if told["t"] == "seat" and not told["mine"] and not told["who"]:
                    self._take(control)
                if told["t"] == "beat":
                    self._hear(telemetry)
                    ready = ready + 1 if self.state.get("mode") == "teleop" else 0
                    self._hold(control, told["n"], self._asked(), speed if ready > 10 else 0.0)

    def wait_until_driven(self) -> None:
        """Return once the set-point of the speed has been the same for half a second, and not zero."""
        last, same = 0.0, 0
        with self.link("/telemetry") as telemetry:
            while same < 10:
                state = json.loads(telemetry.recv(PATIENCE)).get("state")
                if state is not None:
                    speed = state["wish"][0]
                    same = same + 1 if speed == last and speed > 0.0 and state["mode"] == "teleop" else 0
                    last = speed

    def watch(self, seconds: float) -> None:
        """Take all that a browser is told for so long."""
        begun = stopwatch()
        with self.link("/telemetry") as telemetry:
            while stopwatch() - begun < seconds:
                telemetry.recv(PATIENCE)

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

    def _take(self, control: ClientConnection) -> None:
        while not json.loads(control.recv(PATIENCE)).get("run"):
            pass
        control.send(json.dumps({"t": "take", "who": "bench"}))
        self._sequence = 0

    def _hold(self, control: ClientConnection, beat: int, asked: list[str], speed: float = 0.0) -> None:
        self._sequence += 1
        held = speed > 0.0
        words = {"held": held, "neutral": not held, "y": speed, "ask": asked}
        control.send(json.dumps({"t": "hold", "seq": self._sequence, "beat": beat, **words}))

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
        paired = browser.new_context()
        page = paired.new_page()
        page.goto(f"{url}/pair#{code}")
        page.wait_for_url(f"{url}/")
        page = browser.new_context(storage_state=paired.storage_state()).new_page()  # it has the cookie, and no file
        page.goto(url)
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


def page_process() -> int:
    """The process of the page of the run that started this one."""
    run = os.getppid()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == run and b"own_process" in (folder / "cmdline").read_bytes():
                return int(folder.name)
    raise ProcessLookupError("the page has no process at present")


def processor_shares(hand: PageHand, seconds: float) -> tuple[float, float]:
    """Share of one processor that the page's process takes by itself, and for each of `CLIENTS` that watch."""
    page = page_process()
    shares = []
    for clients in (0, CLIENTS):
        threads = [threading.Thread(target=hand.watch, args=(seconds,)) for _ in range(clients)]
        begun, used = stopwatch(), _processor_time(page)
        for thread in threads:
            thread.start()
        _wait(seconds)
        shares.append((_processor_time(page) - used) / (stopwatch() - begun))
        for thread in threads:
            thread.join()
    return shares[0], (shares[1] - shares[0]) / CLIENTS


def _processor_time(process: int) -> float:
    """User and system [s] (proc(5))."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


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
    told["shares"] = processor_shares(hand, float(seconds))
    told["paint"] = first_paint(url, second_code)
    Path(out).write_text(json.dumps(told))
    hand.end()


if __name__ == "__main__":
    main()
