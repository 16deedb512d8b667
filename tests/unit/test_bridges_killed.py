"""Bridges to other programs whose processes are killed again and again: they are heard again in time, each time."""

from __future__ import annotations

import itertools
import json
import os
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from time import monotonic

import pytest
from lateness import BACK
from ros1_rig import Master

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")
pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from artemis.mission.actions import PluginUse
from artemis.mission.loading import load_model, plugin_from
from artemis.plugins.contracts import PluginContext
from artemis.plugins.own_process import ObserverProcess
from artemis.plugins.registry import OBSERVERS
from artemis.testing.observers import ObserverContract
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port

pytestmark = pytest.mark.realtime

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
KILLS, LONG = 3, 20.0
Heard = Callable[[], object]
"""Whether a program that connects now hears the bridge."""


class Ticking:
    """Shows ticks to the process of an observer, 50 times a second."""

    def __init__(self, plugin: str, keys: dict[str, object], folder: Path) -> None:
        kind, config = plugin_from(OBSERVERS, PluginUse.model_validate({"plugin": plugin, **keys}))
        self.process = ObserverProcess(kind, config, PluginContext(name="far", robot=ROBOT, folder=folder, run=folder))
        self.process.wait()
        self.problems: list[tuple[str, str, str]] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._tick)
        self._thread.start()

    def _tick(self) -> None:
        for tick in itertools.cycle(ObserverContract().ticks()):
            if self._end.wait(0.02):
                return
            self.process.see(tick, (), tick.snapshot.time)
            self.problems += self.process.take_problems()

    def until(self, holds: Callable[[], object]) -> None:
        end = monotonic() + LONG
        while not holds():
            assert monotonic() < end, self.problems
            self._end.wait(0.01)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.process.close()


def ros1(closing: ExitStack) -> tuple[dict[str, object], Heard]:
    master = Master()
    closing.callback(master.close)
    master.begin()
    known: set[str] = set()

    def heard() -> bool:
        """Another node has registered its topic."""
        _, uri = master.published.get("/odom", ("", ""))
        new = uri != "" and uri not in known
        known.add(uri)
        return new

    return {"master": master.uri}, heard


def rosbridge(closing: ExitStack) -> tuple[dict[str, object], Heard]:
    port = free_port()

    def heard() -> bool:
        """A client hears odometry."""
        try:
            with connect(f"ws://127.0.0.1:{port}", proxy=None, close_timeout=0.1) as link:
                link.send(json.dumps({"op": "subscribe", "topic": "/odom"}))
                return "child_frame_id" in json.loads(link.recv(timeout=LONG))["msg"]
        except (OSError, EOFError, WebSocketException):
            return False

    return {"port": port}, heard


def foxglove(closing: ExitStack) -> tuple[dict[str, object], Heard]:
    pytest.importorskip("foxglove", reason="needs the extra foxglove: pip install 'artemis-robot[foxglove]'")
    port, protocols = free_port(), [Subprotocol("foxglove.sdk.v1")]

    def heard() -> bool:
        """A viewer is greeted."""
        try:
            with connect(f"ws://127.0.0.1:{port}", subprotocols=protocols, proxy=None, close_timeout=0.1) as link:
                return bool(json.loads(link.recv(timeout=LONG))["op"] == "serverInfo")
        except (OSError, EOFError, WebSocketException):
            return False

    return {"port": port}, heard


@pytest.mark.parametrize("bridge", [ros1, rosbridge, foxglove])
def test_a_bridge_is_heard_again_in_time_however_often_it_is_killed(
    bridge: Callable[[ExitStack], tuple[dict[str, object], Heard]], tmp_path: Path, closing: ExitStack
) -> None:
    keys, heard = bridge(closing)
    ticking = Ticking(bridge.__name__, keys, tmp_path)
    closing.callback(ticking.close)
    ticking.until(heard)
    for _ in range(KILLS):
        pid = ticking.process.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        killed = monotonic()
        ticking.until(lambda: ticking.process.pid not in (None, pid))  # noqa: B023 (called here)
        ticking.until(heard)
        assert monotonic() - killed <= BACK
    ticking.until(lambda: any("it is back after" in words for _, _, words in ticking.problems))
    said = {words.partition(";")[0] for row, _, words in ticking.problems if row == "NET-13"}
    assert "killed by SIGKILL" in said
