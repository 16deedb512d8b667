"""The observer and the input `rosbridge`, with clients of the package websockets."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ports import free_port
from pydantic import ValidationError

pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis.bridges.rosbridge import server
from artemis.bridges.rosbridge.session import ClientSession
from artemis.errors import ConfigError, DeviceLost
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.rosbridge import RosbridgeInput, RosbridgeInputConfig
from artemis.plugins.observers.rosbridge import RosbridgeObserver, RosbridgeObserverConfig
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import Pose, Request
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
TICKS = list(ObserverContract().ticks())
LONG = 20.0


class TestRosbridgeObserver(ObserverContract):
    plugin = RosbridgeObserver
    options: Mapping[str, object] = {"port": 0}


class TestRosbridgeInput(InputContract):
    plugin = RosbridgeInput
    duration = 1.0
    options: Mapping[str, object] = {"port": 0}


class Client:
    """A client that says and hears JSON."""

    def __init__(self, port: int, origin: str | None = None) -> None:
        url = f"ws://127.0.0.1:{port}"
        self._open = ExitStack()
        self.connection: ClientConnection = self._open.enter_context(
            connect(url, origin=Origin(origin) if origin else None, proxy=None, close_timeout=0.1)
        )

    def close(self) -> None:
        self._open.close()

    def say(self, **message: object) -> None:
        self.connection.send(json.dumps(message))

    def hear(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self.connection.recv(timeout=LONG))
        return message

    def ask(self, service: str) -> dict[str, Any]:
        """The answer of a service, which comes after everything that was said before."""
        self.say(op="call_service", service=service, id="asked")
        while (message := self.hear()).get("id") != "asked":
            pass
        return message


class Run:
    """An observer that sees ticks, and an input that is read."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.open = folder, list[Any]()

    def observer(self, **options: object) -> RosbridgeObserver:
        config = RosbridgeObserverConfig.model_validate({"port": 0, **options})
        made = RosbridgeObserver(config, PluginContext(name="web", robot=ROBOT, folder=self.folder, run=self.folder))
        made.see(TICKS[0], (), 0.0)
        self.open.append(made)
        return made

    def input(self, wake: Callable[[], None] = lambda: None, **options: object) -> RosbridgeInput:
        config = RosbridgeInputConfig.model_validate({"port": 0, "enabled_by": "command", **options})
        made = RosbridgeInput(config, PluginContext(name="remote", robot=ROBOT, folder=self.folder, wake=wake))
        made.read(0.0)
        self.open.append(made)
        return made

    def client(self, plugin: Any, origin: str | None = None) -> Client:  # noqa: ANN401 (either)
        made = Client(plugin.server.port, origin)
        self.open.insert(0, made)
        return made


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run(tmp_path)
    yield made
    for each in made.open:
        each.close()


def test_a_run_is_heard(run: Run) -> None:
    observer = run.observer(transforms=True)
    client = run.client(observer)
    assert dict(zip(*client.ask("/rosapi/topics")["values"].values(), strict=True))["/odom"] == "nav_msgs/msg/Odometry"
    client.say(op="subscribe", topic="/odom", type="nav_msgs/Odometry")
    client.say(op="subscribe", topic="/tf_static")
    fixed = client.hear()
    assert (fixed["op"], fixed["topic"]) == ("publish", "/tf_static")
    assert [each["child_frame_id"] for each in fixed["msg"]["transforms"]] == ["rear_left_wheel", "rear_right_wheel"]
    assert client.ask("/rosapi/topic_type")["values"] == {"type": ""}
    for number in range(1, 51):
        observer.see(TICKS[number], (), 0.0)
    heard = [client.hear() for _ in range(50)]
    assert {each["topic"] for each in heard} == {"/odom"}
    assert [each["msg"]["pose"]["pose"]["position"]["x"] for each in heard] == [
        TICKS[number].snapshot.odometry.pose.x for number in range(1, 51)
    ]
    observer.close()
    assert observer.take_problems() == []
    with pytest.raises(ConnectionClosed):
        client.hear()


def test_the_map_is_told_to_who_comes_later(run: Run, tmp_path: Path) -> None:
    content = OccupancyMap(cells=np.array([[0, 100, -1]], np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    shown = ShownMap(content=content, odometry=None)
    context = PluginContext(name="web", robot=ROBOT, folder=tmp_path, run=tmp_path, map=lambda: shown)
    observer = RosbridgeObserver(RosbridgeObserverConfig(port=0), context)
    run.open.append(observer)
    for tick in TICKS[:2]:
        observer.see(tick, (), 0.0)
    client = run.client(observer)
    client.say(op="subscribe", topic="/map", type="nav_msgs/OccupancyGrid")
    heard = client.hear()["msg"]
    assert (heard["info"]["width"], heard["info"]["height"], heard["data"]) == (3, 1, [0, 100, -1])


def test_a_client_that_does_not_read_loses_the_oldest_messages_and_that_is_said_once(run: Run) -> None:
    observer = run.observer(queue=4)
    client = run.client(observer)
    client.say(op="subscribe", topic="/odom")
    client.ask("/rosapi/services")
    problems: list[tuple[str, str, str]] = []
    assert observer.server is not None
    while not problems:
        observer.server.put([("/odom", b"%d" % 0 + b" " * (1 << 20))])
        problems += observer.take_problems()
    problems += observer.take_problems()
    assert problems == [("NET-12", "web", "a client is too slow: messages for it are dropped")]
    observer.close()
    ((_, _, words),) = observer.take_problems()
    assert words.endswith("messages were dropped: clients were too slow")


def test_a_port_in_use_is_refused_before_the_run_and_not_when_a_mission_is_checked(run: Run, tmp_path: Path) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)):
        with pytest.raises(ConfigError, match=f"web: 127.0.0.1, port {port}: Address already in use"):
            run.observer(port=port)
        config = RosbridgeObserverConfig(port=port)
        checked = RosbridgeObserver(config, PluginContext(name="web", robot=ROBOT, folder=tmp_path))
        checked.see(TICKS[0], (), 0.0)
        assert checked.take_problems() == []
        checked.close()
        with pytest.raises(DeviceLost, match="Address already in use"):
            run.input(port=port)


def test_a_page_of_another_site_is_refused_and_one_that_is_named_is_not(run: Run) -> None:
    device = run.input(origins=["http://localhost:8000"])
    for origin in ("http://evil.example", "http://localhost:8001", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            run.client(device, origin)
    assert run.client(device, "http://localhost:8000").ask("/stop")["result"]
    assert run.client(device).ask("/stop")["result"]


@pytest.mark.parametrize("through", [False, True])
def test_a_client_drives_and_stops_and_asks_for_what_is_allowed(run: Run, through: bool) -> None:
    woken: list[bool] = []
    device = run.input(lambda: woken.append(True), allow=["arm"], max_speed_m_s=0.4)
    assert device.server is not None
    client = run.client(run.observer(inputs=device.server.port) if through else device)
    client.say(op="advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
    client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 2.0}})
    assert client.ask("/stop")["values"] == {"success": True, "message": "stop: requested"}
    sample = device.read(1.0)
    assert (sample.speed, sample.enabled, sample.neutral, sample.requests) == (0.4, True, False, (Request.QUICKSTOP,))
    assert woken == [True]
    assert device.read(1.2).age == pytest.approx(0.2)  # nothing more came: too old to drive by
    assert device.read(1.6).neutral
    assert client.ask("/arm")["result"]
    assert device.read(2.0).requests == (Request.ARM,)
    refused = client.ask("/acknowledge")
    assert (refused["result"], refused["values"]) == (False, "no service /acknowledge")
    client.say(op="publish", topic="/stop", msg={})
    client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": "fast"}})
    assert "x is 'fast'" in client.hear()["msg"]
    assert device.read(3.0).requests == (Request.QUICKSTOP,)


def test_a_goal_is_passed_on_and_its_sender_told_why_one_is_refused(run: Run) -> None:
    device = run.input(allow=["goal_pose"])
    client = run.client(device)
    client.say(op="advertise", topic="/goal_pose", type="geometry_msgs/PoseStamped")
    pose = {"position": {"x": 1.5, "y": 2.0}, "orientation": {"w": 1.0}}
    for frame in ("map", "odom"):
        client.say(op="publish", topic="/goal_pose", msg={"header": {"frame_id": frame}, "pose": pose})
    assert client.hear()["msg"] == "it is in the frame 'odom', and map is needed"
    assert (device.read(1.0).goal, device.read(1.02).goal) == (Pose(x=1.5, y=2.0), None)
    assert device.take_problems() == [("NET-14", "goal_pose: it is in the frame 'odom', and map is needed")]
    client.say(op="publish", topic="/initialpose", msg={})
    assert client.hear()["msg"].startswith("/initialpose is not heard here")


def test_of_two_clients_the_first_that_drives_has_the_robot(run: Run) -> None:
    device = run.input()
    one, other = run.client(device), run.client(device)
    for client, speed in ((one, 0.3), (other, -0.3)):
        client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": speed}})
        client.ask("/stop")
    assert device.read(1.0).speed == 0.3


def test_commands_for_an_input_that_is_not_there_are_refused(run: Run) -> None:
    client = run.client(run.observer(inputs=free_port()))
    client.say(op="publish", topic="/cmd_vel", msg={})
    assert "does not take commands" in client.hear()["msg"]


def test_a_server_that_ended_is_told_once(run: Run) -> None:
    observer = run.observer()
    assert observer.server is not None
    observer.server._loop.call_soon_threadsafe(observer.server._end.set)  # type: ignore[union-attr]
    observer.server._thread.join(LONG)
    told = []
    for number in (1, 2):
        observer.see(TICKS[number], (), 0.0)
        told += observer.take_problems()
    assert told == [("NET-12", "web", "its server has ended")]


def test_so_many_clients_at_most(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MOST_CLIENTS", 1)
    observer = run.observer()
    run.client(observer).ask("/rosapi/topics")
    with pytest.raises(ConnectionClosed, match="1 clients are the most"):
        run.client(observer).ask("/rosapi/topics")


def test_connections_that_say_nothing_are_so_many_at_most(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MOST_CLIENTS", 2)
    device = run.input()
    assert device.server is not None
    client = run.client(device)
    with ExitStack() as ends:
        place = ("127.0.0.1", device.server.port)
        for _ in range(3):
            ends.enter_context(socket.create_connection(place, LONG))
        with socket.create_connection(place, 5.0) as one_more, suppress(ConnectionResetError):  # at once: not in 10 s
            assert one_more.recv(1) == b""
        assert client.ask("/stop")["result"]


def test_who_says_too_much_is_closed_and_kept_out_for_a_while(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "KEPT_OUT", 1000.0)
    monkeypatch.setattr(server, "RATE", 0.01)
    device, heard = run.input(), list[str]()
    take = ClientSession.take
    monkeypatch.setattr(ClientSession, "take", lambda self, text, now: heard.append(text) or take(self, text, now))  # type: ignore[func-returns-value]
    client, other = run.client(device), run.client(device)

    def flood() -> None:
        for number in range(100_000):
            client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 0.001 * (number % 100)}})

    with pytest.raises(ConnectionClosed):
        flood()
    assert len(heard) == server.BURST
    assert other.ask("/stop")["result"]
    with pytest.raises((InvalidMessage, ConnectionClosed, ConnectionError, EOFError)):
        run.client(device)
    assert device.server is not None
    device.server._kept_out.clear()
    assert run.client(device).ask("/stop")["result"]


def test_a_flood_of_stops_makes_one_tick_of_its_own(run: Run) -> None:
    woken: list[bool] = []
    device = run.input(lambda: woken.append(True))
    client = run.client(device)
    for time in (1.0, 1.02):
        for _ in range(50):
            client.say(op="publish", topic="/stop", msg={})
        client.ask("/stop")
        assert device.read(time).requests == (Request.QUICKSTOP,)
    assert (len(woken), device.read(1.04).requests) == (1, ())
    client.ask("/stop")
    assert (len(woken), device.read(1.06).requests) == (2, (Request.QUICKSTOP,))


def test_without_its_extra_it_says_what_to_install(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "find_spec", lambda name: None)
    for make in (run.observer, run.input):
        with pytest.raises(
            ConfigError, match=r"rosbridge needs the package websockets: pip install 'artemis-robot\[web\]'"
        ):
            make()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"port": 70000}, "less than or equal to 65535"),
        ({"listen": "everywhere"}, "everywhere"),
        ({"origins": ["localhost:8000"]}, "is no origin of a web page"),
        ({"ros": 3}, "1 or 2"),
    ],
)
def test_wrong_keys_are_refused(options: dict[str, Any], words: str) -> None:
    for config in (RosbridgeObserverConfig, RosbridgeInputConfig):
        with pytest.raises(ValidationError, match=words):
            config.model_validate(options)


def test_two_inputs_of_one_port_are_one_device() -> None:
    one, other, third = (RosbridgeInputConfig(port=port) for port in (9091, 9091, 0))
    assert RosbridgeInput.may_share(one, other, {})
    assert not RosbridgeInput.may_share(third, third, {})
