"""The observer and the input `rosbridge`, with clients of the package websockets."""

from __future__ import annotations

import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lateness import BACK
from msgspec.structs import replace as replace_fields
from pydantic import ValidationError

from artemis.build import install
from artemis_lab.bench.ports import free_port

pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from artemis.bridges.addresses import bound
from artemis.bridges.received import Asked, Mailbox, Received
from artemis.bridges.rosbridge import server
from artemis.bridges.rosbridge.server import RosbridgeServer
from artemis.bridges.rosbridge.session import ClientSession, Offer
from artemis.clock import stopwatch
from artemis.errors import ConfigError, DeviceLost
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_mission, load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.rosbridge import RosbridgeInput, RosbridgeInputConfig
from artemis.plugins.observers.rosbridge import RosbridgeObserver, RosbridgeObserverConfig
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput, Pose, Request, Tick
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
TICKS = list(ObserverContract().ticks())
LONG = 20.0


class TestRosbridgeObserver(ObserverContract):
    plugin = RosbridgeObserver
    options: Mapping[str, object] = {"port": 0}


class TestRosbridgeInput(InputContract):
    plugin = RosbridgeInput
    duration = 1.0
    options: Mapping[str, object] = {"port": 0}

    def given(self) -> PluginContext:
        return replace(super().given(), real_time=True)


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


class Input:
    """An input whose ticks a thread makes, and the samples that it gave."""

    def __init__(self, config: RosbridgeInputConfig, context: PluginContext) -> None:
        self.device, self.samples, self.problems = RosbridgeInput(config, context), list[OperatorInput](), list[Any]()
        self.port, self.woken = self.device.port, 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._tick)
        self._thread.start()

    def _tick(self) -> None:
        while not self._end.wait(0.005):
            with suppress(DeviceLost):
                self.samples.append(sample := self.device.read(stopwatch()))
                self.device.show(shown(sample))
            self.problems += self.device.take_problems()

    def until(self, holds: Callable[[OperatorInput], object]) -> OperatorInput:
        """The first sample from now on of which something holds."""
        seen, end = len(self.samples), stopwatch() + LONG
        while stopwatch() < end:
            for sample in self.samples[seen:]:
                seen += 1
                if holds(sample):
                    return sample
            self._end.wait(0.005)
        raise AssertionError("that never holds")

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.device.close()


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

    def input(self, wake: Callable[[], None] = lambda: None, **options: object) -> Input:
        config = RosbridgeInputConfig.model_validate({"port": 0, "enabled_by": "command", **options})
        context = PluginContext(
            name="remote", robot=ROBOT, folder=self.folder, wake=wake, real_time=True, ignored=ignored
        )
        made = Input(config, context)
        self.open.append(made)
        return made

    def server(self) -> RosbridgeServer:
        """One that has a service alone."""
        offer, config = Offer(services={"/stop": lambda arguments: {"success": True}}), RosbridgeInputConfig()
        made = RosbridgeServer("remote", bound("127.0.0.1", listening=True), offer, config)
        made.start()
        self.open.append(made)
        return made

    def client(self, plugin: Any, origin: str | None = None) -> Client:  # noqa: ANN401 (any of them)
        made = Client(plugin.server.port if hasattr(plugin, "server") else plugin.port, origin)
        self.open.insert(0, made)
        return made

    def settled(self, client: Client) -> Client:
        """A client that has been connected for long enough."""
        pause = threading.Event()
        while "may be an old" in (told := client.ask("/arm")["values"])["message"]:
            pause.wait(0.02)
        assert told == {"success": False, "message": "arm: ignored, the drives are armed"}
        return client


def ignored(request: Request, tick: Tick) -> str | None:
    return "the drives are armed" if request is Request.ARM else None


def shown(sample: OperatorInput) -> Tick:
    """The tick that took a sample."""
    sensed = replace_fields(TICKS[0].snapshot.sensed, inputs=(sample,))
    return replace_fields(TICKS[0], snapshot=replace_fields(TICKS[0].snapshot, sensed=sensed))


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
        with pytest.raises(ConfigError, match=f"remote: 127.0.0.1, port {port}: Address already in use"):
            run.input(port=port)
        context = PluginContext(name="remote", robot=ROBOT, folder=tmp_path)
        device = RosbridgeInput(RosbridgeInputConfig(port=port), context)
        with pytest.raises(DeviceLost, match="its clients need real time"):
            device.read(0.0)
        device.close()


def test_an_address_that_this_computer_does_not_have_is_refused_by_check(tmp_path: Path) -> None:
    context = PluginContext(name="web", robot=ROBOT, folder=tmp_path)
    for plugin, config in ((RosbridgeObserver, RosbridgeObserverConfig), (RosbridgeInput, RosbridgeInputConfig)):
        with pytest.raises(ConfigError, match=r"web: listen: 192\.0\.2\.1: Cannot assign requested address"):
            plugin(config(listen="192.0.2.1"), context)  # type: ignore[arg-type]


MISSION = """
mission: far
robot: robot.yaml
bus: simulation
inputs:
  remote: {plugin: rosbridge, port: 9191, listen: INPUT}
observers:
  web: {plugin: rosbridge, inputs: 9191, port: 9190}
steps:
  - teleop: {input: remote, until: {button: done}}
"""


@pytest.mark.parametrize(
    ("port", "listen", "url"),
    [
        ("9191", "127.0.0.2", "ws://127.0.0.2:9191/"),
        ("9191", "0.0.0.0", "ws://127.0.0.1:9191/"),
        ("9191", "'::'", "ws://[::1]:9191/"),
        ("9091", "127.0.0.1", None),
    ],
)
def test_an_observer_passes_commands_on_to_an_input_that_is_there(
    tmp_path: Path, port: str, listen: str, url: str | None
) -> None:
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION.replace("INPUT", listen).replace("inputs: 9191", f"inputs: {port}"))
    if url is None:
        why = r"8:\d+: observers.web.inputs: 9091 is the port of no input with plugin: rosbridge \(9191\)"
        with pytest.raises(ConfigError, match=why):
            load_mission(mission)
        return
    words = load_mission(mission).mission.model_dump_json(by_alias=True).encode()
    context = PluginContext(name="web", robot=ROBOT, folder=tmp_path, run=tmp_path, mission=words)
    observer = RosbridgeObserver(RosbridgeObserverConfig(port=0, inputs=9191), context)
    try:
        assert observer.server is not None
        assert observer.server._inputs == url
    finally:
        observer.close()


def test_an_input_and_an_observer_at_one_port_are_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    mission = tmp_path / "mission.yaml"
    text = MISSION.replace("inputs: 9191, port: 9190", "port: 9191")
    mission.write_text(text.replace("INPUT", "0.0.0.0"))
    with pytest.raises(ConfigError, match=r"8:\d+: observers.web.port: port 9191 is already used by inputs.remote"):
        load_mission(mission)
    mission.write_text(text.replace("INPUT", "127.0.0.2"))
    assert load_mission(mission), "the same number at another address is another port"


def test_a_page_of_another_site_is_refused_and_one_that_is_named_is_not(run: Run) -> None:
    device = run.input(origins=["http://localhost:8000"])
    for origin in ("http://evil.example", "http://localhost:8001", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            run.client(device, origin)
    assert run.client(device, "http://localhost:8000").ask("/stop")["result"]
    assert run.client(device).ask("/stop")["result"]


@pytest.mark.realtime
@pytest.mark.parametrize("through", [False, True])
def test_a_client_drives_and_stops_and_asks_for_what_is_allowed(run: Run, through: bool) -> None:
    woken: list[bool] = []
    device = run.input(lambda: woken.append(True), allow=["arm", "done"], max_speed_m_s=0.4)
    client = run.client(run.observer(inputs=device.port) if through else device)
    assert client.ask("/stop")["values"] == {"success": True, "message": "stop: requested"}
    assert woken == [True]
    client.say(op="publish", topic="/done", msg={})
    assert "may be an old queued message; send it again" in client.hear()["msg"]
    run.settled(client)
    client.say(op="advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
    client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 2.0}})
    first = device.until(lambda sample: sample.enabled)
    assert (first.speed, first.neutral) == (0.4, False)
    last = device.until(lambda sample: not sample.enabled)
    assert last.neutral, "nothing more came"
    assert max(sample.age or 0.0 for sample in device.samples) > 0.4
    assert client.ask("/done")["values"] == {"success": True, "message": "done: requested"}
    refused = client.ask("/acknowledge")
    assert (refused["result"], refused["values"]) == (False, "no service /acknowledge")
    client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": "fast"}})
    assert "x is 'fast'" in client.hear()["msg"]
    client.say(op="publish", topic="/stop", msg={})
    device.until(lambda sample: Request.QUICKSTOP in sample.requests)
    rows = {row for row, _ in device.problems}
    assert rows == {"NET-04"}, "done, and arm, were said too soon"
    assert sum(Request.DONE in sample.requests for sample in device.samples) == 1


@pytest.mark.realtime
def test_a_goal_is_passed_on_and_its_sender_told_why_one_is_refused(run: Run) -> None:
    device = run.input(allow=["goal_pose", "arm"])
    client = run.settled(run.client(device))
    client.say(op="advertise", topic="/goal_pose", type="geometry_msgs/PoseStamped")
    pose = {"position": {"x": 1.5, "y": 2.0}, "orientation": {"w": 1.0}}
    for frame in ("map", "odom"):
        client.say(op="publish", topic="/goal_pose", msg={"header": {"frame_id": frame}, "pose": pose})
    assert client.hear()["msg"] == "it is in the frame 'odom', and map is needed"
    device.until(
        lambda sample: ("NET-14", "goal_pose: it is in the frame 'odom', and map is needed") in device.problems
    )
    assert [sample.goal for sample in device.samples if sample.goal] == [Pose(x=1.5, y=2.0)]
    client.say(op="publish", topic="/initialpose", msg={})
    assert client.hear()["msg"].startswith("/initialpose is not accepted here")


@pytest.mark.realtime
def test_of_two_clients_the_first_that_drives_has_the_robot(run: Run) -> None:
    device = run.input(allow=["arm"])
    one, other = run.settled(run.client(device)), run.settled(run.client(device))
    one.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 0.3}})
    device.until(lambda sample: sample.enabled)
    for number in range(20):
        one.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 0.3}})
        other.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": -0.3 - 0.001 * number}})
    one.ask("/arm")
    other.ask("/arm")
    assert {sample.speed for sample in device.samples if sample.enabled} == {0.3}


@pytest.mark.realtime
def test_a_process_that_is_killed_again_and_again_is_back_on_the_same_port(run: Run) -> None:
    device = run.input()
    process = device.device.process
    assert process is not None
    for _ in range(3):
        assert run.client(device).ask("/stop")["values"]["success"]
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        killed = stopwatch()
        client = run.client(device)  # the port is there all the time
        assert client.ask("/stop")["values"]["success"]
        assert stopwatch() - killed <= BACK
    device.until(lambda sample: any("it is back after" in words for _, words in device.problems))
    assert {row for row, _ in device.problems} == {"NET-13"}


RUN = """
import asyncio, os, signal, sys
from pathlib import Path
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.rosbridge import RosbridgeInput, RosbridgeInputConfig
from artemis.vehicle import RobotFile

robot = load_model(Path(sys.argv[1]), RobotFile)
context = PluginContext(name="remote", robot=robot, folder=Path(), real_time=True)
device = RosbridgeInput(RosbridgeInputConfig(port=0), context)
while not device.process._restarts._works:
    pass
print(device.process.pid, flush=True)
sys.stdin.readline()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.realtime
def test_its_process_ends_with_a_run_that_is_killed() -> None:
    command = [sys.executable, "-c", RUN, str(MISSIONS / "robots/artemis.yaml")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdin is not None
        assert run.stdout is not None
        with ExitStack() as ends:
            process = os.pidfd_open(int(run.stdout.readline()))
            ends.callback(os.close, process)
            run.stdin.write("\n")
            run.stdin.flush()
            assert run.wait(LONG) == -signal.SIGKILL
            assert select.select([process], [], [], LONG)[0] == [process]


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


@pytest.mark.realtime
def test_who_only_watches_an_observer_keeps_nobody_from_stopping_the_robot(run: Run) -> None:
    device = run.input()
    observer = run.observer(inputs=device.port)
    watching = [run.client(observer) for _ in range(server.MOST_CLIENTS)]
    assert all(each.ask("/stop")["values"]["success"] for each in watching), "they are connected to the input, too"
    assert run.client(device).ask("/stop")["values"]["success"]


def test_connections_that_say_nothing_are_so_many_at_most(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MOST_CLIENTS", 2)
    serving = run.server()
    client = run.client(serving)
    with ExitStack() as ends:
        place = ("127.0.0.1", serving.port)
        for _ in range(3):
            ends.enter_context(socket.create_connection(place, LONG))
        with socket.create_connection(place, 5.0) as one_more, suppress(ConnectionResetError):  # at once: not in 10 s
            assert one_more.recv(1) == b""
        assert client.ask("/stop")["result"]


def test_who_says_too_much_is_closed_and_kept_out_for_a_while(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "KEPT_OUT", 1000.0)
    monkeypatch.setattr(server, "RATE", 0.01)
    serving, heard = run.server(), list[str]()
    take = ClientSession.take
    monkeypatch.setattr(ClientSession, "take", lambda self, text, now: heard.append(text) or take(self, text, now))  # type: ignore[func-returns-value]
    client, other = run.client(serving), run.client(serving)

    def flood() -> None:
        for number in range(100_000):
            client.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 0.001 * (number % 100)}})

    with pytest.raises(ConnectionClosed):
        flood()
    assert len(heard) == server.BURST
    assert other.ask("/stop")["result"]
    with pytest.raises((InvalidMessage, ConnectionClosed, ConnectionError, EOFError)):
        run.client(serving)
    serving._kept_out.clear()
    assert run.client(serving).ask("/stop")["result"]


def test_who_says_something_long_is_closed(run: Run) -> None:
    client = run.client(run.server())
    client.say(op="publish", topic="/cmd_vel", msg={}, pad="x" * server.MOST_MESSAGE)
    with pytest.raises(ConnectionClosed, match="1009"):
        client.hear()


def test_a_flood_of_stops_makes_one_tick_of_its_own(run: Run) -> None:
    woken: list[bool] = []
    mailbox = Mailbox(lambda: woken.append(True))
    for _ in range(2):
        for number in range(50):
            mailbox.absorb(Received(asked=[Asked(Request.QUICKSTOP, 1.0, [number])]))
        (asked,) = mailbox.take().asked
        assert (asked.request, asked.numbers) == (Request.QUICKSTOP, list(range(50)))
    assert (len(woken), mailbox.take().asked) == (1, [])
    mailbox.ask(Request.QUICKSTOP, 2.0)
    assert len(woken) == 2


def test_without_its_extra_it_says_what_to_install(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.build.find_spec", lambda name: None)
    for make in (run.observer, run.input):
        with pytest.raises(ConfigError, match=f"rosbridge needs the package websockets: {re.escape(install('web'))}"):
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
