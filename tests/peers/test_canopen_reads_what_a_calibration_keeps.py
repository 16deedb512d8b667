"""After `calibrate: {steering: ...}` the `canopen` package reads the drives' memory: what was found is kept there."""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402
from test_canopen_drives_sim_epos import ROBOT, Wire, described

from artemis.app import run_mission
from artemis.mission.loading import load_mission
from artemis.sim.world import World

MEMORY = 0x200C


@pytest.mark.slow
def test_another_client_reads_zeros_and_slopes_after_the_power_was_gone(tmp_path: Path) -> None:
    shutil.copy(ROBOT, tmp_path / "robot.yaml")
    measure = {"reference_deg": {"left": 0.8, "right": -1.3}, "save": "drives"}
    mission = {
        "mission": "kept",
        "robot": "robot.yaml",
        "bus": "simulation",
        "steps": [{"calibrate": {"steering": measure}}],
        "simulation": {"true_robot": {"steering_zero_left_deg": 0.8, "steering_zero_right_deg": -1.3}},
    }
    source = tmp_path / "mission.yaml"
    source.write_text(json.dumps(mission))
    worlds: list[World] = []
    outcome = run_mission(load_mission(source), source, witness=lambda world: worlds.append(world) or world)  # type: ignore[func-returns-value]
    assert outcome.exit_status == 0

    for side, node in (("left", 3), ("right", 4)):
        drive = worlds[0].drive(f"steer-{side}")
        drive.power_off()
        network = Wire(drive)  # has it powered on again
        network.run(0.06)
        client = BaseNode402(node, _described())
        network.add_node(client)
        kept = [client.sdo[MEMORY][number].raw for number in range(1, 5)]
        found = outcome.steering[side].calibration
        assert [number / 1e6 for number in kept] == [*found.zero_v, *found.slope_deg_per_v]


def _described() -> object:
    objects = described()
    record = ODRecord("memory", MEMORY)
    for number in range(1, 5):
        member = ODVariable(f"number {number}", MEMORY, number)
        member.data_type = datatypes.INTEGER32
        record.add_member(member)
    objects.add_object(record)
    return objects
