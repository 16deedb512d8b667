"""The observer `foxglove`, with a client that speaks Foxglove's protocol by the package websockets alone.

The protocol is that of github.com/foxglove/ws-protocol, docs/spec.md.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from artemis.build import install
from artemis_lab.bench.ports import free_port

pytest.importorskip("foxglove", reason="needs the extra foxglove: pip install 'artemis-robot[foxglove]'")
pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from artemis.bridges.ros_types import Ros2Types
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.motion.route import route_from_csv
from artemis.plugins.contracts import PluginContext
from artemis.plugins.observers.foxglove import FoxgloveObserver, FoxgloveObserverConfig
from artemis.scan import Scan
from artemis.testing.observers import ObserverContract
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
PLAIN = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
SCANNER = {"plugin": "lms1xx", "x_m": 0.6, "y_m": 0.0, "heading_deg": 0.0, "height_m": 0.3, "least_range_m": 0.5}
BODY = {"front_m": 0.8, "rear_m": 0.3, "half_width_m": 0.4}
ROBOT = RobotFile.model_validate({**PLAIN.model_dump(), "scanners": {"front": SCANNER}, "outline": BODY})
TICKS = list(ObserverContract().ticks())
LONG = 20.0
DATA = 1


class TestFoxgloveObserver(ObserverContract):
    plugin = FoxgloveObserver
    options: Mapping[str, object] = {"port": 0}


class Viewer:
    """Subscribes to topics, and understands what they tell."""

    def __init__(self, port: int) -> None:
        self._open = ExitStack()
        protocols = [Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1")]
        link = connect(f"ws://127.0.0.1:{port}", subprotocols=protocols, proxy=None, close_timeout=0.1)
        self._link = self._open.enter_context(link)
        self.types = Ros2Types("humble")
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    def learn(self, number: int) -> None:
        """The channels, until there are so many."""
        while len(self.channels) < number:
            message = self._link.recv(timeout=LONG)
            if isinstance(message, str) and (told := json.loads(message))["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in told["channels"]}

    def subscribe(self, *topics: str) -> None:
        wanted = []
        for topic in topics:
            self._topics[len(self._topics)] = topic
            wanted.append({"id": len(self._topics) - 1, "channelId": self.channels[topic]["id"]})
        self._link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def hear(self) -> tuple[str, int, Any]:
        """The next message: topic, time [ns] and content."""
        while True:
            message = self._link.recv(timeout=LONG)
            if isinstance(message, bytes) and message[0] == DATA:
                number, time = struct.unpack_from("<IQ", message, 1)
                topic = self._topics[number]
                return topic, time, self.types.unpack(self.channels[topic]["schemaName"], message[13:])

    def close(self) -> None:
        self._open.close()


@pytest.fixture
def observer(tmp_path: Path) -> Iterator[FoxgloveObserver]:
    route = route_from_csv((MISSIONS / "paths/straight.csv").read_text(), "straight.csv")
    context = PluginContext(name="fox", robot=ROBOT, folder=tmp_path, run=tmp_path, routes={0: route})
    made = FoxgloveObserver(FoxgloveObserverConfig(port=0), context)
    yield made
    made.close()


def test_a_viewer_hears_odometry_scan_transforms_and_what_was_told_before_it_came(observer: FoxgloveObserver) -> None:
    observer.see(TICKS[0], (), 0.0)
    with ExitStack() as ends:
        viewer = Viewer(observer.port)
        ends.callback(viewer.close)
        viewer.learn(len(observer._channels))
        assert viewer.channels["/odom"]["encoding"] == "cdr"
        assert viewer.channels["/odom"]["schemaEncoding"] == "ros2msg"
        viewer.subscribe("/odom", "/scan", "/tf", "/tf_static", "/path")
        wanted = {"odom", "scan", "/tf"}
        while (
            not all(observer._channels[name].has_sinks() for name in wanted)
            or not {"/tf_static", "path"} <= observer._new
        ):
            pass  # the server has heard of it
        scan = Scan(source="front", time=0.0, start_angle=-1.0, increment=1.0, ranges=bytes((232, 3, 0, 0, 208, 7)))
        tick = replace(
            TICKS[50], snapshot=replace(TICKS[50].snapshot, sensed=replace(TICKS[50].snapshot.sensed, scans=(scan,)))
        )
        observer.see(tick, (), 0.0)
        heard = {topic: (time, message) for topic, time, message in (viewer.hear() for _ in range(5))}
    assert heard.keys() == {"/odom", "/scan", "/tf", "/tf_static", "/path"}
    time, odometry = heard["/odom"]
    assert odometry.pose.pose.position.x == tick.snapshot.odometry.pose.x
    assert time == odometry.header.stamp.sec * 10**9 + odometry.header.stamp.nanosec
    assert list(heard["/scan"][1].ranges) == [1.0, 0.0, 2.0]
    assert heard["/tf"][1].transforms[0].child_frame_id == "base_link"
    assert [each.child_frame_id for each in heard["/tf_static"][1].transforms][-1] == "front"
    assert len(heard["/path"][1].poses) > 10
    assert observer.take_problems() == []


def test_a_viewer_that_is_too_slow_is_told_once(observer: FoxgloveObserver) -> None:
    problems: list[tuple[str, str, str]] = []
    with ExitStack() as ends:
        viewer = Viewer(observer.port)
        ends.callback(viewer.close)
        viewer.learn(len(observer._channels))
        viewer.subscribe("/odom")
        while not observer._channels["odom"].has_sinks():
            pass
        observer.see(TICKS[0], (), 0.0)
        assert observer.take_problems() == []
        while not problems:  # nobody reads
            observer._channels["odom"].log(bytes(1 << 19))
            problems += observer.take_problems()
        for _ in range(100):
            observer._channels["odom"].log(bytes(1 << 19))
            problems += observer.take_problems()
    assert problems == [("NET-12", "fox", "a viewer is too slow: messages for it are dropped")]
    observer.close()
    assert observer.take_problems() == []


def test_a_port_in_use_is_refused_before_the_run_and_not_when_a_mission_is_checked(
    observer: FoxgloveObserver, tmp_path: Path
) -> None:
    config = FoxgloveObserverConfig(port=observer.port)
    with pytest.raises(ConfigError, match=f"fox: 127.0.0.1, port {observer.port}: .*Address already in use"):
        FoxgloveObserver(config, PluginContext(name="fox", robot=ROBOT, folder=tmp_path, run=tmp_path))
    checked = FoxgloveObserver(config, PluginContext(name="fox", robot=ROBOT, folder=tmp_path))
    checked.see(TICKS[0], (), 0.0)
    checked.close()
    wrong = FoxgloveObserverConfig(port=free_port(), listen="192.0.2.1")
    with pytest.raises(ConfigError, match="Cannot assign requested address"):
        FoxgloveObserver(wrong, PluginContext(name="fox", robot=ROBOT, folder=tmp_path, run=tmp_path))


def test_without_its_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.build.find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=f"fox: plugin: foxglove needs the package foxglove: {re.escape(install('foxglove'))}"
    ):
        FoxgloveObserver(FoxgloveObserverConfig(), PluginContext(name="fox", robot=ROBOT, folder=tmp_path))
