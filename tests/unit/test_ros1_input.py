"""The input `ros1`: what velocity commands mean, how old they may be, and what may be asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from pydantic import ValidationError
from ros1_rig import Master, Peer, Publisher

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")

from artemis.bridges.commands import Command, steered_command, twist_command
from artemis.bridges.poses import GOAL_POSE, INITIAL_POSE, POSE_TYPES
from artemis.bridges.ros_types import TRIGGER_MD5, Ros1Types
from artemis.clock import wall_date
from artemis.errors import DeviceLost
from artemis.mission.loading import load_model
from artemis.motion.ackermann import Ackermann
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.ros1 import Ros1Input, Ros1InputConfig
from artemis.testing.contracts import InputContract
from artemis.values import LocatedPose, OperatorInput, Pose, Request
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
LENGTH, LIMIT = ROBOT.geometry.wheelbase_m, math.radians(60)
TWIST = "geometry_msgs/msg/Twist"
TYPES = Ros1Types()


class TestRos1Input(InputContract):
    plugin = Ros1Input
    duration = 2.5
    options: Mapping[str, object] = {"master": f"http://127.0.0.1:{free_port()}"}


@pytest.fixture
def master() -> Iterator[Master]:
    made = Master()
    made.begin()
    yield made
    made.close()


Make = Callable[..., Ros1Input]


@pytest.fixture
def make(master: Master) -> Iterator[Make]:
    inputs = []

    def make(wake: Callable[[], None] = lambda: None, **options: Any) -> Ros1Input:  # noqa: ANN401 (keys)
        config = Ros1InputConfig(master=master.uri, **options)
        inputs.append(Ros1Input(config, PluginContext(name="remote", robot=ROBOT, folder=Path(), wake=wake)))
        inputs[-1].read(0.0)
        master.until(lambda: inputs[-1]._topic in master.subscribed and not inputs[-1]._thread.problem)  # type: ignore[union-attr]
        return inputs[-1]

    yield make
    for each in inputs:
        each.close()


def twist(speed: float, angular: float) -> bytes:
    return TYPES.pack(TWIST, {"linear": {"x": speed}, "angular": {"z": angular}})


def publisher(master: Master, topic: str = "/cmd_vel", type: str = TWIST, name: str = "/peer") -> Publisher:
    made = Publisher(master, topic, type.replace("/msg/", "/"), TYPES.definition(type)[1], name)
    master.until(lambda: made.heard)
    return made


def told(master: Master, device: Ros1Input, peer: Publisher, data: bytes, now: float) -> OperatorInput:
    """The sample after a message has arrived."""
    peer.say(data)
    master.until(lambda: device._arrived or device._enables)
    return device.read(now)


@pytest.mark.parametrize(("speed", "rate"), [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2), (0.01, 0.0)])
def test_a_twist_is_what_the_robot_then_does(speed: float, rate: float) -> None:
    command = twist_command(speed, rate, LENGTH, LIMIT)
    model = Ackermann(ROBOT.geometry)
    assert command.speed * math.cos(command.steering) == pytest.approx(speed)
    assert command.speed * math.sin(command.steering) / model.wheelbase == pytest.approx(rate)
    assert (command.moves, command.rests) == (True, False)


def test_a_yaw_rate_without_speed_moves_nothing_and_an_angle_steers() -> None:
    assert twist_command(0.0, 0.5, LENGTH, LIMIT) == Command(rests=False, raw=(0.0, 0.5))
    assert twist_command(0.0, 0.0, LENGTH, LIMIT) == Command(raw=(0.0, 0.0))
    assert twist_command(0.0, 0.5, LENGTH, LIMIT, as_angle=True) == Command(0.0, 0.5, True, False, (0.0, 0.5))
    assert twist_command(0.1, 5.0, LENGTH, LIMIT).steering == LIMIT
    assert steered_command(0.1, -2.0, LIMIT).steering == -LIMIT
    for wrong in (math.nan, math.inf):
        with pytest.raises(ValueError, match="no number"):
            steered_command(0.1, wrong, LIMIT)


def test_a_command_drives_while_it_is_fresh_and_is_forgotten(master: Master, make: Make) -> None:
    device = make(enabled_by="command", max_speed_m_s=0.4)
    rest = device.read(1.0)
    assert (rest.enabled, rest.neutral, rest.age) == (False, True, 0.0)
    peer = publisher(master)
    sample = told(master, device, peer, twist(2.0, 0.0), 2.0)
    assert (sample.speed, sample.enabled, sample.neutral, sample.age) == (0.4, True, False, 0.0)
    assert device.read(2.3).age == pytest.approx(0.3)
    gone = device.read(2.6)
    assert (gone.speed, gone.enabled, gone.neutral, gone.age) == (0.0, False, True, 0.0)
    assert told(master, device, peer, twist(0.0, 0.0), 3.0).neutral
    turning = told(master, device, peer, twist(0.0, 1.0), 3.1)
    assert (turning.enabled, turning.neutral, turning.speed) == (False, False, 0.0)
    bad = told(master, device, peer, twist(math.nan, 0.0), 3.2)
    assert math.isnan(bad.axes[0])


def test_without_the_mission_saying_so_a_command_alone_drives_nothing(master: Master, make: Make) -> None:
    device = make()
    peer, button = publisher(master), publisher(master, "/enable", "std_msgs/msg/Bool")
    sample = told(master, device, peer, twist(0.3, 0.0), 1.0)
    assert (sample.enabled, sample.speed) == (False, 0.3)
    assert told(master, device, button, b"\1", 1.02).enabled
    assert not device.read(1.2).enabled
    assert not told(master, device, button, b"\0", 1.22).enabled


def test_of_two_publishers_the_first_that_drives_has_the_robot(master: Master, make: Make) -> None:
    device = make(enabled_by="command")
    one, other = publisher(master, name="/one"), publisher(master, name="/other")
    assert told(master, device, one, twist(0.3, 0.0), 1.0).speed == 0.3
    assert told(master, device, other, twist(-0.3, 0.0), 1.1).speed == 0.3
    assert told(master, device, one, twist(0.0, 0.0), 1.12).neutral
    assert told(master, device, other, twist(-0.3, 0.0), 1.14).speed == -0.3


def test_of_a_flood_the_newest_is_taken_now_and_then(master: Master, make: Make) -> None:
    device = make(enabled_by="command")
    subscription = device._thread.node.subscriptions["/cmd_vel"]  # type: ignore[union-attr]
    peer, taken = publisher(master), list[bytes]()
    subscription._take = lambda data, sender: taken.append(data)
    flood = [twist(0.001 * number, 0.0) for number in range(3000)]
    peer.say(flood[0])
    master.until(lambda: taken)
    peer.say_all(flood[1:])
    master.until(lambda: taken[-1] == flood[-1])
    assert len(taken) < len(flood) / 20
    assert [flood.index(each) for each in taken] == sorted(flood.index(each) for each in taken)


def test_an_ackermann_drive_is_speed_and_angle(master: Master, make: Make) -> None:
    device = make(enabled_by="command", type="ackermann_msgs/AckermannDriveStamped")
    kind = "ackermann_msgs/msg/AckermannDriveStamped"
    peer = publisher(master, "/ackermann_cmd", kind)
    drive = TYPES.pack(kind, {"drive": {"speed": 0.25, "steering_angle": 0.5}})
    sample = told(master, device, peer, drive, 1.0)
    assert [sample.speed, sample.steering] == pytest.approx([0.25 / math.cos(0.5), 0.5])


def test_a_stop_is_always_obeyed_and_the_rest_where_it_is_allowed(master: Master, make: Make) -> None:
    woken: list[bool] = []
    device = make(lambda: woken.append(True), allow=["arm"])
    assert sorted(master.served) == ["/arm", "/stop"]
    header, answer = Peer(master).ask("/stop", TRIGGER_MD5)
    assert (header["type"], answer) == ("std_srvs/Trigger", b"\x01\x01\x0f\0\0\0stop: requested")
    assert (device.read(1.0).requests, device.read(1.1).requests) == ((Request.QUICKSTOP,), ())
    assert "error" in Peer(master).ask("/stop", "0" * 32)[0]
    peer = publisher(master, "/stop", "std_msgs/msg/Empty")
    peer.say(b"")
    master.until(lambda: device._asked)
    assert device.read(1.2).requests == (Request.QUICKSTOP,)
    Peer(master).ask("/arm")
    assert (device.read(1.3).requests, len(woken)) == ((Request.ARM,), 2)
    assert not device.live
    assert make(allow=["arm", "acknowledge"], node="other").live


def placed(kind: str, sec: int, frame: str = "map") -> bytes:
    pose: dict[str, Any] = {"position": {"x": 1.5}, "orientation": {"w": 1.0}}
    if kind == INITIAL_POSE:
        pose = {"pose": pose, "covariance": [0.25 if place in (0, 7, 35) else 0.0 for place in range(36)]}
    header = {"stamp": {"sec": sec, "nanosec": 0}, "frame_id": frame}
    return TYPES.pack(POSE_TYPES[kind], {"header": header, "pose": pose})


def test_goals_and_initial_poses_are_passed_on_once_where_they_are_allowed(master: Master, make: Make) -> None:
    device, now = make(allow=[GOAL_POSE, INITIAL_POSE]), int(wall_date().timestamp())
    assert sorted(master.served) == ["/stop"]
    peers = {kind: publisher(master, f"/{kind}", POSE_TYPES[kind]) for kind in POSE_TYPES}

    def told(kind: str, *given: Any) -> OperatorInput:  # noqa: ANN401 (of a pose)
        peers[kind].say(placed(kind, now, *given))
        master.until(lambda: any(device._places.values()))
        return device.read(1.0)

    assert told(GOAL_POSE).goal == Pose(x=1.5)
    initial = told(INITIAL_POSE).initial_pose
    assert initial == LocatedPose(
        pose=Pose(x=1.5), frame="map", source="remote", covariance=(0.25, 0.0, 0.0, 0.25, 0.0, 0.25)
    )
    assert device.take_problems() == []
    refused = told(GOAL_POSE, "odom")
    assert (refused.goal, refused.initial_pose) == (None, None)
    assert device.take_problems() == [("NET-14", "goal_pose: it is in the frame 'odom', and map is needed")]
    assert device.take_problems() == []


def test_without_a_master_and_a_publisher_it_is_lost(master: Master, make: Make) -> None:
    device = make(enabled_by="command")
    peer = publisher(master)
    master.end()
    master.until(lambda: device._thread is not None and device._thread.problem)
    assert told(master, device, peer, twist(0.3, 0.0), 5.0).enabled
    peer.leave()
    master.until(lambda: device._thread is not None and not device._thread.node.subscriptions["/cmd_vel"].connected)
    with pytest.raises(DeviceLost, match="connection refused"):
        device.read(5.1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"type": "std_msgs/String"}, "geometry_msgs/Twist"),
        ({"topic": "cmd vel"}, "no name in ROS"),
        ({"type": "ackermann_msgs/AckermannDrive", "angular_is": "velocity"}, "has a steering angle"),
        ({"allow": ["everything"]}, "acknowledge"),
        ({"master": "localhost"}, "no URI of a master"),
        ({"listen": "everywhere"}, "everywhere"),
    ],
)
def test_wrong_keys_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Ros1InputConfig.model_validate(options)


def test_two_inputs_of_one_topic_are_one_device() -> None:
    one, other, third = (Ros1InputConfig(topic=topic) for topic in (None, "cmd_vel", "nav_vel"))
    assert Ros1Input.may_share(one, other, {})
    assert not Ros1Input.may_share(one, third, {})
