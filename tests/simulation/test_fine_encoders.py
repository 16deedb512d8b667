"""Whole runs on servo drives whose encoders count finely: their 32-bit counters overflow on the way."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from rig import CALIBRATE, Rig, follow, write_mission

COUNTS = 1 << 17
AROUND = 0.766
"""Of a driven wheel [m]."""


def with_encoders(mission: Path, traction: int, steering: int) -> Path:
    """The mission with encoders of so many counts per turn."""
    robot = mission.with_name("artemis.yaml")
    words = yaml.safe_load(robot.read_text())
    for drive in words["drives"].values():
        counts = traction if drive["role"] == "traction" else steering
        drive["sensor"] = {"type": "encoder_3_channel", "counts_per_turn": counts}
        drive["motor"] = {**drive["motor"], "type": "ec_sine", "pole_pairs": 4}
        turn = counts * drive["gear_ratio"]
        if drive["role"] == "traction":
            words["calibration"]["traction"][f"{drive['side']}_m_per_count"] = AROUND / turn
        else:
            drive["following_error_counts"] = round(turn / 100)
    robot.write_text(yaml.safe_dump(words, sort_keys=False))
    return mission


@pytest.mark.parametrize(("traction", "steering"), [(COUNTS, COUNTS), (1 << 24, 1 << 22)])
def test_a_short_path_is_driven_with_fine_encoders(tmp_path: Path, traction: int, steering: int) -> None:
    """With 2^24 counts of the motor, 50 times a turn of the wheel, 2^31 of them are passed in 1.96 m."""
    path = "x,y\n" + "".join(f"{index / 10:.1f},0.0\n" for index in range(24))
    steps = [CALIBRATE, follow(0.4)]
    mission = write_mission(tmp_path, steps, {"line.csv": path}, robot="artemis_cia402.yaml")
    rig = Rig(with_encoders(mission, traction, steering))
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    assert seen.cross_track() < 0.005
    assert rig.world is not None
    came_around = int(rig.world.nodes[0].read(0x6064, 0)) < 0
    assert came_around == (traction > COUNTS)
