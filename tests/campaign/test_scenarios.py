"""What a seed becomes, and what the monitor expects of it."""

from __future__ import annotations

import json
import re
import signal
from collections import Counter
from pathlib import Path

import pytest
from staged import ROBOT, SEEING

from artemis.devices.can_bus import Traffic
from artemis.mission.loading import load_mission, load_model
from artemis.progress import OWN_STEPS
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Found, Kind
from artemis.values import Tick
from artemis.vehicle import RobotFile
from artemis_lab.campaign.monitor.expected import EXPECTED, When
from artemis_lab.campaign.monitor.faults import AUTOMATIC, BY_ITSELF, FINAL
from artemis_lab.campaign.one_run import InterruptedRun, run_scenario
from artemis_lab.campaign.scenario import NOT_DRAWN, OF_SCANNERS, scenario
from artemis_lab.injections.table import INJECTIONS

SEEDS = range(400)


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return load_model(ROBOT, RobotFile)


@pytest.mark.parametrize("seed", range(25))
def test_every_scenario_is_a_mission_that_may_run(seed: int, robot: RobotFile, tmp_path: Path) -> None:
    load_mission(scenario(seed, robot).write(tmp_path, ROBOT.read_bytes()))


def test_seed_says_everything(robot: RobotFile) -> None:
    assert scenario(7, robot) == scenario(7, robot)
    assert scenario(7, robot) != scenario(8, robot)


@pytest.mark.slow
def test_every_injection_is_drawn_or_says_why_not(robot: RobotFile) -> None:
    drawn = {fault["inject"] for seed in range(3000) for fault in scenario(seed, robot).faults}

    of_others = {id for id, injection in INJECTIONS.items() if "epos1" not in (injection.families or ("epos1",))}
    assert drawn == set(INJECTIONS) - set(NOT_DRAWN) - set(OF_SCANNERS) - of_others
    on_epos4 = load_model(ROBOT.with_name("artemis_epos4.yaml"), RobotFile)
    drawn_there = {fault["inject"] for seed in range(150) for fault in scenario(seed, on_epos4).faults}
    assert drawn_there & of_others


@pytest.mark.parametrize("seed", range(10))
def test_every_scenario_among_things_may_run(seed: int, tmp_path: Path) -> None:
    load_mission(scenario(seed, load_model(SEEING, RobotFile)).write(tmp_path, SEEING.read_bytes()))


def test_every_injection_of_scanners_is_drawn_for_a_robot_that_has_one() -> None:
    robot = load_model(SEEING, RobotFile)
    given = [scenario(seed, robot) for seed in range(300)]

    assert {fault["inject"] for it in given for fault in it.faults} >= set(OF_SCANNERS)
    assert {it.mission["obstacles"]["mode"] for it in given} == {"stop", "slow"}
    assert all(it.resumed_after is not None for it in given)


def test_scenarios_are_of_all_kinds(robot: RobotFile) -> None:
    scenarios = [scenario(seed, robot) for seed in SEEDS]

    kinds = Counter(kind for given in scenarios for kind in given.kinds)
    assert {*OWN_STEPS, "approach", "measure", "backwards"} - {"goto"} == set(kinds)  # that needs a map
    assert min(kinds.values()) >= 4
    names = {name for given in scenarios for name in re.findall(r'"(fault[^"]*)"', json.dumps(given.mission["steps"]))}
    assert {name.partition(":")[0] for name in names} == {"fault"} != names
    assert {len(given.faults) for given in scenarios} >= {0, 1, 2, 3, 4}
    assert any(fault["at_s"] < 4.0 for given in scenarios for fault in given.faults)
    assert {act["do"] for given in scenarios for act in given.operator} == {
        *("acknowledge", "arm", "quickstop", "end", "answer")
    }
    assert any(not given.operator for given in scenarios)
    assert any(given.killed_at is not None for given in scenarios)
    assert all(0.0 <= given.resumed_after <= 1.0 for given in scenarios if given.resumed_after is not None)
    assert all(given.resumed_after is not None for given in scenarios), "every draw is resumed where that is possible"
    assert sum(not given.disturbed for given in scenarios) > 0.1 * len(scenarios)


def test_who_is_asked_has_an_answer_half_a_second_later_in_a_resumed_run_too(robot: RobotFile) -> None:
    for given in (scenario(seed, robot) for seed in SEEDS):
        answers = [act["at_s"] for act in given.operator if act["do"] == "answer"]
        assert answers == [0.5 * count for count in range(1, len(answers) + 1)]


def test_monitor_expects_something_of_every_injection() -> None:
    assert set(EXPECTED) == set(INJECTIONS) - set(NOT_DRAWN)


def test_what_the_monitor_expects_are_rows_of_the_table() -> None:
    for id, expected in EXPECTED.items():
        assert set(expected.shows) <= set(ROWS), id
        assert bool(expected.shows) is (expected.when not in (When.HARMLESS, When.UNTOLD)), id


def test_monitor_is_never_milder_than_the_table_that_runs() -> None:
    for id, expected in EXPECTED.items():
        if expected.shows and id in expected.shows and "seconds" not in INJECTIONS[id].parameters.model_fields:
            assert expected.within <= max(ROWS[id].within, 0.02) + 0.08, id
    for id, times in AUTOMATIC.items():
        assert ROWS[id].recovery.kind is Kind.AUTOMATIC, id
        assert ROWS[id].recovery.times <= times, id
    for id, row in ROWS.items():
        if row.recovery.kind is Kind.NEVER and (row.stages or row.found is Found.EMERGENCY):
            assert id in FINAL, id
        if row.recovery.kind is Kind.ITSELF:
            assert row.severity.name != "QUICK_STOP", id
    assert all(ROWS[id].recovery.kind is Kind.ITSELF for id in BY_ITSELF)


@pytest.mark.slow
def test_same_seed_leaves_the_same_journal(robot: RobotFile, tmp_path: Path) -> None:
    journals = []
    for name in ("first", "second"):
        run_scenario(scenario(2, robot), ROBOT.read_bytes(), tmp_path / name)
        runs = sorted((tmp_path / name / "runs").iterdir())
        journals.append([(run.name, (run / "journal.jsonl").read_bytes()) for run in runs])

    assert journals[0] == journals[1]
    assert len(journals[0][0][1].splitlines()) > 20


def test_signal_that_ends_the_process_group_is_no_finding(robot: RobotFile, tmp_path: Path) -> None:
    sent = list[float]()

    def end(tick: Tick, _: Traffic) -> None:
        if tick.snapshot.time > 0.5 and not sent:
            sent.append(tick.snapshot.time)
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(InterruptedRun) as interrupted:
        run_scenario(scenario(2, robot), ROBOT.read_bytes(), tmp_path, watch=end)
    assert interrupted.value.signal == signal.SIGTERM


@pytest.mark.parametrize("seed", range(40))
def test_every_scenario_of_other_drives_may_run(seed: int, tmp_path: Path) -> None:
    path = ROBOT.with_name("artemis_epos4.yaml")
    load_mission(scenario(seed, load_model(path, RobotFile)).write(tmp_path, path.read_bytes()))


def test_some_seeds_have_a_spare_input_or_wait_for_an_arm(robot: RobotFile) -> None:
    drawn = [scenario(seed, robot) for seed in range(1, 301)]
    spare = [each for each in drawn if "spare" in each.mission["inputs"]]
    waiting = [each for each in drawn if "supervision" in each.mission]

    assert 10 < len(spare) < 60
    assert all(each.mission["steps"][0]["teleop"]["inputs"] == ["stick", "spare"] for each in spare)
    assert 5 < len(waiting) < 40
    assert all(any(act["do"] == "arm" for act in each.operator) for each in waiting), "or it would wait for ever"
    assert all(each.disturbed for each in waiting), "an undisturbed run is compared with the one that resumes it"
