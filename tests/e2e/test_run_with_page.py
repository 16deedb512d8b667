"""`artemis run --page` as a process: paired, driven, stopped, with its page killed on the way, and ended from there."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

import httpx
import pytest
from command_line import MISSIONS, ROBOT, artemis_here, read_until, started
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis_lab.bench.ports import free_port

MISSION = """
mission: page-teleop
robot: artemis.yaml
bus: simulation
inputs:
  page: {plugin: page, max_speed_m_s: 0.5}
steps:
  - teleop: {input: page, until: {button: done}}
"""


class Operator:
    """Somebody at a browser, as far as its words go."""

    def __init__(self, url: str, client: httpx.Client, run: subprocess.Popen[str]) -> None:
        self.url, self.client, self.run = url, client, run
        self.state: dict[str, Any] = {}

    def _link(self, path: str) -> ClientConnection:
        cookie = "; ".join(f"{name}={value}" for name, value in self.client.cookies.items())
        place = self.url.replace("http", "ws") + path
        return connect(place, origin=Origin(self.url), additional_headers={"cookie": cookie}, max_size=None)

    def drive(self, until: str, *, held: bool = True, ask: str = "") -> None:
        """Take control, and hold the stick forward where that counts, until the mode and phase are such."""
        with self._link("/control") as control, self._link("/telemetry") as telemetry:
            while not (told := json.loads(control.recv(20))).get("run"):
                pass
            control.send(json.dumps({"t": "take", "who": "a test"}))
            sequence = 0
            while not re.search(until, f"{self.state.get('mode')}: {self.state.get('phase')}"):
                told = json.loads(control.recv(20))
                if told["t"] != "beat":
                    continue
                self._hear(telemetry)
                if self.state.get("mode") in ("fault", "quickstop") and not ask:
                    pytest.fail(read_until(self.run, "FAULT"))  # or skips: the computer is too busy
                sequence += 1
                holds = held and sequence > 5 and self.state.get("mode") == "teleop" and sequence % 60 > 5
                words = {"held": holds, "neutral": not holds, "y": 0.6 * holds, "ask": [ask] * (ask != "")}
                control.send(json.dumps({"t": "hold", "seq": sequence, "beat": told["n"], **words}))

    def _hear(self, telemetry: ClientConnection) -> None:
        try:
            while True:
                self.state = json.loads(telemetry.recv(0)).get("state", self.state)
        except TimeoutError:
            pass


def children(process: int) -> list[int]:
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(process)], capture_output=True, text=True, check=True)
    return [int(line) for line in found.stdout.split()]


@pytest.mark.realtime
@pytest.mark.exhaustive
def test_a_run_is_driven_from_its_page_and_survives_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    mission, port = tmp_path / "mission.yaml", free_port()
    mission.write_text(MISSION)
    shutil.copy(ROBOT, tmp_path)
    url = f"http://127.0.0.1:{port}"
    with started("run", mission, "--page-port", str(port)) as run:
        (code,) = re.findall(r"pair#(\w+)", read_until(run, "init"))
        with httpx.Client(base_url=url, headers={"origin": url}, timeout=20) as client:
            assert client.post("/pair", json={"code": code}).status_code == 200
            operator = Operator(url, client, run)
            operator.drive("teleop: driving")
            assert client.post("/stop", json={"t": "stop", "id": "1"}).status_code == 202
            read_until(run, "quick stop")
            (page,) = children(run.pid)
            os.kill(page, signal.SIGKILL)
            read_until(run, "it is back after")
            with pytest.raises(ConnectionClosed):  # the run ends, and its page with it
                operator.drive("never", held=False, ask="end")
        read_until(run, "result")
        assert run.wait(60) == 1


@pytest.mark.realtime
@pytest.mark.exhaustive
def test_a_fault_before_anybody_has_come_to_the_page_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a terminal: the operator whom the mission requires may still come."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    mission, port = tmp_path / "mission.yaml", free_port()
    mission.write_text(MISSION + "simulation: {faults: [{at_s: 0.5, inject: DRV-25, node: steer-left}]}\n")
    shutil.copy(ROBOT, tmp_path)
    url = f"http://127.0.0.1:{port}"
    with started("run", mission, "--page-port", str(port)) as run:
        (code,) = re.findall(r"pair#(\w+)", read_until(run, "DRV-25"))
        patient = httpx.HTTPTransport(retries=6)
        with httpx.Client(base_url=url, headers={"origin": url}, timeout=20, transport=patient) as client:
            assert client.post("/pair", json={"code": code}).status_code == 200
            operator = Operator(url, client, run)
            with operator._link("/telemetry") as telemetry:
                while "acknowledge" not in operator.state.get("phase", ""):
                    operator.state = json.loads(telemetry.recv(20)).get("state", operator.state)
        run.send_signal(signal.SIGINT)
        run.wait(60)


def test_one_more_browser_is_paired_by_a_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    done = artemis_here("page", "pair", "--page-port", "8765")
    assert done.returncode == 0
    assert "http://127.0.0.1:8765/pair#" in done.stdout
    with socket.create_server(("127.0.0.1", 0)) as page:
        port = page.getsockname()[1]
        assert "nothing answers" not in artemis_here("page", "pair", "--page-port", str(port)).stdout
    assert "nothing answers" in artemis_here("page", "pair", "--page-port", str(port)).stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["page", "nonsense"], "expected a folder of missions, or pair, or certificate with names"),
        (["page", "pair", "--page-address", "nowhere"], "listen: expected an IPv4 or IPv6 address"),
        (["page", "pair", "--page-address", "0.0.0.0"], "artemis page certificate"),
        (["run", str(MISSIONS / "figure_eight.yaml"), "--page-address", "0.0.0.0"], "artemis page certificate"),
        (["run", str(MISSIONS / "figure_eight.yaml"), "--page-tls", "none", "none"], "none"),
    ],
)
def test_what_cannot_be_is_refused(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    done = artemis_here(*arguments)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr
    assert "Value error" not in done.stderr
