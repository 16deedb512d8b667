"""Drives in which another program has left its own settings: what of them artemis takes back, and what it keeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import CALIBRATE, Rig, robot_text, write_mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission

FORWARD: dict[str, Any] = {"follow": {"path": "path.csv", "follower": {"plugin": "frenet", "speed_m_s": 0.3}}}
PATH = {"path.csv": "0,0\n0.3,0\n0.6,0\n0.9,0\n"}
ENCODER_TYPE, STRUCTURE, POLARITY = (0x3010, 2), (0x3000, 2), (0x3000, 4)
OBSERVER, LOW_PASS = 0x20, 0x10
"""Second digit of the control structure."""


def brought_up(
    folder: Path,
    robot: str,
    found: dict[tuple[int, int], int],
    node: str,
    drive_words: dict[str, Any] | None = None,
    steps: tuple[dict[str, Any], ...] = (CALIBRATE, {"wait": {"seconds": 1.0}}),
) -> Rig:
    """A run in which a drive has had these objects since before, described with these words of the robot file."""
    mission = write_mission(folder, [*steps], PATH, robot=robot)
    if drive_words is not None:
        file = mission.with_name("artemis.yaml")
        words = yaml.safe_load(file.read_text())
        kept = {**words["drives"][node], **drive_words}
        words["drives"][node] = {key: value for key, value in kept.items() if value is not None}
        file.write_text(yaml.safe_dump(words, sort_keys=False))
    rig = Rig(mission)

    def leave() -> None:
        for (index, sub), value in found.items():
            rig.drive(node).poke(index, sub, value)

    return rig.at(0.0, leave)


@pytest.mark.parametrize(
    ("robot", "node", "index", "offset"),
    [
        ("artemis_epos4.yaml", "traction-left", 0x60B1, 200),
        ("artemis_epos4.yaml", "traction-left", 0x60B1, 1000),
        ("artemis_epos4.yaml", "steer-left", 0x60B0, 20000),
        ("artemis_epos4.yaml", "steer-right", 0x60B2, -50),
        ("artemis_cia402.yaml", "steer-left", 0x60B0, 20000),
    ],
)
def test_offsets_that_another_program_left_move_nothing(
    tmp_path: Path, robot: str, node: str, index: int, offset: int
) -> None:
    rig = brought_up(tmp_path, robot, {(index, 0): offset}, node)

    run = rig.run()

    assert (run.status, run.fault_ids) == (0, [])
    assert rig.drive(node).read(index, 0) == 0
    assert max(abs(seen.pose.x) for seen in run.seen) < 0.01, "wheels that are turned straight roll a little"


def test_what_is_no_business_of_artemis_stays_in_an_epos4(tmp_path: Path) -> None:
    """How its encoder counts, and the structure of its velocity regulator, without gains in the robot file."""
    found = {ENCODER_TYPE: 0x0210 | 1, STRUCTURE: 0x10101 | OBSERVER, POLARITY: 1}
    rig = brought_up(tmp_path, "artemis_epos4.yaml", found, "traction-left", {"si_gains": None})

    assert rig.run().status == 0

    drive = rig.drive("traction-left")
    assert int(drive.read(*ENCODER_TYPE)) & 0x0210 == 0x0210
    assert int(drive.read(*STRUCTURE)) & 0xF0 == OBSERVER
    assert drive.read(*POLARITY) == 0, "which way a wheel turns, `mirrored` says"


SI_GAINS = {"current": [1.171880, 3906.250], "velocity": [0.02, 0.5], "position": [1.5, 10.0, 0.02]}


@pytest.mark.parametrize(("observer", "structure"), [(True, OBSERVER), (False, LOW_PASS), (None, LOW_PASS)])
def test_gains_of_the_robot_file_bring_the_structure_that_they_are_for(
    tmp_path: Path, observer: bool | None, structure: int
) -> None:
    gains = SI_GAINS if observer is None else {**SI_GAINS, "observer": observer}
    before = 0x10101 | (LOW_PASS + OBSERVER - structure)
    rig = brought_up(tmp_path, "artemis_epos4.yaml", {STRUCTURE: before}, "traction-left", {"si_gains": gains})

    assert rig.run().status == 0

    assert int(rig.drive("traction-left").read(*STRUCTURE)) & 0xF0 == structure


@pytest.mark.parametrize(
    ("robot", "place", "bit"), [("artemis_epos4.yaml", ENCODER_TYPE, 0x10), ("artemis.yaml", (0x2210, 4), 0x01)]
)
@pytest.mark.parametrize("inverted", [True, False])
def test_the_robot_file_may_say_that_an_encoder_counts_against_its_motor(
    tmp_path: Path, robot: str, place: tuple[int, int], bit: int, inverted: bool
) -> None:
    sensor = {**yaml.safe_load(robot_text(robot))["drives"]["steer-left"]["sensor"], "inverted": inverted}
    rig = brought_up(tmp_path, robot, {place: 0 if inverted else bit}, "steer-left", {"sensor": sensor})

    assert rig.run().status == 0

    assert int(rig.drive("steer-left").read(*place)) & bit == (bit if inverted else 0)


def test_an_epos4_that_takes_each_set_point_at_once_drives_and_misses_none(tmp_path: Path) -> None:
    robot, steps = "artemis_epos4.yaml", (CALIBRATE, FORWARD)
    rig = brought_up(tmp_path, robot, {}, "traction-left", {"interpolation": False}, steps)

    run = rig.run()

    assert (run.status, run.fault_ids) == (0, [])
    assert rig.drive("traction-left").read(0x60C2, 1) == 0
    assert run.seen[-1].pose.x == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize(
    ("robot", "words", "problem"),
    [
        ("artemis.yaml", {"interpolation": False}, "not for this drive"),
        ("artemis_cia402.yaml", {"interpolation": False}, "interpolation_period: false"),
        ("artemis_cia402.yaml", {"sensor": {"type": "encoder_3_channel", "counts_per_turn": 2000, "inverted": True}},
         "not for this drive"),
        ("artemis_epos4.yaml", {"sensor": {"type": "hall", "counts_per_turn": 48, "inverted": True}}, "halls"),
    ],
)  # fmt: skip
def test_words_that_a_drive_does_not_know_are_refused(
    tmp_path: Path, robot: str, words: dict[str, Any], problem: str
) -> None:
    mission = write_mission(tmp_path, [CALIBRATE], robot=robot)
    file = mission.with_name("artemis.yaml")
    written = yaml.safe_load(file.read_text())
    written["drives"]["traction-left"] |= words
    file.write_text(yaml.safe_dump(written, sort_keys=False))

    with pytest.raises(ConfigError, match=problem):
        load_mission(mission)


@pytest.mark.parametrize("robot", ["artemis_epos4.yaml", "artemis_absolute.yaml"])
def test_the_robot_files_of_epos4_keep_no_direction_that_another_program_left_in_an_encoder(
    tmp_path: Path, robot: str
) -> None:
    align = {"calibrate": {"steering": "align"}}
    rig = brought_up(tmp_path, robot, {ENCODER_TYPE: 0x0010 | 1}, "steer-left", steps=(align,))

    assert rig.run().status == 0

    assert int(rig.drive("steer-left").read(*ENCODER_TYPE)) & 0x10 == 0


CIA402 = "artemis_cia402.yaml"
PROFILE_VELOCITY, CYCLIC_VELOCITY = 3, 9
INVERSE = 0xC0
"""Both bits of 0x607E: of positions and of velocities."""


def words_of(node: str, **changes: object) -> dict[str, Any]:
    """The words of a CiA 402 drive, with changes to its `cia402`."""
    known = yaml.safe_load(robot_text(CIA402))["drives"][node]["cia402"]
    return {"cia402": {**known, **changes}}


@pytest.mark.parametrize("mode", [PROFILE_VELOCITY, CYCLIC_VELOCITY])
@pytest.mark.parametrize(("index", "left"), [(0x607E, INVERSE), (0x607E, 0x40), (0x60B0, 50), (0x60B1, 50)])
def test_what_turns_a_cia402_drive_around_or_adds_to_its_set_points_is_cleared_in_every_mode(
    tmp_path: Path, mode: int, index: int, left: int
) -> None:
    words = words_of("traction-left", operating_mode=mode)
    rig = brought_up(tmp_path, CIA402, {(index, 0): left}, "traction-left", words)

    run = rig.run()

    assert (run.status, run.fault_ids) == (0, [])
    assert rig.drive("traction-left").read(index, 0) == 0


def test_the_polarity_that_the_robot_file_says_is_kept(tmp_path: Path) -> None:
    setting = {"index": 0x607E, "type": "u8", "value": INVERSE}
    rig = brought_up(tmp_path, CIA402, {}, "steer-left", words_of("steer-left", settings=[setting]))

    assert rig.run().status == 0

    assert rig.drive("steer-left").read(0x607E, 0) == INVERSE


@pytest.mark.parametrize("index", [0x60B0, 0x60B1, 0x60B2])
def test_offsets_are_no_settings(tmp_path: Path, index: int) -> None:
    words = words_of("steer-left", settings=[{"index": index, "type": "i32", "value": 5}])

    with pytest.raises(ConfigError, match=f"0x{index:04X}:0 is written by artemis"):
        brought_up(tmp_path, CIA402, {}, "steer-left", words)
