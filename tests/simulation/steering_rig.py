"""Runs that measure the potentiometers of the steered wheels, and what is asked of each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rig import Rig, Run, Seen, write_mission

from artemis.drive_states import DriveState
from artemis.sim.epos import SimEpos
from artemis.sim.world import PlantParameters
from artemis.values import Mode
from artemis.vehicle import RobotFile

LEFT, RIGHT = "steer-left", "steer-right"
SIDES = ("left", "right")
HIDDEN = PlantParameters(
    steering_zero_left_deg=0.8,
    steering_zero_right_deg=-1.3,
    potentiometer_slopes_left=(1.02, 0.99),
    potentiometer_slopes_right=(0.985, 1.01),
    potentiometer_noise_v=0.001,
    backlash_deg=0.3,
)
REFERENCE = {"left": 0.8, "right": -1.3}
PLAIN = PlantParameters(steering_zero_left_deg=0.8, steering_zero_right_deg=-1.3)
LEFT_ALONE: dict[str, Any] = {"wheels": "left", "reference_deg": {"left": 0.8}}
MEMORY = 0x200C
Act = Callable[[Rig], None]


def calibrate(
    folder: Path,
    true: PlantParameters = HIDDEN,
    simulation: dict[str, Any] | None = None,
    limits: dict[str, str] | None = None,
    **words: Any,  # noqa: ANN401
) -> Rig:
    """A mission that measures; `words` as in the step, `limits` are replaced in the robot file."""
    step = {"calibrate": {"steering": {"reference_deg": REFERENCE, "save": "drives", **words}}}
    mission = write_mission(folder, [step], simulation=simulation or {})
    robot = folder / "artemis.yaml"
    for old, new in (limits or {}).items():
        assert old in robot.read_text()
        robot.write_text(robot.read_text().replace(old, new))
    return Rig(mission, true_robot=true, longest=120.0)


def true_calibration(robot: RobotFile, true: PlantParameters, side: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Zeros [V] and slopes [degrees per volt] of the machine."""
    known = robot.potentiometers(side)
    factors = getattr(true, f"potentiometer_slopes_{side}")
    slopes = tuple(slope * factor for slope, factor in zip(known.slope_deg_per_v, factors, strict=True))
    zero = getattr(true, f"steering_zero_{side}_deg")
    return tuple(v - zero / slope for v, slope in zip(known.zero_v, slopes, strict=True)), slopes


def memory(drive: SimEpos) -> tuple[int, ...]:
    """What a drive keeps, as signed numbers."""
    found = [drive.read(MEMORY, number) for number in range(1, 5)]
    assert all(isinstance(number, int) for number in found)
    return tuple(int(n) - (1 << 32) if int(n) >= 1 << 31 else int(n) for n in found)


def assert_recovered(run: Run, true: PlantParameters, error_deg: float = 0.06) -> None:
    """Within what the potentiometers' coarseness leaves; and not by chance: the robot file is further away."""
    for side in SIDES:
        found = run.results.steering[side].calibration
        zeros, slopes = true_calibration(run.plan.robot, true, side)
        for number in (0, 1):
            off = (found.zero_v[number] - zeros[number]) * slopes[number]
            assert abs(off) < error_deg, f"{side} {number}: zero is {off:.3f} degrees off"
            assert found.slope_deg_per_v[number] == pytest.approx(slopes[number], rel=1e-3)


def assert_safe(run: Run) -> None:
    """Nothing was driven, and all drives are off at the end."""
    assert all(abs(truth.speed) < 0.05 for truth in run.world.history)  # wheels roll about their kingpins
    assert run.world.truth.states == (DriveState.SWITCH_ON_DISABLED,) * 4
    began = run.first(lambda seen: seen.mode is Mode.CALIBRATE).now + 0.1
    powered = [truth for truth in run.truth_from(began) if truth.states[:2] != (DriveState.SWITCH_ON_DISABLED,) * 2]
    assert not [truth for truth in powered if truth.time < run.in_mode(Mode.CALIBRATE)[-1].now - 0.2]


def reading(seen: Seen) -> bool:
    """A wheel begins to be measured."""
    return seen.phase.startswith("reading the")


def jogs(*rows: tuple[float, str]) -> dict[str, Any]:
    return {"operator": [{"at_s": time, "do": what} for time, what in rows]}
