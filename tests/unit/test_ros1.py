"""The node of ROS 1 and its observer, among peers of our own; tests/peers/test_ros1_tools.py has those of ROS."""

from __future__ import annotations

import asyncio
import gc
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from time import thread_time
from typing import Any

import pytest
from ros1_rig import Master, Peer

from artemis_lab.bench.ports import free_port

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")

from artemis.bridges.names import NameResolver, check_name, check_namespace, part_of_name
from artemis.bridges.ros1 import links, node, xmlrpc
from artemis.bridges.ros1.links import MOST_PUBLISHERS, Subscription
from artemis.bridges.ros1.tcpros import SubscriberLink, framed, pack_header, parse_header
from artemis.bridges.ros1.thread import NodeThread
from artemis.bridges.ros1.xmlrpc import CallError, call
from artemis.bridges.ros_types import Ros1Types
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission, load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.observers.ros1 import Ros1Observer, Ros1ObserverConfig
from artemis.plugins.observing import Observation
from artemis.testing.observers import ObserverContract
from artemis.values import Tick
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
TICKS = list(ObserverContract().ticks())
ODOMETRY = "nav_msgs/msg/Odometry"


@pytest.fixture(scope="module")
def types() -> Ros1Types:
    return Ros1Types()


@pytest.fixture
def master() -> Iterator[Master]:
    made = Master()
    yield made
    made.close()


class Seen:
    """An observer at work: the ticks are shown as fast as somebody waits."""

    def __init__(self, master: Master, **options: Any) -> None:  # noqa: ANN401 (keys of the plugin)
        config = Ros1ObserverConfig(master=master.uri, **options)
        self.observer = Ros1Observer(config, PluginContext(name="ros", robot=ROBOT, folder=Path()))
        self.problems: list[tuple[str, str, str]] = []
        self._ticks: Iterator[Tick] = iter(TICKS)

    def tick(self) -> bool:
        tick = next(self._ticks)
        self.observer.see(tick, (), tick.snapshot.time)
        self.problems += self.observer.take_problems()
        return True

    def close(self) -> None:
        self.observer.close()
        self.problems += self.observer.take_problems()


class TestRos1Observer(ObserverContract):
    plugin = Ros1Observer
    options: Mapping[str, object] = {"master": f"http://127.0.0.1:{free_port()}"}


@pytest.mark.parametrize("name", ["", "1st", "a//b", "a/", "ä", "a-b", "a b", "/", "~", "a/~b"])
def test_a_name_that_ros_forbids_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is no name in ROS"):
        check_name(name)
    with pytest.raises(ValueError, match=r"no name|no namespace"):
        NameResolver("node", "/", {"odom": name})


def test_names_are_resolved_as_ros_does() -> None:
    names = NameResolver("node", "robot/one", {"odom": "/base/odom", "/tf": "tf", "~x": "y"})
    assert names.node == "/robot/one/node"
    found = [names.resolve(name) for name in ("odom", "/robot/one/odom", "/odom", "/tf", "~x", "~z", "cmd_vel")]
    one = "/robot/one"
    assert found == ["/base/odom", "/base/odom", "/odom", f"{one}/tf", f"{one}/y", f"{one}/node/z", f"{one}/cmd_vel"]
    assert [check_namespace(name) for name in ("", "/", "a", "/a/b/")] == ["/", "/", "/a", "/a/b"]
    assert [part_of_name(text) for text in ("front", "front-left", "2nd")] == ["front", "front_left", "n2nd"]


def test_environment_of_ros_is_followed() -> None:
    def host(listen: str, **environment: str) -> str:
        return Ros1ObserverConfig(listen=listen).host(environment, "here")

    assert host("127.0.0.1", ROS_IP="10.0.0.1") == "127.0.0.1"
    assert host("0.0.0.0", ROS_IP="10.0.0.1") == "10.0.0.1"
    assert host("0.0.0.0", ROS_IP="10.0.0.1", ROS_HOSTNAME="robot") == "robot"
    assert (host("0.0.0.0"), host("10.0.0.2")) == ("here", "10.0.0.2")
    config = Ros1ObserverConfig()
    assert config.checked("ros", {})[1] == "http://localhost:11311"
    names, master = config.checked("ros", {"ROS_MASTER_URI": "http://robot:1", "ROS_NAMESPACE": "two"})
    assert (names.node, master) == ("/two/artemis", "http://robot:1")


@pytest.mark.parametrize(
    ("options", "environment", "words"),
    [
        ({}, {"ROS_MASTER_URI": "robot:11311"}, "ros: ROS_MASTER_URI: 'robot:11311' is no URI of a master"),
        ({}, {"ROS_NAMESPACE": "a b"}, "ros: ROS_NAMESPACE: 'a b' is no namespace"),
        ({"listen": "192.0.2.1"}, {}, "ros: listen: 192.0.2.1: Cannot assign requested address"),
    ],
)
def test_what_cannot_be_is_refused_at_the_start(
    options: dict[str, str], environment: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        NodeThread(Ros1ObserverConfig(**options), "ros", environment)  # type: ignore[arg-type]


@pytest.mark.parametrize("group", ["inputs", "observers"])
def test_what_cannot_be_is_refused_by_check(tmp_path: Path, group: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    mission = tmp_path / "mission.yaml"
    mission.write_text(
        f"mission: far\nrobot: robot.yaml\nbus: simulation\n{group}:\n"
        "  far: {plugin: ros1, listen: 192.0.2.1}\nsteps:\n  - wait: {seconds: 1}\n"
    )
    with pytest.raises(
        ConfigError, match=rf"mission.yaml:5:\d+: {group}.far.listen: 192.0.2.1: Cannot assign requested"
    ):
        load_mission(mission)
    mission.write_text(mission.read_text().replace(", listen: 192.0.2.1", ""))
    monkeypatch.setenv("ROS_MASTER_URI", "robot")
    with pytest.raises(ConfigError, match=f"{group}.far.ROS_MASTER_URI: 'robot' is no URI of a master"):
        load_mission(mission)
    assert load_mission(mission, tried=False)  # as a replay does


def test_two_nodes_of_one_name_at_one_master_are_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    mission = tmp_path / "mission.yaml"

    def write(keys: str) -> None:
        mission.write_text(
            "mission: far\nrobot: robot.yaml\nbus: simulation\ninputs:\n"
            f"  remote: {{plugin: ros1, {keys}}}\nobservers:\n  ros: {{plugin: ros1}}\n"
            "steps:\n  - wait: {seconds: 1}\n"
        )

    write("node: artemis")
    why = r"7:3: observers.ros.node: the node /artemis of ROS 1 is already used by inputs.remote"
    with pytest.raises(ConfigError, match=why):
        load_mission(mission)
    for keys in ("allow: []", "node: artemis, namespace: left", "node: artemis, master: 'http://robot:11311'"):
        write(keys)
        assert load_mission(mission)


def test_headers_survive_and_others_are_refused() -> None:
    fields = {"topic": "/a", "error": "x=y", "": ""}
    packed = pack_header(fields)
    assert parse_header(packed[4:]) == fields
    for cut in range(5, len(packed)):
        part = packed[4:cut]
        try:
            assert parse_header(part).items() <= fields.items()  # whole fields
        except ValueError:
            continue
    for rubbish in (b"\x01", b"\xff\xff\xff\xff", b"\x01\0\0\0x", b"\x02\0\0\0=\xff"):
        with pytest.raises(ValueError, match=r"header|codec"):
            parse_header(rubbish)


def test_bytes_that_are_no_message_are_refused(types: Ros1Types) -> None:
    packed = types.pack(ODOMETRY, {"child_frame_id": "base_link"})
    for cut in range(0, len(packed), 7):
        with pytest.raises(ValueError, match="bytes that are no nav_msgs/Odometry"):
            types.unpack(ODOMETRY, packed[:cut])
    with pytest.raises(ValueError, match="has no field speed"):
        types.pack(ODOMETRY, {"speed": 1.0})


def test_a_run_is_heard_on_its_topics(master: Master, types: Ros1Types) -> None:
    master.begin()
    seen = Seen(master, namespace="robot", remap={"odom": "odometry"})
    seen.tick()
    master.until(lambda: "/tf_static" in master.published)
    assert master.published["/robot/odometry"][0] == "nav_msgs/Odometry"
    reader, writer, header = Peer(master).connect("/robot/odometry", types.definition(ODOMETRY)[1])
    assert (header["type"], header["callerid"], header["latching"]) == ("nav_msgs/Odometry", "/robot/artemis", "0")
    master.until(lambda: any(p.links for p in seen.observer._thread.node.publications.values()))  # type: ignore[union-attr]
    seen.tick()
    odometry: Any = types.unpack(ODOMETRY, Peer(master).hear(reader))
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.twist.twist.linear.x == 0.2
    fixed, also, _ = Peer(master).connect("/tf_static")
    transforms: Any = types.unpack("tf2_msgs/msg/TFMessage", Peer(master).hear(fixed))
    assert [each.child_frame_id for each in transforms.transforms] == ["rear_left_wheel", "rear_right_wheel"]
    _, wrong, refusal = Peer(master).connect("/tf_static", "0" * 32)
    assert "md5sum" in refusal["error"]
    seen.close()
    assert (master.published, seen.problems) == ({}, [])
    for each in (writer, also, wrong):
        each.close()


def test_a_master_that_is_not_there_is_told_once_and_met_when_it_comes(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xmlrpc, "PATIENCE", 0.5)
    monkeypatch.setattr(node, "LOOK", 0.05)
    seen = Seen(master)
    master.until(lambda: seen.tick() and seen.problems)
    assert seen.problems == [("NET-12", "ros", f"{master.uri}: connection refused")]
    master.begin()
    master.until(lambda: "/odom" in master.published)
    master.end()
    master.begin()
    master.until(lambda: "/odom" in master.published and seen.tick())
    master.until(lambda: not seen.observer._thread.problem)  # type: ignore[union-attr]
    seen.tick()
    seen.close()
    assert (len(seen.problems), master.published) == (1, {})


def test_another_node_of_the_same_name_ends_it(master: Master) -> None:
    master.begin()
    seen = Seen(master)
    seen.tick()
    master.until(lambda: "/odom" in master.published)
    uri = master.published["/odom"][1]
    assert master.run(call(uri, "shutdown", "/master", "new node registered with same name"))[0] == 1
    master.until(lambda: seen.tick() and seen.problems)
    assert seen.problems == [("NET-12", "ros", "shut down by /master: new node registered with same name")]
    seen.close()


def test_peers_may_ask_what_the_slave_api_has_and_nothing_else(master: Master) -> None:
    master.begin()
    seen = Seen(master)
    seen.tick()
    master.until(lambda: "/odom" in master.published)
    uri = master.published["/odom"][1]

    def ask(method: str, *arguments: object) -> Any:  # noqa: ANN401 (an answer)
        return master.run(call(uri, method, "/peer", *arguments))

    assert ask("getMasterUri") == [1, "", master.uri]
    assert ["/odom", "nav_msgs/Odometry"] in ask("getPublications")[2]
    assert (ask("getSubscriptions")[2], ask("getBusInfo")[2]) == ([], [])
    assert ask("requestTopic", "/nothing", [["TCPROS"]])[:2] == [0, "/artemis does not publish /nothing"]
    assert ask("requestTopic", "/odom", [["UDPROS"]])[0] == 0
    for method, arguments in (("system", ()), ("getPid", (1, 2))):
        with pytest.raises(CallError, match=r"no method|wrong arguments"):
            ask(method, *arguments)

    async def say(data: bytes) -> bytes:
        port = int(uri.rstrip("/").rpartition(":")[2])
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(data)
        answer = await reader.read(4096)
        writer.close()
        return answer

    assert b"501" in master.run(say(b"GET / HTTP/1.1\r\n\r\n"))
    assert master.run(say(b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n")) == b""
    assert b"no call in XML-RPC" in master.run(say(b"POST / HTTP/1.0\r\nContent-Length: 3\r\n\r\n<a>"))
    assert ask("getPid")[0] == 1
    seen.close()


@pytest.mark.parametrize("turns", range(7))
def test_a_connection_that_comes_as_the_node_ends_is_closed(turns: int) -> None:
    closed = list[bool]()

    async def end_early() -> None:
        with socket.socket() as tcp, socket.socket() as rpc:
            for each in (tcp, rpc):
                each.bind(("127.0.0.1", 0))
            made = node.RosNode("/artemis", f"http://127.0.0.1:{free_port()}", tcp, rpc, "127.0.0.1")
            running = asyncio.ensure_future(made.run())
            await asyncio.sleep(0.01)  # it listens
            with socket.create_connection(tcp.getsockname()) as one, socket.create_connection(rpc.getsockname()) as two:
                for _ in range(turns):
                    await asyncio.sleep(0)
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
                for peer in (one, two):
                    peer.settimeout(20.0)
                    with suppress(ConnectionResetError):
                        closed.append(peer.recv(1) == b"")

    asyncio.run(end_early())
    gc.collect()  # a connection that was left is a ResourceWarning, and so a failure
    assert all(closed)


def test_of_a_subscriber_that_does_not_read_the_oldest_messages_are_dropped() -> None:
    async def stuck() -> tuple[SubscriberLink, list[bytes]]:
        arrived, release, gone = asyncio.Queue[bytes](), asyncio.Event(), asyncio.Event()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await release.wait()
            while data := await reader.read(1 << 20):
                arrived.put_nowait(data)
            writer.close()
            gone.set()

        server = await asyncio.start_server(serve, "127.0.0.1", 0, limit=1 << 12)
        _, writer = await asyncio.open_connection("127.0.0.1", server.sockets[0].getsockname()[1])
        link = SubscriberLink(writer, "/slow", queue=4)
        sending = asyncio.ensure_future(link.send())
        block = framed(bytes(1 << 20))
        while not link.dropped:
            link.put(block)
            for _ in range(20):
                await asyncio.sleep(0)
        before = link.dropped
        link.put(framed(b"newest"))
        release.set()
        data = b""
        while not data.endswith(b"newest"):
            data += await asyncio.wait_for(arrived.get(), 20.0)
        sending.cancel()
        writer.close()
        server.close()
        await asyncio.wait_for(gone.wait(), 20.0)
        assert link.dropped == before + 1
        return link, [data]

    link, _ = asyncio.run(stuck())
    assert link.sent >= 4


def test_three_subscribers_lose_nothing_and_a_tick_hands_over_at_once(master: Master, types: Ros1Types) -> None:
    master.begin()
    seen, peer = Seen(master, queue=1000), Peer(master)  # ticks come faster here than they do
    seen.tick()
    master.until(lambda: "/odom" in master.published)
    links = [peer.connect("/odom")[:2] for _ in range(3)]
    publication = seen.observer._thread.node.publications["/odom"]  # type: ignore[union-attr]
    master.until(lambda: len(publication.links) == len(links))
    for _ in range(50):
        seen.tick()
    for reader, _ in links:
        heard: list[Any] = [types.unpack(ODOMETRY, peer.hear(reader)) for _ in range(50)]
        assert [message.header.seq for message in heard] == list(range(50))
    at_work, took = Observation("ros", seen.observer, threaded=True), []
    for tick in TICKS[60:260]:
        begun = thread_time()
        at_work.see(tick, (), tick.snapshot.time)
        took.append(thread_time() - begun)
    at_work.close()
    assert sorted(took)[100] <= 30e-6, f"{sorted(took)[100] * 1e6:.1f} us"
    assert (publication.dropped, seen.problems) == (0, [])
    for _, writer in links:
        writer.close()


def test_publishers_that_come_while_it_registers_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    """The master knows of a subscriber before that has the answer: news may overtake it."""
    uri, met = "http://127.0.0.1:1/", list[str]()

    async def registered() -> None:
        with socket.socket() as tcp, socket.socket() as rpc:
            made = node.RosNode("/node", "http://127.0.0.1:1", tcp, rpc, "127.0.0.1")
            made.subscribe("/cmd_vel", "geometry_msgs/Twist", "*", lambda data, sender: None)

            async def ask(method: str, *arguments: object) -> list[str]:
                made._publisher_update("/master", "/cmd_vel", [uri])
                return []

            monkeypatch.setattr(made, "_ask", ask)
            await made._register()
            met.extend(made.subscriptions["/cmd_vel"]._wanted)
            for task in made._tasks:
                task.cancel()
            await asyncio.gather(*made._tasks, return_exceptions=True)

    asyncio.run(registered())
    assert met == [uri]


def test_of_a_topic_so_many_publishers_are_heard_at_most() -> None:
    subscription = Subscription("/artemis", "/cmd_vel", "geometry_msgs/Twist", "0" * 32, lambda data, sender: None)
    for uris in ([f"http://127.0.0.1:{port}/" for port in range(1, 5000)], ["http://127.0.0.1:7/"] * 100):
        work = subscription.meet(uris)
        for each in work:
            each.close()
        assert len(work) == min(len(set(uris)), MOST_PUBLISHERS) * (len(set(uris)) > 1)


def test_a_publisher_at_a_port_that_none_can_have_is_told_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    async def answer(uri: str, *arguments: object) -> object:
        asked.append(uri)
        return [1, "", ["TCPROS", "127.0.0.1", 70000]]

    async def hear() -> str:
        subscription = Subscription("/artemis", "/cmd_vel", "geometry_msgs/Twist", "0" * 32, lambda data, sender: None)
        (work,) = subscription.meet(["http://127.0.0.1:7/"])
        task = asyncio.ensure_future(work)
        while len(asked) < 2:
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return subscription.problem

    monkeypatch.setattr(links, "call", answer)
    monkeypatch.setattr(links, "AGAIN", 0.0)
    assert "0-65535" in asyncio.run(asyncio.wait_for(hear(), 20.0))
