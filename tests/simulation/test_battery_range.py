"""Whole runs with a battery and a robot that are not as the file says: how far it still reaches is known."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import yaml
from rig import CALIBRATE, MISSIONS, Rig, robot_text, write_mission

from artemis.battery import Battery, BatteryState
from artemis.mission.loading import load_mission

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
CAPACITY, SMALL = 0.4, 0.2
"""[Ah]: a robot that is empty after a quarter of an hour, not after ten; and in half of that, for each change."""
TELLS = {"artemis_battery.yaml": 0.02, "artemis_epos4.yaml": 0.05}
"""Down to so much charge above the reserve, by robot: a tenth of it is half a step in which the voltage is measured,
15 mV (10 bits behind the divider) and 50 mV; the curve rises there by 95 mV for 1 % of the charge."""
LAP: dict[str, Any] = {"follow": {"path": "circle.csv", "follower": {"plugin": "frenet", "speed_m_s": 0.5}}}
DRIVE: dict[str, Any] = {
    "try": {"steps": [{"repeat": {"steps": [LAP]}}], "catch": {"battery-short": [{"say": "not another lap"}]}}
}


def driven(
    folder: Path, seed: int, robot: str, start_v: float, capacity: float = CAPACITY
) -> list[tuple[float, float, BatteryState]]:
    """Of each tick under way: true charge above the reserve, true metres to there, and what is estimated.

    Hidden: capacity, idle power, resistance; and of the file's numbers are wrong the force for a current, and what a
    metre takes.
    """
    dice = Random(seed)
    described = yaml.safe_load(robot_text("artemis_battery.yaml"))["battery"]
    described |= {
        "capacity_ah": capacity,
        "newtons_per_ampere": described["newtons_per_ampere"] * dice.uniform(0.9, 1.1),
        "joules_per_metre": 72.0 * dice.uniform(0.7, 1.3),
    }
    supply = {
        "battery_v": start_v,
        "capacity_scale": dice.uniform(0.9, 1.1),
        "idle_w": described["idle_w"] * dice.uniform(0.85, 1.15),
        "source_resistance_ohm": described["resistance_ohm"] * dice.uniform(0.8, 1.2),
    }
    simulation = {"seed": seed, "pace": "fast", "true_robot": {"supply": supply}}
    files = {"circle.csv": (MISSIONS / "paths/circle.csv").read_text()}
    mission = write_mission(folder, [CALIBRATE, DRIVE], files, robot, simulation=simulation, tick_hz=25)
    file = mission.with_name("artemis.yaml")
    words = yaml.safe_load(file.read_text())
    words["battery"] = described if "epos4" not in robot else {k: v for k, v in described.items() if k != "measured"}
    file.write_text(yaml.safe_dump(words, sort_keys=False))
    battery = load_mission(mission).robot.battery
    assert battery is not None
    return _under_way(Rig(mission, longest=4000.0), battery)


def _under_way(rig: Rig, battery: Battery) -> list[tuple[float, float, BatteryState]]:
    seen: list[tuple[float, float, BatteryState]] = []

    def note(tick: Any) -> bool:  # noqa: ANN401 (of the rig)
        snapshot = tick.tick.snapshot
        if snapshot.battery is not None and abs(snapshot.odometry.speed) > 0.1:
            assert rig.world is not None
            charge = battery.charge_at(rig.world.battery_v) - battery.reserve_percent / 100.0
            seen.append((charge, snapshot.odometry.driven, snapshot.battery))
        return False

    rig.when(note, lambda: None)
    assert rig.run().status == 0
    charges, metres = np.array([charge for charge, _, _ in seen]), np.array([metre for _, metre, _ in seen])
    last = metres > metres[-1] - 50.0
    per_metre = (charges[last][0] - charges[-1]) / (metres[-1] - metres[last][0])
    end = metres[-1] + charges[-1] / per_metre  # it stopped when another lap was too far
    return [(charge, end - metre, told) for (charge, _, told), metre in zip(seen, metres, strict=True)]


@pytest.mark.parametrize(
    "robot", ["artemis_battery.yaml", pytest.param("artemis_epos4.yaml", marks=pytest.mark.exhaustive)]
)
@pytest.mark.parametrize(
    ("seed", "capacity"),
    [(1, SMALL), *(pytest.param(seed, CAPACITY, marks=pytest.mark.exhaustive) for seed in range(1, 9))],
)
def test_from_half_charge_on_the_range_is_right_within_a_tenth(
    tmp_path: Path, seed: int, capacity: float, robot: str
) -> None:
    """Of a battery that was full when the run began."""
    told = driven(tmp_path, seed, robot, 25.55, capacity)
    late = [(left, state) for charge, left, state in told if TELLS[robot] < charge < 0.4]
    assert len(late) > 6000 * capacity
    wrong = [(left, state.range_m) for left, state in late if abs(state.range_m - left) > 0.1 * left]
    assert not wrong, f"{len(wrong)} of {len(late)}, such as {wrong[0]}"
    assert all(abs(state.range_m - left) < 2.0 * state.range_std_m for left, state in late)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(1, 7))
def test_a_run_that_begins_at_half_charge_knows_it_as_well_as_it_says(tmp_path: Path, seed: int) -> None:
    """Nothing measured tells a wrong capacity from a right one before some of it was taken: the error is the file's."""
    robot = "artemis_battery.yaml"
    told = driven(tmp_path, seed, robot, 24.4)
    assert all(abs(state.range_m - left) < 2.0 * state.range_std_m for _, left, state in told)
    errors = [(charge, abs(state.range_m - left) / left) for charge, left, state in told if charge > TELLS[robot]]
    assert max(error for charge, error in errors if charge < 0.35) < 0.3
    assert max(error for charge, error in errors if charge < 0.2) < 0.15
