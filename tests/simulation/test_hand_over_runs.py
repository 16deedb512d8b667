"""Whole runs with two inputs in one step: who has the robot, what the loss of each does, what is recorded."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, MISSIONS, Rig, Run, run, stick, write_mission

from artemis.values import Mode

BOTH = {"teleop": {"inputs": ["pilot", "trainee"], "until": {"button": "done"}}}
AT = 12.0
"""The trainee has driven for a while by then."""
PILOT = stick((0, 0, 0, 0), (20, 0, 0, 0))
TRAINEE = stick((0, 0, 0, 0), (10, 0, 0.5, 1), (16, 0, 0, 0), (19, 0, 0, 0))


def two(folder: Path, *faults: dict[str, Any], pilot: str = PILOT, trainee: str = TRAINEE, **keys: str) -> Run:
    """A run in which the trainee drives from 10 s to 16 s, if nothing else is said."""
    inputs = {
        "pilot": {"plugin": "scripted", "file": "pilot.csv"},
        "trainee": {"plugin": "scripted", "file": "trainee.csv"},
    }
    files = {"pilot.csv": pilot, "trainee.csv": trainee}
    step = {"teleop": {**BOTH["teleop"], **keys}}
    return run(write_mission(folder, [CALIBRATE, step], files, inputs=inputs, simulation={"faults": list(faults)}))


def phases(done: Run) -> list[str]:
    names = [seen.tick.wish.phase for seen in done.seen if seen.mode is Mode.TELEOP]
    return [name for name, _ in itertools.groupby(names)]


def test_mission_of_the_docs_hands_over_and_back(tmp_path: Path) -> None:
    folder = tmp_path / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    done = Rig(folder / "teleop_hand_over.yaml").run()
    assert phases(done) == [
        "hold the enable button to drive",
        "driving: trainee",
        "driving: instructor",
        "release all controls of trainee",
        "hold the enable button to drive",
        "driving: trainee",
        "hold the enable button to drive",
        "",
    ]
    assert (done.status, done.fault_ids) == (0, [])
    speeds = [seen.tick.set_points.speed for seen in done.seen if seen.mode is Mode.TELEOP]
    assert all(before * after >= 0.0 for before, after in itertools.pairwise(speeds)), "never from + to - in a tick"
    assert max(speeds) > 0.3
    assert min(speeds) < -0.3


@pytest.mark.sampled(3)
@pytest.mark.parametrize("id", ["INP-01", "INP-03", "INP-06"])
def test_lower_input_that_fails_while_nobody_needs_it_is_a_warning(tmp_path: Path, id: str) -> None:
    pilot = stick((0, 0, 0, 0), (10, 0, 0.5, 1), (15, 0, 0, 0), (20, 0, 0, 0))
    done = two(tmp_path, {"at_s": AT, "inject": id, "input": "trainee", "duration_s": 2.0}, pilot=pilot)
    assert done.status == 0
    assert done.fault_ids in ([id], [id, "INP-03"])  # instead of bad samples the last good one counts, and grows old
    assert not [seen for seen in done.seen if seen.mode in (Mode.QUICKSTOP, Mode.FAULT)]
    moving = [seen for seen in done.seen if AT < seen.time < AT + 2.0]
    assert {seen.tick.wish.phase for seen in moving} == {"driving: pilot"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["pilot", "trainee"])
@pytest.mark.parametrize("id", ["INP-01", "INP-03"])
def test_input_that_drives_or_could_take_over_stops_the_robot_when_it_fails(tmp_path: Path, id: str, name: str) -> None:
    done = two(tmp_path, {"at_s": AT, "inject": id, "input": name, "duration_s": 2.0})
    assert done.fault_ids == [id]
    stop = next(seen for seen in done.seen if seen.mode is Mode.QUICKSTOP)
    assert AT - 0.001 < stop.time <= AT + 0.2
    assert not any(seen.tick.wish.phase.startswith("driving") for seen in done.seen if seen.time > stop.time)


def test_stop_button_of_the_one_that_does_not_drive_stops_at_once(tmp_path: Path) -> None:
    done = two(tmp_path, {"at_s": AT, "inject": "INP-11", "input": "pilot"})
    stop = next(seen for seen in done.seen if seen.mode is Mode.QUICKSTOP)
    assert stop.time <= AT + 0.04
    assert stop.tick.set_points.speed == 0.0


def test_path_is_recorded_whoever_drives(tmp_path: Path) -> None:
    done = two(tmp_path, record="way")
    (path,) = tmp_path.glob("runs/*/paths/way.csv")
    assert len(path.read_text().splitlines()) > 10
    assert done.status == 0


def test_button_that_was_never_released_drives_nothing_though_its_input_is_lost_for_a_tick(tmp_path: Path) -> None:
    """Before the wheels are aligned, and before the step: nobody has seen the controls released."""
    lost = [{"at_s": at, "inject": "INP-01", "input": "trainee", "duration_s": 0.02} for at in (3.0, 16.0)]
    held = stick((0, 0, 0.5, 1), (5, 0, 0, 0), (6, 0, 0.5, 1), (20, 0, 0, 0), (21, 0, 0.5, 1), (23, 0, 0, 0))
    done = two(tmp_path, *lost, pilot=stick((0, 0, 0, 0), (25, 0, 0, 0)), trainee=held)
    for begin, end, mode in ((2.0, 4.9, Mode.INIT), (15.0, 19.9, Mode.READY)):
        waits = [(seen.mode, seen.phase) for seen in done.seen if begin < seen.time < end]
        assert [wait for wait, _ in itertools.groupby(waits)] == [
            (mode, "release the controls"),
            (mode, "release the controls; no reports from trainee"),
            (mode, "release the controls"),
        ]
    drives = done.first(lambda seen: seen.phase == "driving: trainee")
    assert drives.time == pytest.approx(21.0, abs=0.05)
    assert (done.status, done.fault_ids) == (0, ["INP-01"])


def test_input_that_stays_away_is_left_aside_until_it_was_seen_released(tmp_path: Path) -> None:
    away = {"at_s": 0.0, "inject": "INP-01", "input": "trainee", "duration_s": 18.0}
    held = stick((0, 0, 0, 0), (10, 0, 0.5, 1), (21, 0, 0, 0), (22, 0, 0.5, 1), (24, 0, 0, 0))
    done = two(tmp_path, away, pilot=stick((0, 0, 0, 0), (26, 0, 0, 0)), trainee=held)
    waits = [seen.time for seen in done.seen if seen.phase == "release the controls; no reports from trainee"]
    assert waits[-1] == pytest.approx(5.0, abs=0.03)
    assert phases(done)[:4] == [
        "hold the enable button to drive",
        "release all controls of trainee",
        "hold the enable button to drive",
        "driving: trainee",
    ]
    assert done.first(lambda seen: seen.phase == "driving: trainee").time == pytest.approx(22.0, abs=0.05)
    assert done.status == 0
