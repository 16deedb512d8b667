"""What a robot file asks of its drives fits into their objects, however fine their encoders are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from artemis.devices.epos_objects import PERIOD, Units, quantities, settings
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
AROUND = 0.766
"""Of a driven wheel [m]."""
Words = dict[str, Any]


def with_counts(words: Words, counts: int, role: str = "steering", gear: float | None = None) -> None:
    """Encoders of so many counts at the drives of a role."""
    for drive in words["drives"].values():
        if drive["role"] == role:
            drive["sensor"] = {"type": "encoder_3_channel", "counts_per_turn": counts}
            drive["motor"] = {**drive["motor"], "type": "ec_sine", "pole_pairs": 4}
            drive["gear_ratio"] = gear or drive["gear_ratio"]
            turn = counts * drive["gear_ratio"]
            if role == "steering":
                drive["following_error_counts"] = round(turn / 100)
            else:
                words["calibration"]["traction"][f"{drive['side']}_m_per_count"] = AROUND / turn


def read(folder: Path, robot: str, change: Callable[[Words], None]) -> RobotFile:
    """The robot file of another robot."""
    words = yaml.safe_load((ROBOTS / f"{robot}.yaml").read_text())
    change(words)
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(words, sort_keys=False))
    return load_model(path, RobotFile)


def refused(folder: Path, robot: str, change: Callable[[Words], None]) -> list[str]:
    """What is wrong with it, without its place in the file."""
    with pytest.raises(ConfigError) as found:
        read(folder, robot, change)
    return [problem.split(": ", 1)[1] for problem in found.value.problems]


@pytest.mark.parametrize(
    ("robot", "role", "counts"),
    [
        ("artemis", "steering", 30000),
        ("artemis_epos4", "steering", 4_000_000),
        ("artemis_epos4", "traction", 10_000_000),
        ("artemis_cia402", "steering", 1 << 22),
        ("artemis_cia402", "traction", 1 << 23),
    ],
)
def test_the_finest_encoder_that_a_family_takes_is_accepted(tmp_path: Path, robot: str, role: str, counts: int) -> None:
    described = read(tmp_path, robot, lambda words: with_counts(words, counts, role))
    for name, drive in described.drives.items():
        for object, value, _ in settings(described, drive, PERIOD):
            assert object.type.decode(object.type.encode(value)) == value
        if drive.role == role:
            assert quantities(described, drive, PERIOD)["counts"] == counts
            turn = counts * drive.gear_ratio
            wheel = AROUND if role == "traction" else 6.283185307
            assert abs(Units(described, drive).counts) == pytest.approx(turn / wheel, rel=1e-6), name


@pytest.mark.parametrize(
    ("robot", "counts", "text"),
    [
        ("artemis", 30004, "expected at most 30000, which is what EPOS takes of an encoder, found 30004"),
        (
            "artemis_epos4",
            10_000_004,
            "expected at most 10000000, which is what EPOS4 takes of an encoder, found 10000004",
        ),
        ("artemis_epos4", 2002, "expected four times the lines of an encoder (EPOS4), found 2002"),
    ],
)
def test_an_encoder_that_is_too_fine_for_the_family_is_refused(
    tmp_path: Path, robot: str, counts: int, text: str
) -> None:
    problems = refused(tmp_path, robot, lambda words: with_counts(words, counts))
    assert problems == [f"drives.steer-{side}.sensor.counts_per_turn: {text}" for side in ("left", "right")]


def test_a_steered_wheel_that_counts_beyond_32_bits_is_refused(tmp_path: Path) -> None:
    """Its set-points would overflow to the other end of the counter."""
    problems = refused(tmp_path, "artemis_cia402", lambda words: with_counts(words, 1 << 23))
    text = "from lock to lock, 129 degrees of the wheel, CiA 402 drive would count 2.839e+09 (gear_ratio 946); its"
    text += " positions have 32 bit: expected at most 6345567, found 8388608"
    assert problems == [f"drives.steer-{side}.sensor.counts_per_turn: {text}" for side in ("left", "right")]


def test_the_stops_of_a_steering_motor_are_counted_too(tmp_path: Path) -> None:
    def fine(words: Words) -> None:
        with_counts(words, 4_000_000, gear=1800)
        words["drives"]["steering"] |= {"family": "epos2", "hardware_version": 0x6220}
        words["calibration"]["steering"]["middle"]["travel_deg"] = 120.0
        words["limits"]["steering_rate_wheel_deg_s"] = 15.0

    (problem,) = refused(tmp_path, "small_car", fine)
    assert problem.startswith(
        "drives.steering.sensor.counts_per_turn: from lock to lock, 126 degrees of the wheel, EPOS2"
    )


def test_a_motor_that_passes_half_of_the_counter_between_messages_is_refused(tmp_path: Path) -> None:
    problems = refused(tmp_path, "artemis_cia402", lambda words: with_counts(words, 1 << 26, "traction"))
    text = "at 3190 rpm (max_speed_rpm) its 32-bit position counter would overflow in less than a second: expected"
    text += " at most 53855389, found 67108864"
    assert problems == [f"drives.traction-{side}.sensor.counts_per_turn: {text}" for side in ("left", "right")]


@pytest.mark.parametrize(
    ("key", "scale", "text"),
    [
        (
            "velocity_units_per_rpm",
            1e6,
            "2820 rpm would be 2819999966 units; 0x60FF, 0x606C and 0x607F hold 1 to 2147483647",
        ),
        ("velocity_units_per_rpm", 1e-6, "2820 rpm would be 0 units; 0x60FF, 0x606C and 0x607F hold 1 to 2147483647"),
        (
            "acceleration_units_per_rpm_s",
            1e6,
            "19583 rpm/s would be 19583333098 units; 0x6083 to 0x6085 hold 1 to 4294967295",
        ),
    ],
)
def test_units_in_which_a_speed_or_a_ramp_does_not_fit_are_refused(
    tmp_path: Path, key: str, scale: float, text: str
) -> None:
    def scaled(words: Words) -> None:
        for drive in words["drives"].values():
            if drive["role"] == "traction":
                drive["cia402"] = {**drive["cia402"], key: scale}

    problems = refused(tmp_path, "artemis_cia402", scaled)
    assert problems == [f"drives.traction-{side}.cia402.{key}: {text}" for side in ("left", "right")]


@pytest.mark.parametrize(
    ("absent", "problem"),
    [
        ([], "19583 rpm/s would be 19583333098 units"),
        ([0x6083, 0x6084], "5875 rpm/s would be"),
        ([0x6083, 0x6085], "19583 rpm/s would be 19583333098 units"),
        ([0x6083, 0x6084, 0x6085], ""),
    ],
)
def test_ramps_for_which_a_drive_has_no_object_need_not_fit(tmp_path: Path, absent: list[int], problem: str) -> None:
    def scaled(words: Words) -> None:
        for drive in words["drives"].values():
            if drive["role"] == "traction":
                drive["cia402"] = {**drive["cia402"], "acceleration_units_per_rpm_s": 1e6, "absent": absent}

    if not problem:
        read(tmp_path, "artemis_cia402", scaled)
        return
    assert all(problem in each for each in refused(tmp_path, "artemis_cia402", scaled))
