"""How a scanner is mounted, by drives: fitted with its uncertainty, refused where a drive does not show it, written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from office import OFFICE
from test_map_readings import mounted, robot_with, scan_of, tick

from artemis.calibration.own_parts import own_parts
from artemis.calibration.scanner_drive import ScannerDrive, scanner_drive
from artemis.calibration.scanner_fit import fit_mounting
from artemis.commands import calibrate_scanner as command
from artemis.errors import CalibrationError, ConfigError
from artemis.mapping.se2 import Array, between, compose
from artemis.values import Tick
from artemis.yaml_edit import edit
from artemis.yaml_file import survey
from artemis_lab.bench.laser_worlds import ANGLES, seen

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml"
LOOPS = [(2.0, 0.0), (5.0, 7.8), (2.0, 0.0), (5.0, -7.8)] * 2
"""Lengths [m], and by how much each turns [rad]."""


def driven(pieces: list[tuple[float, float]], step: float = 0.06) -> Array:
    """Poses of the rear axle."""
    poses = [np.zeros(3)]
    for length, turn in pieces:
        count = round(length / step)
        bend = turn / count
        motion = np.array([step * np.cos(bend / 2), step * np.sin(bend / 2), bend])
        for _ in range(count):
            poses.append(compose(poses[-1], motion))
    return np.array(poses)


def counted(poses: Array, scale: float, bend: float) -> Array:
    """By wheels that count so much of the distance, and turn by so much for each metre."""
    found = [np.zeros(3)]
    for motion in between(poses[:-1], poses[1:]):
        found.append(compose(found[-1], motion * (scale, scale, 1.0) + (0.0, 0.0, bend * motion[0])))
    return np.array(found)


def noisy(poses: Array, seed: int) -> Array:
    dice = np.random.default_rng(seed)
    return poses + dice.normal(0.0, [0.002, 0.002, np.radians(0.05)], poses.shape)


@pytest.mark.parametrize("mounting", [(0.56, 0.0, 0.0), (0.3, -0.15, 90.0), (-0.1, 0.2, 178.0), (0.0, 0.0, -93.0)])
def test_the_mounting_is_found_within_its_interval_though_the_wheels_are_wrong(
    mounting: tuple[float, float, float],
) -> None:
    x, y, degrees = mounting
    true, known = driven(LOOPS), np.array([x, y, np.radians(degrees)])
    for seed in range(3):
        found = fit_mounting(counted(true, 0.98, 0.01), noisy(compose(true, known), seed))
        off = np.abs(between(known, found.mounting))
        assert np.all(np.abs(found.mounting[:2] - known[:2]) < found.half_width[:2])
        assert off[2] < found.half_width[2]
        assert np.all(found.half_width < [0.007, 0.007, np.radians(0.4)])
        assert found.odometry[0] == pytest.approx(1 / 0.98 - 1, abs=0.004)


def test_what_a_drive_does_not_show_is_refused_with_what_it_lacks() -> None:
    mounting = np.array([0.5, 0.1, 0.2])

    def refused(pieces: list[tuple[float, float]]) -> str:
        true = driven(pieces)
        with pytest.raises(CalibrationError) as raised:
            fit_mounting(true, noisy(compose(true, mounting), 1))
        return str(raised.value)

    straight = refused([(25.0, 0.05)])
    assert straight.startswith("x and y of the scanner are not observable on this drive: in 25.0 m it turned by 3 deg")
    assert "curves to both sides" in straight
    assert "not observable" in refused([(30.0, 40.0)])  # one circle, again and again
    assert "too short" in refused([(2.0, 0.0), (3.0, 4.0), (3.0, -4.0)])


def looked_around(mirrored: bool) -> ScannerDrive:
    """A scanner whose mounting nobody knows, in an office; its angles as of one that is the other way up, or not."""
    true = compose([-2.0, -3.0, 0.0], driven([(1.2, 0.0), (2.0, 2.2), (1.0, -1.5)]))
    place = np.array([0.3, 0.1, 0.5])
    ticks = []
    for number, pose in enumerate(true):
        beams = -ANGLES if mirrored else ANGLES
        scan = scan_of(seen(OFFICE, compose(pose, place), beams), 0.1 * number)
        ticks.append(tick(0.1 * number, pose, scan))
    return scanner_drive(ticks, robot_with("front"), "front")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_scanner_is_followed_by_its_scans_alone_whichever_way_up_it_is(mirrored: bool) -> None:
    drive = looked_around(mirrored)
    assert (drive.mirrored, drive.unmatched) == (mirrored, 0)
    first, last = (between(drive.odometry[0], drive.odometry[-1]), between(drive.scanner[0], drive.scanner[-1]))
    place = np.array([0.3, 0.1, 0.5])
    assert compose(place, last) == pytest.approx(compose(first, place), abs=0.02)


def test_a_robot_that_stands_shows_nothing() -> None:
    ticks = [tick(0.1 * k, np.zeros(3), scan_of(seen(OFFICE, np.zeros(3)), 0.1 * k)) for k in range(30)]
    with pytest.raises(CalibrationError, match="front: 1 scans while the robot moved"):
        scanner_drive(ticks, robot_with("front"), "front")


def test_old_and_new_values_are_told_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = mounted(0.56, 0.0, 179.0, mask=[[-10, 5], [90, 100]])
    true = driven(LOOPS)
    found = fit_mounting(true, noisy(compose(true, [0.6, -0.03, np.radians(-179.0)]), 1))
    drive = ScannerDrive(odometry=true, scanner=true, mirrored=True, unmatched=0)

    wanted = command.changes("front", old, old, drive, found)
    command.tell("front", old, drive, found, wanted)

    told = capsys.readouterr().out
    (heading,) = [line.split() for line in told.splitlines() if line.startswith("heading_deg")]
    assert float(heading[3]) == pytest.approx(2.0, abs=0.2)  # the shorter way around
    assert "upside_down          false      true" in told
    assert "mask        [[-10.0, 5.0], [90.0, 100.0]] becomes [[-100.0, -90.0], [-5.0, 10.0]]" in told
    robot = tmp_path / "robot.yaml"
    robot.write_bytes(ROBOT.read_bytes())
    edit(robot, wanted)
    data = survey(robot.read_bytes(), "")[0].data
    assert isinstance(data, dict)
    front = data["scanners"]["front"]  # type: ignore[index, call-overload]
    assert front["x_m"] == pytest.approx(0.6, abs=0.005)  # type: ignore[index, call-overload]
    assert front["upside_down"] is True  # type: ignore[index, call-overload]
    assert "# SICK LMS100 above the front axle" in robot.read_text()


ROUND = driven([(2.0, 7.0), (2.0, -1.0)])


def scanned(poses: Array, *, post: bool = True) -> list[Tick]:
    """Drives in an office, with a scanner before which a post of the robot stands, 4 degrees wide."""
    ticks = []
    for number, pose in enumerate(poses):
        ranges = seen(OFFICE, pose) + np.random.default_rng(number).normal(0.0, 0.012, len(ANGLES))
        if post:
            ranges[np.abs(np.degrees(ANGLES) - 70.0) <= 2.0] = 0.6
        ticks.append(tick(0.1 * number, pose, scan_of(ranges, 0.1 * number)))
    return ticks


def test_what_stays_the_same_wherever_the_robot_is_is_a_part_of_it() -> None:
    assert own_parts(scanned(ROUND), "front", ()) == ((68.0, 73.0),)
    assert own_parts(scanned(ROUND), "front", ((-90.0, -80.0), (68.0, 69.5))) == ((-90.0, -80.0), (68.0, 73.0))
    assert own_parts(scanned(ROUND), "front", ((60.0, 80.0),)) == ((60.0, 80.0),), "it is masked already"
    assert own_parts(scanned(ROUND, post=False), "front", ()) == ()


def test_walls_beside_a_straight_drive_are_no_part_of_the_robot() -> None:
    aisle = [tick(0.1 * k, np.array([0.06 * k, 0, 0]), scan_of(np.full(len(ANGLES), 0.6), 0.1 * k)) for k in range(50)]
    assert own_parts(aisle, "front", ()) == ()


def test_a_scanner_that_sees_too_much_of_the_robot_is_refused() -> None:
    ticks = [tick(0.1 * k, pose, scan_of(np.full(len(ANGLES), 0.6), 0.1 * k)) for k, pose in enumerate(ROUND)]
    with pytest.raises(CalibrationError, match=r"front: it sees the robot itself in \d+.* degrees"):
        own_parts(ticks, "front", ())


def test_a_mask_that_is_found_is_told_and_written() -> None:
    old = mounted(0.6, 0.0, 0.0)
    seeing = mounted(0.6, 0.0, 0.0, mask=[[67.0, 73.0]])
    true = driven(LOOPS)
    found = fit_mounting(true, noisy(compose(true, [0.6, 0.0, 0.0]), 1))
    for mirrored, mask in ((False, [[67.0, 73.0]]), (True, [[-73.0, -67.0]])):
        drive = ScannerDrive(odometry=true, scanner=true, mirrored=mirrored, unmatched=0)
        assert command.changes("front", old, seeing, drive, found)["scanners", "front", "mask"] == mask


def test_confirming_needs_a_file() -> None:
    with pytest.raises(ConfigError, match="say which robot file"):
        command.calibrate_scanner(Path("run"), None, None, yes=True)
