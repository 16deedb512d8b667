"""Potentiometers that are supplied with another voltage than 5 V: what they show, what is refused, and their rails."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import CALIBRATE, MISSIONS, Rig, follow, run, write_mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.motion.potentiometers import is_at_a_rail
from artemis.sim.wheels import PotentiometerFailure
from artemis.vehicle import RobotFile


def supplied(mission: Path, volts: float) -> Path:
    """The mission with potentiometers supplied so, that show as much of it as those of 5 V."""
    robot = mission.with_name("artemis.yaml")
    words = yaml.safe_load(robot.read_text())
    robot.write_text(yaml.safe_dump(with_supply(words, volts), sort_keys=False))
    return mission


def with_supply(words: dict[str, Any], volts: float) -> dict[str, Any]:
    for source in words["calibration"]["steering"].values():
        source["zero_v"] = [zero * volts / 5.0 for zero in source["zero_v"]]
        source["slope_deg_per_v"] = [slope * 5.0 / volts for slope in source["slope_deg_per_v"]]
        source["supply_v"] = volts
    return words


@pytest.mark.parametrize(("robot", "volts"), [("artemis.yaml", 3.3), ("artemis_epos4.yaml", 10.0)])
def test_wheels_are_aligned_and_steered_by_them(robot: str, volts: float, tmp_path: Path) -> None:
    true = {"start_steering_left_deg": 20.0, "start_steering_right_deg": -20.0}
    steps = [CALIBRATE, follow(0.4)]
    mission = write_mission(tmp_path, steps, robot=robot, simulation={"true_robot": true})
    seen = run(supplied(mission, volts))
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)


@pytest.mark.parametrize(("shown", "there"), [(9.79, False), (9.81, True), (0.21, False), (0.19, True)])
def test_a_rail_is_two_percent_of_the_supply(shown: float, there: bool, tmp_path: Path) -> None:
    assert is_at_a_rail((5.0, shown), 10.0) is there
    mission = write_mission(tmp_path, [CALIBRATE], robot="artemis_epos4.yaml")
    rig = Rig(supplied(mission, 10.0))

    def fail() -> None:
        assert rig.world is not None
        rig.world.steered["steer-left"].failures[1] = PotentiometerFailure(stuck=shown)

    rig.at(0.0, fail)
    assert ("STE-04" in rig.run().fault_ids) is there


@pytest.mark.parametrize(
    ("robot", "change", "text"),
    [
        ("artemis", {"supply_v": 10.0}, "supply_v: the analog inputs of this drive (EPOS) read up to 5 V, found 10 V"),
        ("artemis", {"supply_v": 0.5}, "supply_v: expected 1 to 10 V, found 0.5 V"),
        (
            "artemis_epos4",
            {"supply_v": 3.3},
            "slope_deg_per_v[0]: at +-60 degrees (limits.steering_deg) the potentiometer would show 1.68 and 3.34 V; "
            "between its ends are 0 to 3.3 V (supply_v)",
        ),
    ],
)
def test_a_supply_that_does_not_fit_is_refused(robot: str, change: dict[str, float], text: str, tmp_path: Path) -> None:
    words = yaml.safe_load((MISSIONS / "robots" / f"{robot}.yaml").read_text())
    words["calibration"]["steering"]["left"].update(change)
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(words))
    with pytest.raises(ConfigError) as refused:
        load_model(file, RobotFile)
    assert f"calibration.steering.left.{text}" in refused.value.problems[0]


def test_what_an_object_can_show_limits_the_supply_of_another_drive(tmp_path: Path) -> None:
    words = with_supply(yaml.safe_load((MISSIONS / "robots/artemis_cia402.yaml").read_text()), 10.0)
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(words))
    load_model(file, RobotFile)
    for drive in words["drives"].values():
        for each in drive["cia402"].get("analog_inputs", ()):
            each["units_per_v"] = 4000
    file.write_text(yaml.safe_dump(words))
    with pytest.raises(ConfigError, match=r"\(CiA 402 drive\) read up to 8.19 V, found 10 V"):
        load_model(file, RobotFile)
