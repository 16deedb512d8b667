"""ROS' own tools hear and drive artemis. `scripts/ros_peers` installs them."""

from __future__ import annotations

import math
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")
sys.path.append(str(Path(__file__).parents[1] / "unit"))
from programs import bridge_of, until

from artemis.bridges.ros_types import TRIGGER_MD5, Ros1Types, ros1_name
from artemis.bridges.topics import Topics
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_model
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs import ros1
from artemis.plugins.inputs.ros1 import Ros1Input, Ros1InputConfig
from artemis.plugins.observers.ros1 import Ros1Observer, Ros1ObserverConfig
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput, Pose, Request
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port

MISSIONS = Path(__file__).parents[2] / "missions"
TF_ECHO = Path("/usr/lib/tf/tf_echo")
RATE, DURATION = 20, 60.0
"""Of the commands [Hz]; longest time that anything may take [s]."""
TOLD = {
    "/odom": "nav_msgs/Odometry",
    "/tf": "tf2_msgs/TFMessage",
    "/tf_static": "tf2_msgs/TFMessage",
    "/joint_states": "sensor_msgs/JointState",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
    "/path": "nav_msgs/Path",
    "/goal": "geometry_msgs/PoseStamped",
    "/battery": "sensor_msgs/BatteryState",
    "/map": "nav_msgs/OccupancyGrid",
}
FAR = 1.5
"""So far drives the node of rospy [m]."""
STEPS = """
steps:
  - teleop: {input: remote, until: {button: done}}
"""

pytestmark = [
    pytest.mark.exhaustive,  # ../unit/test_ros1.py and test_ros1_input.py speak the same protocol without them
    pytest.mark.realtime,
    pytest.mark.skipif(shutil.which("rosmaster") is None, reason="installed by scripts/ros_peers"),
]


class Ros:
    """A master on a free port, and tools that know it."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.environment = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}", "ROS_IP": "127.0.0.1"}
        self.environment |= {"ROS_HOME": str(folder), "PYTHONUNBUFFERED": "1"}
        self.running: list[subprocess.Popen[str]] = []

    def is_there(self) -> bool:
        """Whether the master answers."""
        with socket.socket() as asking:
            return asking.connect_ex(("127.0.0.1", self.port)) == 0

    def begin(self, *command: str) -> subprocess.Popen[str]:
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, env=self.environment, stdout=pipe, stderr=subprocess.STDOUT, text=True)
        self.running.append(process)
        return process

    def told(self, *command: str) -> str:
        """What a tool prints until it ends by itself."""
        pipe = subprocess.PIPE
        done = subprocess.run(command, env=self.environment, stdout=pipe, text=True, timeout=DURATION, check=False)
        return done.stdout

    def close(self) -> None:
        """End them all; none stays behind that takes the processor from other tests."""
        for process in self.running:
            if process.poll() is None:
                process.terminate()
        try:
            for process in self.running:
                process.communicate(timeout=DURATION)
        finally:
            for process in self.running:
                process.kill()


@pytest.fixture(autouse=True)
def never_held_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """That this computer is busy is no hold-up of an input in this process."""
    monkeypatch.setattr(ros1, "stopwatch", lambda: 0.0)


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros]:
    made = Ros(tmp_path)
    made.begin("rosmaster", "--core", "-p", str(made.port))
    pause = Event()
    while not made.is_there():
        pause.wait(0.1)
    yield made
    made.close()


def test_types_have_the_sums_that_ros_has(ros: Ros) -> None:
    types = Ros1Types()
    robot = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
    used = {topic.type for topic in Topics(robot).topics} | {"sensor_msgs/msg/LaserScan", "geometry_msgs/msg/Twist"}
    used |= {"geometry_msgs/msg/TwistStamped", "std_msgs/msg/Bool", "std_msgs/msg/Empty"}
    assert {type: ros.told("rosmsg", "md5", ros1_name(type)).strip() for type in sorted(used)} == {
        type: types.definition(type)[1] for type in sorted(used)
    }
    assert ros.told("rossrv", "md5", "std_srvs/Trigger").strip() == TRIGGER_MD5


def test_a_map_is_latched_for_the_tools_of_ros(ros: Ros) -> None:
    cells = np.full((30, 40), -1, np.int8)
    cells[0, :7] = 100
    known = ShownMap(content=OccupancyMap(cells=cells, resolution=0.05, origin=(-2.0, -1.0, 0.0)))
    robot = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
    context = PluginContext(name="ros", robot=robot, folder=MISSIONS, map=lambda: known)
    observer = Ros1Observer(Ros1ObserverConfig(master=ros.environment["ROS_MASTER_URI"]), context)
    try:
        tick = next(ObserverContract().ticks())
        observer.see(tick, (), 0.0)
        told = ros.told("rostopic", "echo", "-n", "1", "/map")
    finally:
        observer.close()
    assert all(line in told for line in ('frame_id: "map"', "width: 40", "height: 30", "x: -2.0"))
    data = told.partition("data:")[2]  # the digits of its time are not counted
    assert (data.count("100"), data.count("-1,")) == (7, 30 * 40 - 8)


def test_goals_and_poses_of_the_tools_of_ros_are_passed_on(ros: Ros) -> None:
    robot = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
    keys = {"allow": ["goal_pose", "initialpose"], "master": ros.environment["ROS_MASTER_URI"]}
    config = Ros1InputConfig.model_validate({**keys, "remap": {"goal_pose": "/move_base_simple/goal"}})
    device = Ros1Input(config, PluginContext(name="rviz", robot=robot, folder=MISSIONS))
    header = "header: {stamp: now, frame_id: map}"
    pose = "position: {x: 1.5, y: 2.0}, orientation: {z: 0.6, w: 0.8}"
    spread = ", ".join("0.25" if place in (0, 7, 35) else "0" for place in range(36))
    taken, pause = list[OperatorInput](), Event()
    try:
        device.read(0.0)
        assert device._thread is not None
        while not all(each.registered for each in device._thread.node.subscriptions.values()):
            pause.wait(0.02)
        for topic, type, content in (
            ("/move_base_simple/goal", "geometry_msgs/PoseStamped", f"{{{header}, pose: {{{pose}}}}}"),
            (
                "/initialpose",
                "geometry_msgs/PoseWithCovarianceStamped",
                f"{{{header}, pose: {{pose: {{{pose}}}, covariance: [{spread}]}}}}",
            ),
        ):
            tool = ros.begin("rostopic", "pub", "-1", topic, type, content)
            while not device._mailbox._received.poses:
                assert tool.poll() in (None, 0)
                pause.wait(0.02)
            taken.append(device.read(1.0))
    finally:
        device.close()
    assert device.take_problems() == []
    goal, initial = taken[0].goal, taken[1].initial_pose
    assert goal == Pose(x=1.5, y=2.0, heading=pytest.approx(2 * math.atan2(0.6, 0.8)))  # type: ignore[arg-type]
    assert initial is not None
    assert (initial.pose, initial.covariance) == (goal, (0.25, 0.0, 0.0, 0.25, 0.0, 0.25))


def cut(device: Ros1Input) -> None:
    """Have an input lose every connection that it has; one from which it does not read just now is not in the map."""
    assert device._thread is not None
    pause = Event()
    while any(subscription.connected for subscription in device._thread.node.subscriptions.values()):
        for fd in list(device._thread._loop._selector.get_map()):  # type: ignore[attr-defined]
            with suppress(OSError), socket.socket(fileno=os.dup(fd)) as each:
                if each.family == socket.AF_INET and each.getpeername():  # one that listens has no peer
                    each.shutdown(socket.SHUT_RDWR)
        pause.wait(0.01)


def test_what_rostopic_has_kept_arms_nothing_but_a_stop_that_it_has_kept_stops(ros: Ros) -> None:
    robot = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
    for topic in ("/arm", "/stop"):
        ros.begin("rostopic", "pub", topic, "std_msgs/Empty")
        while "Publishers: None" in (info := ros.told("rostopic", "info", topic)) or "Publishers" not in info:
            pass
    config = Ros1InputConfig.model_validate({"allow": ["arm"], "master": ros.environment["ROS_MASTER_URI"]})
    device = Ros1Input(config, PluginContext(name="remote", robot=robot, folder=MISSIONS))
    problems, requests, pause = list[tuple[str, str]](), list[Request](), Event()

    def until(holds: Callable[[], object]) -> None:
        for _ in range(round(DURATION / 0.02)):
            requests.extend(device.read(0.0).requests)
            problems.extend(device.take_problems())
            if holds():
                return
            pause.wait(0.02)
        raise AssertionError(f"that never holds: {problems}, {requests}")

    try:
        for number in (1, 2):
            until(lambda: min(len(problems), len(requests)) >= number)  # noqa: B023 (called here)
            assert requests == number * [Request.QUICKSTOP]
            assert all(row == "NET-04" and "latched message from" in words for row, words in problems)
            cut(device)
        tool = ros.begin("rostopic", "pub", "-1", "/arm", "std_msgs/Empty")
        until(lambda: Request.ARM in requests)
        assert tool.wait(DURATION) == 0
    finally:
        device.close()


def running(ros: Ros, folder: Path, **keys: str) -> subprocess.Popen[str]:
    """A run that waits for commands; with other keys of its input."""
    shutil.copytree(MISSIONS / "robots", folder / "robots")
    head, _, rest = (MISSIONS / "ros_teleop.yaml").read_text().partition("steps:")
    for key, value in keys.items():
        head = head.replace("    plugin: ros1\n", f"    plugin: ros1\n    {key}: {value}\n", 1)
    mission = folder / "mission.yaml"
    mission.write_text(head + STEPS + rest[rest.index("simulation:") :])
    run = ros.begin(str(Path(sys.executable).with_name("artemis")), "run", str(mission))
    until(run, "to drive")
    return run


@pytest.mark.exhaustive
def test_a_node_of_rospy_hears_and_drives_while_the_bridge_is_killed(ros: Ros, tmp_path: Path) -> None:
    run = running(ros, tmp_path)
    driver = ros.begin("/usr/bin/python3", str(Path(__file__).with_name("rospy_node.py")), str(FAR))
    until(run, "driving")
    os.kill(bridge_of(run), signal.SIGKILL)
    until(run, "it is back")
    until(run, "quick stop")
    told = until(driver, "stop")
    assert told[-2:] == ["gaps 0 begun again 1", "stop True"]
    run.send_signal(signal.SIGINT)
    until(run, "result")


def test_is_driven_by_commands_with_a_stamp(ros: Ros, tmp_path: Path) -> None:
    run = running(ros, tmp_path, type="geometry_msgs/TwistStamped")
    command = "{header: auto, twist: {linear: {x: 0.3}, angular: {z: 0.2}}}"
    ros.begin("rostopic", "pub", "-s", "-r", str(RATE), "/cmd_vel", "geometry_msgs/TwistStamped", command)
    until(run, "driving")
    run.send_signal(signal.SIGINT)
    (distance,) = [line for line in until(run, "report ") if line.startswith("distance")]
    assert float(distance.split()[1]) > 0.0


def test_is_driven_and_heard_by_the_tools_of_ros(ros: Ros, tmp_path: Path) -> None:
    run = running(ros, tmp_path)
    assert "/odom [nav_msgs/Odometry] 1 publisher" in ros.told("rostopic", "list", "-v")
    assert "xmlrpc reply" in ros.told("rosnode", "ping", "-c", "1", "/artemis")
    info = ros.told("rosnode", "info", "/artemis_remote")
    assert "/cmd_vel" in info
    assert "/stop" in info
    info = ros.told("rosnode", "info", "/artemis")
    assert all(f"* {topic} [{type}]" in info for topic, type in TOLD.items())
    info = ros.told("rostopic", "info", "/odom")
    assert "Type: nav_msgs/Odometry" in info
    assert "* /artemis (http://127.0.0.1:" in info.partition("Publishers:")[2].partition("Subscribers:")[0]
    counting = ros.begin("rostopic", "hz", "/odom")
    rate = float(until(counting, "average rate")[-1].split()[-1])
    assert rate == pytest.approx(50.0, abs=2.0)
    counting.terminate()
    bag = tmp_path / "run.bag"
    recorder = ros.begin("rosbag", "record", "--duration=3", "-O", str(bag), "/odom", "/tf", "/joint_states")
    command = "{linear: {x: 0.3}, angular: {z: 0.2}}"
    hand = ros.begin("rostopic", "pub", "-r", str(RATE), "/cmd_vel", "geometry_msgs/Twist", command)
    until(run, "driving")
    assert "base_link" in ros.told("rostopic", "echo", "-n", "1", "/odom")
    assert "front_left_steering" in ros.told("rostopic", "echo", "-n", "1", "/joint_states")
    assert "ARTEMIS: traction-left" in ros.told("rostopic", "echo", "-n", "1", "/diagnostics")
    assert "rear_left_wheel" in ros.told("rostopic", "echo", "-n", "1", "/tf_static")
    recorder.wait(DURATION)
    recorded = ros.told("rosbag", "info", str(bag))
    assert all(type in recorded for type in ("nav_msgs/Odometry", "tf2_msgs/TFMessage", "sensor_msgs/JointState"))
    if TF_ECHO.exists():
        echo = ros.begin(str(TF_ECHO), "odom", "front_left_wheel")
        until(echo, "Translation")
    assert "success: True" in ros.told("rosservice", "call", "/stop")
    until(run, "quick stop")
    hand.terminate()
    until(run, "stopped: arm to continue")
    ros.told("rosservice", "call", "/arm")
    until(run, "armed again")
    until(run, "to drive")
    ros.told("rosservice", "call", "/done")
    lines = until(run, "result")
    assert lines[-1].split() == ["result", "done"]
    assert run.wait(DURATION) == 0
    assert "/odom" not in ros.told("rostopic", "list")
