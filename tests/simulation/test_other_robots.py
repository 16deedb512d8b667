"""Robots with other axles than those of ARTEMIS drive, calibrate their odometry, and find where their wheels stand."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from rig import MISSIONS, Run, run

from artemis.commands.calibrate_odometry import calibrate_with_truth
from artemis.commands.run import run_and_report
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission, load_model
from artemis.motion.path import path_from_csv
from artemis.states.requests import ignored
from artemis.values import Mode, Request
from artemis.vehicle import RobotFile

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
NAMES = ("rear_driven", "tricycle", "small_car")
WHEELBASES = {"rear_driven": 0.606, "tricycle": 0.809, "small_car": 0.364}
STRAIGHT = """
mission: straight
robot: robots/robot.yaml
bus: simulation
steps:
  - calibrate: {{steering: align}}
  - follow: {{path: paths/line.csv, follower: {{speed_m_s: 0.3}}}}
simulation:
  true_robot: {{{true}}}
  operator: [{operator}]
"""
BY_HAND = "{at_s: 2.0, do: accept}"


def cross_track(seen: Run) -> float:
    """Of the true rear axle, in the frame of the start: root mean square [m]."""
    path = path_from_csv((MISSIONS / "paths/figure_eight.csv").read_text(), "figure_eight.csv")
    origin = seen.first(lambda each: each.tick.wish.reset_pose).pose
    cos, sin = math.cos(origin.heading), math.sin(origin.heading)
    found = []
    for each in seen.in_mode(Mode.FOLLOW):
        x, y = each.pose.x - origin.x, each.pose.y - origin.y
        tracking = each.tick.wish.tracking
        if tracking is not None:
            place = x * cos + y * sin, y * cos - x * sin
            found.append(path.project(*place, near=tracking.arc_length).cross_track)
    return float(np.sqrt(np.mean(np.square(found))))


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["", "_absolute", "_epos4", "_cia402", *(f"_{name}" for name in NAMES)])
def test_the_figure_eight_is_driven_within_three_millimetres(name: str, tmp_path: Path) -> None:
    shutil.copytree(MISSIONS, tmp_path / "m", ignore=shutil.ignore_patterns("runs"))
    seen = run(tmp_path / "m" / f"figure_eight{name}.yaml", longest=300.0)
    assert seen.status == 0
    assert cross_track(seen) < 0.003


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", NAMES)
def test_odometry_is_calibrated_from_the_robot_file_alone(name: str, tmp_path: Path) -> None:
    for folder in ("robots", "inputs"):
        shutil.copytree(MISSIONS / folder, tmp_path / folder)
    mission = yaml.safe_load((MISSIONS / "calibration_pattern.yaml").read_text())
    mission["robot"] = f"robots/{name}.yaml"
    mission["steps"][0] = {"calibrate": {"steering": "align"}}
    hidden = {"wheel_scale_middle": 1.012, "wheel_scale_left": 1.01, "wheel_scale_right": 0.996, "slip": 0.003}
    hidden |= {"steering_zero_middle_deg": 0.6, "steering_scale_middle": 1.008, "wheelbase_m": WHEELBASES[name]}
    mission["simulation"] = {"seed": 3, "true_robot": hidden}
    file, robot = tmp_path / "m.yaml", tmp_path / "robots" / f"{name}.yaml"
    file.write_text(yaml.safe_dump(mission))
    before = load_model(robot, RobotFile)
    assert run_and_report(file, False, None) == 0
    (driven,) = (tmp_path / "runs").iterdir()
    calibrate_with_truth([driven], ["simulation"], None, [], None, robot)
    after = load_model(robot, RobotFile)
    assert after.geometry.wheelbase_m == pytest.approx(WHEELBASES[name], rel=0.004)
    assert after.angle_source("middle").scale == pytest.approx(1.008, abs=0.003)
    scales = [after.metres_per_count(side) / before.metres_per_count(side) for side in ("left", "right")]
    true = (1.01, 0.996) if name == "rear_driven" else (1.012, 1.012)
    assert scales == pytest.approx(true, abs=0.006)  # less what slips


def straight(tmp_path: Path, source: str, true: str = "", operator: str = "") -> Path:
    """A mission of the small car along a line, with another source of the steering angle."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "paths").mkdir()
    (tmp_path / "paths/line.csv").write_text("x_m,y_m\n0,0\n0.4,0\n0.8,0\n")
    text = (MISSIONS / "robots/small_car.yaml").read_text()
    known = "middle: {angle: hard_stop, stop_deg: 47.0, travel_deg: 94.0}"
    assert known in text
    text = text.replace(known, f"middle: {source}")
    (tmp_path / "robots/robot.yaml").write_text(text)
    mission = tmp_path / "mission.yaml"
    mission.write_text(STRAIGHT.format(true=true, operator=operator))
    return mission


def heading(seen: Run) -> float:
    """How far the robot has truly turned [degrees]."""
    first, last = seen.seen[0].pose, seen.seen[-1].pose
    return math.degrees(last.heading - first.heading)


@pytest.mark.parametrize(("stop", "start"), [(47.0, 7.0), (-47.0, 39.0), (47.0, -44.0)])
def test_a_hard_stop_is_found_from_wherever_the_wheels_stand(stop: float, start: float, tmp_path: Path) -> None:
    source = f"{{angle: hard_stop, stop_deg: {stop}}}"
    seen = run(straight(tmp_path, source, f"start_steering_middle_deg: {start}"), longest=120.0)
    assert seen.status == 0
    assert abs(heading(seen)) < 0.1
    assert not seen.faults


def test_without_a_stop_nothing_drives(tmp_path: Path) -> None:
    source = "{angle: hard_stop, stop_deg: 178.0}"
    seen = run(straight(tmp_path, source), longest=120.0)
    assert seen.status == 1
    assert "CAL-03" in {fault.id for fault in seen.faults}
    assert not seen.in_mode(Mode.FOLLOW)


def test_a_person_sets_the_wheels_straight(tmp_path: Path) -> None:
    seen = run(straight(tmp_path, "{angle: by_hand}", operator=BY_HAND), longest=60.0)
    assert seen.status == 0
    assert abs(heading(seen)) < 0.1
    (accepted,) = [tick for tick in seen.ticks if Request.ACCEPT in tick.snapshot.sensed.requests]
    assert ignored(Request.ACCEPT, accepted) is None


@pytest.mark.parametrize("operator", ["", "{at_s: 2.0, do: arm}"])
def test_where_nobody_accepts_the_check_says_so_and_the_run_ends(operator: str, tmp_path: Path) -> None:
    mission = straight(tmp_path, "{angle: by_hand}", operator=operator)
    text = "simulation.operator: only a person can accept that the wheels stand straight (`angle: by_hand`)"
    assert [remark.partition("; ")[0] for remark in load_mission(mission).remarks] == [text]
    seen = run(mission, longest=60.0)
    assert (seen.status, seen.fault_ids) == (1, [])
    phases = [tick.wish.phase for tick in seen.ticks]
    assert "no operator can accept: set the wheels straight by hand, then accept (enter)" in phases


def test_where_somebody_accepts_the_check_says_nothing(tmp_path: Path) -> None:
    assert load_mission(straight(tmp_path, "{angle: by_hand}", operator=BY_HAND)).remarks == ()


def test_what_has_no_potentiometers_measures_none(tmp_path: Path) -> None:
    mission = straight(tmp_path, "{angle: by_hand}", operator=BY_HAND)
    mission.write_text(mission.read_text().replace("steering: align", "steering: from_potentiometers"))
    with pytest.raises(ConfigError, match="the robot has no potentiometers: write `align`"):
        load_mission(mission)
