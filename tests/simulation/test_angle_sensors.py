"""Robots whose steering has absolute encoders or a home switch: they drive straight, and notice what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import MISSIONS, Run, run
from test_other_robots import cross_track, heading

from artemis.commands.calibrate_odometry import calibrate_with_truth
from artemis.commands.calibrate_steering import calibrate_steering
from artemis.commands.run import run_and_report
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.values import Mode
from artemis.vehicle import RobotFile

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
ABSOLUTE, SWITCH = "artemis_absolute", "small_car_switch"
FOLLOW = {"path": "line.csv", "follower": {"speed_m_s": 0.3}}
EPOS4_STEERING = {
    "family": "epos4",
    "hardware_version": 0x6150,
    "motor": {
        "type": "dc",
        "pole_pairs": 1,
        "continuous_current_ma": 1000,
        "output_current_ma": 2000,
        "thermal_time_constant_s": 13.0,
        "max_speed_rpm": 6000,
        "torque_constant_mnm_per_a": 38.2,
    },
}


def mission(
    folder: Path,
    robot: dict[str, Any] | str,
    true: dict[str, float] | None = None,
    faults: list[dict[str, Any]] | None = None,
    tick_hz: int = 50,
) -> Path:
    """Along a line of 0.8 m."""
    if isinstance(robot, str):
        robot = yaml.safe_load((MISSIONS / f"robots/{robot}.yaml").read_text())
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    (folder / "line.csv").write_text("x_m,y_m\n0,0\n0.4,0\n0.8,0\n")
    simulation = {"true_robot": true or {}, "faults": faults or []}
    steps = [{"calibrate": {"steering": "align"}}, {"follow": FOLLOW}]
    words = {
        "mission": "straight",
        "robot": "robot.yaml",
        "bus": "simulation",
        "tick_hz": tick_hz,
        "steps": steps,
        "simulation": simulation,
    }
    file = folder / "mission.yaml"
    file.write_text(yaml.safe_dump(words))
    return file


def follows_straight(seen: Run) -> None:
    assert seen.status == 0
    assert not seen.faults
    assert abs(heading(seen)) < 0.1


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["absolute", "small_car_switch"])
def test_the_figure_eight_is_driven_within_three_millimetres(name: str, tmp_path: Path) -> None:
    seen = run(MISSIONS / f"figure_eight_{name}.yaml", longest=300.0)
    assert seen.status == 0
    assert cross_track(seen) < 0.003


def test_absolute_encoders_with_noise_are_enough_without_a_sweep(tmp_path: Path) -> None:
    seen = run(mission(tmp_path, ABSOLUTE, {"encoder_noise_counts": 1.0}), longest=60.0)
    follows_straight(seen)
    turned = [abs(tick.set_points.steering) for tick in seen.ticks if tick.mode is not Mode.FOLLOW]
    assert max(turned) < 0.15, "as it was found, then straight ahead: nothing turns to find out more"


@pytest.mark.parametrize("start", [-41.0, 33.0])
def test_a_home_switch_is_found_by_an_epos(start: float, tmp_path: Path) -> None:
    follows_straight(run(mission(tmp_path, SWITCH, {"start_steering_middle_deg": start}), longest=120.0))


def test_a_home_switch_is_found_by_an_epos4(tmp_path: Path) -> None:
    robot = yaml.safe_load((MISSIONS / f"robots/{SWITCH}.yaml").read_text())
    robot["drives"]["steering"] |= EPOS4_STEERING
    del robot["drives"]["steering"]["gains"]
    robot["calibration"]["steering"]["middle"] |= {"on_side": "right", "switch_deg": -3.0}
    follows_straight(run(mission(tmp_path, robot), longest=120.0))


@pytest.mark.parametrize("robot", ["small_car", SWITCH])
@pytest.mark.parametrize("at_s", [1.25, 1.2969, 1.33, 1.37])
def test_a_computer_that_is_late_is_not_taken_for_a_motor_that_is_held(at_s: float, robot: str, tmp_path: Path) -> None:
    late = {"at_s": at_s, "inject": "SYS-07", "seconds": 0.039}
    follows_straight(run(mission(tmp_path, robot, faults=[late], tick_hz=25), longest=120.0))


def test_a_coupling_that_slips_is_seen_by_the_absolute_encoder(tmp_path: Path) -> None:
    slips = {"at_s": 6.0, "inject": "STE-05", "node": "steer-left"}
    seen = run(mission(tmp_path, ABSOLUTE, faults=[slips]), longest=60.0)
    assert seen.status == 1
    first = seen.faults[0]
    assert (first.id, first.device) == ("STE-05", "steer-left")


@pytest.mark.parametrize(
    ("name", "true", "key", "wanted"),
    [
        (ABSOLUTE, {"left": 0.8, "right": -0.3}, "zero_deg", {"left": 213.55, "right": 30.77}),
        (SWITCH, {"middle": 0.6}, "switch_deg", {"middle": 13.1}),
    ],
)
def test_the_zero_is_measured_with_a_reference_and_kept_in_the_robot_file(
    name: str, true: dict[str, float], key: str, wanted: dict[str, float], tmp_path: Path
) -> None:
    file = mission(tmp_path, name, {f"steering_zero_{side}_deg": angle for side, angle in true.items()})
    status = calibrate_steering(file, None, true, new=False, yes=True, simulate=False, write_simulated=True)
    assert status == 0
    found = load_model(tmp_path / "robot.yaml", RobotFile)
    assert {side: getattr(found.angle_source(side), key) for side in wanted} == pytest.approx(wanted, abs=0.02)


def test_what_cannot_be_measured_is_refused(tmp_path: Path) -> None:
    file = mission(tmp_path, SWITCH)
    with pytest.raises(ConfigError, match="the robot has no potentiometers: write `align`"):
        calibrate_steering(file, None, {"middle": 0.1}, new=True, yes=True, simulate=False, write_simulated=True)
    robot = yaml.safe_load((MISSIONS / f"robots/{SWITCH}.yaml").read_text())
    robot["calibration"]["steering"]["middle"] = {"angle": "by_hand"}
    with pytest.raises(ConfigError, match="a person sets the wheels straight at each start: there is nothing"):
        calibrate_steering(
            mission(tmp_path, robot), None, {"middle": 0.1}, new=False, yes=True, simulate=False, write_simulated=True
        )


@pytest.mark.exhaustive
def test_the_zero_of_an_absolute_encoder_is_calibrated_by_driving(tmp_path: Path) -> None:
    words = yaml.safe_load((MISSIONS / "calibration_pattern.yaml").read_text())
    (tmp_path / "robots").mkdir()
    robot = tmp_path / "robots/robot.yaml"
    robot.write_text((MISSIONS / f"robots/{ABSOLUTE}.yaml").read_text())
    words["robot"] = "robots/robot.yaml"
    words["steps"][0] = {"calibrate": {"steering": "align"}}
    hidden = {"steering_zero_left_deg": 0.5, "steering_zero_right_deg": 0.5}  # their difference does not show
    words["simulation"] = {"seed": 3, "true_robot": hidden}
    (tmp_path / "inputs").mkdir()
    for file in (MISSIONS / "inputs").iterdir():
        (tmp_path / "inputs" / file.name).write_bytes(file.read_bytes())
    file = tmp_path / "m.yaml"
    file.write_text(yaml.safe_dump(words))
    before = load_model(robot, RobotFile)
    assert run_and_report(file, False, None) == 0
    (driven,) = (tmp_path / "runs").iterdir()
    calibrate_with_truth([driven], ["simulation"], None, [], None, robot)
    after = load_model(robot, RobotFile)
    sources: list[Any] = [each.angle_source(side) for side in ("left", "right") for each in (after, before)]
    shifted = [sources[0].zero_deg - sources[1].zero_deg, sources[2].zero_deg - sources[3].zero_deg]
    assert shifted == pytest.approx([-0.5, 0.5], abs=0.02)
