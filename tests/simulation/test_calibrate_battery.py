"""From hidden errors to a robot file: a run that drives and stands, what it tells of the battery, and the file."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from rig import MISSIONS

from artemis.commands.calibrate_battery import calibrate_battery
from artemis.commands.run import run_and_report
from artemis.errors import ConfigError, RecordingError
from artemis.mission.loading import load_model
from artemis.vehicle import RobotFile

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
MISSION = """
mission: battery
tick_hz: 25
robot: robots/artemis_battery.yaml
bus: simulation
steps:
  - calibrate: {steering: from_potentiometers}
  - repeat:
      times: 2
      steps:
        - follow: {path: paths/circle.csv, follower: {plugin: frenet, speed_m_s: 0.5}, laps: 5}
        - wait: {seconds: 100}
simulation:
  seed: 4
  pace: fast
  true_robot: {supply: {battery_v: 25.5, capacity_scale: 0.9, idle_w: 24, source_resistance_ohm: 0.12}}
"""


@pytest.fixture
def missions(tmp_path: Path) -> Path:
    """With a battery of a few minutes."""
    for folder in ("robots", "paths"):
        shutil.copytree(MISSIONS / folder, tmp_path / folder)
    robot = tmp_path / "robots" / "artemis_battery.yaml"
    text = robot.read_text().replace("capacity_ah: 17 ", "capacity_ah: 0.3 ").replace("reserve_percent: 10", "")
    robot.write_text(text.replace("newtons_per_ampere: 29 ", "newtons_per_ampere: 30.3 "))
    (tmp_path / "battery.yaml").write_text(MISSION)
    return tmp_path


def test_what_a_run_tells_of_its_battery_gets_into_the_robot_file(
    missions: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = missions / "robots" / "artemis_battery.yaml"
    assert run_and_report(missions / "battery.yaml", False, None) == 0
    (driven,) = (missions / "runs").iterdir()
    before = file.read_text()
    capsys.readouterr()

    calibrate_battery([driven], [], None, yes=False)
    assert file.read_text() == before
    assert "not written; --write ROBOT" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="a person at a terminal is needed"):
        calibrate_battery([driven], [], file, yes=False)
    calibrate_battery([driven], [], file, yes=True)

    told = capsys.readouterr().out
    assert re.search(r"^capacity_ah +0\.3 +0\.2\d+ +-\d+\.\d% +\+- 0\.0\d+$", told, re.MULTILINE)
    assert re.search(r"^newtons_per_ampere +30\.3  held$", told, re.MULTILINE)
    assert "# of a driven wheel" in file.read_text(), "comments stay"
    battery = load_model(file, RobotFile).battery
    assert battery is not None
    assert battery.capacity_ah == pytest.approx(0.27, rel=0.1)
    assert battery.idle_w == pytest.approx(24.0, rel=0.1)
    assert battery.resistance_ohm == pytest.approx(0.12, rel=0.1)
    assert battery.joules_per_metre == pytest.approx((24.0 + 16.5) / 0.48, rel=0.1)
    with pytest.raises(ConfigError, match="its battery differs from that of the runs"):
        calibrate_battery([driven], [], file, yes=True)


def test_words_that_make_no_sense_are_refused(missions: Path) -> None:
    with pytest.raises(ConfigError, match="--hold: capacity is none of capacity_ah"):
        calibrate_battery([missions], ["capacity"], None, yes=False)
    with pytest.raises(ConfigError, match="one of capacity_ah, idle_w, newtons_per_ampere has to be known"):
        calibrate_battery([missions], ["resistance_ohm"], None, yes=False)
    with pytest.raises(ConfigError, match="say which robot file"):
        calibrate_battery([missions], [], None, yes=True)
    shutil.copy(MISSIONS / "follow_circle.yaml", missions / "short.yaml")
    text = re.sub("steps:.*", "steps: [{wait: {seconds: 1}}]\n", (missions / "short.yaml").read_text(), flags=re.DOTALL)
    (missions / "short.yaml").write_text(text)
    assert run_and_report(missions / "short.yaml", False, None) == 0
    with pytest.raises(RecordingError, match="whose file describes no battery"):
        calibrate_battery(list((missions / "runs").iterdir()), [], None, yes=False)
