"""Goals and initial poses as other programs send them: which are used, and why the others are not."""

from __future__ import annotations

import math
from typing import Any

import pytest

from artemis.bridges.json_messages import JsonMessages
from artemis.bridges.poses import GOAL_POSE, INITIAL_POSE, POSE_TYPES, asked_initial_pose, asked_pose

NOW = 1_800_000_000.5
STAMP = {"sec": 1_799_999_999, "nanosec": 0}
QUARTER = {"z": math.sqrt(0.5), "w": math.sqrt(0.5)}


def message(kind: str = GOAL_POSE, *, ros: int = 2, **changes: Any) -> object:  # noqa: ANN401 (parts of the message)
    header = {"frame_id": "map", "stamp": STAMP, **changes.pop("header", {})}
    pose = {"position": {"x": 1.5, "y": -2.0}, "orientation": QUARTER, **changes}
    content = {"pose": pose, "covariance": pose.pop("covariance", [0.0] * 36)} if kind == INITIAL_POSE else pose
    messages = JsonMessages(ros)
    return messages.unpack(POSE_TYPES[kind], messages.pack(POSE_TYPES[kind], {"header": header, "pose": content}))


@pytest.mark.parametrize("header", [{}, {"frame_id": "/map"}, {"stamp": {}}, {"stamp": {"sec": 1_800_000_010}}])
@pytest.mark.parametrize("ros", [1, 2])
def test_a_pose_on_the_map_is_taken(header: dict[str, Any], ros: int) -> None:
    pose = asked_pose(message(header=header, ros=ros), NOW)
    assert (pose.x, pose.y) == (1.5, -2.0)
    assert pose.heading == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"header": {"frame_id": "odom"}}, "it is in the frame 'odom', and map is needed"),
        ({"header": {"frame_id": ""}}, "it is in the frame '', and map is needed"),
        ({"header": {"stamp": {"sec": 1_799_999_900}}}, "it is stamped 100 s ago by this computer's clock"),
        ({"header": {"stamp": {"sec": 1_800_000_060}}}, "it is stamped 60 s ahead by this computer's clock"),
        ({"header": {"stamp": {"sec": 12}}}, "it is stamped 1799999988 s ago"),
        ({"orientation": {}}, "its orientation is no rotation"),
        ({"orientation": {"z": 1.0, "w": 1.0}}, "its orientation is no rotation"),
        ({"position": {"x": 1e7}}, "its position is x 1e"),
    ],
)
def test_one_that_cannot_be_used_is_refused_with_the_reason(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        asked_pose(message(**changes), NOW)


def spread(**places: float) -> list[float]:
    return [places.get(f"at{place}", 0.0) for place in range(36)]


def test_an_initial_pose_has_the_covariance_of_the_plane() -> None:
    given = spread(at0=0.25, at1=0.01, at6=0.01, at7=0.16, at35=0.07, at14=9.0)
    found = asked_initial_pose(message(INITIAL_POSE, covariance=given), NOW, "rviz")
    assert (found.source, found.frame, found.covariance) == ("rviz", "map", (0.25, 0.01, 0.0, 0.16, 0.0, 0.07))
    assert found.pose == asked_pose(message(), NOW)
    assert asked_initial_pose(message(INITIAL_POSE), NOW, "rviz").covariance == ()


@pytest.mark.parametrize(
    "given", [spread(at0=0.25), spread(at0=-1.0, at7=1.0, at35=1.0), spread(at0=1.0, at1=2.0, at7=1.0, at35=1.0)]
)
def test_a_covariance_that_is_none_is_refused(given: list[float]) -> None:
    with pytest.raises(ValueError, match="its covariance is none"):
        asked_initial_pose(message(INITIAL_POSE, covariance=given), NOW, "rviz")


@pytest.mark.parametrize("header", ["7", '{"frame_id": 7}', '{"frame_id": "map", "stamp": {"sec": "1"}}'])
def test_a_header_that_is_none_is_refused_where_it_counts(header: str) -> None:
    data = b'{"header": %s, "pose": {"orientation": {"w": 1}}}' % header.encode()
    with pytest.raises(ValueError, match=r"is stamped|in the frame"):
        asked_pose(JsonMessages().unpack(POSE_TYPES[GOAL_POSE], data), NOW)
    command = JsonMessages().unpack("geometry_msgs/msg/TwistStamped", b'{"header": 7, "twist": {}}')
    assert command.twist.linear.x == 0.0  # type: ignore[attr-defined]


def test_of_a_covariance_the_length_counts() -> None:
    with pytest.raises(ValueError, match="covariance is no list of 36 values"):
        JsonMessages().unpack(POSE_TYPES[INITIAL_POSE], b'{"pose": {"covariance": [1, 2]}}')
