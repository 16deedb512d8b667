"""roslibpy hears and drives artemis; meanwhile the bridge's process is killed, and the robot drives on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from lateness import BACK

pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
pytest.importorskip("roslibpy", reason="needs the package roslibpy")
sys.path.append(str(Path(__file__).parents[1] / "unit"))
from programs import bridge_of, until
from websockets.sync.client import connect

from artemis_lab.bench.ports import free_port

ROOT = Path(__file__).parents[2]
LONG = 60.0

FAR = 0.3
"""The robot has driven on [m]."""

pytestmark = [pytest.mark.realtime, pytest.mark.exhaustive]


@pytest.fixture
def running() -> Iterator[list[subprocess.Popen[str]]]:
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate(timeout=LONG)


def begun(running: list[subprocess.Popen[str]], *command: str) -> subprocess.Popen[str]:
    pipe, environment = subprocess.PIPE, {**os.environ, "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True)
    running.append(process)
    return process


def test_roslibpy_drives_on_while_the_bridge_is_killed(tmp_path: Path, running: list[subprocess.Popen[str]]) -> None:
    shutil.copytree(ROOT / "missions/robots", tmp_path / "robots")
    tells, takes = free_port(), free_port()
    text = (
        (ROOT / "missions/rosbridge_teleop.yaml")
        .read_text()
        .replace("  - calibrate: {steering: from_potentiometers}\n", "")
    )
    text = text.replace("plugin: rosbridge\n", f"plugin: rosbridge\n    port: {takes}\n")
    mission = tmp_path / "mission.yaml"
    mission.write_text(text.replace("inputs: 9091", f"port: {tells}, inputs: {takes}"))
    run = begun(running, str(Path(sys.executable).with_name("artemis")), "run", str(mission))
    until(run, "to drive")
    client = begun(running, sys.executable, str(Path(__file__).with_name("roslibpy_drives.py")), str(tells), str(takes))
    assert "/odom" in until(client, "topics")[-1].split()
    until(client, "heard")
    until(run, "driving")
    killed = bridge_of(run)
    os.kill(killed, signal.SIGKILL)
    (folder,) = (tmp_path / "runs").iterdir()
    journal = folder / "journal.jsonl"
    until(run, "it is back")
    assert bridge_of(run) != killed
    with connect(f"ws://127.0.0.1:{tells}", proxy=None) as link:
        link.send(json.dumps({"op": "subscribe", "topic": "/odom"}))
        while json.loads(link.recv(timeout=LONG))["msg"]["pose"]["pose"]["position"]["x"] < FAR:
            pass
    assert client.stdin is not None
    client.stdin.write("\n")
    client.stdin.flush()
    until(run, "quick stop")
    assert "answer True stop: requested" in until(client, "over")
    run.send_signal(signal.SIGINT)
    lines = until(run, "result")
    entries = [json.loads(line) for line in journal.read_text().splitlines()]
    told = [entry["text"] for entry in entries if "NET-13" in entry.get("text", "")]
    assert [text for text in told if "killed by SIGKILL; it is started again" in text]
    (back,) = {text.partition("back after ")[2].split()[0] for text in told if "back after" in text}
    assert float(back) <= BACK
    stops = [line for line in lines if "INP-0" in line]
    assert stops == []
