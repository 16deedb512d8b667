"""Scans become readings of a mapper: where the odometry was, how the scanner is mounted, what it sees of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from core_builders import snapshot

from artemis.mapping.laser import Reading
from artemis.mapping.readings import ScanReadings
from artemis.mapping.se2 import Array, compose
from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.values import Mode, Odometry, Pose, SetPoints, Tick, Wish
from artemis_lab.bench.laser_worlds import ANGLES, OFFICE, SETTINGS, seen

PERIOD = 0.02


def mounted(x: float = 0.0, y: float = 0.0, degrees: float = 0.0, **keys: object) -> Mounting:
    words = {"plugin": "lms1xx", "x_m": x, "y_m": y, "heading_deg": degrees, "height_m": 0.3, "least_range_m": 0.05}
    return Mounting.model_validate(words | keys)


def scan_of(ranges: Array, time: float, beam_time: float = 0.0, source: str = "front") -> Scan:
    return Scan(
        source=source,
        time=time,
        beam_time=beam_time,
        start_angle=float(ANGLES[0]),
        increment=float(ANGLES[1] - ANGLES[0]),
        ranges=(1000 * ranges).round().astype("<u2").tobytes(),
    )


def tick(time: float, pose: Array, *scans: Scan, reset: bool = False) -> Tick:
    x, y, heading = pose.tolist()
    seen = snapshot(time, odometry=Odometry(pose=Pose(x=x, y=y, heading=heading)), scans=scans)
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
    reading = one(ScanReadings(SETTINGS, "front", mounted()), *before, tick(1.2, np.array([0, 0, 0.18]), scan))
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
        reading = one(ScanReadings(SETTINGS, "front", mounting), tick(0.0, robot, scan_of(ranges, 0.0)))
        ahead = points(reading)[np.abs(np.arctan2(points(reading)[:, 1], points(reading)[:, 0])).argmin()]
        assert np.hypot(*ahead[:2]) == pytest.approx(
            seen(OFFICE, robot, np.arctan2(ahead[1:2], ahead[:1]))[0], abs=0.01
        )


def test_what_a_scanner_sees_of_its_robot_is_no_wall() -> None:
    ranges = np.full(len(ANGLES), 3.0)
    ranges[:10], ranges[60:70] = 0.3, 0.04
    everything = one(ScanReadings(SETTINGS, "front", mounted()), tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))
    hidden = mounted(mask=[[-135, -120]], least_range_m=0.1)
    masked = one(ScanReadings(SETTINGS, "front", hidden), tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))
    assert np.hypot(*points(everything)[:, :2].T).min() < 0.5
    assert np.hypot(*points(masked)[:, :2].T).min() > 2.9


def test_another_origin_of_the_odometry_is_no_motion() -> None:
    readings = ScanReadings(SETTINGS, "front", mounted())
    ranges = seen(OFFICE, np.zeros(3))
    moved, origin = np.array([1.0, 2.0, 0.5]), np.zeros(3)
    first = one(readings, tick(0.0, moved, scan_of(ranges, 0.0)), tick(PERIOD, moved, reset=True))
    second = one(readings, tick(2 * PERIOD, origin), tick(3 * PERIOD, origin, scan_of(ranges, 3 * PERIOD)))
    third = one(readings, tick(4 * PERIOD, np.array([1.0, 0.0, 0.0]), scan_of(ranges, 4 * PERIOD)))
    assert first.odometry == pytest.approx(moved)
    assert second.odometry == pytest.approx(moved)
    assert third.odometry == pytest.approx(compose(moved, [1.0, 0.0, 0.0]))


def test_scans_of_another_scanner_are_passed_over() -> None:
    readings, ranges = ScanReadings(SETTINGS, "rear", mounted()), np.ones(len(ANGLES))
    assert list(readings.see(tick(0.0, np.zeros(3), scan_of(ranges, 0.0)))) == []
    assert len(list(readings.see(tick(0.1, np.zeros(3), scan_of(ranges, 0.1, source="rear"))))) == 1


def test_of_a_time_nobody_counted_the_nearest_tick_counts() -> None:
    ranges = np.ones(len(ANGLES))
    for time, expected in ((-1.0, 1.0), (0.5, 1.5), (9.0, 2.0)):
        readings = ScanReadings(SETTINGS, "front", mounted())
        first, second = tick(0.0, np.array([1.0, 0, 0])), tick(1.0, np.array([2.0, 0, 0]), scan_of(ranges, time))
        odometry = one(readings, first, second).odometry
        assert odometry is not None
        assert odometry[0] == pytest.approx(expected)
