"""Missions driven without a robot: by given outcomes, and by random ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from command_line import artemis_here

from artemis.errors import ConfigError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.random_walks import never_reached
from artemis.testing import walk

MISSIONS = Path(__file__).parents[2] / "missions"
HEAD = "mission: m\nrobot: robots/artemis.yaml\nbus: simulation\ninputs: {stick: {plugin: keyboard}}\nsteps:\n"
ASK = '  - ask: {question: "which?", answers: [left, right], at_most_s: 9}\n'


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    (tmp_path / "robots").mkdir()
    shutil.copy(MISSIONS / "robots/artemis.yaml", tmp_path / "robots")
    return tmp_path / "m.yaml"


def loaded(mission: Path, steps: str) -> LoadedMission:
    mission.write_text(HEAD + steps)
    return load_mission(mission)


# ---------------------------------------------------------------------------------------------- given outcomes


def test_walk_tells_which_steps_ran_what_happened_and_how_it_ended() -> None:
    made = walk(MISSIONS / "retry_after_fault.yaml", "done", "fault:DRV-25", "done", "lost", "done", "fault:DRV-25")
    follow = "follow paths/loop_left.csv"
    assert made.steps == ["calibrate steering", follow] * 3
    assert made.places[2] == "steps[1].try.between[1].calibrate"
    assert "retry 1 of 2 after fault:DRV-25" in made.events
    assert made.said == ["aligning the wheels again"] * 2 + ["three times is enough"]
    assert (made.ended, made.at) == ("failed", "")


def test_any_is_not_for_a_fault_that_the_try_does_not_name() -> None:
    made = walk(MISSIONS / "retry_after_fault.yaml", "done", "fault:COM-03")
    assert (made.at, made.ended, made.said, made.events[1:]) == ("follow paths/loop_left.csv", "", [], [])


def test_walk_that_is_not_over_tells_where_it_is() -> None:
    made = walk(MISSIONS / "patrol.yaml", "done", {"charge_percent": 25.0}, "done")
    assert (made.at, made.ended) == ("wait for charge_percent > 40", "")
    assert made.said == ["battery low, to the charger"]
    assert walk(MISSIONS / "patrol.yaml").at == "calibrate steering"


def test_signal_lasts_until_it_changes_and_a_press_for_one_tick() -> None:
    endurance = MISSIONS / "endurance.yaml"
    assert walk(endurance, "done", {"stick.done": True}).said == ["enough"]
    assert walk(endurance, "done", "done", 3600).said == ["an hour is over"]
    patrol = walk(MISSIONS / "patrol.yaml", "done", {"charge_percent": 25.0}, {"run_s": 30.0}, "done")
    assert patrol.at == "wait for charge_percent > 40", "still low: nothing fires anew"


def test_answers_timeouts_and_seconds(mission: Path) -> None:
    found = loaded(mission, f"{ASK}{ASK}{ASK}  - wait: {{seconds: 3}}\n  - wait: {{for: run_s > 30, at_most_s: 5}}\n")
    assert walk(found, "left", "right").steps == ["ask which?"] * 3
    assert walk(found, "timeout").ended == "timeout"
    assert walk(found, "left", "left", 8.0).at == "ask which?"
    assert walk(found, "left", "left", 9.0).ended == "timeout"
    assert walk(found, "left", "left", "left", 3).at == "wait for run_s > 30"
    assert walk(found, "left", "left", "left", "done", {"run_s": 31}).ended == "done"
    assert walk(found, "left", "left", "left", "done", "timeout").ended == "timeout"


def test_a_moving_behaviour_may_be_lost(mission: Path) -> None:
    approach = "approach: {until: driven_m > 1, at_most_m: 2}"
    found = loaded(
        mission,
        f"  - calibrate: {{steering: from_potentiometers}}\n"
        f"  - try: {{steps: [{{{approach}}}], catch: {{lost: [{{say: lost}}], too-far: [{{say: far}}]}}}}\n",
    )
    for happening in ("lost", "fault:LOC-01"):
        made = walk(found, "done", happening)
        assert (made.said, made.ended) == (["lost"], "done")
    assert walk(found, "done", "too-far").said == ["far"]
    assert walk(found, "done", "fault:DRV-25").at == "approach driven_m > 1"
    assert walk(found, "done", {"driven_m": 1.5}).ended == "done"


def test_a_step_that_calibrates_is_finished_before_the_steps_of_a_watcher(mission: Path) -> None:
    steps = "[{calibrate: {steering: from_potentiometers}}, {wait: {seconds: 9}}]"
    watch = "{if: driven_m > 1, steps: [{say: far}, {wait: {seconds: 1}}]}"
    found = loaded(mission, f"  - during: {{steps: {steps}, when: [{watch}]}}\n")
    made = walk(found, {"driven_m": 2.0}, 5.0)
    assert (made.at, made.said) == ("calibrate steering", [])
    made = walk(found, {"driven_m": 2.0}, "done", 0.1)
    assert (made.steps, made.said) == (["calibrate steering", "wait 9 s", "wait 1 s"], ["far"])
    assert walk(found, {"driven_m": 2.0}, "fault:DRV-25").at == "calibrate steering"


def test_mission_that_is_a_list_is_walked_too() -> None:
    made = walk(MISSIONS / "figure_eight.yaml", "done", "fault:DRV-25", "done")
    assert (made.steps, made.ended) == (["calibrate steering", "follow paths/figure_eight.csv"], "done")


@pytest.mark.parametrize(
    ("happening", "reason"),
    [
        (
            "lfet",
            "'lfet', number 1: the step 'ask which?' does not end so; nearest is 'left', there are left, right, ",
        ),
        ("done", "the step 'ask which?' does not end so"),
        ("lost", "does not end so"),
        ("fault", "does not end so"),
        ("blocked", "does not end so"),
        ("fault:DRV-2x", "no fault 'DRV-2x' in the fault table; nearest is 'DRV-"),
        ("fault:x", "no fault 'x' in the fault table; `artemis faults` shows it"),
        ({"battery": 3.0}, "unknown signal 'battery'; nearest is 'battery_v'"),
        ({"battery_v": True}, "battery_v is a number"),
        ({"stick.done": 1.0}, "stick.done is true or false"),
        ({"answer": "left"}, "an answer is given to the step that asks"),
        (True, "write an outcome, so many seconds, or signals"),
        (-1.0, "write an outcome, so many seconds, or signals"),
    ],
)
def test_what_cannot_happen_is_refused_with_the_nearest_name(mission: Path, happening: object, reason: str) -> None:
    found = loaded(mission, ASK)
    with pytest.raises(ConfigError, match="walk: ") as refused:
        walk(found, happening)  # type: ignore[arg-type]
    assert reason in str(refused.value)


def test_nothing_happens_after_the_end(mission: Path) -> None:
    with pytest.raises(ConfigError, match="'left', number 2: the mission has ended before, with done"):
        walk(loaded(mission, ASK), "left", "left")


# ---------------------------------------------------------------------------------------------- random outcomes


def test_steps_that_random_walks_never_reach_are_told_with_their_place(mission: Path) -> None:
    steps = (
        f"{ASK}  - choose:\n"
        "      - if: answer == 'left' and answer == 'right'\n"
        "        steps:\n"
        "          - repeat: {times: 2, steps: [{say: both}]}\n"
        "          - call: twice\n"
        "      - steps: [call: twice]\n"
        "  - repeat: {times: 100000, steps: [{wait: {seconds: 1}}]}\n"
        "  - say: over\n"
        "parts:\n  twice: {steps: [{say: a}, {choose: [{if: run_s < 0, steps: [{say: never}]}]}]}\n"
    ).replace("{say: both}", "{wait: {seconds: 1}}")
    missed = never_reached(loaded(mission, steps), 60)
    assert [line.removeprefix(str(mission)).rpartition(":")[0] for line in missed] == [
        ":10:13: steps[1].choose[0].steps[0].repeat",
        ":11:13: steps[1].choose[0].steps[1].call",
        ":16:64: parts.twice.steps[1].choose[0].steps[0].say",
    ]


@pytest.mark.parametrize(
    "name", ["patrol", "retry_after_fault", "ask_which_way", "endurance", "show_and_repeat", "two_robots_first"]
)
def test_random_walks_reach_every_step_of_the_missions_that_show_words(name: str) -> None:
    assert never_reached(load_mission(MISSIONS / f"{name}.yaml"), 100) == []


def test_check_prints_what_is_never_reached_and_succeeds(mission: Path) -> None:
    loaded(mission, f"{ASK}  - choose: [{{if: answer == 'left' and answer == 'right', steps: [{{say: both}}]}}]\n")
    done = artemis_here("check", str(mission), "--walk", "30", "--seed", "7")
    assert done.returncode == 0
    first, second = done.stdout.splitlines()
    assert first == f"{mission}: ok"
    assert second.endswith("m.yaml:7:68: steps[1].choose[0].steps[0].say: never reached in 30 random walks")
    assert artemis_here("check", str(MISSIONS / "patrol.yaml"), "--walk", "30").stdout.splitlines()[1:] == [
        "  30 random walks reached every step"
    ]
