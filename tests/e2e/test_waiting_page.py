"""`artemis page FOLDER` as a process: what it starts, what it hands over, and what a run does that has lost it."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import httpx
import pytest
from command_line import MISSIONS, artemis_here, assert_left_at_rest, only_run, read_until, started
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis.commands.run import run_and_report
from artemis.errors import ConfigError
from artemis_lab.bench.ports import free_port

MISSION = """
# Straight on.
mission: line
robot: robots/artemis.yaml
bus: simulation
steps:
  - calibrate: {steering: from_potentiometers}
  - follow: {path: paths/straight.csv, follower: {speed_m_s: 0.2}}
"""
PATIENCE = 90.0
PAUSE = threading.Event()
"""Never set."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    made = tmp_path / "missions"
    made.mkdir()
    for part in ("robots", "paths"):
        shutil.copytree(MISSIONS / part, made / part)
    (made / "line.yaml").write_text(MISSION.lstrip())
    return made


class Browser:
    """A paired browser, as far as its words go."""

    def __init__(self, port: int, code: str) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self.client = httpx.Client(base_url=self.url, headers={"origin": self.url}, timeout=PATIENCE)
        assert self.client.post("/pair", json={"code": code}).status_code == 200

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def another(self) -> Browser:
        return Browser(int(self.url.rpartition(":")[2]), self.client.post("/invite").json()["code"])

    def link(self, path: str) -> ClientConnection:
        cookie = "; ".join(f"{name}={value}" for name, value in self.client.cookies.items())
        place = self.url.replace("http", "ws") + path
        return connect(place, origin=Origin(self.url), additional_headers={"cookie": cookie}, max_size=None)

    def await_page(self, path: str) -> None:
        """Wait until the page that has such a resource is served."""
        for _ in range(int(PATIENCE / 0.1)):
            try:
                if self.client.get(path).status_code == 200:
                    return
            except httpx.TransportError:
                pass
            PAUSE.wait(0.1)
        raise AssertionError(path)


def say(link: ClientConnection, **words: object) -> None:
    link.send(json.dumps(words))


def told(link: ClientConnection, wanted: str) -> dict[str, Any]:
    """The next message of which this is true."""
    while True:
        message: dict[str, Any] = json.loads(link.recv(PATIENCE))
        if eval(wanted, {"m": message}):
            return message


@contextmanager
def waiting(folder: Path, port: int) -> Iterator[tuple[subprocess.Popen[str], Browser]]:
    with started("page", folder, "--page-port", str(port)) as page:
        (code,) = re.findall(r"pair#(\w+)", read_until(page, "pair#"))
        with Browser(port, code) as browser:
            yield page, browser


def begin(browser: Browser) -> None:
    """Start the mission, and wait until its page is served."""
    with browser.link("/waiting") as link:
        mission = told(link, "m['missions'] and m['missions'][0]['checked']")["missions"][0]
        assert (mission["mission"], mission["about"], mission["problems"]) == ("line", "Straight on.", [])
        say(link, t="take", who="a test")
        say(link, t="start", file="line.yaml", hash=mission["hash"])
        with pytest.raises(WebSocketException):
            told(link, "False")
    browser.await_page("/history")


def until_it_waits(browser: Browser) -> None:
    """Wait until the drives are configured, and somebody has to arm: a late host stops the run before, and after."""
    with browser.link("/telemetry") as telemetry:
        told(telemetry, "'arm' in m.get('state', {}).get('phase', '')")


def asked_to_end(browser: Browser) -> None:
    """Take control at the page of the run, and end it."""
    with browser.link("/control") as control:
        told(control, "m.get('run')")
        say(control, t="take", who="a test")
        try:
            for sequence in range(1, 2000):
                beat = told(control, "m['t'] == 'beat'")["n"]
                say(control, t="hold", seq=sequence, beat=beat, ask=["end"])
        except WebSocketException:
            pass


@pytest.mark.realtime
@pytest.mark.exhaustive
def test_a_run_is_started_once_and_the_page_comes_back_with_its_end(folder: Path) -> None:
    with waiting(folder, free_port()) as (page, one), one.another() as two:
        with one.link("/waiting") as first, two.link("/waiting") as second:
            mission = told(first, "m['missions'] and m['missions'][0]['checked']")["missions"][0]
            start = {"t": "start", "file": "line.yaml", "hash": mission["hash"]}
            say(first, t="take", who="one")
            told(first, "m['seat']['mine']")
            for link in (second, first, second):
                say(link, **start)
            assert told(second, "m['seat']['refused']")["seat"]["refused"] == "take control first"
            assert told(first, "m['run']")["run"]["who"].startswith("one at ")
            say(first, **start)
            refused = told(first, "m['seat']['refused']")["seat"]["refused"]
            assert refused.endswith("has started line")
        one.await_page("/history")
        assert one.client.get("/missions").status_code == 404, "the run's own page is served, to the same cookie"
        page.send_signal(signal.SIGSTOP)
        try:
            assert one.client.post("/stop", json={"t": "stop", "id": "1"}).status_code == 202, (
                "it needs no other process"
            )
        finally:
            page.send_signal(signal.SIGCONT)
        asked_to_end(two)
        one.await_page("/missions")
        with one.link("/waiting") as link:
            last = told(link, "m['last']")["last"]
            assert (last["status"], last["mission"]) == (1, "line")
            assert any(line.startswith("report") for line in last["lines"])
        page.send_signal(signal.SIGTERM)
        assert page.wait(60) == 0
    assert len(list((folder / "runs").iterdir())) == 1


@pytest.mark.realtime
@pytest.mark.exhaustive
@pytest.mark.timeout(90)  # where the second page begins only after the run's end, it waits for ever
def test_a_run_ends_in_order_with_the_page_that_started_it(folder: Path) -> None:
    port = free_port()
    with waiting(folder, port) as (page, browser):
        begin(browser)
        until_it_waits(browser)
        page.kill()
        page.wait(60)
        other = artemis_here("page", folder, "--page-port", str(port))
        assert (other.returncode, "or a run that one started" in other.stderr) == (2, True)
        run = only_run(folder)
        for _ in range(int(PATIENCE / 0.1)):
            if (run / "report.html").exists():
                break
            PAUSE.wait(0.1)
        assert_left_at_rest(run)
        with pytest.raises(httpx.TransportError):
            browser.client.get("/history")


@pytest.mark.realtime
@pytest.mark.exhaustive
def test_the_end_of_the_page_ends_its_run_first_however_often_it_is_asked_for(folder: Path) -> None:
    with waiting(folder, free_port()) as (page, browser):
        begin(browser)
        until_it_waits(browser)
        run = only_run(folder)
        while page.poll() is None and not (run / "report.html").exists():
            page.send_signal(signal.SIGTERM)
            PAUSE.wait(0.1)
        assert page.wait(90) == 0
        assert (run / "report.html").exists(), "it was waited for"
        assert_left_at_rest(run)


def test_a_mission_that_is_not_as_it_was_checked_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match="has changed since it was checked"):
        run_and_report(folder / "line.yaml", simulate=False, page={"started_by_page": True}, checked="0" * 64)
    assert not (folder / "runs").exists()


def test_only_a_page_starts_a_run_in_its_way(folder: Path) -> None:
    facts = json.loads(artemis_here("check", "--json", "--page", folder / "line.yaml").stdout)
    done = artemis_here("run", folder / "line.yaml", "--started-by-page", facts["hash"])
    assert (done.returncode, "only `artemis page`" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["nowhere"], "expected a folder of missions"), ([".", "x"], "expected a folder, pair, or certificate")],
)
def test_what_is_no_folder_is_refused(arguments: list[str], words: str, folder: Path) -> None:
    done = artemis_here("page", *arguments)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr


def test_problems_are_told_to_programs_with_what_is_known(folder: Path) -> None:
    broken = folder / "broken.yaml"
    broken.write_text(
        "# What it is for.\n#\n# More.\nmission: later\nrobot: robots/none.yaml\nbus: simulation\nsteps: []\n"
    )
    done = artemis_here("check", "--json", folder / "line.yaml", broken)
    good, bad = map(json.loads, done.stdout.splitlines())
    assert done.returncode == 2
    assert (good["robot"], good["simulated"], len(good["hash"]), good["problems"]) == ("ARTEMIS", True, 64, [])
    assert (bad["mission"], bad["about"]) == ("later", "What it is for.")
    assert f"{broken}:5:1: robot: file not found" in bad["problems"][0]
    done = artemis_here("check", "--json", MISSIONS / "figure_eight_socketcan.yaml")
    assert json.loads(done.stdout)["bus"] == "socketcan vcan0"
