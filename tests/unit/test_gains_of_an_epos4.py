"""`artemis calibrate gains` with EPOS4 drives: gains in SI units, from the command to the drives and the robot file."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from gains_rig import ROBOT, SETTLED, storing

from artemis.commands import calibrate_gains as command
from artemis.commands.calibrate_gains import Wanted, trial_from
from artemis.commands.gains_auto import Identified, calibrate_auto
from artemis.commands.gains_trial import Findings, Trial, write_mission
from artemis.devices.can_bus import FrameBus
from artemis.drive_schema import SiGains
from artemis.errors import ConfigError
from artemis.mission.actions import NewGains
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import plan_from
from artemis.sim.bus import SimBus
from artemis.sim.world import World
from artemis.states.gains import GainsStep

LEFT, DRIVEN, OTHER = "steer-left", "traction-left", "traction-right"


def mission(folder: Path, **changes: Any) -> Path:  # noqa: ANN401 (as in a mission)
    """With the robot file of four EPOS4."""
    text = (ROBOT.parent / "artemis_epos4.yaml").read_text()
    (folder / "robots").mkdir(exist_ok=True)
    (folder / "robots" / "robot.yaml").write_text(text)
    content = {"mission": "m", "robot": "robots/robot.yaml", "bus": "simulation", "steps": [{"wait": {"seconds": 1}}]}
    path = folder / "mission.yaml"
    path.write_text(json.dumps({**content, **changes}))
    return path


def problems(path: Path, *drives: str, **gains: str) -> str:
    with pytest.raises(ConfigError) as caught:
        trial_from(load_mission(path), Wanted(drives=drives, gains=gains))
    return str(caught.value)


def test_a_trial_gives_the_drive_what_the_words_say_in_its_own_units(tmp_path: Path) -> None:
    path = mission(tmp_path)
    loaded = load_mission(path)
    trial = trial_from(loaded, Wanted(drives=(DRIVEN,), gains={"velocity": "0.05,2"}))
    assert trial.new == NewGains(velocity=(0.05, 2))
    (tmp_path / "trial").mkdir()
    made, _ = write_mission(loaded, path, trial, tmp_path / "trial")
    (step,) = [step for step in plan_from(made).steps if isinstance(step, GainsStep)]
    assert step.gains == {DRIVEN: (1171880, 3906250, 50000, 2000000, 1500000, 780000, 16000)}


def test_what_an_epos4_does_not_take_and_what_is_too_much_is_told_in_the_robot_file_s_units(tmp_path: Path) -> None:
    path = mission(tmp_path)
    assert "velocity P 4295: expected 0 to 4294 (EPOS4)" in problems(path, DRIVEN, velocity="4295.0,1")
    assert "velocity P 0.25: at most 10 times the present 0.024" in problems(path, DRIVEN, velocity="0.25,0.9")
    assert "current I 39063: at most 10 times the present 3906.25" in problems(path, LEFT, current="1,39063")
    assert "these are the gains of the robot file already" in problems(path, DRIVEN, velocity="0.024,0.9")


def test_drives_whose_gains_have_different_units_are_not_tried_together(tmp_path: Path) -> None:
    path = mission(tmp_path)
    robot = tmp_path / "robots" / "robot.yaml"
    other = (
        "    side: right\n    mirrored: true\n    family: epos1\n    hardware_version: 0x6210\n    si_gains: null\n"
        "    gains: {current: [400, 120], velocity: [1200, 180], position: [150, 10, 200]}\n"
        "    motor: {type: ec_block, pole_pairs: 12, continuous_current_ma: 5000, output_current_ma: 10000,\n"
        "            thermal_time_constant_s: 52.6, max_speed_rpm: 3190}\n"
    )
    robot.write_text(robot.read_text().replace("    side: right\n    mirrored: true\n", other, 1))
    told = "the gains of these drives have different units: try one family after the other"
    assert told in problems(path, DRIVEN, OTHER, velocity="1,1")


def test_loads_need_gains_in_the_robot_file(tmp_path: Path) -> None:
    loads: Any = {"true_robot": {"loads": {"traction": {}}}}
    path = mission(tmp_path, simulation=loads)
    load_mission(path)
    robot = tmp_path / "robots" / "robot.yaml"
    before, _, after = robot.read_text().partition("    si_gains:")
    robot.write_text(before + after[after.index("}") :].partition("\n")[2])  # the first drive's
    with pytest.raises(ConfigError, match="only for drives with `si_gains` in the robot file: traction-left has none"):
        load_mission(path)


def test_gains_that_are_kept_are_stored_and_written_in_si_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = storing(monkeypatch)
    loaded = load_mission(mission(tmp_path))
    new = NewGains(position=(6.25, 2.5, 1e-5))
    trial = Trial(drives=(LEFT,), role="steering", side="left", step=5.0, new=new)
    found = Findings(traces={}, responses={"now": [SETTLED], "new": [SETTLED]})
    assert command.decide(loaded, trial, found, yes=True) == 0
    assert stored == [{LEFT: (1171880, 3906250, 20000, 500000, 6250000, 2500000, 10)}]
    kept = load_mission(tmp_path / "mission.yaml").robot.drives[LEFT].si_gains
    assert kept == SiGains(current=(1.17188, 3906.25), velocity=(0.02, 0.5), position=(6.25, 2.5, 1e-5))


def test_the_robot_file_s_gains_are_shown_beside_the_drives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.calibrate_gains(mission(tmp_path), Wanted(drives=(DRIVEN,), gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].split() == [DRIVEN, "robot", "file", "1.17188,3906.25", "0.024,0.9", "1.5,0.78,0.016"]
    assert lines[3].split() == ["drive", "1.17188,3906.25", "0.02,0.5", "*", "1.5,0.78,0.016"]
    assert len({line.index("1.5,0.78") for line in lines[2:4]} | {lines[1].index("position P")}) == 1


@pytest.mark.parametrize("structure", [0x10101, 0x10111, 0x10121])
@pytest.mark.parametrize("said", [None, False, True])
def test_the_structure_that_a_drive_s_gains_are_for_is_shown_beside_them(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    structure: int,
    said: bool | None,
) -> None:
    """0x3000:2, second hexadecimal digit: 1 is the low pass, 2 the observer."""
    path = mission(tmp_path)
    robot = tmp_path / "robots" / "robot.yaml"
    gains = "si_gains: {current: [1.17188, 3906.25], velocity: [0.02, 0.5], position: [1.5, 0.78, 0.016]"
    assert gains in robot.read_text()
    instead = gains + f", observer: {str(said).lower()}" if said is not None else "# {"
    robot.write_text(robot.read_text().replace(gains, instead))

    def left(loaded: LoadedMission, simulated: bool) -> FrameBus:
        loop = asyncio.get_running_loop()
        world = World(loaded.robot, loaded.true_robot, start=loop.time())
        world.drive(LEFT).poke(0x3000, 2, structure)
        return SimBus(world, loaded.robot.bitrate, loop)

    monkeypatch.setattr(command, "open_bus", left)

    assert command.calibrate_gains(path, Wanted(drives=(LEFT,), gains={})) == 0

    file, drive, *rest = capsys.readouterr().out.splitlines()[2:]
    has = structure == 0x10121
    differs = said is not None and said != has
    assert file.endswith("  observer: true") is bool(said)
    assert drive.endswith(f"  observer: {str(has).lower()}{' *' * differs}") is (has or differs)
    assert bool(rest) is differs


@pytest.mark.parametrize(
    ("name", "observer", "told"), [(DRIVEN, True, True), (DRIVEN, False, False), (LEFT, True, False)]
)
def test_gains_that_are_found_are_for_no_observer(tmp_path: Path, name: str, observer: bool, told: bool) -> None:
    """That of the velocity regulator: steered wheels get others of the position regulator."""
    robot = load_mission(mission(tmp_path)).robot
    gains = robot.drives[name].si_gains
    assert gains is not None
    drive = robot.drives[name].model_copy(update={"si_gains": gains.model_copy(update={"observer": observer})})
    robot = robot.model_copy(update={"drives": {**robot.drives, name: drive}})
    trial = Trial(drives=(name,), role=drive.role, side=drive.side, step=0.2, new=None)

    lines = list(Identified(robot, trial).lines())

    assert (
        any(
            line.endswith(f"{name}: computed as a plain PI loop, without the observer (si_gains.observer)")
            for line in lines
        )
        is told
    )


@pytest.mark.exhaustive
def test_driven_wheels_get_gains_that_settle_much_sooner(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    load: Any = {"inertia_scale": 1.3, "friction_scale": 0.8, "play_deg": 0.2, "delay_ms": 3.0}
    path = mission(tmp_path, simulation={"true_robot": {"loads": {"traction": load}}})
    assert calibrate_auto(path, Wanted(drives=(DRIVEN, OTHER), gains={})) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("restored    traction-left, traction-right") for line in lines)
    now, new = ([line.split() for line in lines if line.startswith(f"{label} ")][-1] for label in ("now", "new"))
    quickest_now, slowest_new = float(now[8]), float(new[10])
    assert slowest_new <= 0.6 * quickest_now
    assert "not" not in new, "each one settles"
    assert any(line.startswith("better") for line in lines)
