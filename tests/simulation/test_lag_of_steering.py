"""How far a steering motor may lag: what a robot file leaves out fits every start, and what none fits is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from rig import MISSIONS, run
from test_angle_sensors import mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission, load_model
from artemis.vehicle import RobotFile

STOPPED = {"start_steering_middle_deg": -9.0}


def with_lag(folder: Path, name: str, counts: int | None, tick_hz: int = 50) -> Path:
    """A mission along a line, with a robot whose steering drives may lag by so much; None: it does not say."""
    robot = yaml.safe_load((MISSIONS / f"robots/{name}.yaml").read_text())
    for drive in robot["drives"].values():
        if drive["role"] == "steering":
            drive.pop("following_error_counts")
            drive.update({} if counts is None else {"following_error_counts": counts})
    return mission(folder, robot, STOPPED if name == "small_car" else None, tick_hz=tick_hz)


@pytest.mark.parametrize("name", ["artemis", "artemis_epos4", "small_car"])
def test_a_robot_file_without_a_lag_drives(name: str, tmp_path: Path) -> None:
    seen = run(with_lag(tmp_path, name, None), longest=120.0)
    assert (seen.status, seen.fault_ids) == (0, [])


def test_without_a_number_a_steered_wheel_may_lag_by_three_degrees(tmp_path: Path) -> None:
    with_lag(tmp_path, "artemis", None)
    robot = load_model(tmp_path / "robot.yaml", RobotFile)
    assert {name: drive.lag_counts for name, drive in robot.drives.items()} == {
        "traction-left": 2000,
        "traction-right": 2000,
        "steer-left": round(3 / 360 * 2000 * 946),
        "steer-right": round(3 / 360 * 2000 * 946),
    }


@pytest.mark.parametrize(("tick_hz", "least"), [(25, 7500), (50, 4723), (200, 2639)])
def test_the_least_lag_with_which_a_hard_stop_is_found_finds_it(tick_hz: int, least: int, tmp_path: Path) -> None:
    seen = run(with_lag(tmp_path, "small_car", least, tick_hz), longest=120.0)
    assert (seen.status, seen.fault_ids) == (0, [])
    file = with_lag(tmp_path, "small_car", least - 1, tick_hz)
    with pytest.raises(ConfigError) as refused:
        load_mission(file)
    (problem,) = refused.value.problems
    assert problem.startswith(f"{tmp_path}/robot.yaml:")
    assert ": drives.steering.following_error_counts: " in problem
    assert f"degrees behind, at {tick_hz} ticks a second: expected at least {least}, or leave it out" in problem
