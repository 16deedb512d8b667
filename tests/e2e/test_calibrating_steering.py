"""`artemis calibrate steering`: at the terminal and without anybody there, into the drives and the robot file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import ROBOT, artemis_here, only_run, write_mission
from pseudo_terminal import Terminal, terminal

from artemis.commands import calibrate_steering
from artemis.errors import ConfigError

HIDDEN = "simulation: {true_robot: {steering_zero_left_deg: 0.8, steering_zero_right_deg: -1.3}}\n"
ALONE = ("--reference-left", "0.8", "--reference-right", "-1.3", "--yes")
OLD = "left: {zero_v: [2.51, 2.48], slope_deg_per_v: [72.0, -72.0]}"


def robot_file(folder: Path) -> str:
    return (folder / "robots" / "artemis.yaml").read_text(encoding="utf-8")


def read(screen: Terminal, words: str) -> None:
    """A person reads for some time what stands there; the line changes ten times a second."""
    for _ in range(8):
        screen.see(words)


@pytest.mark.slow
def test_without_anybody_there_the_robot_file_gets_the_result_and_keeps_its_comments(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=HIDDEN)

    done = artemis_here("calibrate", "steering", mission, *ALONE, "--write-simulated")

    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads((only_run(tmp_path) / "calibration.json").read_text())["steering"]
    before, after = ROBOT.read_text(encoding="utf-8").splitlines(), robot_file(tmp_path).splitlines()
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert [new for _, new in changed] == [
        f"    {side}: {{zero_v: {found[side]['zero_v']}, slope_deg_per_v: {found[side]['slope_deg_per_v']}}}"
        for side in ("left", "right")
    ]
    assert found["left"]["zero_v"] == pytest.approx([2.51 - 0.8 / 72, 2.48 + 0.8 / 72], abs=5e-4)
    assert "steer-left keeps the new values" in done.stdout
    assert f"changed: {tmp_path}/robots/artemis.yaml" in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mission.yaml", "paths", "robots", "runs"]
    assert artemis_here("replay", only_run(tmp_path)).returncode == 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("bus", ["simulation", "{interface: udp_multicast, channel: 239.74.163.2}"])
def test_simulated_drives_do_not_change_the_robot_file_by_themselves(tmp_path: Path, bus: str) -> None:
    mission = write_mission(tmp_path, bus=bus, more=HIDDEN)

    done = artemis_here("calibrate", "steering", mission, "--side", "left", "--reference-left=0", "--yes", "--simulate")

    assert done.returncode == 0, done.stdout + done.stderr
    assert f"not changed by simulated drives (--write-simulated does): {tmp_path}/robots/artemis.yaml" in done.stdout
    assert robot_file(tmp_path) == ROBOT.read_text(encoding="utf-8")


@pytest.mark.exhaustive
def test_a_robot_file_that_cannot_be_changed_is_told_with_where_the_values_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise ConfigError("artemis.yaml: cannot be written: No space left on device")

    monkeypatch.setattr(calibrate_steering, "edit", refuse)

    mission = write_mission(tmp_path)
    done = artemis_here(
        "calibrate", "steering", mission, "--side", "left", "--reference-left=0.8", "--yes", "--write-simulated"
    )

    assert done.returncode == 1
    assert "steer-left keeps the new values" in done.stdout
    assert "NOT changed: artemis.yaml: cannot be written" in done.stdout
    assert f"the values are in {only_run(tmp_path)}/calibration.json" in done.stdout


@pytest.mark.exhaustive
@pytest.mark.parametrize("meanwhile", ["changed", "locked"])
def test_a_robot_file_that_somebody_else_touched_meanwhile_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, meanwhile: str
) -> None:
    mission, file = write_mission(tmp_path), tmp_path / "robots" / "artemis.yaml"

    def touch(*_: object) -> None:
        if meanwhile == "locked":
            file.chmod(0o444)
        elif not file.read_text().endswith("# mine\n"):
            file.write_text(file.read_text() + "# mine\n")

    monkeypatch.setattr(calibrate_steering._Kept, "see", touch)
    options = ("--side", "left", "--reference-left=0.8", "--yes", "--write-simulated")
    done = artemis_here("calibrate", "steering", mission, *options)

    assert done.returncode == 1
    why = {"changed": "it was changed by another program meanwhile", "locked": "is read-only"}[meanwhile]
    assert f"NOT changed: {file}: {why}; the values are in" in done.stdout
    assert file.read_text().removesuffix("# mine\n") == ROBOT.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "a person at a terminal is needed, or --page, or --reference-left, --reference-right, --yes"),
        (("--yes", "--reference-left=0"), "a person at a terminal is needed, or --page, or --reference-right"),
        (("--side", "up"), "--side up: write left or right"),
        (("--side", "left", "--reference-right=1"), "--reference-right is of a wheel that is not measured"),
        (("--side", "left", "--reference-left=1", "--new", "--yes"), "both wheels are measured"),
        (("--store", "--yes"), "--store writes what the robot file says"),
        (
            ("--reference-left=6", "--reference-right=0", "--yes"),
            "reference_deg.left is 6: a zero that is wrong by more",
        ),
        (("--reference-left=90", "--reference-right=0", "--yes"), "Invalid value for '--reference-left'"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_moves(
    tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    mission = write_mission(tmp_path)

    done = artemis_here("calibrate", "steering", mission, *options)

    assert done.returncode == 2
    assert words in done.stderr
    assert not (tmp_path / "runs").exists()
    assert not list(tmp_path.glob("calibrate-*"))


def test_drives_are_given_what_the_robot_file_says(tmp_path: Path) -> None:
    done = artemis_here("calibrate", "steering", write_mission(tmp_path), "--store")

    assert done.returncode == 0, done.stdout + done.stderr
    assert "steer-right keeps the robot file's values" in done.stdout
    assert not (tmp_path / "runs").exists(), "nothing moves for that"
    assert robot_file(tmp_path) == ROBOT.read_text(encoding="utf-8")


@pytest.mark.exhaustive
@pytest.mark.realtime
def test_a_person_turns_a_wheel_straight_reads_the_result_and_says_yes(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=HIDDEN)
    with terminal(mission, command=("calibrate", "steering", "--side", "left", "--write-simulated")) as screen:
        screen.see(r"left wheel at [+-]0\.0 deg")
        screen.press(b"-")
        screen.see(r"left wheel at -1\.0 deg")
        for number in (9, 8):
            screen.press(b".")
            screen.see(rf"left wheel at -0\.{number} deg")
        read(screen, r"left wheel at -0\.8 deg")
        screen.press(b"\n")
        read(screen, "keep clear, the wheels turn to both sides now")
        screen.press(b"\n")
        read(screen, "keep this in the drives and the robot file")
        screen.press(b"\n")
        assert screen.end() == 0
    assert f"changed: {tmp_path}/robots/artemis.yaml" in screen.everything
    assert OLD not in robot_file(tmp_path)


@pytest.mark.exhaustive
@pytest.mark.realtime
def test_who_aborts_changes_nothing(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=HIDDEN)
    with terminal(mission, command=("calibrate", "steering", "--side", "left")) as screen:
        screen.see(r"left wheel at [+-]0\.0 deg")
        screen.press(b"+")
        screen.see(r"left wheel at \+1\.0 deg")
        screen.press(b"q")
        assert screen.end() == 1
    assert "no drive was written to" in screen.everything
    assert robot_file(tmp_path) == ROBOT.read_text(encoding="utf-8")
