"""From hidden errors to a robot file: drive, calibrate, write, drive another way."""

from __future__ import annotations

import shutil
from math import hypot
from pathlib import Path

import pytest
from rig import MISSIONS

from artemis.commands.calibrate_odometry import calibrate_closing, calibrate_with_truth
from artemis.commands.run import run_and_report
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.recording.mcap_reader import Recording
from artemis.vehicle import RobotFile

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
HIDDEN = {
    "steering_zero_left_deg": 0.8,
    "steering_zero_right_deg": 0.2,
    "steering_scale_left": 1.004,
    "steering_scale_right": 0.997,
    "wheel_scale_left": 1.01,
    "wheel_scale_right": 0.995,
    "wheelbase_m": 0.566,
    "track_m": 0.431,
    "scrub_radius_m": 0.06,
}
WEAVING = """
inputs: {{wheel: {{plugin: scripted, file: inputs/calibration_pattern.csv, max_speed_m_s: 0.5, hysteresis_deg: 0}}}}
steps:
  - calibrate: {{steering: from_potentiometers}}
  - teleop: {{input: wheel, until: {{button: done}}}}
simulation: {{seed: {seed}, true_robot: {{{true}, potentiometer_noise_v: 0.002, slip: 0.004}}}}
"""
EIGHT = """
steps:
  - calibrate: {{steering: from_potentiometers}}
  - follow: {{path: paths/figure_eight.csv, follower: {{plugin: indiveri, speed_m_s: 0.4}}}}
simulation: {{seed: {seed}, true_robot: {{{true}, potentiometer_noise_v: 0.002, slip: 0.004}}}}
"""


def driven(folder: Path, name: str, steps: str, true: dict[str, float], seed: int) -> Path:
    """The folder of a run."""
    mission = folder / f"{name}.yaml"
    words = ", ".join(f"{key}: {value:.9g}" for key, value in true.items())
    text = f"mission: {name}\nrobot: robots/artemis.yaml\nbus: simulation{steps.format(seed=seed, true=words)}"
    mission.write_text(text)
    assert run_and_report(mission, False, None) == 0
    return next((folder / "runs").glob(f"*-{name}"))


def error_at_end(run: Path) -> tuple[float, float]:
    """Of the odometry [m], and the distance [m]."""
    last = Recording(run).last_tick()
    assert last is not None
    assert last.true_pose is not None
    pose, true = last.snapshot.odometry.pose, last.true_pose
    return hypot(pose.x - true.x, pose.y - true.y), last.snapshot.odometry.distance


def seen_by(robot: RobotFile, old: RobotFile) -> dict[str, float]:
    """The same machine as `HIDDEN`, as deviations from another robot file."""
    true = dict(HIDDEN)
    for side in ("left", "right"):
        before, after = old.potentiometers(side), robot.potentiometers(side)
        true[f"steering_zero_{side}_deg"] += before.slope_deg_per_v[0] * (after.zero_v[0] - before.zero_v[0])
        true[f"steering_scale_{side}"] *= before.scale / after.scale
        true[f"wheel_scale_{side}"] *= old.metres_per_count(side) / robot.metres_per_count(side)
    return true


@pytest.mark.exhaustive
@pytest.mark.parametrize("drives", ["artemis", "artemis_epos4"])
def test_a_calibrated_robot_knows_where_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str], drives: str) -> None:
    for folder in ("robots", "inputs", "paths"):
        shutil.copytree(MISSIONS / folder, tmp_path / folder)
    file = tmp_path / "robots" / "artemis.yaml"
    shutil.copy(MISSIONS / "robots" / f"{drives}.yaml", file)
    old = load_model(file, RobotFile)
    before, _ = error_at_end(driven(tmp_path, "before", EIGHT, HIDDEN, 3))
    run = driven(tmp_path, "weaving", WEAVING, HIDDEN, 1)
    capsys.readouterr()

    calibrate_with_truth([run], ["simulation"], None, [], None, file)
    told = capsys.readouterr().out
    robot = load_model(file, RobotFile)
    after, distance = error_at_end(driven(tmp_path, "after", EIGHT, seen_by(robot, old), 4))

    assert "zero difference" in told
    assert "--store" in told
    assert "<svg" in (run / "calibration.html").read_text()
    assert "# of the contact points" in file.read_text()
    assert robot.geometry.wheelbase_m == pytest.approx(0.566, rel=3e-3)
    assert robot.potentiometers("left").scale == pytest.approx(1.004, abs=1.5e-3)
    assert before > 0.1
    assert after < 0.002 * distance
    with pytest.raises(ConfigError, match="drive again"):
        calibrate_with_truth([run], ["simulation"], None, [], None, file)


@pytest.mark.exhaustive
def test_runs_need_a_truth_or_to_return(tmp_path: Path) -> None:
    shutil.copytree(MISSIONS / "robots", tmp_path / "robots")
    shutil.copytree(MISSIONS / "paths", tmp_path / "paths")
    run = driven(tmp_path, "eight", EIGHT, {"steering_zero_left_deg": 0.3, "steering_zero_right_deg": 0.3}, 5)
    last = Recording(run).last_tick()
    assert last is not None
    assert last.true_pose is not None

    with pytest.raises(ConfigError, match="--returns-to-start"):
        calibrate_with_truth([run], [], None, [], None, None)
    with pytest.raises(ConfigError, match="3 for 1 runs"):
        calibrate_with_truth([run], ["a", "b", "c"], None, [], None, None)
    closing = tmp_path / "ends.csv"
    closing.write_text("run,x_m,y_m,heading_deg\n2,0,0,0\n")
    with pytest.raises(ConfigError, match="expected the numbers 1 to 1"):
        calibrate_closing([run], closing, None, None, None)
