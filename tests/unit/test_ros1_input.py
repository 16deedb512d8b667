"""The input `ros1`: what velocity commands mean, how old they may be, and what may be asked for."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from pydantic import ValidationError
from ros1_rig import Master, Peer, Publisher

from artemis_lab.bench.ports import free_port

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")

from artemis.bridges import answers
from artemis.bridges.commands import Command, steered_command, twist_command
from artemis.bridges.poses import GOAL_POSE, INITIAL_POSE, POSE_TYPES
from artemis.bridges.received import Received
from artemis.bridges.ros1.tcpros import framed
from artemis.bridges.ros1.xmlrpc import call
from artemis.bridges.ros_types import Ros1Types
from artemis.clock import wall_date
from artemis.errors import DeviceLost
from artemis.mission.loading import load_model
from artemis.motion.ackermann import Ackermann
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs import ros1
from artemis.plugins.inputs.ros1 import Ros1Input, Ros1InputConfig
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import LocatedPose, OperatorInput, Pose, Request, Tick
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


class Device(Ros1Input):
    """One whose clock the test sets."""

    def __init__(self, config: Ros1InputConfig, context: PluginContext) -> None:
        self.time = 0.0
        super().__init__(config, context, lambda: self.time)

    def read_at(self, time: float) -> OperatorInput:
        self.time = time
        return self.read(time)


Ignored = Callable[[Request, Tick], str | None]
Make = Callable[..., Device]


@pytest.fixture
def make(master: Master, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    inputs: list[Device] = []
    monkeypatch.setattr(ros1, "stopwatch", lambda: 0.0)  # that this computer is busy is no hold-up

    def make(
        wake: Callable[[], None] = lambda: None,
        ignored: Ignored = lambda request, tick: None,
        **options: Any,  # noqa: ANN401 (keys)
    ) -> Device:
        config = Ros1InputConfig(master=master.uri, **options)
        context = PluginContext(name="remote", robot=ROBOT, folder=Path(), wake=wake, ignored=ignored)
        inputs.append(Device(config, context))
        inputs[-1].read_at(0.0)
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


def waits(device: Device) -> bool:
    """Whether something is there to be taken."""
    device._mailbox.absorb(received := device._mailbox.take())
    return received != Received()


def told(master: Master, device: Device, peer: Publisher, data: bytes, now: float) -> OperatorInput:
    """The sample after a message has arrived."""
    device.time = now
    peer.say(data)
    master.until(lambda: waits(device))
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
    rest = device.read_at(1.0)
    assert (rest.enabled, rest.neutral, rest.age) == (False, True, 0.0)
    peer = publisher(master)
    sample = told(master, device, peer, twist(2.0, 0.0), 2.0)
    assert (sample.speed, sample.enabled, sample.neutral, sample.age) == (0.4, True, False, 0.0)
    assert device.read_at(2.3).age == pytest.approx(0.3)
    gone = device.read_at(2.6)
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
    assert not device.read_at(1.2).enabled
    assert not told(master, device, button, b"\0", 1.22).enabled


def test_of_two_publishers_the_first_that_drives_has_the_robot(master: Master, make: Make) -> None:
    device = make(enabled_by="command")
    one, other = publisher(master, name="/one"), publisher(master, name="/other")
    assert told(master, device, one, twist(0.3, 0.0), 1.0).speed == 0.3
    assert told(master, device, other, twist(-0.3, 0.0), 1.1).speed == 0.3
    assert told(master, device, one, twist(0.0, 0.0), 1.12).neutral
    assert told(master, device, other, twist(-0.3, 0.0), 1.14).speed == -0.3


def test_a_second_publisher_does_not_take_the_robot_over_after_a_hold_up(make: Make) -> None:
    device = make(enabled_by="command")
    one, other = Command(0.3, moves=True, rests=False), Command(-0.3, moves=True, rests=False)
    device._mailbox.command("/one", 1.0, one)
    assert device.read_at(1.0).speed == 0.3
    device._mailbox.command("/other", 1.198, other)
    device._mailbox.command("/one", 1.2, one)
    assert device.read_at(1.2).speed == 0.3
    device._mailbox.command("/other", 1.38, other)
    assert device.read_at(1.38).speed == -0.3, "the first is silent"


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


def shown(sample: OperatorInput) -> Tick:
    """The tick that took a sample."""
    (tick,) = itertools.islice(ObserverContract().ticks(), 1)
    sensed = replace(tick.snapshot.sensed, inputs=(sample,))
    return replace(tick, snapshot=replace(tick.snapshot, sensed=sensed))


def called(master: Master, device: Device, name: str, now: float = 1.0) -> tuple[bytes, OperatorInput]:
    """The response of a service, and the sample that took what it asks for."""
    asked = asyncio.run_coroutine_threadsafe(Peer(master).ask_later(name), master._loop)
    master.until(lambda: waits(device))
    sample = device.read(now)
    assert device.show(shown(sample)) == ""
    return asked.result(20.0)[1], sample


def trigger(success: bool, words: str) -> bytes:
    """The response of a Trigger."""
    return b"\x01" + framed(bytes([success]) + framed(words.encode()))[4:]


def test_a_stop_is_always_obeyed_and_the_rest_where_it_is_allowed(master: Master, make: Make) -> None:
    woken: list[bool] = []
    device = make(lambda: woken.append(True), allow=["arm"])
    assert sorted(master.served) == ["/arm", "/stop"]
    answer, sample = called(master, device, "/stop")
    assert (answer, sample.requests) == (trigger(True, "stop: requested"), (Request.QUICKSTOP,))
    assert device.read_at(1.1).requests == ()
    assert "error" in Peer(master).ask("/stop", "0" * 32)[0]
    peer = publisher(master, "/stop", "std_msgs/msg/Empty")
    peer.say(b"")
    master.until(lambda: waits(device))
    assert device.read_at(1.2).requests == (Request.QUICKSTOP,)
    answer, sample = called(master, device, "/arm")
    assert (answer, sample.requests, len(woken)) == (trigger(True, "arm: requested"), (Request.ARM,), 2)
    assert not device.live
    assert make(allow=["arm", "acknowledge"], node="other").live


def test_a_service_answers_what_became_of_it(master: Master, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    device = make(allow=["arm"], ignored=lambda request, tick: f"{request.value} in {tick.mode.value}")
    assert called(master, device, "/arm")[0] == trigger(False, "arm: ignored, arm in follow")
    asked = asyncio.run_coroutine_threadsafe(Peer(master).ask_later("/arm"), master._loop)
    master.until(lambda: waits(device))
    device.time += 0.4
    assert device.read(1.5).requests == ()
    words = "arm: 0.4 s old, without effect; ask again"
    assert (asked.result(20.0)[1], device.take_problems()) == (trigger(False, words), [("NET-04", words)])
    asked = asyncio.run_coroutine_threadsafe(Peer(master).ask_later("/arm"), master._loop)
    master.until(lambda: waits(device))
    other = replace(device.read(2.0), requests=())  # the guard gave another sample in its place
    device.show(shown(other))
    words = "arm: ignored, the input is lost, or was sent what cannot be used"
    assert asked.result(20.0)[1] == trigger(False, words)
    monkeypatch.setattr(answers, "PATIENCE", 0.05)
    assert Peer(master).ask("/stop")[1] == trigger(False, "the run has not taken it within 0.05 s")


def test_what_waited_while_the_run_was_held_up_is_as_old_as_it_is(master: Master, make: Make) -> None:
    device = make(enabled_by="command", allow=["arm", GOAL_POSE])
    peers = {
        topic: publisher(master, f"/{topic}", type)
        for topic, type in (
            ("cmd_vel", TWIST),
            ("arm", "std_msgs/msg/Empty"),
            ("stop", "std_msgs/msg/Empty"),
            (GOAL_POSE, POSE_TYPES[GOAL_POSE]),
        )
    }
    device.read_at(1.0)
    peers["cmd_vel"].say(twist(0.3, 0.0))
    peers["arm"].say(b"")
    peers["stop"].say(b"")
    peers[GOAL_POSE].say(placed(GOAL_POSE, int(wall_date().timestamp())))
    master.until(
        lambda: len(device._mailbox._asked) == 2 and device._mailbox._commands and device._mailbox._received.poses
    )
    sample = device.read_at(1.2)
    assert (sample.speed, sample.enabled) == (0.3, True)
    assert sample.age == pytest.approx(0.2)
    assert (sample.requests, sample.goal) == ((Request.QUICKSTOP,), None)
    told = [f"{what}: 0.2 s old, without effect; ask again" for what in ("arm", "goal_pose")]
    assert device.take_problems() == [("NET-04", words) for words in told]


def test_what_the_thread_reads_first_after_a_hold_up_has_waited_as_long(
    master: Master, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, time = make(enabled_by="command", allow=["arm"]), [0.0]
    monkeypatch.setattr(ros1, "stopwatch", lambda: time[0])
    drive, arm, stop = (
        publisher(master, topic, type)
        for topic, type in (("/cmd_vel", TWIST), ("/arm", "std_msgs/msg/Empty"), ("/stop", "std_msgs/msg/Empty"))
    )
    time[0] += 1.8
    held = told(master, device, drive, twist(0.3, 0.0), 1.8)
    assert (held.speed, held.enabled) == (0.0, False)
    assert told(master, device, arm, b"", 1.8).requests == ()
    assert device.take_problems() == [("NET-04", "arm: 1.8 s old, without effect; ask again")]
    assert called(master, device, "/arm", 1.8)[0] == trigger(False, "arm: 1.8 s old, without effect; ask again")
    assert told(master, device, stop, b"", 1.8).requests == (Request.QUICKSTOP,)
    device.take_problems()
    time[0] += ros1.DRAIN
    assert told(master, device, drive, twist(0.3, 0.0), 1.85).age == 0.0
    assert told(master, device, arm, b"", 1.85).requests == (Request.ARM,)
    time[0] += ros1.BEAT
    assert told(master, device, arm, b"", 1.9).requests == (Request.ARM,)
    assert device.take_problems() == []


def test_a_hold_up_with_nothing_to_read_is_seen_all_the_same(
    master: Master, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, time = make(allow=["arm"]), [0.0]
    monkeypatch.setattr(ros1, "stopwatch", lambda: time[0])
    arm = publisher(master, "/arm", "std_msgs/msg/Empty")
    for _ in range(20):  # a second in which nothing is said
        time[0] += ros1.BEAT
        master.until(lambda: device._ran == time[0])
    assert told(master, device, arm, b"", 1.0).requests == (Request.ARM,)


@pytest.mark.parametrize(
    ("topic", "type", "data", "counts"),
    [
        ("arm", "std_msgs/msg/Empty", b"", False),
        ("stop", "std_msgs/msg/Empty", b"", True),
        ("cmd_vel", TWIST, TYPES.pack(TWIST, {"linear": {"x": 0.3}}), False),
    ],
)
def test_what_a_publisher_has_kept_counts_only_where_it_has_just_come(
    master: Master, make: Make, topic: str, type: str, data: bytes, counts: bool
) -> None:
    def kept(name: str) -> Publisher:
        return Publisher(master, f"/{topic}", type.replace("/msg/", "/"), TYPES.definition(type)[1], name, kept=data)

    def arrives() -> bool:
        """Whether what a publisher has kept has an effect; else there is a warning."""
        master.until(lambda: waits(device))
        sample = device.read(device.time)
        device.time += 1.0
        problems = device.take_problems()
        effect = bool(sample.requests) or sample.enabled
        words = f"{topic}: latched message from {names[-1]} dropped; send it again"
        assert problems == ([] if effect else [("NET-04", words)])
        return effect

    names = ["/before"]
    before = kept("/before")
    device = make(enabled_by="command", allow=["arm"])
    assert arrives() == counts, "it was there when the run began"
    before.cut()
    assert arrives() == counts, "its connection was made anew"
    names.append("/new")
    new = kept("/new")
    assert arrives(), "it came and said that"
    new.say(data)
    assert arrives(), "and says it again"
    new.cut()
    assert arrives() == counts
    master.run(call(master.subscribed[f"/{topic}"][1], "publisherUpdate", "/master", f"/{topic}", []))
    master.until(lambda: not device._thread.node.subscriptions[f"/{topic}"].connected)  # type: ignore[union-attr]
    master.run(call(master.subscribed[f"/{topic}"][1], "publisherUpdate", "/master", f"/{topic}", [new.uri]))
    assert arrives() == counts, "it is registered anew"


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
        master.until(lambda: waits(device))
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
        device.read_at(5.1)


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
