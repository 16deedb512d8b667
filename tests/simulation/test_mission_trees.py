"""Whole runs of missions with words: faults, stops, coming to rest, and going on after the process was gone."""

from __future__ import annotations

import itertools
import random
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from resuming import Done, run
from rig import CALIBRATE, follow, write_mission

from artemis.commands.replay import replay_run
from artemis.values import Mode, Tick

pytestmark = pytest.mark.short_alignment

WAIT = {"wait": {"seconds": 0.3}}
BY_HAND = [{"at_s": 14.0, "do": "acknowledge"}, {"at_s": 16.0, "do": "arm"}]


def told(ticks: list[Tick]) -> list[str]:
    """What happened in the mission, in words."""
    return [f"{event.kind} {event.text} {event.place}" for tick in ticks for event in tick.events]


def phases(ticks: list[Tick]) -> list[str]:
    """Modes in their order."""
    return [mode.value for mode, _ in itertools.groupby(tick.mode for tick in ticks)]


# ---------------------------------------------------------------------------------------------- watchers, rest


def test_the_robot_comes_to_rest_on_the_gate_before_a_branch_begins_and_the_path_goes_on(tmp_path: Path) -> None:
    watch = {"if": "driven_m > 0.4", "steps": [WAIT]}
    mission = write_mission(tmp_path, [CALIBRATE, {"during": {"steps": [follow(0.4)], "when": [watch]}}])
    done = run(mission)
    assert done.outcome.exit_status == 0
    fired = next(index for index, tick in enumerate(done.ticks) if tick.events and tick.events[0].kind == "fired")
    resting = list(itertools.takewhile(lambda tick: tick.mode is Mode.FOLLOW, done.ticks[fired:]))
    speeds = [tick.set_points.speed for tick in resting]
    assert all(0.0 <= after <= before for before, after in itertools.pairwise(speeds))
    assert len({round(a - b, 4) for a, b in itertools.pairwise(speeds) if a > b > 0.0}) == 1, "one ramp"
    waiting = [tick for tick in done.ticks[fired:] if tick.wish.phase == "waiting"]
    assert all(tick.snapshot.standing for tick in waiting)
    assert phases(done.ticks[fired:]) == ["follow", "ready", "follow", "ready", "end"]
    assert done.arc_lengths() == sorted(done.arc_lengths()), "it goes on where it stopped"
    assert done.arc_lengths()[-1] == pytest.approx(1.2, abs=0.03)


def test_a_run_with_words_is_replayed_bit_for_bit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    when = [{"if": "driven_m > 0.4", "then": "enough"}]
    steps = [{"during": {"steps": [follow(0.4)], "when": when, "at_most_s": 60.0}}]
    attempt = {"try": {"retries": 1, "between": [WAIT], "steps": steps, "catch": {"enough": [{"say": "enough"}]}}}
    done = run(write_mission(tmp_path, [CALIBRATE, attempt]))
    assert done.outcome.exit_status == 0
    assert replay_run(done.folder) == 0
    assert "every command equal" in capsys.readouterr().out
    assert [entry.text for entry in done.journal if entry.kind == "mission"] == [
        "step ended: done (steps[0].calibrate)",
        "condition met: driven_m > 0.4: coming to rest",
        "retry 1 of 1 after enough",
        "step ended: done (steps[1].try.between[0].wait)",
        "condition met: driven_m > 0.4",
        "outcome enough caught (steps[1].try)",
        "said: enough",
    ]


def test_what_steps_beside_watch_does_not_stop_the_robot_and_no_word_says_so(tmp_path: Path) -> None:
    beside = {
        "during": {"steps": [{"wait": {"for": "run_s > 1000"}}], "when": [{"if": "driven_m > 0.4", "steps": [WAIT]}]}
    }
    done = run(write_mission(tmp_path, [CALIBRATE, {"together": {"steps": [follow(0.4)], "beside": [beside]}}]))
    assert "condition met: driven_m > 0.4" in [entry.text for entry in done.journal if entry.kind == "mission"]
    fired = next(index for index, tick in enumerate(done.ticks) if tick.events and tick.events[0].kind == "fired")
    assert done.ticks[fired + 5].set_points.speed >= done.ticks[fired].set_points.speed > 0.3


# ---------------------------------------------------------------------------------------------- faults and stops

FAULT = {"inject": "DRV-25", "node": "steer-left", "at_s": 10.0}
"""While the path is followed."""


@pytest.mark.parametrize(("name", "catches"), [("fault:DRV-25", True), ("lost", False), ("any", False)])
def test_a_fault_is_an_outcome_only_where_a_try_names_it_and_only_after_the_recovery(
    tmp_path: Path, name: str, catches: bool
) -> None:
    catch = {name: [{"say": "caught"}]}
    steps: list[Any] = [CALIBRATE, {"try": {"steps": [follow(0.1)], "catch": catch}}]
    done = run(write_mission(tmp_path, steps, simulation={"faults": [FAULT], "operator": BY_HAND}))
    assert done.outcome.exit_status == 0
    stopped = next(index for index, tick in enumerate(done.ticks) if tick.mode is Mode.FAULT)
    frozen = list(itertools.takewhile(lambda tick: tick.mode is not Mode.READY, done.ticks[stopped:]))
    assert {tick.position.step for tick in frozen} == {1}
    assert told(frozen) == []
    after = done.ticks[stopped + len(frozen) :]
    assert after[0].snapshot.time > 16.0
    assert (Mode.FOLLOW in {tick.mode for tick in after}) is not catches
    assert ("said caught steps[1].try.catch.fault:DRV-25[0].say" in told(after)) is catches


@pytest.mark.parametrize("name", ["fault:DRV-25", "fault:DRV-02"])
def test_a_try_may_name_any_of_the_faults_of_a_stop(tmp_path: Path, name: str) -> None:
    both = [FAULT, {**FAULT, "inject": "DRV-02", "node": "steer-right"}]
    steps: list[Any] = [CALIBRATE, {"try": {"steps": [follow(0.1)], "catch": {name: [{"say": "caught"}]}}}]
    done = run(write_mission(tmp_path, steps, simulation={"faults": both, "operator": BY_HAND}))
    assert done.outcome.exit_status == 0
    assert f"caught {name} steps[1].try" in told(done.ticks)
    assert Mode.FOLLOW not in {tick.mode for tick in done.ticks if tick.snapshot.time > 16.0}


WATCHED = {"during": {"steps": [follow(0.1)], "when": [{"if": "driven_m > 0.1", "steps": [{"wait": {"seconds": 6}}]}]}}


@pytest.mark.parametrize("catches", [True, False])
def test_a_fault_in_the_branch_of_a_watcher_is_an_outcome_only_where_a_try_around_names_it(
    tmp_path: Path, catches: bool
) -> None:
    steps = [{"try": {"steps": [WATCHED], "catch": {"fault": [{"say": "caught"}]}}}] if catches else [WATCHED]
    done = run(write_mission(tmp_path, [CALIBRATE, *steps], simulation={"faults": [FAULT], "operator": BY_HAND}))
    assert done.outcome.exit_status == 0
    events = [event.kind for tick in done.ticks for event in tick.events]
    frozen = [tick for tick in done.ticks if 10.1 < tick.snapshot.time < 16.0]
    assert {(tick.position.step, tick.position.done) for tick in frozen} == {(2, frozen[0].position.done)}
    assert 0.5 < frozen[0].position.done < 5.0, "in the middle of the branch"
    assert ("caught" in events) is catches
    after = [tick for tick in done.ticks if tick.snapshot.time > 16.0]
    assert (Mode.FOLLOW in {tick.mode for tick in after}) is not catches
    waited = [tick.position.done for tick in after if tick.position.step == 2]
    assert min(waited) == pytest.approx(frozen[0].position.done, abs=0.03)
    assert catches or max(waited) == pytest.approx(6.0, abs=0.03)


def test_a_final_fault_ends_the_run_whatever_a_try_names(tmp_path: Path) -> None:
    final = {"inject": "DRV-05", "node": "steer-left", "at_s": 10.0}
    names = {"fault:DRV-05": [{"say": "caught"}], "any": [{"say": "caught"}]}
    attempt = {"try": {"retries": 2, "again_on": ["fault"], "steps": [follow(0.1)], "catch": names}}
    mission = write_mission(tmp_path, [CALIBRATE, attempt], simulation={"faults": [final], "operator": BY_HAND})
    done = run(mission, until=lambda tick: tick.snapshot.time > 20.0)
    assert done.ticks[-50].wish.phase.startswith("this run cannot continue; end it: ")
    assert done.outcome.exit_status == 1
    assert told(done.ticks) == ["ended done steps[0].calibrate"]
    assert done.ticks[-1].position.faults == ("DRV-05",)
    assert phases(done.ticks)[-2:] == ["fault", "end"]


@pytest.mark.parametrize("ends", [Mode.FAULT, Mode.INIT])
def test_a_fault_that_the_mission_was_not_told_of_yet_is_its_outcome_in_the_run_that_resumes_it(
    tmp_path: Path, ends: Mode
) -> None:
    steps: list[Any] = [CALIBRATE, {"try": {"steps": [follow(0.1)], "catch": {"fault:DRV-25": [{"say": "caught"}]}}}]
    mission = write_mission(tmp_path, steps, simulation={"faults": [FAULT], "operator": BY_HAND})
    first = run(mission, until=lambda tick: tick.snapshot.time > 10.1 and tick.mode is ends)
    assert first.ticks[-1].position.faults == ("DRV-25",)
    assert first.recorded[-1].position == first.ticks[-1].position
    second = run(mission, first.folder)
    assert second.outcome.exit_status == 0
    assert told(second.ticks) == [
        "ended fault:DRV-25 steps[1].try.steps[0].follow",
        "caught fault:DRV-25 steps[1].try",
        "said caught steps[1].try.catch.fault:DRV-25[0].say",
    ]
    assert Mode.FOLLOW not in {tick.mode for tick in second.ticks}


def test_a_stop_is_never_an_outcome(tmp_path: Path) -> None:
    operator = [{"at_s": 10.0, "do": "quickstop"}, {"at_s": 12.0, "do": "arm"}]
    steps: list[Any] = [
        CALIBRATE,
        {"try": {"retries": 3, "again_on": ["fault"], "steps": [follow(0.1)], "catch": {"any": [WAIT]}}},
    ]
    done = run(write_mission(tmp_path, steps, simulation={"operator": operator}))
    assert done.outcome.exit_status == 0
    assert "quickstop" in phases(done.ticks)
    assert told(done.ticks) == ["ended done steps[0].calibrate", "ended done steps[1].try.steps[0].follow"]


def test_an_outcome_that_nobody_catches_ends_the_run_as_failed(tmp_path: Path) -> None:
    done = run(write_mission(tmp_path, [CALIBRATE, {"wait": {"for": "run_s > 1000", "at_most_s": 0.5}}, follow(0.4)]))
    assert done.outcome.exit_status == 1
    assert done.ticks[-1].position.ended == "timeout"
    assert Mode.FOLLOW not in {tick.mode for tick in done.ticks}


# ---------------------------------------------------------------------------------------------- resume

RESUMED: list[Any] = [
    CALIBRATE,
    {
        "repeat": {
            "times": 2,
            "steps": [
                {
                    "try": {
                        "retries": 1,
                        "between": [{"say": "again"}, WAIT],
                        "steps": [{"wait": {"for": "run_s > 1000", "at_most_s": 0.3}}],
                        "catch": {"timeout": [WAIT, {"say": "late"}]},
                    }
                }
            ],
        }
    },
    {"during": {"steps": [follow(0.4)], "when": [{"if": "run_s > 0", "steps": [WAIT, WAIT]}], "at_most_s": 60.0}},
    {"together": {"steps": [WAIT, WAIT], "beside": [{"repeat": {"times": 2, "steps": [WAIT]}}]}},
]
BACK = follow(0.4)
BACK["follow"]["from_end"] = True
COUNTED: list[Any] = [
    CALIBRATE,
    {"wait": {"for": "run_s > 9"}},
    {
        "during": {
            "steps": [follow(0.4), {"choose": [{"if": "driven_m > 1", "steps": [WAIT]}]}, BACK],
            "when": [
                {"if": "driven_m > 0.4", "steps": [WAIT]},
                {"if": "driven_m > 1.9", "steps": [{"say": "far"}, WAIT]},
            ],
        }
    },
    {"repeat": {"until": "driven_m > 2 and run_s > 10", "times": 9, "steps": [WAIT]}},
]
"""Its signals count over all runs of it; there and back."""


@pytest.fixture(scope="module", params=[RESUMED, COUNTED], ids=["words", "signals"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Done]:
    """A run to the end, in which nothing depends on how long the bring-up takes."""
    mission = write_mission(tmp_path_factory.mktemp("mission"), request.param)
    return mission, run(mission)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
def test_a_run_that_is_broken_off_at_any_tick_does_the_rest_and_nothing_else(
    whole: tuple[Path, Done], seed: int
) -> None:
    mission, done = whole
    at = random.Random(seed).choice([tick for tick in done.ticks if tick.mode is not Mode.END]).snapshot.time
    first = run(mission, until=lambda tick: tick.snapshot.time >= at)
    second = run(mission, first.folder)
    assert second.outcome.exit_status == 0
    assert told(first.ticks) + told(second.ticks) == told(done.ticks)


def test_time_and_distance_count_over_all_runs_of_a_mission(tmp_path: Path) -> None:
    last = {"wait": {"for": "driven_m > 2.3 and run_s > 40"}}
    mission = write_mission(tmp_path, [CALIBRATE, follow(0.4), BACK, last])
    folder = None
    for ends in (lambda tick: tick.position.done > 0.6, lambda tick: tick.position.step == 3):
        folder = run(mission, folder, ends).folder
    done = run(mission, folder)
    begin, end = done.ticks[0].position, done.ticks[-1]
    assert begin.driven == pytest.approx(2.4, abs=0.05)
    assert end.position == replace(begin, step=4, done=0.0)
    assert begin.time + end.snapshot.time > 40.0 > end.snapshot.time + 10.0
