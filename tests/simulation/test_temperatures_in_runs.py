"""Temperatures of power stages in whole runs: read while the robot drives, shown, recorded, and drawn."""

from __future__ import annotations

from pathlib import Path

import pytest
from rig import CALIBRATE, Rig, Run, follow, write_mission
from test_runs_of_families import EPOS4, mixed

from artemis.devices.temperature import EVERY
from artemis.page.view import PageView
from artemis.recording.mcap_reader import Recording
from artemis.report.charts import charts_of
from artemis.report.series import read_series
from artemis.supervision.catalogue import ROWS
from artemis.values import Mode

HOT = {"at_s": 12.0, "inject": "DRV-06", "node": "traction-left", "ambient_c": 115.0, "duration_s": 60.0}


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Run:
    run = Rig(mixed(write_mission(tmp_path_factory.mktemp("mixed"), [CALIBRATE, follow(0.4)], robot=EPOS4))).run()
    assert run.is_done
    return run


def test_those_that_measure_theirs_are_read_while_the_robot_drives_and_no_frame_is_held_back(driven: Run) -> None:
    seen = driven.seen
    while_driving = [each.tick.snapshot.sensed for each in seen if each.mode is Mode.FOLLOW]
    told = {drive.name: drive.temperature_c for drive in while_driving[-1].drives}
    assert told["traction-left"] is None
    assert told["traction-right"] is None
    assert told["steer-left"] == pytest.approx(25.0, abs=2.0)
    assert told["steer-right"] == pytest.approx(25.0, abs=2.0)
    assert not any(sensed.bus.blocked for sensed in while_driving)
    assert all(drive.stray == 0 for sensed in while_driving for drive in sensed.drives)
    asked = [frame for each in seen for frame in each.sent if frame.data[1:4] == b"\x01\x32\x01"]
    assert len(asked) == pytest.approx(2 * seen[-1].now / EVERY, abs=4)


def test_the_page_and_the_report_show_them(driven: Run) -> None:
    assert driven.outcome is not None
    recording = Recording(driven.outcome.run.path)
    view = PageView(recording.robot, recording.mission, {})
    *_, last = (tick for tick in recording.ticks() if tick.mode is Mode.FOLLOW)
    assert view.state(last)["temperatures"] == [drive.temperature_c for drive in last.snapshot.sensed.drives]
    (chart,) = charts_of(read_series(recording))["Temperatures"]
    assert chart.title == "steering drives"
    assert [line.name for line in chart.lines] == ["steer-left", "steer-right"]


def test_a_drive_that_is_too_hot_says_how_hot_it_is_while_it_cools(tmp_path: Path) -> None:
    """Also in the mode fault, where the operator waits for it."""
    simulation = {"faults": [HOT], "operator": [{"at_s": 40.0, "do": "end"}]}
    run = Rig(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=EPOS4, simulation=simulation)).run()
    assert "DRV-06" in run.fault_ids
    assert "five minutes" in ROWS["DRV-06"].advice
    later = [each for each in run.seen if each.mode is Mode.FAULT][-1].tick.snapshot.sensed
    hot = {drive.name: drive.temperature_c for drive in later.drives}
    assert hot["traction-left"] == pytest.approx(115.0, abs=5.0)
    assert hot["steer-left"] == pytest.approx(25.0, abs=3.0)
