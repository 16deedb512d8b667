"""`--page`: what it adds to a mission, what it refuses, and that such a run still replays."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from page_rig import MISSIONS

from artemis.app import Parts, run_mission
from artemis.clock import SimulatedLoop
from artemis.commands.one_step import mission_of
from artemis.commands.replay import replay_run
from artemis.drive_states import DriveState
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.mission.page import add_page, has_page
from artemis.planning import inputs_used, is_fast, plan_from, plugin_made, setup_for
from artemis.plugins.inputs.scripted import ScriptedInput
from artemis.states.plan import Shared, TeleopStep
from artemis.values import Mode, Tick


def test_the_page_drives_beside_the_others_and_no_faster() -> None:
    loaded = load_mission(MISSIONS / "teleop_keyboard.yaml", page={"port": 9999})
    (step,) = (step for step in plan_from(loaded).steps if isinstance(step, TeleopStep))
    assert (step.input, step.lower, step.speed) == ("keys", ("page",), 0.5)
    assert loaded.mission.inputs["page"].options == {"required": False, "max_speed_m_s": 0.5}
    assert loaded.mission.observers["page"].options == {"input": "page", "port": 9999}


def test_a_mission_without_an_operator_is_left_as_it_is_and_keeps_real_time() -> None:
    plain = load_mission(MISSIONS / "figure_eight.yaml")
    with_page = load_mission(MISSIONS / "figure_eight.yaml", page={})
    assert [type(step) for step in plan_from(plain).steps] == [type(step) for step in plan_from(with_page).steps]
    assert (is_fast(plain), is_fast(with_page)) == (True, False)


def test_a_mission_s_own_page_stays() -> None:
    loaded = load_mission(MISSIONS / "page_teleop.yaml", page={"port": 9999})
    assert loaded.mission.inputs["page"].options == {"max_speed_m_s": 0.7}
    assert loaded.mission.observers["page"].options == {"port": 9999}


def test_adding_it_again_changes_nothing() -> None:
    mission: dict[str, Any] = {"inputs": {"a": {"plugin": "x"}}, "steps": [{"teleop": {"input": "a"}}]}
    assert not has_page(mission)
    add_page(mission, {})
    assert has_page(mission)
    assert mission["steps"] == [{"teleop": {"inputs": ["a", "page"]}}]
    once = repr(mission)
    add_page(mission, {})
    assert repr(mission) == once


@pytest.mark.parametrize(
    ("mission", "allowed"),
    [
        ("ros_goto.yaml", ("initialpose",)),  # its localizer takes one
        ("goto_workshop.yaml", None),
        ("figure_eight.yaml", None),
    ],
)
def test_a_page_that_is_added_allows_what_the_mission_takes(mission: str, allowed: tuple[str, ...] | None) -> None:
    options = load_mission(MISSIONS / mission, page={}).mission.inputs["page"].options
    assert options.get("allow") == (None if allowed is None else list(allowed))


def test_a_step_that_asks_a_page_for_its_goal_has_it_added() -> None:
    given: dict[str, Any] = {"steps": [{"repeat": {"steps": [{"goto": {"to": {"from_input": "page"}}}]}}]}
    add_page(given, {})
    assert given["inputs"]["page"] == {"plugin": "page", "required": False, "allow": ["goal_pose"]}


@pytest.mark.parametrize("localizer", [{"plugin": "no such"}, {"plugin": 3}, "scan_map"])
def test_a_localizer_that_is_none_is_left_to_the_mission_s_reader(localizer: object) -> None:
    given: dict[str, Any] = {"localizer": localizer, "steps": []}
    add_page(given, {})
    assert "allow" not in given["inputs"]["page"]


def test_a_mission_of_one_step_is_served_at_a_page_where_that_is_wanted() -> None:
    step = {"calibrate": {"steering": {"wheels": "left", "save": "nothing"}}}
    with mission_of(MISSIONS / "figure_eight.yaml", "calibrate-steering", step, page={"port": 9999}) as (loaded, _):
        assert loaded.mission.observers["page"].options == {"input": "page", "port": 9999}
        assert not is_fast(loaded)


@pytest.mark.parametrize("section", ["inputs", "observers"])
def test_another_thing_of_its_name_is_refused(section: str) -> None:
    with pytest.raises(ConfigError, match=f"{section}.page"):
        add_page({section: {"page": {"plugin": "other"}}}, {})


@pytest.mark.parametrize("mission", [{}, {"inputs": 3, "observers": [], "steps": "x"}, {"steps": [{"teleop": 3}, 4]}])
def test_what_is_no_mission_is_left_to_its_reader(mission: dict[str, Any]) -> None:
    add_page(mission, {})


@pytest.mark.slow
def test_a_run_with_a_page_that_was_added_replays(tmp_path: Path) -> None:
    """The recorded file of the mission does not have the page; the recorded mission has."""
    loaded = load_mission(MISSIONS / "teleop_scripted.yaml", page={})
    mission = loaded.mission.model_copy(update={"record": str(tmp_path), "observers": {}})
    loaded = replace(loaded, mission=mission)
    uses = inputs_used(loaded, simulated=True)
    devices = {
        name: plugin_made("artemis.inputs", use, setup_for(loaded, name))
        for name, use in uses.items()
        if name != "page"
    }
    assert any(isinstance(device, ScriptedInput) for device in devices.values())
    outcome = run_mission(loaded, MISSIONS / "teleop_scripted.yaml", parts=Parts(inputs=devices, loop=SimulatedLoop))
    assert replay_run(outcome.run.path) == 0


def test_a_run_that_a_page_started_waits_for_arm() -> None:
    plans = [
        plan_from(load_mission(MISSIONS / "figure_eight.yaml", page={"started_by_page": started}))
        for started in (True, False)
    ]
    assert [Shared(plan).bring_up.armed for plan in plans] == [False, True]


@pytest.mark.exhaustive
def test_before_the_first_arm_no_recovery_enables_the_drives(tmp_path: Path) -> None:
    raw = (MISSIONS / "figure_eight.yaml").read_text()
    more = (
        "supervision: {wait_for_arm: true}\nrecovery: {SYS-01: {resume: continue}}\n"
        f"record: {tmp_path}\nsimulation:\n  operator: [{{at_s: 12.0, do: arm}}, {{at_s: 20.0, do: end}}]\n"
        "  faults: [{at_s: 1.0, inject: SYS-01}, {at_s: 8.0, inject: SYS-01}]\n"
    )
    for folder in ("robots", "paths"):
        shutil.copytree(MISSIONS / folder, tmp_path / folder)
    mission = tmp_path / "mission.yaml"
    mission.write_text(raw.partition("simulation:")[0] + more)
    ticks: list[Tick] = []
    run_mission(load_mission(mission), mission, watch=lambda tick, traffic: ticks.append(tick))
    stopped = [tick for tick in ticks if tick.mode in (Mode.QUICKSTOP, Mode.FAULT)]
    assert round(stopped[0].snapshot.time) == 1
    on = [
        tick.snapshot.time
        for tick in ticks
        if any(drive.state is DriveState.OPERATION_ENABLE for drive in tick.snapshot.sensed.drives)
    ]
    assert 12.0 < on[0] < 20.0
