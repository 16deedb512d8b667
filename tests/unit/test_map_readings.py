"""Scans become readings of a mapper: where the odometry was, how the scanner is mounted, what it sees of the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from core_builders import ROBOT, drives, snapshot
from office import OFFICE

from artemis.errors import ConfigError
from artemis.mapping.graph_file import MapGraph, read_graph
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import FREE, OccupancyMap, occupancy
from artemis.mapping.pose_graph import PoseGraph
from artemis.mapping.readings import ScanReadings
from artemis.mapping.recent_odometry import KEPT
from artemis.mapping.se2 import Array, compose
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Mode, Odometry, Pose, SetPoints, Tick, Wish
from artemis.vehicle import RobotFile
from artemis_lab.bench.laser_worlds import ANGLES, SETTINGS, driven, seen

PERIOD = 0.02


def mounted(x: float = 0.0, y: float = 0.0, degrees: float = 0.0, **keys: object) -> Mounting:
    words = {"plugin": "lms1xx", "x_m": x, "y_m": y, "heading_deg": degrees, "height_m": 0.3, "least_range_m": 0.05}
    return Mounting.model_validate(words | keys)


def robot_with(scanner: str, **keys: float) -> RobotFile:
    """A robot with one scanner, above its rear axle if nothing else is said."""
    return ROBOT.model_copy(update={"scanners": {scanner: mounted(**keys)}})


def scan_of(ranges: Array, time: float, beam_time: float = 0.0, source: str = "front") -> Scan:
    return Scan(
        source=source,
        time=time,
        beam_time=beam_time,
        start_angle=float(ANGLES[0]),
        increment=float(ANGLES[1] - ANGLES[0]),
        ranges=(1000 * ranges).round().astype("<u2").tobytes(),
    )


def tick(time: float, pose: Array, *scans: Scan, reset: bool = False, age: float = 0.0) -> Tick:
    """A tick at which the wheels' positions are so old [s]."""
    x, y, heading = pose.tolist()
    odometry = Odometry(pose=Pose(x=x, y=y, heading=heading))
    seen = snapshot(time, odometry=odometry, scans=scans, drives=drives(age=age))
    return Tick(snapshot=seen, mode=Mode.TELEOP, wish=Wish(reset_pose=reset), set_points=SetPoints())


def points(reading: Reading) -> Array:
    assert reading.points is not None
    return reading.points


def one(readings: ScanReadings, *ticks: Tick) -> Reading:
    (found,) = [reading for each in ticks for reading in readings.see(each)]
    return found


def test_a_scan_is_turned_back_by_what_the_robot_turned_while_it_lasted() -> None:
    """A robot on the spot turns by 1 rad/s while its scanner needs 40 ms: ignored, bearings err by 2.3 degrees."""
    lasting, rate = 0.04, 1.0
    share = np.arange(len(ANGLES)) / (len(ANGLES) - 1)
    ranges = np.array(
        [
            seen(OFFICE, np.array([0.0, 0.0, rate * lasting * (part - 0.5)]), ANGLES[k : k + 1])[0]
            for k, part in enumerate(share)
        ]
    )
    scan = scan_of(ranges, 1.0, lasting / (len(ANGLES) - 1))
    before = [tick(PERIOD * k, np.array([0.0, 0.0, rate * (PERIOD * k - 1.02)])) for k in range(60)]
    reading = one(ScanReadings(SETTINGS, ROBOT, "front", mounted()), *before, tick(1.2, np.array([0, 0, 0.18]), scan))
    assert reading.odometry == pytest.approx([0, 0, 0], abs=1e-9)
    assert reading.time == pytest.approx(1.02)
    at_once = seen(OFFICE, np.zeros(3), np.arctan2(points(reading)[:, 1], points(reading)[:, 0]))
    assert np.abs(np.hypot(*points(reading)[:, :2].T) - at_once).max() < 0.002


def test_a_scanner_may_be_mounted_anywhere_also_upside_down() -> None:
    """Its angles count as seen from above in any case, so both see the same."""
    robot = np.array([0.5, 0.3, 0.2])
    for upside_down in (False, True):
        mounting = mounted(0.4, -0.1, 30.0, upside_down=upside_down)
        ranges = seen(OFFICE, compose(robot, [0.4, -0.1, np.radians(30.0)]))
        reading = one(ScanReadings(SETTINGS, ROBOT, "front", mounting), tick(0.0, robot, scan_of(ranges, 0.0)))
        ahead = points(reading)[np.abs(np.arctan2(points(reading)[:, 1], points(reading)[:, 0])).argmin()]
        assert np.hypot(*ahead[:2]) == pytest.approx(
            seen(OFFICE, robot, np.arctan2(ahead[1:2], ahead[:1]))[0], abs=0.01
        )


def test_what_a_scanner_sees_of_its_robot_is_no_wall() -> None:
    ranges = np.full(len(ANGLES), 3.0)
    ranges[:10], ranges[60:70] = 0.3, 0.04
    everything = one(ScanReadings(SETTINGS, ROBOT, "front", mounted()), tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))
    hidden = mounted(mask=[[-135, -120]], least_range_m=0.1)
    masked = one(ScanReadings(SETTINGS, ROBOT, "front", hidden), tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))
    assert np.hypot(*points(everything)[:, :2].T).min() < 0.5
    assert np.hypot(*points(masked)[:, :2].T).min() > 2.9


def test_another_origin_of_the_odometry_is_no_motion() -> None:
    readings = ScanReadings(SETTINGS, ROBOT, "front", mounted())
    ranges = seen(OFFICE, np.zeros(3))
    moved, origin = np.array([1.0, 2.0, 0.5]), np.zeros(3)
    first = one(readings, tick(0.0, moved, scan_of(ranges, 0.0)), tick(PERIOD, moved, reset=True))
    second = one(readings, tick(2 * PERIOD, origin), tick(3 * PERIOD, origin, scan_of(ranges, 3 * PERIOD)))
    third = one(readings, tick(4 * PERIOD, np.array([1.0, 0.0, 0.0]), scan_of(ranges, 4 * PERIOD)))
    assert first.odometry == pytest.approx(moved)
    assert second.odometry == pytest.approx(moved)
    assert third.odometry == pytest.approx(compose(moved, [1.0, 0.0, 0.0]))


def test_scans_of_another_scanner_are_passed_over() -> None:
    readings, ranges = ScanReadings(SETTINGS, ROBOT, "rear", mounted()), np.ones(len(ANGLES))
    assert list(readings.see(tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))) == []
    assert len(list(readings.see(tick(0.1, np.zeros(3), scan_of(ranges, 0.1, source="rear"))))) == 1


def test_before_the_first_tick_the_odometry_is_that_of_the_first() -> None:
    ranges = np.ones(len(ANGLES))
    for time, expected in ((-1.0, 1.0), (0.5, 1.5), (1.0, 2.0)):
        readings = ScanReadings(SETTINGS, ROBOT, "front", mounted())
        first, second = tick(0.0, np.array([1.0, 0, 0])), tick(1.0, np.array([2.0, 0, 0]), scan_of(ranges, time))
        odometry = one(readings, first, second).odometry
        assert odometry is not None
        assert odometry[0] == pytest.approx(expected)


def test_the_odometry_counts_at_the_time_at_which_the_drives_measured_it() -> None:
    """At 1 m/s, 20 ms before the tick: 2 cm. A scan whose end it does not reach waits for the next tick."""
    readings, speed = ScanReadings(SETTINGS, ROBOT, "front", mounted()), 1.0
    scan = scan_of(np.ones(len(ANGLES)), 10 * PERIOD)
    found = []
    for number in range(13):
        age = PERIOD if number else 0.0
        true = np.array([speed * (PERIOD * number - age), 0.0, 0.0])
        seen = readings.see(tick(PERIOD * number, true, *[scan] * (number == 10), age=age))
        found += [(number, each.odometry) for each in seen]
    ((number, odometry),) = found
    assert number == 11
    assert odometry is not None
    assert odometry[0] == pytest.approx(speed * 10 * PERIOD)


def test_a_scan_of_the_future_holds_up_no_others_for_ever() -> None:
    readings, ranges = ScanReadings(SETTINGS, ROBOT, "front", mounted()), np.ones(len(ANGLES))
    times = [PERIOD * number for number in range(2 * KEPT)]
    scans = [scan_of(ranges, 1e9 if number == 3 else time) for number, time in enumerate(times)]
    found = [r for time, scan in zip(times, scans, strict=True) for r in readings.see(tick(time, np.zeros(3), scan))]
    assert found[-1].time == pytest.approx(times[-1])
    assert len(found) == len(times) - 1


def free_inside(
    content: OccupancyMap, world_pose: Array, corner: tuple[float, float], size: tuple[float, float]
) -> int:
    """Cells, 5 cm or more inside of a box of the world, that are free on a map which begins at a pose in the world."""
    row, column = np.indices(content.cells.shape)
    x, y, _ = content.origin
    local = np.stack([x + (column + 0.5) * content.resolution, y + (row + 0.5) * content.resolution, 0.0 * row], -1)
    px, py = (compose(world_pose, local)[..., k] - corner[k] for k in (0, 1))
    inside = (px > 0.05) & (px < size[0] - 0.05) & (py > 0.05) & (py < size[1] - 0.05)
    return int((inside & (content.cells == FREE)).sum())


def test_no_cell_inside_of_a_solid_thing_is_free(tmp_path: Path) -> None:
    """The scanner sees past a corner that is between its robot's rear axle and what it sees. Also out of the file."""
    corner, size, place = (-3.5, -2.5), (1.2, 0.8), np.array([0.56, 0.0, 0.0])
    way = driven([(-4.0, -3.0), (-1.8, -3.0), (-1.8, -1.3), (-4.1, -1.2), (-4.1, -3.0)], step=0.1)
    robot = robot_with("front", x=place[0])
    readings, mapper = ScanReadings(SETTINGS, robot, "front"), Mapper(replace(SETTINGS, cells=1024))
    for number, pose in enumerate(way):
        scan = scan_of(seen(OFFICE, compose(pose, place)), 0.1 * number)
        for reading in readings.see(tick(0.1 * number, pose, scan)):
            mapper.add(reading)
    mapper.finish()
    file = tmp_path / "office.graph"
    file.write_bytes(mapper.result().packed())
    for keys in (mapper.keys, read_graph(file).keys):
        assert free_inside(occupancy(keys), way[0], corner, size) == 0
    keys.places[:] = 0.0
    assert free_inside(occupancy(keys), way[0], corner, size) > 50, "from the axle, beams would cross the box"


def test_a_graph_from_before_the_scanner_had_a_place_is_read(tmp_path: Path) -> None:
    keys = KeyScans()
    keys.append(np.ones((3, 4)), np.zeros(3), np.array([0.5, 0.1]))
    content = msgspec.msgpack.decode(MapGraph(keys, PoseGraph(), np.zeros((1, 4))).packed())
    assert content.pop("places")
    (tmp_path / "old.graph").write_bytes(msgspec.msgpack.encode(content))
    assert read_graph(tmp_path / "old.graph").keys.places.tolist() == [[0.0, 0.0]]
    content["places"] = bytes(8)
    (tmp_path / "cut.graph").write_bytes(msgspec.msgpack.encode(content))
    with pytest.raises(ConfigError, match=r"cut\.graph: is no pose graph"):
        read_graph(tmp_path / "cut.graph")
