"""`artemis init`: asks, and leaves a robot and a mission that run at once."""

from __future__ import annotations

import io
import runpy
from pathlib import Path

import pytest
from command_line import ROBOT, artemis_here

from artemis import testing
from artemis.commands.init import LIKE, QUESTIONS
from artemis.mission.loading import load_mission, load_model
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

CART = ["", "Cart", "0.3", "0,25", "0.02", "0.2", "30", "800", "40", "0.6"]
TRACTOR = ["artemis", "Tractor", "1.2", "0,9", "", "0.4", "30", "800", "40", "0.9"]
FILES = {
    "first.yaml",
    "mission.schema.json",
    "paths/first.csv",
    "robot.schema.json",
    "robots/robot.yaml",
    "test_first.py",
}


def answer(monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{each}\n" for each in answers)))


def test_without_questions_the_machine_is_artemis(tmp_path: Path) -> None:
    done = artemis_here("init", "--yes", tmp_path / "new")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"artemis run {tmp_path}/new/first.yaml" in done.stdout
    made = {str(file.relative_to(tmp_path / "new")) for file in (tmp_path / "new").rglob("*") if file.is_file()}
    assert made == FILES
    written, known = load(tmp_path / "new/robots/robot.yaml").data, load(ROBOT).data
    assert isinstance(written, dict)
    assert isinstance(known, dict)
    assert written["drives"] == known["drives"]
    assert written["geometry"] == known["geometry"]
    robot, artemis = load_mission(tmp_path / "new/first.yaml").robot, load_model(ROBOT, RobotFile)
    assert robot.calibration.steering == artemis.calibration.steering
    assert robot.metres_per_count("left") == pytest.approx(artemis.metres_per_count("left"), rel=1e-4)
    for file in ("first.yaml", "robots/robot.yaml"):
        assert (tmp_path / "new" / file).read_text().startswith("# yaml-language-server: $schema=")


def test_test_of_the_first_mission_passes(tmp_path: Path) -> None:
    assert artemis_here("init", "--yes", tmp_path).returncode == 0
    names = runpy.run_path(str(tmp_path / "test_first.py"))
    names["test_first_mission_aligns_the_wheels_and_follows_its_path"]()


@pytest.mark.parametrize(
    ("answers", "wheelbase", "track", "diameter"),
    [(CART, 0.3, 0.25, 0.2), pytest.param(TRACTOR, 1.2, 0.9, 0.4, marks=pytest.mark.exhaustive)],  # five minutes' drive
)
def test_another_machine_runs_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    answers: list[str],
    wheelbase: float,
    track: float,
    diameter: float,
) -> None:
    answer(monkeypatch, *answers)
    assert artemis_here("init", tmp_path).returncode == 0
    robot = load_mission(tmp_path / "first.yaml").robot
    assert (robot.robot, robot.geometry.wheelbase_m, robot.geometry.track_m) == (answers[1], wheelbase, track)
    assert robot.metres_per_count("left") * 72 * 30 == pytest.approx(diameter * 3.14159265, rel=1e-6)
    assert {drive.gear_ratio for drive in robot.drives.values()} == {30, 800}
    assert "47 counts" not in (tmp_path / "robots/robot.yaml").read_text()
    done = artemis_here("run", tmp_path / "first.yaml")
    assert done.returncode == 0, done.stderr
    assert "result        done" in done.stdout


def test_answers_that_no_machine_has_are_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer(monkeypatch, "tricycl", "artemis", "Tractor", "560", "much", "0.56", *TRACTOR[3:])
    done = artemis_here("init", tmp_path)
    assert done.returncode == 0
    assert "'tricycl': expected one of these: nearest is 'tricycle', there are artemis, epos4, cia402," in done.stdout
    assert "'560': expected 0.1 to 10 m" in done.stdout
    assert "'much': expected a number in m" in done.stdout
    assert load_mission(tmp_path / "first.yaml").robot.geometry.wheelbase_m == 0.56


@pytest.mark.parametrize(
    ("answers", "problem"),
    [
        (TRACTOR[:4], "the input ended before the last answer; nothing was written"),
        (
            [*TRACTOR[:-1], "5"],
            "5 m/s is too fast: a motor of 3190 rpm and a gear of 30 drive",
        ),
        (
            ["", "Tractor", "0.2", "0.9", *TRACTOR[4:]],
            "robots/robot.yaml:9:3: geometry.track_m: expected at most three times wheelbase_m (0.2 m), found 0.9 m",
        ),
    ],
)
def test_nothing_is_written_where_it_ends_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answers: list[str], problem: str
) -> None:
    answer(monkeypatch, *answers)
    done = artemis_here("init", tmp_path / "new")
    assert done.returncode == 2
    assert problem in done.stderr
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("like", LIKE)
def test_each_robot_to_begin_with_is_the_one_of_the_examples_and_makes_a_mission_that_runs(
    tmp_path: Path, like: str
) -> None:
    """With its own numbers as defaults; its first mission aligns the wheels as it can."""
    name, _ = LIKE[like]
    known = load_model(ROBOT.with_name(name), RobotFile)
    assert (Path(testing.__file__).with_name(name)).read_text() == ROBOT.with_name(name).read_text()
    assert artemis_here("init", "--yes", "--like", like, tmp_path).returncode == 0
    robot = load_mission(tmp_path / "first.yaml").robot
    assert (robot.robot, robot.geometry, robot.calibration.steering) == (
        known.robot,
        known.geometry,
        known.calibration.steering,
    )
    for drive, told in robot.drives.items():
        assert told == known.drives[drive]
    assert robot.metres_per_count("left") == pytest.approx(known.metres_per_count("left"), rel=1e-4)
    runpy.run_path(str(tmp_path / "test_first.py"))["test_first_mission_aligns_the_wheels_and_follows_its_path"]()


@pytest.mark.parametrize(("like", "axle"), [("artemis", "front"), ("tricycle", "rear"), ("small-car", "rear")])
def test_the_track_that_is_asked_for_is_the_one_of_the_robot_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, like: str, axle: str
) -> None:
    answer(monkeypatch, like, *[""] * len(QUESTIONS))
    asked = artemis_here("init", tmp_path).stdout
    assert f"Track: between the contact points of the {axle} wheels [m]" in asked
    assert ("Scrub radius" in asked, "Distance of the kingpins" in asked) == (like != "small-car", like == "small-car")


@pytest.mark.parametrize(("kingpins", "scrub"), [("0.34", 0.03), ("0,4", 0.0), ("0.5", 0.0)])
@pytest.mark.parametrize("like", ["rear-driven", "small-car"])
def test_with_driven_rear_wheels_the_kingpins_are_as_far_apart_as_was_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, like: str, kingpins: str, scrub: float
) -> None:
    """Or as near as the robot file can tell: not farther apart than the driven wheels."""
    answer(monkeypatch, like, "", "", "0.4", kingpins, *[""] * len(QUESTIONS))
    made = artemis_here("init", tmp_path)
    assert made.returncode == 0, made.stderr
    geometry = load_model(tmp_path / "robots/robot.yaml", RobotFile).geometry
    assert (geometry.track_m, geometry.scrub_radius_m) == (0.4, scrub)
    assert geometry.kingpin_distance_m == pytest.approx(min(0.4, float(kingpins.replace(",", "."))))


@pytest.mark.parametrize(
    "like", ["small-car", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in LIKE if name != "small-car")]
)
def test_the_first_mission_of_another_robot_is_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, like: str
) -> None:
    answer(monkeypatch, like, *[""] * len(QUESTIONS))
    asked = artemis_here("init", tmp_path)
    assert asked.returncode == 0, asked.stderr
    assert f"are still those of {load_mission(tmp_path / 'first.yaml').robot.robot}:" in asked.stdout
    done = artemis_here("run", tmp_path / "first.yaml")
    assert done.returncode == 0, done.stderr
    assert "result        done" in done.stdout


@pytest.mark.parametrize(
    ("like", "hint"),
    [
        ("smallcar", "nearest is 'small-car', there are artemis"),
        *((far, "there are artemis") for far in ("foo", "x", "")),
    ],
)
def test_a_robot_to_begin_with_that_is_not_there_is_refused(tmp_path: Path, like: str, hint: str) -> None:
    """What is far from every name is not called near one."""
    done = artemis_here("init", "--yes", "--like", like, tmp_path / "new")
    assert done.returncode == 2
    assert f"--like {like}: no such robot; {hint}, epos4," in done.stderr
    assert not (tmp_path / "new").exists()


def test_files_that_are_there_stay_unless_forced(tmp_path: Path) -> None:
    (tmp_path / "first.yaml").write_text("mine")
    done = artemis_here("init", "--yes", tmp_path)
    assert (done.returncode, (tmp_path / "first.yaml").read_text()) == (2, "mine")
    assert "first.yaml: exists already" in done.stderr
    assert artemis_here("init", "--yes", "--force", tmp_path).returncode == 0
    assert load_mission(tmp_path / "first.yaml").mission.mission == "first"


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "new"):
        done = artemis_here("init", "--yes", folder)
        assert done.returncode == 2
        assert "a file is where this folder has to be; name another folder" in done.stderr


def test_a_question_takes_a_decimal_comma() -> None:
    wheelbase = QUESTIONS[1]
    assert wheelbase.value("0,7") == 0.7
    with pytest.raises(ValueError, match=r"0\.1 to 10 m"):
        wheelbase.value("nan")
