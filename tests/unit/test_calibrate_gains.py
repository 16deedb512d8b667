"""`artemis calibrate gains`: what it is asked for, what it shows and tries."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from gains_rig import DRIVEN, LEFT, POSITION, RIGHT, ROBOT, SETTLED, mission, robot_file, storing

from artemis.app import Outcome
from artemis.commands import calibrate_gains as command
from artemis.commands.calibrate_gains import Wanted, calibrate_gains, trial_from
from artemis.commands.gains_trial import Findings, GainsWatch, Trial, write_mission
from artemis.errors import ConfigError, RecordingError
from artemis.mission.actions import NewGains
from artemis.mission.loading import LoadedMission, load_mission
from artemis.recording.mcap_reader import Recording
from artemis.recording.run_folder import RunFolder


def problems(loaded: LoadedMission, *drives: str, step: float | None = None, **gains: str) -> str:
    with pytest.raises(ConfigError) as caught:
        trial_from(loaded, Wanted(drives=drives, gains=gains, step=step))
    return str(caught.value)


def test_wrong_options_are_all_told_before_anything_moves(tmp_path: Path) -> None:
    loaded = load_mission(mission(tmp_path))
    assert "no such drive; did you mean steer-left?" in problems(loaded, "steer-lft", position="1,2,3")
    for position in ("1,2", "1,2,3,4", "-1,2,3", "nan,2,3", "a,b,c", ""):
        assert "expected P,I,D: 3 numbers as the robot file has them" in problems(loaded, LEFT, position=position)
    for position, wrong in (("1,2,32768", "D 32768"), ("1.5,2,3", "P 1.5")):
        told = f"--drive 'steer-left': position {wrong}: expected a whole number of 0 to 32767 (EPOS)"
        assert told in problems(loaded, LEFT, position=position)
    assert "--current '1': expected P,I: 2 numbers" in problems(loaded, LEFT, current="1")
    assert "--drive is missing" in problems(loaded, position="1,2,3")
    assert "one kind after the other" in problems(loaded, LEFT, DRIVEN, velocity="1,2")
    assert "expected 0.5 to 20 degrees" in problems(loaded, LEFT, step=21.0)
    assert "expected 0.1 to 0.2 m/s" in problems(loaded, DRIVEN, step=0.3)
    assert "already" in problems(loaded, LEFT, position="150,10,200")
    large = problems(loaded, LEFT, current="5000,1501", position="1501,0,200")
    assert large.splitlines() == [
        "calibrate gains: --drive 'steer-left': current I 1501: at most 10 times the present 150 per trial",
        "calibrate gains: --drive 'steer-left': position P 1501: at most 10 times the present 150 per trial",
    ]
    both = problems(loaded, "nobody", position="1", step=30.0).splitlines()
    assert len(both) == 2


@pytest.mark.parametrize(
    ("gains", "problem"),
    [
        ({"steer-lft": {"position": [1, 2, 3]}}, "no such drive; did you mean steer-left?"),
        ({LEFT: {"position": [1, 2]}}, "the list is too short"),
        ({LEFT: {"position": [1, 2, 32768]}}, "position D 32768: expected a whole number of 0 to 32767"),
        ({LEFT: {}}, "expected at least one of current, velocity, position"),
        ({LEFT: {"speed": [1, 2]}}, "unknown key"),
        ({LEFT: {"velocity": [10001, 1000]}}, "velocity P 10001: at most 10 times the present 1000 per trial"),
        ({}, "expected a list of at least 1"),
    ],
)
def test_wrong_gains_in_a_mission_are_told_with_their_place(
    tmp_path: Path, gains: dict[str, Any], problem: str
) -> None:
    path = mission(tmp_path, steps=[{"calibrate": {"gains": gains}}])
    with pytest.raises(ConfigError) as caught:
        load_mission(path)
    (told,) = caught.value.problems
    assert told.startswith(f"{path}:1:")
    assert "steps[0].calibrate.gains" in told
    assert problem in told


def test_a_drive_without_gains_in_the_robot_file_cannot_try_any(tmp_path: Path) -> None:
    path = mission(tmp_path)
    robot = tmp_path / "robots" / "artemis.yaml"
    robot.write_text(
        "".join(line for line in robot.read_text().splitlines(True) if "gains: {current: [500" not in line)
    )
    assert "the robot file has no gains of it" in problems(load_mission(path), LEFT, position="1,2,3")


def test_a_gain_of_none_may_become_any(tmp_path: Path) -> None:
    path = mission(tmp_path)
    robot = tmp_path / "robots" / "artemis.yaml"
    robot.write_text(robot.read_text().replace("position: [150, 10, 200]", "position: [150, 0, 200]"))
    trial = trial_from(load_mission(path), Wanted(drives=(LEFT,), gains={"position": "1500,900,2000"}))
    assert trial.new == NewGains(position=(1500, 900, 2000))


def test_several_drives_of_one_kind_are_tried_together(tmp_path: Path) -> None:
    trial = trial_from(load_mission(mission(tmp_path)), Wanted(drives=(RIGHT, LEFT, RIGHT), gains=POSITION))
    assert trial.drives == (RIGHT, LEFT)
    assert (trial.side, trial.step) == ("right", 5.0)
    assert trial.new == NewGains(position=(600, 10, 200))


@pytest.mark.parametrize(
    ("drive", "new", "kinds", "places"),
    [
        (LEFT, NewGains(position=(1, 2, 3)), ["turn", "gains", "turn"], {"now": 0, "new": 2}),
        (LEFT, None, ["turn"], {"now": 0}),
        (DRIVEN, NewGains(velocity=(1, 2)), ["steering", "", "", "gains", "", ""], {"now": 1, "new": 4}),
        (DRIVEN, None, ["steering", "", ""], {"now": 1}),
    ],
)
def test_the_mission_of_a_trial(
    tmp_path: Path, drive: str, new: NewGains | None, kinds: list[str], places: Mapping[str, int]
) -> None:
    stick = {"plugin": "scripted", "file": "stick.csv"}
    (tmp_path / "stick.csv").write_text("time_s,x,y,enable\n0,0,0,0\n")
    simulation = {"seed": 7, "inputs": {"stick": stick}, "operator": [{"at_s": 1.0, "do": "end"}]}
    path = mission(tmp_path, inputs={"stick": stick}, simulation=simulation)
    loaded = load_mission(path)
    role = "steering" if drive == LEFT else "traction"
    trial = Trial(drives=(drive,), role=role, side="left", step=0.2, new=new)
    (tmp_path / "made").mkdir()
    made, source = write_mission(loaded, path, trial, tmp_path / "made")
    found = [step.action.model_fields_set & {"turn", "gains", "steering"} for step in made.mission.steps]
    assert ["".join(each) for each in found] == kinds
    assert trial.places == places
    assert (made.mission.tick_hz, made.folder, made.mission.simulation.seed) == (200, tmp_path, 7)
    assert (made.mission.inputs, len(made.mission.simulation.operator)) == ({}, 1)
    assert source.read_text().startswith("# A trial of gains, made of mission.yaml.")


def test_a_slow_bus_is_not_filled_and_a_mission_s_own_frequency_holds(tmp_path: Path) -> None:
    path = mission(tmp_path, tick_hz=50)
    robot = tmp_path / "robots" / "artemis.yaml"
    robot.write_text(robot.read_text() + "bitrate: 250000\n")
    trial = Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=None)
    for keys, expected in ((b'"tick_hz": 50, ', 50), (b"", 50)):
        path.write_bytes(
            path.read_bytes().replace(b'"tick_hz": 50', b'"tick_hz": 50' if keys else b'"record": "runs/"')
        )
        (tmp_path / f"made{len(keys)}").mkdir()
        made, _ = write_mission(load_mission(path), path, trial, tmp_path / f"made{len(keys)}")
        assert made.mission.tick_hz == expected


@pytest.mark.parametrize(("bitrate", "tick_hz"), [(1_000_000, 200), (800_000, 125), (500_000, 100), (250_000, 50)])
def test_a_trial_has_ticks_of_whole_milliseconds(bitrate: int, tick_hz: int, tmp_path: Path) -> None:
    """Drives that interpolate take no other."""
    path = mission(tmp_path)
    robot = tmp_path / "robots" / "artemis.yaml"
    robot.write_bytes(ROBOT.with_name("artemis_epos4.yaml").read_bytes() + b"bitrate: %d\n" % bitrate)
    trial = Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=None)
    (tmp_path / "made").mkdir()
    made, _ = write_mission(load_mission(path), path, trial, tmp_path / "made")
    assert made.mission.tick_hz == tick_hz


def test_shows_what_differs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate_gains(mission(tmp_path), Wanted(gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "gains of ARTEMIS in the robot file, and in the drives (simulated) now"
    assert lines[2].split() == ["traction-left", "robot", "file", "400,120", "1200,180", "150,10,200"]
    assert lines[3].split() == ["drive", "400,120", "400,120", "*", "150,10,200"]
    assert lines[-1].startswith("* differs")


def test_gains_that_are_not_known_are_shown_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = mission(tmp_path)
    shutil.copy(ROBOT.with_name("artemis_cia402.yaml"), tmp_path / "robots")
    path.write_bytes(path.read_bytes().replace(b"robots/artemis.yaml", b"robots/artemis_cia402.yaml"))
    assert calibrate_gains(path, Wanted(gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "traction-left   not known of a CiA 402 drive: the maker's own tool shows them"


def test_repetitions_are_steps_of_one_run() -> None:
    trial = Trial(
        drives=(DRIVEN,), role="traction", side="left", step=0.2, new=NewGains(velocity=(1, 2)), repetitions=3
    )
    assert trial.tests == {"now": [1, 2, 3, 4, 5, 6], "new": [8, 9, 10, 11, 12, 13]}
    assert len(trial.steps) == 14


def test_nothing_to_try_is_no_trial(tmp_path: Path) -> None:
    path = mission(tmp_path)
    for wanted in (Wanted(gains={}, step=5.0), Wanted(gains={}, yes=True)):
        with pytest.raises(ConfigError, match="are for a trial"):
            calibrate_gains(path, wanted)
    with pytest.raises(ConfigError, match="no such drive"):
        calibrate_gains(path, Wanted(gains={}, drives=("nobody",)))


def test_a_real_robot_does_not_move_unasked(tmp_path: Path) -> None:
    path = mission(tmp_path, bus={"interface": "virtual", "channel": "nowhere"})
    with pytest.raises(ConfigError, match=r"terminal.*--yes: .* turn by 5 degrees to the left and back, once with"):
        calibrate_gains(path, Wanted(drives=(LEFT,), gains=POSITION))
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_a_trial_is_a_run_with_table_and_figure_and_keeps_nothing_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = mission(tmp_path)
    assert calibrate_gains(path, Wanted(drives=(LEFT,), gains=POSITION, yes=True)) == 0
    out = capsys.readouterr().out
    for text in (
        "steer-left: a step of 5.0 degrees, of which the gate makes a ramp of 0.15 s",
        "restored    steer-left: the gains of the robot file",
        "kept        nothing: simulated drives",
    ):
        assert text in out
    (run,) = (tmp_path / "runs").iterdir()
    assert run.name.endswith("-gains")
    assert (run / "gains.png").read_bytes().startswith(b"\x89PNG")
    assert (run / "report.html").is_file()
    assert Recording(run).outcome == "done"
    assert (tmp_path / "robots" / "artemis.yaml").read_text() == ROBOT.read_text()


# ---------------------------------------------------------------------------------------------- too little is seen


def on_a_real_robot(monkeypatch: pytest.MonkeyPatch) -> list[Mapping[str, tuple[int, ...]]]:
    """The command takes simulated drives for real ones; what it stores comes into the list."""
    monkeypatch.setattr(command, "is_simulated", lambda *_: False)
    return storing(monkeypatch)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("at", [2.5, 5.0, 8.0, 11.4])
def test_a_trial_that_was_not_recorded_whole_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], at: float
) -> None:
    stored = on_a_real_robot(monkeypatch)
    path = mission(tmp_path, simulation={"faults": [{"at_s": at, "inject": "DSK-02"}]})
    assert calibrate_gains(path, Wanted(drives=(LEFT,), gains=POSITION, yes=True)) == 1
    out = capsys.readouterr().out
    assert "kept        nothing: the trial was not recorded whole" in out
    assert "restored    steer-left: the gains of the robot file" in out  # as the run itself has seen
    assert (stored, robot_file(tmp_path)) == ([], ROBOT.read_text())


@pytest.mark.exhaustive
def test_a_recording_that_cannot_be_read_keeps_nothing_and_what_the_drives_have_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def damaged(_: Path) -> Recording:
        raise RecordingError("recording.mcap: not written by artemis")

    stored = on_a_real_robot(monkeypatch)
    monkeypatch.setattr(command, "Recording", damaged)
    assert calibrate_gains(mission(tmp_path), Wanted(drives=(LEFT,), gains=POSITION, yes=True)) == 1
    out = capsys.readouterr().out
    assert "kept        nothing: recording.mcap: not written by artemis" in out
    assert "restored    steer-left" in out
    assert (stored, robot_file(tmp_path)) == ([], ROBOT.read_text())


@pytest.mark.exhaustive
def test_a_drive_that_takes_nothing_back_is_no_restored_one_and_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = on_a_real_robot(monkeypatch)
    silent = {"at_s": 9.0, "inject": "COM-08", "node": LEFT, "duration_s": 20.0}
    path = mission(tmp_path, simulation={"faults": [silent]})
    assert calibrate_gains(path, Wanted(drives=(LEFT,), gains=POSITION, yes=True)) == 1
    out = capsys.readouterr().out
    assert "WARNING     steer-left may have the gains on trial while it has power" in out
    assert "restored" not in out
    assert stored == []


@pytest.mark.exhaustive
def test_a_trial_without_new_gains_has_nothing_to_restore(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate_gains(mission(tmp_path), Wanted(drives=(LEFT,), gains={}, tried=True)) == 0
    out = capsys.readouterr().out
    assert "settled within 5 %" in out
    assert "restored" not in out
    assert "kept" not in out


def test_what_was_not_seen_to_come_back_is_no_trial_to_keep_gains_of(tmp_path: Path) -> None:
    trial = Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=NewGains(position=(600, 10, 200)))
    outcome = Outcome(failed=False, interrupted=None, run=RunFolder(path=tmp_path), duration=1, elapsed=1, steering={})
    whole, watch = Findings(traces={}, responses={"now": [SETTLED], "new": [SETTLED]}), GainsWatch()
    assert command._unproven(trial, watch, whole, outcome) == "steer-left did not take the robot file's gains back"
    assert command._unproven(replace(trial, new=None), watch, whole, outcome) == ""
    watch.restored.add(LEFT)
    assert command._unproven(trial, watch, whole, outcome) == ""
    assert "ends early" in command._unproven(trial, watch, replace(whole, missing="it ends early"), outcome)
    half = replace(whole, responses={"now": [SETTLED]})
    assert command._unproven(trial, watch, half, outcome) == "not all of the trial was seen"


def test_nothing_settles_where_nothing_was_seen() -> None:
    assert not Findings(traces={}, responses={}).settled
    assert not Findings(traces={}, responses={"now": [SETTLED]}).settled
    assert Findings(traces={}, responses={"now": [], "new": [SETTLED]}).settled
