"""What a run says to other programs: content, frames, rates."""

from __future__ import annotations

import math
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.bridges.ros_types import Ros1Types, Ros2Types
from artemis.bridges.stamps import Stamps
from artemis.bridges.topics import Content, Topics
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_model
from artemis.motion.planned_route import packed_route, planned_route
from artemis.motion.poses import placed
from artemis.motion.route import route_from_csv
from artemis.scan import Scan
from artemis.testing.observers import ObserverContract
from artemis.values import DriveFeedback, Fault, JobKind, JobResult, LocatedPose, Pose, Severity, Tick, Verdict
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
TICKS = list(ObserverContract().ticks())
SECOND = 1_000_000_000


def changed(tick: Tick, **changes: object) -> Tick:
    return replace(tick, snapshot=replace(tick.snapshot, **changes))


def told(tick: Tick, robot: RobotFile = ROBOT) -> dict[str, Content]:
    return {topic.name: content for topic, content in Topics(robot).tell(tick, 5 * SECOND)}


def test_rates_are_those_of_the_page() -> None:
    topics = Topics(ROBOT, every=2)
    counts = Counter(said.topic.name for n, tick in enumerate(TICKS[:100]) for said in topics.tell(tick, n))
    assert counts == {"odom": 50, "/tf": 50, "/diagnostics": 2}
    assert not list(Topics(ROBOT).tell(TICKS[0], 0, wanted=()))
    assert "/tf" not in {topic.name for topic in Topics(ROBOT, transforms=False).topics}


def test_map_and_odom_meet_in_the_robot() -> None:
    where = Pose(x=3.0, y=-1.0, heading=2.0)
    tick = changed(TICKS[50], pose=LocatedPose(pose=where, frame="map", covariance=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)))
    content = told(tick)
    first, second = content["/tf"]["transforms"]
    assert [first["header"]["frame_id"], second["header"]["frame_id"]] == ["map", "odom"]
    poses = []
    for part in (first, second):
        moved, turned = part["transform"]["translation"], part["transform"]["rotation"]
        poses.append(Pose(x=moved["x"], y=moved["y"], heading=2 * math.atan2(turned["z"], turned["w"])))
    assert placed(*poses).x == pytest.approx(where.x)
    assert placed(*poses).y == pytest.approx(where.y)
    covariance = content["pose"]["pose"]["covariance"]
    assert [covariance[place] for place in (0, 1, 5, 6, 7, 11, 30, 31, 35)] == [1, 2, 3, 2, 4, 5, 3, 5, 6]
    lost = changed(tick, pose=replace(tick.snapshot.pose, lost=True))
    assert "pose" not in told(lost)
    assert "odom" not in told(changed(tick, odometry=replace(tick.snapshot.odometry, lost=True)))


def test_wheels_turn_about_their_kingpins() -> None:
    drives = (
        DriveFeedback(name="traction-left", position=1.0, velocity=0.2, age=0.0),
        DriveFeedback(name="steer-left", position=0.5, age=0.0),
        DriveFeedback(name="steer-right"),
        DriveFeedback(name="another", age=0.0),
    )
    content = told(changed(TICKS[0], sensed=replace(TICKS[0].snapshot.sensed, drives=drives)))
    assert content["joint_states"]["name"] == ["front_left_wheel", "front_left_steering"]
    radius = 2.1276596e-4 * 72 * 50 / math.tau
    assert content["joint_states"]["position"] == pytest.approx([1.0 / radius, 0.5])
    (wheel,) = content["/tf"]["transforms"][1:]
    place = wheel["transform"]["translation"]
    assert (place["x"], place["z"]) == pytest.approx((0.56 - 0.0625 * math.sin(0.5), radius))
    assert place["y"] == pytest.approx(0.1555 + 0.0625 * math.cos(0.5))
    levels = {row["name"]: row["level"] for row in content["/diagnostics"]["status"]}
    assert levels["ARTEMIS: steer-right"] == 3
    assert levels["ARTEMIS: traction-left"] == 0


def test_a_fault_is_told_at_once_with_its_words() -> None:
    topics = Topics(ROBOT)
    list(topics.tell(TICKS[0], 0))
    fault = Fault(id="DRV-01", severity=Severity.QUICK_STOP, text="is gone", device="steer-left")
    tick = changed(TICKS[1], verdict=Verdict(severity=Severity.QUICK_STOP, faults=(fault,)))
    (rows,) = [said.content["status"] for said in topics.tell(tick, 0) if said.topic.name == "/diagnostics"]
    assert [rows[-1][key] for key in ("level", "name", "message")] == [2, "ARTEMIS: DRV-01 steer-left", "is gone"]


def test_a_planned_route_is_told_on_the_map() -> None:
    points = np.column_stack([np.linspace(0.0, 1.0, 21), np.zeros(21), np.full(21, 0.4)])
    values = packed_route(planned_route(points, ROBOT, 0.4))
    result = JobResult(id=1, kind=JobKind.PLAN, drive="a route", ok=True, values=values)
    topics = Topics(ROBOT)
    list(topics.tell(TICKS[0], 0))
    tick = changed(TICKS[1], sensed=replace(TICKS[1].snapshot.sensed, results=(result,)))
    content = {said.topic.name: said.content for said in topics.tell(tick, 0)}
    assert content["path"]["header"]["frame_id"] == "map"
    places = [pose["pose"]["position"] for pose in content["path"]["poses"]]
    assert [places[0], places[-1]] == [{"x": 0.0, "y": 0.0}, {"x": 1.0, "y": 0.0}]
    assert content["goal"] == content["path"]["poses"][-1]


def test_battery_scans_and_paths_are_told() -> None:
    route = route_from_csv((MISSIONS / "paths/straight.csv").read_text(), "straight.csv")
    mounting = {"plugin": "lms1xx", "x_m": 0.6, "y_m": 0.0, "heading_deg": 0.0, "height_m": 0.3, "least_range_m": 0.5}
    body = {"front_m": 0.8, "rear_m": 0.3, "half_width_m": 0.4}
    data = {**ROBOT.model_dump(), "scanners": {"front": mounting}, "outline": body}
    robot = RobotFile.model_validate(data)
    topics = Topics(robot, {0: route})
    scan = Scan(source="front", time=-0.5, start_angle=-1.0, increment=1.0, ranges=bytes((232, 3, 0, 0, 208, 7)))
    tick = changed(TICKS[0], sensed=replace(TICKS[0].snapshot.sensed, scans=(scan,), battery_v=24.5))
    content = {said.topic.name: said.content for said in topics.tell(tick, 5 * SECOND)}
    assert content["battery"]["voltage"] == 24.5
    assert content["scan"]["header"] == {"stamp": {"sec": 4, "nanosec": SECOND // 2}, "frame_id": "front"}
    assert (content["scan"]["angle_max"], list(content["scan"]["ranges"])) == (1.0, [1.0, 0.0, 2.0])
    assert content["goal"] == content["path"]["poses"][-1]
    again = [said for number, tick in enumerate(TICKS[1:120]) for said in topics.tell(tick, number * SECOND)]
    assert "path" not in {said.topic.name for said in again}
    goals = [said for said in again if said.topic.name == "goal"]
    assert [said.content["header"]["stamp"]["sec"] for said in goals] == [49, 99], "for who comes later"
    assert [said.content["pose"] for said in goals] == 2 * [content["goal"]["pose"]]
    assert not goals[0].topic.latched
    over = replace(TICKS[150], position=replace(TICKS[150].position, step=1))
    (path,) = [said.content for said in topics.tell(over, 0) if said.topic.name == "path"]
    assert path["poses"] == []
    later = [replace(tick, position=over.position) for tick in TICKS[151:300]]
    assert "goal" not in {said.topic.name for tick in later for said in topics.tell(tick, 0)}
    (fixed,) = topics.begin(0)
    assert [part["child_frame_id"] for part in fixed.content["transforms"]] == [
        "rear_left_wheel",
        "rear_right_wheel",
        "front",
    ]


def test_a_battery_is_told_as_far_as_it_is_known() -> None:
    robot = load_model(MISSIONS / "robots/artemis_battery.yaml", RobotFile)
    assert robot.battery is not None
    capacity = robot.battery.capacity_ah
    sensed = replace(TICKS[0].snapshot.sensed, battery_v=24.0)
    known = BatteryState(volts=24.1, charge=0.75, charge_std=0.1, watts=48.0)

    def battery(robot: RobotFile, known: BatteryState | None) -> Content:
        return told(changed(TICKS[0], sensed=sensed, battery=known), robot)["battery"]

    whole = battery(robot, known)
    assert (whole["voltage"], whole["percentage"], whole["current"]) == (24.0, 0.75, -2.0)
    assert (whole["charge"], whole["capacity"], whole["present"]) == (0.75 * capacity, capacity, True)
    names = ("percentage", "current", "charge", "temperature", "design_capacity")
    assert all(math.isnan(battery(robot, None)[name]) for name in names)
    assert all(math.isnan(battery(ROBOT, None)[name]) for name in (*names, "capacity"))
    pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")
    for types in (Ros1Types(), Ros2Types("jazzy")):
        types.prepare("sensor_msgs/msg/BatteryState")
        message = types.unpack("sensor_msgs/msg/BatteryState", types.pack("sensor_msgs/msg/BatteryState", whole))
        assert (message.percentage, message.current) == (0.75, -2.0)  # type: ignore[attr-defined]


def test_a_map_is_told_where_it_is_another_one_with_the_frame_of_the_odometry_on_it() -> None:
    cells = np.array([[-1, 0, 100], [0, 0, 100]], np.int8)
    content = OccupancyMap(cells=cells, resolution=0.05, origin=(-1.0, 2.0, 0.0))
    maps: list[ShownMap | None] = [None, None, ShownMap(content=content, odometry=Pose(x=0.5))]
    topics = Topics(ROBOT, map=lambda: maps.pop(0) if len(maps) > 1 else maps[0])
    grids = [said for tick in TICKS[:150] for said in topics.tell(tick, SECOND) if said.topic.name == "map"]
    (grid,) = grids
    assert (grid.topic.type, grid.topic.latched) == ("nav_msgs/msg/OccupancyGrid", True)
    about = grid.content["info"]
    assert grid.content["header"]["frame_id"] == "map"
    assert (about["resolution"], about["width"], about["height"]) == (0.05, 3, 2)
    assert (about["origin"]["position"], about["origin"]["orientation"]["w"]) == ({"x": -1.0, "y": 2.0}, 1.0)
    assert list(grid.content["data"]) == [-1, 0, 100, 0, 0, 100]
    moved = {said.topic.name: said.content for said in topics.tell(TICKS[150], 0)}["/tf"]["transforms"]
    assert [(each["header"]["frame_id"], each["child_frame_id"]) for each in moved] == [
        ("map", "odom"),
        ("odom", "base_link"),
    ]
    assert moved[0]["transform"]["translation"]["x"] == 0.5


def test_a_map_that_is_known_before_the_run_is_told_at_its_beginning() -> None:
    known = ShownMap(content=OccupancyMap(cells=np.zeros((2, 2), np.int8), resolution=0.1, origin=(0.0, 0.0, 0.0)))
    topics = Topics(ROBOT, transforms=False, map=lambda: known)
    assert [said.topic.name for said in topics.begin(0)] == ["map"]
    assert "map" not in {said.topic.name for said in topics.tell(TICKS[0], 0)}


def test_stamps_are_the_least_late_and_follow_a_clock_that_is_set() -> None:
    times = iter([100.5, 101.2, 102.9, 503.0])
    stamps = Stamps(lambda: datetime.fromtimestamp(next(times), UTC))
    found = [stamps.stamp(time) / SECOND for time in (0.0, 1.0, 2.0, 3.0)]
    assert found == pytest.approx([100.5, 101.2, 102.20001, 503.0])
