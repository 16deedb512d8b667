"""A mission's `simulation.faults`: what it asks for happens at its time, is in the journal, and replays."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, MISSIONS, STICK, TELEOP, Run, follow, run, stick, write_mission

from artemis.clock import run as run_loop
from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState
from artemis.errors import ConfigError
from artemis.mission import injector, load_mission, mission_schema
from artemis.mission.injector import FaultInjector, Simulated
from artemis.mission.schema import InjectedFault
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.plugins.inputs.scripted import ScriptedConfig, ScriptedInput
from artemis.recording.disk import Disk
from artemis.recording.journal import Entry, read_journal
from artemis.sim.bus import SimBus
from artemis.sim.world import World
from artemis_lab.injections import missions
from artemis_lab.injections.bad_plugins import BadInput
from artemis_lab.injections.stage import Needs
from artemis_lab.injections.table import INJECTIONS

pytestmark = pytest.mark.short_alignment


def faulty(folder: Path, *faults: dict[str, Any], by_hand: bool = False) -> Run:
    """A run that brings up, aligns and drives at 0.2 m/s, with these faults."""
    rows = [(0.0, 0.0, 0.0, 0), (5.4, 0.0, 0.5, 1), (10.4, 0.0, 0.0, 0)]
    steps = [CALIBRATE, TELEOP if by_hand else follow()]
    files = {"stick.csv": stick(*rows)}
    return run(write_mission(folder, steps, files, inputs=STICK, simulation={"seed": 3, "faults": list(faults)}))


def injected(done: Run) -> list[Entry]:
    assert done.outcome is not None
    return [entry for entry in read_journal(done.outcome.run.journal).entries if entry.kind == "injected"]


def test_injection_is_written_to_the_journal_at_its_run_time(tmp_path: Path) -> None:
    done = faulty(
        tmp_path,
        {"at_s": 5.413, "inject": "COM-13", "node": "steer-left", "duration_s": 0.5},
        {"at_s": 6.4, "inject": "DRV-25", "node": "steer-right", "heard": False},
    )
    first, second = injected(done)
    assert first.time == pytest.approx(5.413)
    assert second.time == pytest.approx(6.4)
    assert first.text == "COM-13 steer-left: feedback arrives twice"
    assert first.data == {"id": "COM-13", "device": "steer-left", "duration_s": 0.5}
    assert second.data == {"id": "DRV-25", "device": "steer-right", "heard": False}
    state = next(truth.states[3] for truth in done.truth_from(6.42))
    assert state in (DriveState.FAULT, DriveState.FAULT_REACTION_ENABLED)
    assert not [frame for frame in done.bus.heard if frame.id == 0x084 and frame.data[:2] == b"\x11\x86"]


def test_fault_at_zero_is_there_before_the_first_tick(tmp_path: Path) -> None:
    done = faulty(tmp_path, {"at_s": 0.0, "inject": "COM-32"})
    (entry,) = injected(done)
    assert entry.time == 0.0
    assert not done.bus.heard


FOLLOWER_FAULTS: list[dict[str, Any]] = [
    {"inject": "PLG-02"},
    {"inject": "PLG-03", "seconds": 0.03},
    {"inject": "PLG-06", "returns": "a text"},
    {"inject": "RUN-11", "value": "inf"},
    {"inject": "RUN-12", "duration_s": 0.5},
    {"inject": "PTH-08", "duration_s": 6.0},
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", FOLLOWER_FAULTS, ids=lambda fault: str(fault["inject"]))
def test_fault_of_a_follower_replays_bit_for_bit(tmp_path: Path, fault: dict[str, Any]) -> None:
    done = faulty(tmp_path, {"at_s": 5.9, **fault})
    assert len(injected(done)) == 1
    before = [seen.tick.wish.command for seen in done.seen if 5.4 < seen.time < 5.89]
    after = [seen.tick.wish.command for seen in done.seen if 5.89 < seen.time < 10.4]
    assert {round(command.speed, 3) for command in before} == {0.2}
    drives_on = fault["inject"] == "PTH-08"  # the path would have ended at 9.9 s
    assert ({round(command.speed, 3) for command in after} == {0.2}) is drives_on
    assert done.recompute().difference is None


def test_fault_of_an_input_happens_and_ends(tmp_path: Path) -> None:
    done = faulty(tmp_path, {"at_s": 6.4, "inject": "INP-09", "duration_s": 0.5}, by_hand=True)
    held = {round(seen.time, 2): seen.tick.snapshot.sensed.inputs[0].enabled for seen in done.seen if seen.time > 5.9}
    assert [held[time] for time in (6.3, 6.44, 6.8, 6.96)] == [True, False, False, True]


def test_same_seed_makes_the_same_run(tmp_path: Path) -> None:
    fault = {"at_s": 5.4, "inject": "COM-14", "bits": 2, "length": None, "probability": 0.5, "count": None}
    one, two = (faulty(tmp_path / name, fault) for name in ("one", "two"))
    assert one.bus.heard == two.bus.heard
    assert [tick.snapshot.sensed for tick in one.ticks] == [tick.snapshot.sensed for tick in two.ticks]


def test_mission_may_name_every_injection(tmp_path: Path) -> None:
    node = {Needs.DRIVE: "steer-left", Needs.TRACTION: "traction-left", Needs.STEERING: "steer-left"}
    faults = [
        {"at_s": 1.0, "inject": id, **({"node": node[injection.needs]} if injection.needs in node else {})}
        for id, injection in INJECTIONS.items()
        if "epos1" in (injection.families or ("epos1",))
    ]
    steps = [CALIBRATE, follow(), TELEOP]
    files = {"stick.csv": stick((0.0, 0.0, 0.0, 0))}
    robot = "artemis_lms100.yaml"
    mission = write_mission(tmp_path, steps, files, robot, inputs=STICK, simulation={"faults": faults})
    assert [fault.inject for fault in load_mission(mission).mission.simulation.faults] == [
        fault["inject"] for fault in faults
    ]


def test_error_code_and_object_must_be_of_the_drives_family(tmp_path: Path) -> None:
    node = {"at_s": 1.0, "node": "steer-left"}
    faults: list[dict[str, object]] = [
        {**node, "inject": "DRV-34"},
        {**node, "inject": "DRV-13", "code": 0x7381},
        {**node, "inject": "COM-10", "index": 0x605A},
    ]
    with pytest.raises(ConfigError) as caught:
        load_mission(write_mission(tmp_path, [CALIBRATE], simulation={"faults": faults}))
    assert [problem.split(": ", 2)[2] for problem in caught.value.problems] == [
        "DRV-34 is no error of a drive of family epos1, only of epos4",
        "expected 0xFF02 or 0xFF03 of a drive of family epos1, found 0x7381",
        "a drive of family epos1 has no object 0x605A sub-index 0",
    ]
    others = write_mission(
        tmp_path / "epos4", [CALIBRATE], robot="artemis_epos4.yaml", simulation={"faults": faults[1:]}
    )
    assert len(load_mission(others).mission.simulation.faults) == 2


def test_fault_of_a_plugin_that_the_mission_does_not_have_is_refused(tmp_path: Path) -> None:
    faults = [{"at_s": 1.0, "inject": "INP-03"}, {"at_s": 1.0, "inject": "PTH-09"}]
    with pytest.raises(ConfigError) as caught:
        load_mission(write_mission(tmp_path, [CALIBRATE], simulation={"faults": faults}))
    assert [problem.split(": ", 2)[2] for problem in caught.value.problems] == [
        "INP-03 needs an input: the mission has none",
        "PTH-09 needs a follower or a behaviour: no step has one",
    ]


def test_fault_of_a_scanner_that_the_robot_does_not_have_is_refused(tmp_path: Path) -> None:
    faults: list[dict[str, object]] = [{"at_s": 1.0, "inject": "LAS-01"}]
    with pytest.raises(ConfigError, match="LAS-01 needs a scanner: the robot has none"):
        load_mission(write_mission(tmp_path, [CALIBRATE], simulation={"faults": faults}))
    faults[0]["scanner"] = "frnt"
    with pytest.raises(ConfigError, match="no such scanner: frnt; did you mean front"):
        load_mission(write_mission(tmp_path, [CALIBRATE], robot="artemis_lms100.yaml", simulation={"faults": faults}))


def test_schema_knows_what_can_be_injected() -> None:
    schema: dict[str, Any] = mission_schema()
    assert schema["$defs"]["InjectedFault"]["properties"]["inject"]["enum"] == list(INJECTIONS)


def test_mission_without_faults_loads_none_of_it() -> None:
    code = f"""
import sys, tempfile
from pathlib import Path
from artemis.errors import ConfigError
from artemis.mission import injector, load_mission, mission_schema
from artemis.mission.injector import FaultInjector, Simulated
from artemis.mission.schema import InjectedFault
load_mission(Path({str(MISSIONS / "figure_eight.yaml")!r}))
import artemis.app
sys.exit(any(name.startswith(("artemis.testing", "artemis_lab")) for name in sys.modules))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_faults_are_refused_where_nothing_makes_them_happen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mission = write_mission(tmp_path, [CALIBRATE], simulation={"faults": [{"at_s": 1.0, "inject": "COM-22"}]})
    gone = EntryPoint("lab", "no_such_package.injections", injector.GROUP)
    for points in ([], [gone]):
        monkeypatch.setattr(injector, "entry_points", lambda group, points=points: points)
        with pytest.raises(ConfigError) as caught:
            load_mission(mission)
        (problem,) = caught.value.problems
        assert problem.endswith("simulation.faults: the package artemis_lab makes them happen: it is not installed")
        assert "enum" not in mission_schema()["$defs"]["InjectedFault"]["properties"]["inject"]  # type: ignore[index]


def test_mission_without_faults_has_its_bus_as_it_is(tmp_path: Path) -> None:
    done = faulty(tmp_path)
    assert done.status == 0
    assert injected(done) == []


# ---------------------------------------------------------------------------------------------- without a mission


def test_injector_wraps_the_inputs_of_a_run_where_they_lie() -> None:
    robot = load_mission(MISSIONS / "figure_eight.yaml").robot
    lab: FaultInjector = missions

    async def main() -> None:
        world = World(robot)
        bus = lab.failing_bus(SimBus(world, robot.bitrate, asyncio.get_running_loop()), seed=0)
        device = ScriptedInput(ScriptedConfig(file="stick.csv"), context)
        inputs: dict[str, InputDevice] = {"stick": device}
        noted: list[Entry] = []
        run = Simulated(
            robot=robot,
            world=world,
            bus=bus,
            disk=Disk(),
            inputs=inputs,
            localizer=None,
            request=lambda request: None,
        )
        lab.begin(run, [InjectedFault(at_s=0.0, inject="COM-22")], noted.append)
        assert isinstance(inputs["stick"], BadInput)
        with pytest.raises(ConnectionError, match="unplugged"):
            bus.send(Frame(0x080))
        assert [entry.text for entry in noted] == ["COM-22: the adapter is unplugged"]

    context = PluginContext(
        name="stick", robot=robot, folder=Path(), files={"stick.csv": b"time_s,x,y,enable\n0,0,0,0\n"}
    )
    run_loop(main(), simulated=True)
