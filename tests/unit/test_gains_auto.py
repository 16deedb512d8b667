"""`artemis calibrate gains --auto` on simulated drives whose regulators compute with their gains."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from gains_rig import mission, robot_file

from artemis.commands.calibrate_gains import Wanted
from artemis.commands.gains_auto import calibrate_auto
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.sim.axis import LOADS

DRIVEN = ("traction-left", "traction-right")


@pytest.fixture(autouse=True)
def _no_pages(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report's page costs more than the run; the exhaustive test writes it."""
    if request.node.get_closest_marker("exhaustive") is None:
        monkeypatch.setattr("artemis.commands.run.write_report", lambda *_: None)


def with_loads(folder: Path, **loads: dict[str, Any]) -> Path:
    return mission(folder, simulation={"true_robot": {"loads": loads}})


def test_gains_are_not_given_to_what_finds_them(tmp_path: Path) -> None:
    path = mission(tmp_path)
    for wanted in (Wanted(drives=DRIVEN, gains={"velocity": "1,2"}), Wanted(drives=DRIVEN, gains={}, tried=True)):
        with pytest.raises(ConfigError, match="--auto finds the gains itself"):
            calibrate_auto(path, wanted)
    with pytest.raises(ConfigError, match="--drive is missing"):
        calibrate_auto(path, Wanted(gains={}))


def test_loads_are_of_drives_whose_gains_are_known(tmp_path: Path) -> None:
    path = with_loads(tmp_path, traction={})
    robot = tmp_path / "robots" / "artemis.yaml"
    lines = robot.read_text().splitlines(True)
    robot.write_text("".join(line for line in lines if "gains: {current: [400" not in line))
    with pytest.raises(ConfigError) as caught:
        load_mission(path)
    assert caught.value.problems[0].startswith(f"{path}:1:")
    assert "loads.traction: only for drives with `gains` in the robot file" in caught.value.problems[0]


def test_wheels_that_follow_the_ramp_keep_their_gains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = with_loads(tmp_path, steering={})
    before = robot_file(tmp_path)
    assert calibrate_auto(path, Wanted(drives=("steer-left",), gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    (found,) = [float(line.split()[2]) for line in lines if line.startswith("steer-left      inertia ")]
    assert found == pytest.approx(1e-3 * LOADS["steering"].inertia * 60.0 / math.tau * 946, rel=0.1)
    assert "the ramp that the gate makes of the step takes 0.15 s" in lines[-1]
    assert robot_file(tmp_path) == before


@pytest.mark.exhaustive
def test_a_fault_in_the_first_trial_ends_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = with_loads(tmp_path, steering={"inertia_scale": 8.0})
    assert calibrate_auto(path, Wanted(drives=("steer-left",), gains={})) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "trial       aborted: nothing is kept"


@pytest.mark.exhaustive
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "load",
    [
        {"inertia_scale": 1.3, "friction_scale": 0.8, "play_deg": 0.2, "delay_ms": 3.0},
        {"inertia_scale": 2.4, "friction_scale": 1.6, "play_deg": 0.1, "delay_ms": 0.0},
        {"inertia_scale": 1.0, "friction_scale": 0.5, "play_deg": 0.3, "delay_ms": 6.0},
    ],
    ids=["with play", "heavy", "late"],
)
def test_driven_wheels_that_swing_get_gains_that_do_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], load: dict[str, float]
) -> None:
    """Whole runs, with bus, gate and recording."""
    path = with_loads(tmp_path, traction=load)
    assert calibrate_auto(path, Wanted(drives=DRIVEN, gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("restored    traction-left, traction-right") for line in lines)
    (better,) = (line for line in lines if line.startswith("better      "))
    swung = "the present gains did not settle each time" in better
    assert swung or float(better.split()[3].rstrip("%")) <= 60.0
    assert lines[-1].startswith("kept        nothing: simulated drives")
    figures = list((tmp_path / "runs").glob("*/gains.png"))
    assert len(figures) == 2
