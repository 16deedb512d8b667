"""The node of ROS 2 and its plugins, among programs of our own; tests/peers/test_ros2_fast_dds.py has one of others."""

from __future__ import annotations

import errno
import math
import os
import re
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from multiprocessing import Pipe
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from lateness import BACK
from pydantic import ValidationError
from ros2_rig import LONGEST, Program, own_address, until

pytest.importorskip("rosbags", reason="needs the extra ros2: pip install 'artemis-robot[ros2]'")
pytest.importorskip("cyclonedds", reason="needs the extra ros2: pip install 'artemis-robot[ros2]'")

from artemis.bridges import child_process, kept_process
from artemis.bridges.received import Received
from artemis.bridges.ros2 import dds, process
from artemis.bridges.ros2.parts import MESSAGE, READER, NodeState
from artemis.bridges.ros2.settings import MOST_DOMAIN, check_ros2_name, unicast_ports
from artemis.bridges.ros_types import STORES, Ros2Types
from artemis.build import install
from artemis.clock import stopwatch
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.loading import load_mission, load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.ros2 import Ros2Input, Ros2InputConfig
from artemis.plugins.observers.ros2 import Ros2Observer, Ros2ObserverConfig
from artemis.plugins.own_process import ObserverProcess
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput, Pose, Request
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
CONTRACT = ObserverContract()
CONTRACT.duration = 10 * LONGEST
TICKS = list(CONTRACT.ticks())
ODOMETRY, TWIST, TF = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist", "tf2_msgs/msg/TFMessage"
BOOL, EMPTY, POSE = "std_msgs/msg/Bool", "std_msgs/msg/Empty", "geometry_msgs/msg/PoseStamped"


class TestRos2Observer(ObserverContract):
    plugin = Ros2Observer
    options: Mapping[str, object] = {"domain": MOST_DOMAIN}


@pytest.mark.exhaustive  # that of ros1 shares all but the network
class TestRos2Input(InputContract):
    plugin = Ros2Input
    duration = 2.5
    options: Mapping[str, object] = {"domain": MOST_DOMAIN}


class Seen:
    """An observer at work: each step shows it the next tick."""

    def __init__(self, domain: int, closing: ExitStack, **options: Any) -> None:  # noqa: ANN401 (keys of the plugin)
        context = PluginContext(name="dds", robot=ROBOT, folder=Path())
        self.observer = Ros2Observer(Ros2ObserverConfig(domain=domain, **options), context)
        closing.callback(self.observer.close)
        self.node = self.observer._node
        self.problems: list[str] = []
        self._ticks = iter(TICKS)

    def tick(self) -> None:
        tick = next(self._ticks)
        self.observer.see(tick, (), tick.snapshot.time)
        for id, name, words in self.observer.take_problems():
            assert (id, name) == ("NET-13" if "started again" in words or "is back" in words else "NET-12", "dds")
            self.problems.append(words)


def program(domain: int, closing: ExitStack, *heard: tuple[str, str]) -> Program:
    made = Program(domain)
    closing.callback(made.node.close)
    for topic, type in heard:
        made.hear(topic, type)
    return made


class Device(Ros2Input):
    """One whose clock the test sets: seconds since the newest arrival that was waited for."""

    def __init__(self, config: Ros2InputConfig, context: PluginContext) -> None:
        self.time = 0.0
        super().__init__(config, context, lambda: self._node.arrived + self.time)

    def read_at(self, time: float) -> OperatorInput:
        self.time = time
        return self.read(time)


def await_arrival(device: Device) -> None:
    """Wait until something is there to be taken."""

    def waits() -> bool:
        device._mailbox.absorb(received := device._mailbox.take())
        return received != Received()

    until(waits)


Make = Callable[..., Device]


@pytest.fixture
def make(domain: int, closing: ExitStack) -> Make:
    def made(wake: Callable[[], None] = lambda: None, **options: Any) -> Device:  # noqa: ANN401 (keys)
        context = PluginContext(name="remote", robot=ROBOT, folder=Path(), wake=wake)
        device = Device(Ros2InputConfig(domain=domain, **options), context)
        closing.callback(device.close)
        device.read(0.0)
        return device

    return made


def devices(pid: int | None) -> list[str]:
    """The network devices to which the UDP sockets of a process are bound; empty for one of every device."""
    rows = subprocess.run(["ss", "-uanpH"], stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
    ours = [row.split()[3] for row in rows if f"pid={pid}," in row]
    return [address.partition("%")[2].partition(":")[0] for address in ours]


@pytest.mark.skipif(not own_address(), reason="this computer has no network")
def test_nothing_is_taken_at_an_address_that_the_mission_does_not_say(domain: int, closing: ExitStack) -> None:
    seen, (port, _) = Seen(domain, closing), unicast_ports(domain)
    until(lambda: seen.node.state.heard, seen.tick)
    refused = []
    for address in ("127.0.0.1", own_address()):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.connect((address, port))
            other.send(b"no RTPS")
            try:  # what nobody listens for is answered at once
                other.send(b"no RTPS")
            except ConnectionRefusedError:
                refused.append(address)
    assert (refused, seen.problems) == ([own_address()], [])


@pytest.mark.parametrize("name", ["", "a b", "1st", "a__b", "~a", "a//b", "ä", "/"])
def test_a_name_that_ros_2_forbids_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is no name in ROS"):
        check_ros2_name(name)


def test_a_private_name_is_one() -> None:
    assert check_ros2_name("~/odom") == "~/odom"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"domain": 233}, "less than or equal to 232"),
        ({"domain": -1}, "greater than or equal to 0"),
        ({"distribution": "foxy"}, "humble"),
        ({"type": "geometry_msgs/Twist"}, "geometry_msgs/msg/Twist"),
        ({"type": "ackermann_msgs/msg/AckermannDrive", "angular_is": "velocity"}, "has a steering angle"),
        ({"topic": "cmd__vel"}, "is no name in ROS 2"),
        ({"remap": {"stop": "~halt"}}, "is no name in ROS 2"),
        ({"listen": "robot"}, "robot"),
        ({"listen": "::1"}, "an address of IPv4"),
        ({"allow": ["everything"]}, "acknowledge"),
    ],
)
def test_wrong_keys_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Ros2InputConfig.model_validate(options)


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"ROS_DOMAIN_ID": "233"}, "dds: ROS_DOMAIN_ID: '233' is no domain: a number from 0 to 232"),
        ({"ROS_DOMAIN_ID": "one"}, "dds: ROS_DOMAIN_ID: 'one' is no domain"),
        ({"ROS_DISTRO": "foxy"}, "dds: ROS_DISTRO: 'foxy' is not known: write `distribution:`, one of humble, iron"),
    ],
)
def test_wrong_variables_of_ros_are_refused(variables: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        process.NodeProcess(Ros2ObserverConfig(), "dds", "artemis", variables)


def test_variables_of_ros_are_followed_where_the_mission_is_silent() -> None:
    variables = {"ROS_DOMAIN_ID": "7", "ROS_DISTRO": "humble"}
    silent, said = Ros2ObserverConfig(), Ros2ObserverConfig(domain=3, distribution="kilted")
    assert [(each.domain_id(variables), each.peers(variables)) for each in (silent, said)] == [
        (7, "humble"),
        (3, "kilted"),
    ]
    assert (silent.domain_id({}), silent.peers({})) == (0, "jazzy")
    assert [unicast_ports(number) for number in (0, 1, MOST_DOMAIN)] == [(7410, 7609), (7660, 7859), (65410, 65535)]


def test_an_address_that_this_computer_does_not_have_is_refused(closing: ExitStack) -> None:
    with pytest.raises(ConfigError, match=r"dds: listen: 192\.0\.2\.77: Cannot assign"):
        Seen(0, closing, listen="192.0.2.77")
    with pytest.raises(ConfigError, match=r"remote: listen: 192\.0\.2\.77: Cannot assign"):
        Ros2Input(Ros2InputConfig(listen="192.0.2.77"), PluginContext(name="remote", robot=ROBOT, folder=Path()))


def test_without_its_extra_the_plugins_say_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"cyclonedds": None}
    monkeypatch.setattr("artemis.build.find_spec", lambda package: found.get(package, object()))
    context, wanted = PluginContext(name="dds", robot=ROBOT, folder=Path()), re.escape(install("ros2"))
    with pytest.raises(ConfigError, match=f"dds: plugin: ros2 needs the package cyclonedds: {wanted}"):
        Ros2Observer(Ros2ObserverConfig(), context)
    with pytest.raises(ConfigError, match=wanted):
        Ros2Input(Ros2InputConfig(), context)
    mission = Path(__file__).parents[2] / "missions/ros2_teleop.yaml"
    with pytest.raises(ConfigError, match=rf"ros2_teleop\.yaml:8:\d+: inputs\.remote\.plugin: ros2 needs .*{wanted}"):
        load_mission(mission)
    assert load_mission(mission, tried=False)  # as a replay does


@pytest.mark.parametrize("distribution", STORES)
def test_every_distribution_has_every_type(distribution: str) -> None:
    types = Ros2Types(distribution)
    node = process.NodeProcess(Ros2ObserverConfig(distribution=distribution), "dds", "artemis", {})  # type: ignore[arg-type]
    for type in ("ackermann_msgs/msg/AckermannDriveStamped", "nav_msgs/msg/OccupancyGrid", ODOMETRY, EMPTY):
        types.prepare(type)
        node.publish("/a", type)
    parts = node.parts()
    assert parts.types["rmw_dds_common/msg/Gid"] == [("data", ["char", 24 if distribution == "humble" else 16])]
    assert [bool(each.hash) for each in parts.writers] == 4 * [distribution != "humble"]


def test_the_hash_of_a_type_is_that_which_its_package_states() -> None:
    """As `ros2 topic info -v` shows it: std_msgs' String of Iron and later (REP 2016)."""
    assert Ros2Types("jazzy").hash("std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_a_run_is_heard_and_nothing_listens_but_on_the_loopback_device(domain: int, closing: ExitStack) -> None:
    seen = Seen(domain, closing, namespace="robot", remap={"odom": "odometry"})
    other = program(domain, closing, ("/robot/odometry", ODOMETRY), ("/tf", TF))
    other.begin()
    until(lambda: other.heard["/robot/odometry"] and other.heard["/tf"], seen.tick)
    odometry = other.heard["/robot/odometry"][0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.twist.twist.linear.x == 0.2
    assert seen.problems == []
    assert devices(seen.node.pid) == 3 * ["lo"]  # of two ports, and of the one that it sends from


def test_a_process_that_is_killed_is_told_once_and_comes_back(domain: int, closing: ExitStack) -> None:
    seen, other = Seen(domain, closing), program(domain, closing, ("/odom", ODOMETRY))
    other.begin()
    until(lambda: other.heard["/odom"], seen.tick)
    before = len(other.heard["/odom"])
    assert seen.node.pid is not None
    os.kill(seen.node.pid, signal.SIGKILL)
    until(lambda: seen.problems, seen.tick)
    until(lambda: len(other.heard["/odom"]) > before and len(seen.problems) == 2, seen.tick)
    assert seen.problems[0] == "its process: killed by SIGKILL; it is started again"
    assert float(seen.problems[1].removeprefix("it is back after ").removesuffix(" s")) <= BACK


def test_a_process_that_hangs_is_replaced(domain: int, closing: ExitStack, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_process, "SILENCE", 0.5)
    seen = Seen(domain, closing)
    until(lambda: seen.node.state.heard, seen.tick)
    hung = seen.node.pid
    assert hung is not None
    os.kill(hung, signal.SIGSTOP)
    until(lambda: seen.problems, seen.tick)
    until(lambda: seen.node.state.heard and seen.node.pid != hung, seen.tick)
    assert seen.problems[0] == "its process does not answer; it is started again"


def test_processes_that_have_nothing_to_do_do_nothing(domain: int, closing: ExitStack, make: Make) -> None:
    seen, device = Seen(domain, closing), make()
    until(lambda: seen.node.state.heard and device._node.state.senders, seen.tick)

    def used() -> float:
        """Seconds of a processor that both have used."""
        stats = [
            Path(f"/proc/{node.pid}/stat").read_text().rpartition(")")[2].split() for node in (seen.node, device._node)
        ]
        return math.fsum(int(each) for stat in stats for each in stat[11:13]) / os.sysconf("SC_CLK_TCK")

    before, steps = used(), iter(range(50))
    until(lambda: next(steps, None) is None)  # a second
    assert used() - before < 0.2


def test_ports_that_are_all_in_use_are_told(domain: int, closing: ExitStack) -> None:
    first, last = unicast_ports(domain)
    for port in range(first, last + 1):
        closing.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(("", port))
    seen = Seen(domain, closing)
    until(lambda: seen.problems, seen.tick)
    assert seen.problems == [f"every port of domain {domain} is in use: {first} to {last}; it is started again"]


def children(pid: int | None) -> list[int]:
    """Processes that this one has begun, in whatever thread."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def is_over(pid: int) -> bool:
    """Whether a process has ended; whoever adopted it may not have asked yet how."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.realtime
def test_a_run_s_observer_is_killed_again_and_again_and_takes_the_process_of_dds_with_it(
    domain: int, closing: ExitStack, tmp_path: Path
) -> None:
    context = PluginContext(name="dds", robot=ROBOT, folder=tmp_path, run=tmp_path)
    other, ticks = program(domain, closing, ("/odom", ODOMETRY)), iter(TICKS)
    other.begin()
    heard, begun = other.heard["/odom"], monotonic()
    observer = ObserverProcess(Ros2Observer, Ros2ObserverConfig(domain=domain), context)
    closing.callback(observer.close)
    observer.wait()

    def tick() -> None:
        shown = next(ticks)
        observer.see(shown, (), shown.snapshot.time)
        observer.take_problems()

    until(lambda: heard, tick)
    first = monotonic() - begun
    for _ in range(3):
        pid = observer.pid
        assert pid is not None
        (dds,) = children(pid)
        os.kill(pid, signal.SIGKILL)
        killed, before = monotonic(), len(heard)
        until(lambda: observer.pid != pid, tick)  # noqa: B023 (called here)
        until(lambda: is_over(dds), tick)  # noqa: B023
        until(lambda: len(heard) > before + 1, tick)  # noqa: B023
        assert monotonic() - killed <= max(BACK, 1.5 * first)  # two processes: a slow computer is slow each time


@pytest.mark.realtime
def test_the_process_ends_with_the_run(domain: int, closing: ExitStack) -> None:
    seen = Seen(domain, closing)
    until(lambda: seen.node.state.heard, seen.tick)
    pid = seen.node.pid
    seen.observer.close()
    assert not Path(f"/proc/{pid}").exists()
    assert seen.problems == []


def sample(device: Device) -> OperatorInput:
    """The one at which something has just arrived."""
    await_arrival(device)
    return device.read_at(0.0)


@pytest.mark.parametrize("reliable", [True, pytest.param(False, marks=pytest.mark.exhaustive)])
def test_a_command_drives_while_it_is_fresh(domain: int, closing: ExitStack, make: Make, reliable: bool) -> None:
    device, other = make(enabled_by="command", max_speed_m_s=0.4), program(domain, closing)
    other.has("/cmd_vel", TWIST, reliable=reliable)
    other.begin()
    until(lambda: other.meets("/cmd_vel") and device._heard()[0])
    other.say("/cmd_vel", linear={"x": 2.0})
    first = sample(device)
    assert (first.speed, first.enabled, first.neutral, first.age) == (0.4, True, False, 0.0)
    assert device.read_at(0.3).age == pytest.approx(0.3)
    gone = device.read_at(0.6)
    assert (gone.speed, gone.enabled, gone.neutral, gone.age) == (0.0, False, True, 0.0)


def test_a_stop_is_always_obeyed_and_the_rest_where_it_is_allowed(domain: int, closing: ExitStack, make: Make) -> None:
    woken: list[bool] = []
    device, other = make(lambda: woken.append(True), allow=["arm"]), program(domain, closing)
    topics = [("/stop", EMPTY), ("/arm", EMPTY), ("/enable", BOOL), ("/acknowledge", EMPTY)]
    for topic, type in topics:
        other.has(topic, type, reliable=topic != "/stop")
    other.begin()
    until(lambda: all(other.meets(topic) for topic, _ in topics[:3]))
    assert not other.meets("/acknowledge")
    other.say("/stop")
    assert (sample(device).requests, woken) == ((Request.QUICKSTOP,), [True])
    other.say("/arm")
    assert sample(device).requests == (Request.ARM,)
    other.say("/enable", data=True)
    assert sample(device).buttons == (True,)


def test_what_waited_for_a_run_that_was_held_up_is_as_old_as_it_is(
    domain: int, closing: ExitStack, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, other = make(enabled_by="command", allow=["arm", "goal_pose"]), program(domain, closing)
    topics = (("/cmd_vel", TWIST), ("/arm", EMPTY), ("/goal_pose", POSE), ("/stop", EMPTY))
    for topic, type in topics:
        other.has(topic, type)
    other.begin()
    until(lambda: all(other.meets(topic) for topic, _ in topics))
    waiting, end, hear = list[bytes](), threading.Event(), device._node._hear

    def held(block: bytes) -> str:
        """The thread stands still from the first message on."""
        if block.startswith(MESSAGE):
            waiting.append(block)
            assert end.wait(LONGEST)
        return hear(block)

    monkeypatch.setattr(device._node, "_hear", held)
    other.say("/cmd_vel", linear={"x": 0.3})
    other.say("/arm")
    other.say("/goal_pose", header={"frame_id": "map"}, pose={"orientation": {"w": 1.0}})
    other.say("/stop")
    until(lambda: waiting)
    begun = stopwatch()
    device._clock = lambda: begun + 1.8
    end.set()
    until(lambda: len(waiting) >= 5)  # a stop comes twice
    until(lambda: len(device._mailbox._asked) == 2 and device._mailbox._received.poses and device._mailbox._commands)
    taken = device.read(0.0)
    assert (taken.requests, taken.goal, taken.speed, taken.enabled) == ((Request.QUICKSTOP,), None, 0.0, False)
    assert {words.partition(":")[0] for _, words in device.take_problems()} == {"arm", "goal_pose"}


def test_what_dds_kept_while_its_process_could_not_send_is_as_old_as_it_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    time, ended, sent = [100.0], threading.Event(), list[float]()
    monkeypatch.setattr(dds, "stopwatch", lambda: time[0])

    class Node:
        """One that has a message at each look."""

        readers = (None,)

        def __init__(self) -> None:
            self.waiting = self

        def wait(self, longest: int) -> None:
            time[0] += 0.01

        def state(self) -> NodeState:
            return NodeState([], [], [], 0)

        def take(self, number: int) -> list[tuple[int, bytes]]:
            return [(1, b"")]

    def send(block: bytes) -> None:
        """The third message waits until there is room."""
        if block.startswith(MESSAGE):
            sent.append(READER.unpack_from(block, 1)[2])
            time[0] += 1.8 if len(sent) == 3 else 0.0
            if len(sent) == 5:
                ended.set()

    dds._serve(Node(), send, ended)  # type: ignore[arg-type]
    assert sent == pytest.approx([100.01, 100.02, 100.03, 100.03, 101.85])


def test_a_goal_is_passed_on_once(domain: int, closing: ExitStack, make: Make) -> None:
    device, other = make(allow=["goal_pose"]), program(domain, closing)
    other.has("/goal_pose", POSE)
    other.begin()
    until(lambda: other.meets("/goal_pose"))
    pose = {"position": {"x": 1.5}, "orientation": {"w": 1.0}}
    other.say("/goal_pose", header={"frame_id": "map"}, pose=pose)
    await_arrival(device)
    assert (device.read_at(0.0).goal, device.read_at(0.02).goal) == (Pose(x=1.5), None)
    other.say("/goal_pose", header={"frame_id": "base_link"}, pose=pose)
    await_arrival(device)
    assert device.read_at(0.04).goal is None
    assert device.take_problems() == [("NET-14", "goal_pose: it is in the frame 'base_link', and map is needed")]


def test_a_publisher_that_offers_less_is_refused_and_told(domain: int, closing: ExitStack, make: Make) -> None:
    device, other = make(allow=["arm"]), program(domain, closing)
    other.has("/arm", EMPTY, reliable=False)
    other.begin()
    words: list[str] = []
    until(lambda: words, lambda: words.extend(filter(None, [device.show(TICKS[0])])))
    assert words == ["a publisher of /arm is refused: more reliability is asked for than it offers"]
    assert (device.show(TICKS[0]), other.meets("/arm")) == ("", False)


def test_a_command_that_is_too_long_is_dropped_and_told(domain: int, closing: ExitStack, make: Make) -> None:
    kind = "geometry_msgs/msg/TwistStamped"
    device, other = make(enabled_by="command", type=kind), program(domain, closing)
    other.has("/cmd_vel", kind)
    other.begin()
    until(lambda: other.meets("/cmd_vel") and device._heard()[0])
    other.say("/cmd_vel", header={"frame_id": "x" * 20_000}, twist={"linear": {"x": 0.1}})
    words: list[str] = []
    until(lambda: words, lambda: words.extend(filter(None, [device.show(TICKS[0])])))
    assert words == ["a message of /cmd_vel is dropped: it has more than 16384 bytes"]
    other.say("/cmd_vel", twist={"linear": {"x": 0.2}})
    assert sample(device).raw == (0.2, 0.0)


def test_without_its_process_an_input_is_lost(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "SOONEST", 30.0)
    device = make()
    until(lambda: device._node.pid)
    os.kill(device._node.pid or 0, signal.SIGKILL)
    until(lambda: device._node.problem)
    assert not device.read_at(1.0).enabled
    with pytest.raises(DeviceLost, match="its process: killed by SIGKILL"):
        device.read_at(5.0)
    device._mailbox.ask(Request.QUICKSTOP, 0.0)
    assert device.read_at(5.1).requests == (Request.QUICKSTOP,)


def test_a_process_that_cannot_be_started_is_told(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(kept_process, "ChildProcess", full)
    device = make()
    until(lambda: device._node.problem)
    with pytest.raises(DeviceLost, match="its process cannot be started: Resource temporarily unavailable"):
        device.read_at(5.0)


def test_a_process_for_which_there_are_no_more_files_is_tried_again(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full() -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(kept_process, "Pipe", full)
    device = make()
    until(lambda: device._node.problem)
    assert device._node.problem == "its process cannot be started: Too many open files"
    monkeypatch.setattr(kept_process, "Pipe", Pipe)
    until(lambda: device._node.state.senders)
    rows, words = zip(*device.take_problems(), strict=True)
    assert set(rows) == {"NET-13"}
    assert words[0] == "its process cannot be started: Too many open files; it is started again"


def test_of_a_flood_the_newest_is_passed_on_now_and_then(domain: int, closing: ExitStack, make: Make) -> None:
    device, other = make(enabled_by="command"), program(domain, closing)
    other.has("/cmd_vel", TWIST)
    other.begin()
    until(lambda: other.meets("/cmd_vel") and device._heard()[0])
    taken: list[bytes] = []
    device._node._takers[device._number] = lambda data, sender: taken.append(data)
    for number in range(3000):
        other.say("/cmd_vel", linear={"x": 0.001 * number})
    last = device._node.types.pack(TWIST, {"linear": {"x": 0.001 * 2999}})
    until(lambda: last in taken)
    assert len(taken) < 3000 / 3


def test_two_inputs_of_one_topic_are_one_device() -> None:
    one, other, third = (Ros2InputConfig(topic=topic) for topic in (None, "cmd_vel", "nav_vel"))
    assert Ros2Input.may_share(one, other, {})
    assert not Ros2Input.may_share(one, third, {})
