"""What drives measure of themselves that the robot file describes: supply, temperature, safe torque off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import CALIBRATE, MISSIONS, Rig, follow, write_mission

from artemis.drive_states import DriveState
from artemis.mission.loading import load_model
from artemis.sim.epos_settings import SimSettings
from artemis.vehicle import RobotFile

CIA402 = "artemis_cia402.yaml"
LINK = {"index": 0x6079, "type": "u32", "units_per_v": 1000}
"""DC link circuit voltage of the profile, mV."""
HEAT = {"index": 0x2500, "subindex": 1, "type": "i16", "units_per_degree": 10}
SAFE = {"index": 0x2600, "type": "u8", "closed": 0x03}


def measuring(mission: Path, **words: object) -> Path:
    """The mission on drives of the profile with these words, and the battery of a robot that has one."""
    robot = mission.with_name("artemis.yaml")
    read = yaml.safe_load(robot.read_text())
    for drive in read["drives"].values():
        drive["cia402"] = {**drive["cia402"], **words}
    read["battery"] = yaml.safe_load((MISSIONS / "robots" / "artemis_battery.yaml").read_text())["battery"]
    del read["battery"]["measured"]
    robot.write_text(yaml.safe_dump(read, sort_keys=False))
    return mission


def faulty(tmp_path: Path, *faults: dict[str, Any], **words: object) -> Path:
    steps = [CALIBRATE, follow(0.4)]
    return measuring(write_mission(tmp_path, steps, robot=CIA402, simulation={"faults": list(faults)}), **words)


def test_the_first_drive_whose_supply_is_described_measures_the_battery(tmp_path: Path) -> None:
    mission = measuring(write_mission(tmp_path, [CALIBRATE], robot=CIA402), supply=LINK)
    source = load_model(mission.with_name("artemis.yaml"), RobotFile).supply_source
    assert source is not None
    assert (source.drive, str(source.object), source.volts_per_unit) == ("traction-left", "0x6079:0", 0.001)


@pytest.mark.parametrize(
    ("id", "options"),
    [
        ("PWR-01", {"voltage": 22.0, "within_s": 0.5}),
        ("PWR-02", {"voltage": 21.0, "within_s": 0.2}),
        ("PWR-03", {"voltage": 19.0, "duration_s": 0.6}),
    ],
)
def test_the_rows_of_the_battery_are_noticed_by_what_a_drive_of_the_profile_measures(
    tmp_path: Path, id: str, options: dict[str, Any]
) -> None:
    seen = Rig(faulty(tmp_path, {"at_s": 5.0, "inject": id, **options}, supply=LINK)).run()
    assert id in seen.fault_ids
    volts = [tick.tick.snapshot.sensed.battery_v for tick in seen.seen]
    assert {type(each) for each in volts} == {float, type(None)}
    assert seen.recompute().difference is None


def test_the_temperature_of_each_power_stage_is_read(tmp_path: Path) -> None:
    mission = measuring(
        write_mission(tmp_path, [CALIBRATE, {"wait": {"seconds": 12.0}}], robot=CIA402), temperature=HEAT
    )
    seen = Rig(mission).run()
    assert (seen.status, seen.fault_ids) == (0, [])
    assert {drive.temperature_c for drive in seen.ticks[-1].snapshot.sensed.drives} == {25.0}


def test_a_drive_that_stays_off_is_asked_for_its_inputs_of_safe_torque_off(tmp_path: Path) -> None:
    rig = Rig(measuring(write_mission(tmp_path, [CALIBRATE], robot=CIA402), sto=SAFE), settings=SimSettings())

    def open_it() -> None:
        failures = rig.drive("steer-left").failures
        failures.misreport(0x2600, 0, lambda shown: 0x01)
        failures.refuse_states(DriveState.READY)

    seen = rig.at(0.1, open_it).run()
    assert [(fault.id, fault.device) for fault in seen.faults] == [("DRV-29", "steer-left")]
    assert "its STO inputs are open: they read 0x01" in seen.faults[0].text
