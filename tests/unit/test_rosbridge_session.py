"""What a client of rosbridge may say, and what it is told: without a connection."""

from __future__ import annotations

import json
import math
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artemis.bridges.json_messages import FORMS, JsonMessages, full_name
from artemis.bridges.rosbridge.session import (
    MOST_TOPICS,
    QUEUE,
    SETTLED,
    ClientSession,
    Message,
    Offer,
    Outgoing,
)
from artemis.bridges.topics import SCAN_TYPE, Topics
from artemis.mission.loading import load_model
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions/robots/artemis.yaml", RobotFile)
TWIST, ODOMETRY = "geometry_msgs/msg/Twist", "nav_msgs/msg/Odometry"

CONNECTED = -10.0
"""When the client connected [s]."""


class Desk:
    """One client's session, and all that it was told."""

    def __init__(self, elsewhere: str = "") -> None:
        self.arrived: list[tuple[bytes, str]] = []
        self.sent: list[dict[str, Any]] = []
        self.path = Outgoing("nav_msgs/msg/Path", latched=True)
        offer = Offer(
            told={"/odom": Outgoing(ODOMETRY), "/path": self.path},
            heard={topic: (TWIST, self.take) for topic in ("/cmd_vel", "/other")},
            services={"/stop": self.stop, "/arm": self.arm},
            early={"/other": lambda why: f"other: {why}", "/arm": lambda why: f"arm: {why}"},
            elsewhere=elsewhere,
        )
        self.later: list[Coroutine[Any, Any, None]] = []
        self.session = ClientSession(
            offer,
            "client 1",
            lambda data: self.sent.append(json.loads(data)),
            JsonMessages(),
            CONNECTED,
            self.later.append,
        )

    def take(self, data: bytes, sender: str) -> str:
        self.arrived.append((data, sender))
        return "too fast" if b"9.5" in data else ""

    def stop(self, arguments: Message) -> Message:
        if arguments:
            raise ValueError("it takes no arguments")
        return {"success": True}

    async def arm(self, arguments: Message) -> Message:
        return {"success": False, "message": "arm: ignored, the drives are armed"}

    def say(self, *, at: float = 0.0, **message: object) -> bool:
        return self.session.take(json.dumps(message), at)

    def told(self) -> list[dict[str, Any]]:
        told, self.sent[:] = list(self.sent), []
        return told

    def errors(self, *, at: float = 0.0, **message: object) -> list[str]:
        self.say(at=at, **message)
        return [each["msg"] for each in self.told() if each["op"] == "status"]


def numbered(number: int) -> bytes:
    return json.dumps({"op": "publish", "topic": "/odom", "msg": number}).encode()


def heard(desk: Desk) -> list[int]:
    return [each["msg"] for each in desk.told()]


def test_a_topic_is_heard_from_subscribe_to_unsubscribe() -> None:
    desk = Desk()
    desk.session.put("/odom", numbered(0), 0.0)
    desk.say(op="subscribe", topic="odom", type="nav_msgs/Odometry", id="a")
    desk.say(op="subscribe", topic="/odom", id="b")
    assert desk.session.subscribed == {"/odom"}
    desk.session.put("/odom", numbered(1), 0.1)
    desk.say(op="unsubscribe", topic="/odom", id="a")
    desk.session.put("/odom", numbered(2), 0.2)
    desk.say(op="unsubscribe", topic="/odom")
    desk.session.put("/odom", numbered(3), 0.3)
    assert heard(desk) == [1, 2]
    assert desk.errors(op="unsubscribe", topic="/odom") == ["/odom is not subscribed to"]


def test_a_latched_message_is_told_to_who_comes_later() -> None:
    desk = Desk()
    desk.path.last = b'{"msg":7}'
    for _ in range(2):  # once
        desk.say(op="subscribe", topic="/path")
    assert heard(desk) == [7]


def test_messages_come_no_faster_than_asked_for_and_so_many_wait() -> None:
    desk = Desk()
    desk.say(op="subscribe", topic="/odom", throttle_rate=125)
    for number in range(20):
        desk.session.put("/odom", numbered(number), number / 16)
    assert heard(desk) == list(range(0, 20, 2))
    desk.say(op="subscribe", topic="/odom", throttle_rate=100, queue_length=2)  # replaces the one without an id
    for number in range(5):
        desk.session.put("/odom", numbered(number), 2.0)
    for time in (2.05, 2.1, 2.15, 2.2, 2.3):
        desk.session.look(time)
    assert heard(desk) == [0, 3, 4]
    desk.say(op="subscribe", topic="/odom", id="fast")  # the least of all holds
    desk.session.put("/odom", numbered(5), 2.301)
    assert heard(desk) == [5]


def test_a_command_arrives_with_who_sent_it() -> None:
    desk = Desk()
    desk.say(op="advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
    desk.say(op="publish", topic="/cmd_vel", msg={"linear": {"x": 0.5}})
    desk.say(op="unadvertise", topic="/cmd_vel")
    assert [(json.loads(data), sender) for data, sender in desk.arrived] == [({"linear": {"x": 0.5}}, "client 1")]
    assert desk.told() == []


def test_what_cannot_be_used_is_refused_with_the_reason() -> None:
    desk = Desk()
    assert desk.errors(op="publish", topic="/cmd_vel", msg={"linear": {"x": 9.5}}) == ["too fast"]


def test_a_service_answers_later() -> None:
    desk = Desk()
    desk.say(op="call_service", service="/arm", id="x")
    assert desk.told() == []
    (answer,) = desk.later
    with suppress(StopIteration):
        answer.send(None)
    values = {"success": False, "message": "arm: ignored, the drives are armed"}
    assert desk.told() == [{"op": "service_response", "service": "/arm", "id": "x", "values": values, "result": True}]


def test_what_a_client_says_as_soon_as_it_has_connected_may_have_waited_for_that() -> None:
    desk, at = Desk(), CONNECTED + 0.25
    why = "dropped: sent 0.25 s after client 1 connected, may be an old queued message"
    assert desk.errors(at=at, op="publish", topic="/other", msg={}) == [f"other: {why}"]
    desk.say(at=at, op="call_service", service="/arm")
    assert [each["values"] for each in desk.told()] == [{"success": False, "message": f"arm: {why}"}]
    assert (desk.arrived, desk.later) == ([], [])
    desk.say(at=at, op="publish", topic="/cmd_vel", msg={})
    desk.say(at=at, op="call_service", service="/stop")
    assert (len(desk.arrived), desk.told()[-1]["values"]) == (1, {"success": True})
    desk.say(at=CONNECTED + SETTLED, op="publish", topic="/other", msg={})
    assert len(desk.arrived) == 2


def test_a_service_answers_with_the_call_s_id() -> None:
    desk = Desk()
    desk.say(op="call_service", service="/stop", id="x")
    desk.say(op="call_service", service="stop", args={"now": True})
    desk.say(op="call_service", service="/go", id="y")
    assert desk.told() == [
        {"op": "service_response", "service": "/stop", "id": "x", "values": {"success": True}, "result": True},
        {"op": "service_response", "service": "/stop", "values": "it takes no arguments", "result": False},
        {"op": "service_response", "service": "/go", "id": "y", "values": "no service /go", "result": False},
    ]


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({}, "op is missing"),
        ({"op": "fragment"}, "unknown operation 'fragment'"),
        ({"op": 5}, "op: 5 is no text"),
        ({"op": "subscribe"}, "topic is missing"),
        ({"op": "subscribe", "topic": "a b"}, "'a b' is no name in ROS"),
        (
            {"op": "subscribe", "topic": "/odom", "type": "std_msgs/String"},
            "/odom is nav_msgs/msg/Odometry, and std_msgs",
        ),
        ({"op": "subscribe", "topic": "/odom", "compression": "cbor"}, "/odom: compression 'cbor'"),
        ({"op": "subscribe", "topic": "/odom", "throttle_rate": -1}, "throttle_rate: -1 is no number"),
        ({"op": "subscribe", "topic": "/odom", "queue_length": True}, "queue_length: True is no number"),
        ({"op": "advertise", "topic": "/cmd_vel", "type": "my_msgs/Wish"}, "/cmd_vel: unknown type 'my_msgs/Wish'"),
        (
            {"op": "advertise", "topic": "/cmd_vel", "type": "std_msgs/Bool"},
            f"/cmd_vel is {TWIST}, and std_msgs/msg/Bool",
        ),
        ({"op": "advertise", "topic": "/go", "type": TWIST}, "/go is not accepted here; topics that are: /cmd_vel"),
        ({"op": "unadvertise", "topic": "/cmd_vel"}, "/cmd_vel is not advertised"),
        (
            {"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": "fast"}}},
            "x is 'fast', and float is expected",
        ),
        ({"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"v": 1}}}, "linear has no field v"),
        ({"op": "publish", "topic": "/cmd_vel", "msg": 3}, "message is no message"),
        ({"op": "publish", "topic": "/odom", "msg": {}}, "/odom is not accepted here"),
        ({"op": "set_level", "level": "all"}, "level 'all': none, error, warning, info"),
        ({"op": "call_service"}, "service is missing"),
    ],
)
def test_what_cannot_be_is_an_error_with_its_reason(message: dict[str, Any], words: str) -> None:
    desk = Desk()
    (error,) = desk.errors(**message)
    assert words in error
    assert desk.arrived == []


def test_a_status_has_the_id_of_what_it_is_about_and_the_level_that_is_wanted() -> None:
    desk = Desk()
    for text in ("", "{", "[]", "\xff", "[" * 5000):
        assert desk.session.take(text.encode("latin1"), 0.0)
        assert [each["level"] for each in desk.told()] == ["error"]
    desk.say(op="fly", id="z")
    assert desk.told()[0]["id"] == "z"
    desk.say(op="subscribe", topic="/nothing")
    assert desk.told() == []
    desk.say(op="set_level", level="warning")
    assert desk.errors(op="subscribe", topic="/nothing", fragment_size=9) == [
        "/nothing: fragment_size: messages are sent whole",
        "/nothing: it has no publisher here",
    ]
    desk.say(op="set_level", level="none")
    assert desk.errors(op="fly") == []


def test_a_client_has_so_many_topics_at_most() -> None:
    desk = Desk()
    for number in range(MOST_TOPICS):
        desk.say(op="subscribe", topic=f"/t{number}")
    assert desk.errors(op="subscribe", topic="/one_more") == [f"{MOST_TOPICS} topics are the most"]


def test_what_waits_for_a_client_s_time_is_bounded_whatever_it_wants() -> None:
    desk = Desk()
    for number in range(MOST_TOPICS):
        desk.say(op="subscribe", topic="/odom", id=f"{number}", throttle_rate=1e6, queue_length=1e6)
    desk.say(op="subscribe", topic="/odom", id="0", throttle_rate=1e6, queue_length=1e6)  # replaces
    assert desk.errors(op="subscribe", topic="/odom", id="more") == [
        f"{MOST_TOPICS} subscriptions to a topic are the most"
    ]
    for number in range(10 * QUEUE):
        desk.session.put("/odom", numbered(number), 0.0)
    desk.told()
    for hour in range(1, 2 * QUEUE):
        desk.session.look(1e4 * hour)
    assert heard(desk) == list(range(9 * QUEUE, 10 * QUEUE))


@pytest.mark.parametrize("number", ["1" + "0" * 30, "1" + "0" * 400, "-1e999"])
def test_a_number_that_none_can_hold_is_an_error(number: str) -> None:
    desk = Desk()
    text = '{"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": %s}}}'
    assert desk.session.take(text % number, 0.0)
    assert len(desk.told()) == 1 - len(desk.arrived)


def test_commands_may_be_for_others() -> None:
    desk = Desk(elsewhere="port 9091")
    assert not desk.say(op="publish", topic="/cmd_vel", msg={})
    assert not desk.say(op="advertise", topic="/cmd_vel", type=TWIST)
    assert not desk.say(op="call_service", service="/end")
    assert desk.say(op="call_service", service="/stop")
    assert desk.say(op="subscribe", topic="/odom")
    assert desk.arrived == []


# ---------------------------------------------------------------------------------------------- messages


def test_forms_are_those_of_the_types() -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")
    from artemis.bridges.ros_types import Ros2Types

    store = Ros2Types("humble")._store

    def fields(type: str) -> Any:  # noqa: ANN401 (a form)
        return {name: shape(of) for name, of in store.fielddefs[type][1]}

    def shape(of: Any) -> Any:  # noqa: ANN401 (part of a form)
        node, kind = of
        match node.name:
            case "NAME":
                return fields(kind)
            case "BASE":
                return {"string": "", "bool": False}.get(kind[0], 0.0 if kind[0].startswith("float") else 0)
        (inner, name), _ = kind
        return [fields(name)] if inner.name == "NAME" else ()

    def plain(form: Any) -> Any:  # noqa: ANN401 (part of a form)
        if isinstance(form, dict):
            return {name: plain(part) for name, part in form.items()}
        return [plain(form[0])] if isinstance(form, list) else () if isinstance(form, tuple) else form

    for type, form in FORMS.items():
        if type == "std_msgs/msg/Empty":
            assert form == {}
            continue
        expected = fields(type)
        if type.startswith("diagnostic"):
            expected["status"][0]["level"] = 0  # a byte
        assert repr(plain(form)) == repr(expected), type


def test_all_that_artemis_tells_has_a_form() -> None:
    assert {topic.type for topic in Topics(ROBOT).topics} | {SCAN_TYPE} <= FORMS.keys()
    assert full_name("nav_msgs/Odometry") == full_name(ODOMETRY) == ODOMETRY


def test_a_message_is_whole_and_what_is_no_number_is_null() -> None:
    scan = {
        "header": {"stamp": {"sec": 1, "nanosec": 2}},
        "ranges": np.array([1000, 65535]) * 1e-3,
        "angle_min": math.nan,
    }
    packed = json.loads(JsonMessages().pack(SCAN_TYPE, scan))
    assert packed["header"] == {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": ""}
    assert (packed["ranges"], packed["angle_min"], packed["intensities"]) == ([1.0, 65.535], None, [])
    old = json.loads(JsonMessages(1).pack(SCAN_TYPE, scan))
    assert old["header"] == {"seq": 0, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": ""}
    with pytest.raises(ValueError, match="no field speed"):
        JsonMessages().pack(ODOMETRY, {"speed": 1.0})


def test_a_message_is_understood_whatever_its_header_is() -> None:
    data = json.dumps({"header": {"seq": 5, "stamp": {"secs": 1, "nsecs": 0}}, "twist": {"linear": {"x": 1}}})
    twist: Any = JsonMessages().unpack("geometry_msgs/msg/TwistStamped", data.encode())
    assert (twist.twist.linear.x, twist.twist.angular.z) == (1.0, 0.0)
    for wrong in (b"{", b'{"data":1}', b'{"data":null}'):
        with pytest.raises(ValueError, match=r"no JSON|bool is expected"):
            JsonMessages().unpack("std_msgs/msg/Bool", wrong)
    with pytest.raises(ValueError, match=r"no JSON|x is"):
        JsonMessages().unpack(TWIST, b'{"linear":{"x":1e999}}')
