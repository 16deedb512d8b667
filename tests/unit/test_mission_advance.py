"""How a mission goes on: every word, every outcome, and what each event does to it."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from mission_trees import Walker
from msgspec import json
from msgspec.structs import replace

from artemis.plugins.acting import MAX_STATE_BYTES, state_text
from artemis.progress import Acted, Position, SignalValue
from artemis.states.advance import Place, states_in

WAIT = {"wait": {"seconds": 1.0}}
ASK = {"ask": {"question": "?", "answers": ["left", "right"], "at_most_s": 5.0}}
FOLLOW = {"follow": {"path": "a.csv", "follower": {}}}
TELEOP = {"teleop": {"input": "stick", "until": {"button": "done"}}}
CALIBRATE = {"calibrate": {"steering": "from_potentiometers"}}


def say(text: str) -> dict[str, str]:
    return {"say": text}


# ---------------------------------------------------------------------------------------------- lists


def test_a_list_is_done_step_by_step_and_keeps_no_place() -> None:
    walk = Walker(CALIBRATE, WAIT, FOLLOW)
    assert (walk.present, walk.position.place) == ("steps.0.calibrate", "")
    assert walk.tick("done") == "steps.1.wait"
    assert walk.tick(done=0.9) == "steps.1.wait"
    assert walk.position.done == 0.9
    assert walk.tick(done=1.0) == "steps.2.follow"
    assert walk.position.done == 0.0
    assert walk.tick("done") == "over"
    assert (walk.position.ended, walk.told()) == ("", [])


def test_an_outcome_that_nobody_catches_ends_the_mission_with_it() -> None:
    walk = Walker({"wait": {"for": "run_s > 9", "at_most_s": 2.0}}, FOLLOW)
    assert walk.tick(done=2.0) == "over"
    assert walk.position.ended == "timeout"
    assert walk.told() == ["ended timeout"]


@pytest.mark.parametrize(("outcome", "ended"), [("done", ""), ("failed", "failed")])
def test_end_ends_the_mission_from_anywhere(outcome: str, ended: str) -> None:
    end = {"choose": [{"if": "run_s > 1", "steps": [{"end": {"outcome": outcome, "say": "enough"}}]}]}
    inside = {"try": {"steps": [ASK, end], "catch": {"any": [WAIT]}}}
    walk = Walker({"repeat": {"times": 3, "steps": [inside]}}, FOLLOW)
    assert walk.tick(answers=["left"], run_s=2.0) == "over"
    assert walk.position.ended == ended
    assert walk.told()[-2:] == ["said enough", f"end {outcome}"]


def test_end_without_words_says_nothing() -> None:
    walk = Walker(WAIT, {"end": {}})
    walk.tick("done")
    assert [told.split(" ")[0] for told in walk.told()] == ["ended", "end"]


# ---------------------------------------------------------------------------------------------- wait, ask


def test_wait_for_a_condition_ends_once_it_holds() -> None:
    walk = Walker({"wait": {"for": "battery_v > 26", "at_most_s": 60.0}}, FOLLOW)
    assert walk.tick() == walk.tick(battery_v=25.9) == "steps.0.wait"
    assert walk.tick(battery_v=26.1) == "steps.1.follow"


@pytest.mark.parametrize("answer", ["right", "2"])
def test_an_answer_is_a_signal_from_then_on(answer: str) -> None:
    branches = [{"if": "answer == 'right'", "steps": [FOLLOW]}, {"steps": [WAIT]}]
    walk = Walker(ASK, {"choose": branches})
    assert walk.tick(answers=["3", "up", ""]) == "steps.0.ask"
    assert walk.tick(answers=[answer]) == "steps.1.choose.0.steps.0.follow"
    assert walk.position.answer == "right"


def test_a_question_that_nobody_answers_times_out() -> None:
    walk = Walker({"try": {"steps": [ASK], "catch": {"timeout": [say("nobody"), WAIT]}}})
    assert walk.tick(done=5.0) == "steps.0.try.catch.timeout.1.wait"
    assert walk.told() == ["ended timeout", "caught timeout", "said nobody"]


# ---------------------------------------------------------------------------------------------- repeat


def test_repeat_counts_its_rounds_and_tells_them() -> None:
    walk = Walker({"repeat": {"times": 2, "steps": [FOLLOW, WAIT]}}, CALIBRATE)
    for _ in range(2):
        assert walk.present == "steps.0.repeat.steps.0.follow"
        assert walk.tick("done") == "steps.0.repeat.steps.1.wait"
        walk.tick("done")
    assert walk.present == "steps.1.calibrate"
    assert [told for told in walk.told() if "round" in told] == ["round 2 of 2"]


def test_a_step_that_begins_anew_says_so_also_where_it_is_the_same() -> None:
    walk = Walker({"repeat": {"steps": [FOLLOW]}})
    walk.tick(done=3.0)
    assert not walk.begun
    walk.tick("done")
    assert (walk.begun, walk.position.done) == (True, 0.0)


def test_until_is_asked_between_two_rounds_only() -> None:
    walk = Walker({"repeat": {"until": "run_s > 10", "steps": [FOLLOW]}}, WAIT)
    assert walk.tick(run_s=11.0) == "steps.0.repeat.steps.0.follow"
    assert walk.tick("done", run_s=9.0) == "steps.0.repeat.steps.0.follow"
    assert walk.tick("done", run_s=11.0) == "steps.1.wait"


def test_round_is_the_one_that_runs_of_the_innermost_repeat() -> None:
    inner = {"repeat": {"until": "round == 2", "steps": [FOLLOW]}}
    choose = {"choose": [{"if": "round == 2", "steps": [WAIT]}, {"steps": [CALIBRATE]}]}
    walk = Walker({"repeat": {"times": 2, "steps": [inner, choose]}})
    seen = []
    while walk.present != "over":
        seen.append(walk.present.rsplit(".", 1)[1])
        walk.tick("done")
    assert seen == ["follow", "follow", "calibrate", "follow", "follow", "wait"]


# ---------------------------------------------------------------------------------------------- try


def test_retries_begin_anew_with_what_is_between_and_are_counted_from_each_entry() -> None:
    attempt = {"try": {"retries": 1, "between": [CALIBRATE], "steps": [ASK], "catch": {"any": [WAIT]}}}
    walk = Walker({"repeat": {"times": 2, "steps": [attempt]}})
    for _ in range(2):
        assert walk.present.endswith("try.steps.0.ask")
        assert walk.tick("timeout").endswith("try.between.0.calibrate")
        assert walk.tick("done").endswith("try.steps.0.ask")
        assert walk.tick("timeout").endswith("try.catch.any.0.wait")
        walk.tick("done")
    assert walk.present == "over"
    assert walk.position.ended == ""
    assert "retry 1 of 1 after timeout" in walk.told()


def test_only_what_again_on_names_is_tried_again() -> None:
    steps = [{"during": {"steps": [FOLLOW], "when": [{"if": "run_s > 5", "then": "late"}], "at_most_s": 9.0}}]
    walk = Walker({"try": {"retries": 5, "again_on": ["late"], "steps": steps, "catch": {"timeout": [WAIT]}}})
    assert walk.tick(run_s=6.0) == "steps.0.try.steps.0.during.steps.0.follow"
    assert walk.told() == ["fired run_s > 5", "retry 1 of 5 after late"]
    assert walk.tick(dt=10.0) == "steps.0.try.catch.timeout.0.wait"


def test_a_branch_of_catch_is_not_caught_by_its_own_try() -> None:
    walk = Walker({"try": {"steps": [ASK], "catch": {"timeout": [ASK]}}})
    walk.tick("timeout")
    assert walk.tick("timeout") == "over"
    assert walk.position.ended == "timeout"


def test_an_outcome_climbs_to_the_try_that_names_it() -> None:
    inner = {"try": {"steps": [ASK], "catch": {"fault": [CALIBRATE]}}}
    walk = Walker({"try": {"steps": [{"repeat": {"steps": [inner]}}], "catch": {"timeout": [WAIT]}}})
    assert walk.tick("timeout") == "steps.0.try.catch.timeout.0.wait"


# ---------------------------------------------------------------------------------------------- faults


@pytest.mark.parametrize("name", ["fault:DRV-25", "fault"])
def test_a_fault_ends_the_step_where_a_try_names_it(name: str) -> None:
    walk = Walker({"try": {"steps": [FOLLOW], "catch": {name: [CALIBRATE]}}})
    assert walk.tick(fault="DRV-25") == f"steps.0.try.catch.{name}.0.calibrate"
    assert "ended fault:DRV-25" in walk.told()
    assert walk.position.faults == ()


@pytest.mark.parametrize("catch", [{"fault:DRV-25": [WAIT]}, {"timeout": [WAIT]}, {"any": [WAIT]}, {"lost": [WAIT]}])
def test_without_one_the_step_goes_on_where_it_was_and_the_fault_is_forgotten(catch: dict[str, object]) -> None:
    walk = Walker({"try": {"steps": [{"during": {"steps": [FOLLOW], "at_most_s": 99.0}}], "catch": catch}})
    walk.tick(done=2.0)
    assert walk.tick(fault="COM-03").endswith("follow")
    assert (walk.position.done, walk.position.faults, walk.begun) == (2.0, (), False)


def test_faults_are_tried_again_only_where_again_on_names_them() -> None:
    walk = Walker({"try": {"retries": 1, "steps": [FOLLOW], "catch": {"fault": [WAIT]}}})
    assert walk.tick(fault="DRV-25").endswith("catch.fault.0.wait")
    walk = Walker({"try": {"retries": 1, "again_on": ["fault:DRV-25"], "steps": [FOLLOW]}})
    walk.tick(done=2.0)
    assert walk.tick(fault="DRV-25").endswith("steps.0.follow")
    assert (walk.begun, walk.position.done) == (True, 0.0)


@pytest.mark.parametrize(
    ("again_on", "fault", "present"),
    [
        (["fault:DRV-25", "lost"], "DRV-25", "catch.any.0.wait"),
        (["fault:DRV-25", "lost"], "PTH-06", "catch.any.0.wait"),
        (["fault:DRV-25", "lost"], "COM-03", "steps.0.follow"),
        (["fault"], "COM-03", "catch.any.0.wait"),
        (["any", "lost"], "COM-03", "steps.0.follow"),
    ],
)
def test_any_is_the_rest_of_the_outcomes_that_the_same_try_names(again_on: list[str], fault: str, present: str) -> None:
    walk = Walker({"try": {"retries": 1, "again_on": again_on, "steps": [FOLLOW], "catch": {"any": [WAIT]}}})
    assert walk.tick(fault=fault).endswith("steps.0.follow")
    assert walk.tick(fault=fault).endswith(present)


def test_any_tries_no_fault_again_that_only_catch_names() -> None:
    steps = {"retries": 1, "again_on": ["any"], "steps": [FOLLOW]}
    walk = Walker({"try": {**steps, "catch": {"fault": [WAIT]}}})
    assert walk.tick(fault="DRV-25").endswith("catch.fault.0.wait")
    walk = Walker({"try": {**steps, "catch": {"blocked": [WAIT]}}})
    assert walk.tick("blocked").endswith("steps.0.follow")
    assert walk.tick("blocked").endswith("catch.blocked.0.wait")


@pytest.mark.parametrize("name", ["faulty", "fault-free", "lost-again"])
def test_an_outcome_that_sounds_like_a_fault_is_none(name: str) -> None:
    during = {"during": {"steps": [FOLLOW], "when": [{"if": "run_s > 1", "then": name}]}}
    walk = Walker({"try": {"retries": 1, "steps": [during], "catch": {name: [WAIT]}}})
    assert walk.tick(run_s=2.0).endswith("follow")
    assert f"retry 1 of 1 after {name}" in walk.told()


def test_any_does_not_take_a_fault_that_only_a_try_around_names() -> None:
    inner = {"try": {"steps": [FOLLOW], "catch": {"any": [WAIT]}}}
    walk = Walker({"try": {"steps": [inner], "catch": {"fault": [CALIBRATE]}}})
    assert walk.tick(fault="DRV-25") == "steps.0.try.catch.fault.0.calibrate"


def test_the_branch_with_the_most_exact_name_is_done_wherever_it_stands() -> None:
    catch = {"any": [ASK], "fault": [WAIT], "lost": [FOLLOW], "fault:DRV-25": [CALIBRATE]}
    walks = [Walker({"try": {"steps": [FOLLOW], "catch": catch}}) for _ in range(4)]
    assert walks[0].tick(fault="DRV-25").endswith("calibrate")
    assert walks[1].tick(fault="PTH-06").endswith("catch.lost.0.follow")
    assert walks[2].tick(fault="COM-03").endswith("wait")
    assert walks[3].tick("blocked").endswith("ask")


@pytest.mark.parametrize(
    ("catch", "outcome"),
    [
        (("fault:COM-03",), "fault:COM-03"),
        (("fault:COM-03", "fault:DRV-25"), "fault:DRV-25"),
        (("lost", "fault:COM-03"), "fault:COM-03"),
        (("lost",), "fault:PTH-06"),
    ],
)
def test_of_several_faults_the_most_severe_that_a_try_names_is_the_outcome(
    catch: tuple[str, ...], outcome: str
) -> None:
    walk = Walker({"try": {"steps": [FOLLOW], "catch": {name: [WAIT] for name in catch}}})
    walk.tick(fault=("DRV-25", "COM-03", "PTH-06"))
    assert f"ended {outcome}" in walk.told()
    assert walk.position.faults == ()


@pytest.mark.parametrize("branch", ["catch", "between"])
def test_a_fault_in_a_branch_is_not_caught_by_the_try_of_the_branch(branch: str) -> None:
    words = {"retries": 1, "again_on": ["timeout"], "between": [FOLLOW]} if branch == "between" else {}
    walk = Walker({"try": {"steps": [ASK], "catch": {"timeout": [FOLLOW], "fault": [WAIT]}, **words}})
    present = walk.tick("timeout")
    assert present.endswith("follow")
    assert walk.tick(fault="DRV-25") == present


def test_a_path_that_was_left_is_the_outcome_lost_of_follow() -> None:
    walk = Walker({"try": {"steps": [FOLLOW], "catch": {"lost": [WAIT]}}})
    assert walk.tick(fault="PTH-06") == "steps.0.try.catch.lost.0.wait"


@pytest.mark.parametrize("inner", [False, True])
@pytest.mark.parametrize("resting", [False, True])
def test_a_fault_is_caught_although_a_watcher_waits_for_the_robot_to_stand(*, inner: bool, resting: bool) -> None:
    caught = {"catch": {"fault": [CALIBRATE]}}
    body = {"try": {"steps": [FOLLOW], **caught}} if inner else FOLLOW
    during = {"during": {"steps": [body], "when": [{"if": "battery_v < 23", "steps": [WAIT]}]}}
    walk = Walker(during if inner else {"try": {"steps": [during], **caught}})
    if resting:
        walk.tick(standing=False, battery_v=22.0)
        assert walk.rests
    assert walk.tick(fault="DRV-25", battery_v=22.0).endswith("catch.fault.0.calibrate")
    assert walk.tick(battery_v=22.0).endswith("wait" if inner else "calibrate")


def test_a_watcher_is_done_after_a_fault_that_nobody_catches() -> None:
    walk = Walker({"during": {"steps": [FOLLOW], "when": [{"if": "battery_v < 23", "steps": [WAIT]}]}})
    walk.tick(done=1.0, standing=False, battery_v=22.0)
    assert walk.tick(fault="DRV-25", battery_v=22.0).endswith("follow")
    assert walk.rests
    assert walk.tick(battery_v=22.0).endswith("wait")


# ---------------------------------------------------------------------------------------------- during


def test_a_watcher_lets_the_robot_come_to_rest_then_does_its_steps_and_resumes() -> None:
    when = {"if": "battery_v < 23", "steps": [WAIT]}
    walk = Walker({"during": {"steps": [FOLLOW], "when": [when]}})
    assert walk.tick(done=1.0, standing=False).endswith("follow")
    assert walk.tick(done=1.5, standing=False, battery_v=22.0).endswith("follow")
    assert walk.rests
    assert walk.tick(done=1.8, standing=False).endswith("follow")
    assert walk.tick(standing=True).endswith("when.0.steps.0.wait")
    assert not walk.rests
    assert walk.tick("done").endswith("follow")
    assert (walk.position.done, walk.begun) == (1.8, True)


def test_a_condition_must_be_false_once_before_it_fires_again() -> None:
    walk = Walker({"during": {"steps": [FOLLOW], "when": [{"if": "battery_v < 23", "steps": [WAIT]}]}})
    walk.tick(battery_v=22.0)
    assert walk.tick("done", battery_v=22.0).endswith("follow")
    assert walk.tick(battery_v=22.0).endswith("follow")
    assert walk.tick(battery_v=24.0).endswith("follow")
    assert walk.tick(battery_v=22.0).endswith("wait")


def test_a_branch_may_restart_the_steps_or_end_them_with_an_outcome_of_its_own() -> None:
    when = [{"if": "stick.record", "then": "restart"}, {"if": "stick.done", "then": "pressed"}]
    walk = Walker(
        {"try": {"steps": [{"during": {"steps": [WAIT, FOLLOW], "when": when}}], "catch": {"pressed": [ASK]}}}
    )
    walk.tick("done")
    assert walk.tick(stick__record=True).endswith("during.steps.0.wait")
    assert walk.tick(stick__done=True) == "steps.0.try.catch.pressed.0.ask"


def test_the_first_watcher_and_the_outer_one_go_first() -> None:
    inner = {"during": {"steps": [FOLLOW], "when": [{"if": "run_s > 1", "steps": [WAIT]}]}}
    outer = [{"if": "run_s > 2", "steps": [ASK]}, {"if": "run_s > 1", "steps": [CALIBRATE]}]
    walk = Walker({"during": {"steps": [inner], "when": outer}})
    assert walk.tick(run_s=3.0).endswith("when.0.steps.0.ask")


def test_while_a_branch_runs_only_outer_watchers_look() -> None:
    inner = {
        "during": {"steps": [FOLLOW], "when": [{"if": "run_s > 1", "steps": [WAIT]}, {"if": "run_s > 2", "then": "x"}]}
    }
    walk = Walker(
        {
            "during": {
                "steps": [{"try": {"steps": [inner], "catch": {"x": [WAIT]}}}],
                "when": [{"if": "run_s > 3", "steps": [ASK]}],
            }
        }
    )
    assert walk.tick(run_s=1.5).endswith("when.0.steps.0.wait")
    assert walk.tick(run_s=2.5).endswith("when.0.steps.0.wait")
    assert walk.tick(run_s=3.5).endswith("when.0.steps.0.ask")
    assert walk.tick("done", run_s=3.5).endswith("when.0.steps.0.wait"), "the branch of the inner one goes on"


def test_at_most_counts_only_time_in_which_the_mission_runs_and_lets_the_robot_come_to_rest() -> None:
    walk = Walker(
        {"try": {"steps": [{"during": {"steps": [FOLLOW], "at_most_s": 10.0}}], "catch": {"timeout": [WAIT]}}}
    )
    walk.tick(dt=9.9, standing=False)
    assert not walk.rests
    walk.tick(dt=0.1, standing=False)
    assert walk.rests
    assert walk.tick(dt=0.1, standing=True) == "steps.0.try.catch.timeout.0.wait"


@pytest.mark.parametrize("then", ["resume", "restart", "charged"])
@pytest.mark.parametrize("inner", [False, True])
def test_a_step_that_a_watcher_interrupts_ends_with_no_outcome_of_its_own(then: str, *, inner: bool) -> None:
    """Not even in the tick in which the condition becomes true: the robot stands, but its mode has not ended yet."""
    body = {"try": {"steps": [FOLLOW], "catch": {"battery-short": [CALIBRATE]}}} if inner else FOLLOW
    during = {"during": {"steps": [body], "when": [{"if": "battery_v < 23", "steps": [WAIT], "then": then}]}}
    charged = {"charged": [ASK]} if then == "charged" else {}
    walk = Walker({"try": {"steps": [during], "catch": {**charged, "any": [CALIBRATE]}}})
    assert walk.tick("battery-short", standing=False, battery_v=22.0).endswith("follow")
    assert walk.rests
    assert walk.tick("battery-short", standing=False).endswith("follow")
    assert walk.tick().endswith("when.0.steps.0.wait")
    assert walk.told() == ["fired battery_v < 23"]
    assert walk.tick("done").endswith("ask" if then == "charged" else "follow")
    if then != "charged":
        assert walk.tick("battery-short", standing=False).endswith("calibrate"), "then it counts again"


def test_a_step_that_rests_for_a_bad_outcome_beside_it_ends_with_no_other() -> None:
    together = {"together": {"steps": [FOLLOW], "beside": [{"wait": {"for": "run_s > 100", "at_most_s": 1.0}}]}}
    walk = Walker({"try": {"steps": [together], "catch": {"timeout": [CALIBRATE], "blocked": [ASK]}}})
    assert walk.tick("blocked", dt=1.0, standing=False).endswith("follow")
    assert walk.tick().endswith("catch.timeout.0.calibrate")


def test_steps_that_end_while_the_robot_comes_to_rest_are_over() -> None:
    walk = Walker({"during": {"steps": [FOLLOW], "when": [{"if": "run_s > 1", "steps": [WAIT]}]}}, CALIBRATE)
    walk.tick(run_s=2.0, standing=False)
    assert walk.tick("done", standing=False) == "steps.1.calibrate"


# ---------------------------------------------------------------------------------------------- choose, together


def test_without_a_branch_that_holds_nothing_is_done() -> None:
    walk = Walker({"choose": [{"if": "battery_v > 1", "steps": [FOLLOW]}]}, WAIT)
    assert walk.present == "steps.1.wait"


def test_the_branch_stays_what_it_was_when_it_was_chosen() -> None:
    walk = Walker(WAIT, {"choose": [{"if": "run_s > 1", "steps": [FOLLOW]}, {"steps": [CALIBRATE]}]})
    assert walk.tick("done", run_s=2.0).endswith("follow")
    assert walk.tick(run_s=0.0).endswith("follow")


def test_steps_beside_end_by_themselves_and_the_steps_end_all() -> None:
    beside = [{"wait": {"seconds": 0.5}}, {"wait": {"for": "run_s > 100"}}]
    walk = Walker({"together": {"steps": [FOLLOW], "beside": beside}}, CALIBRATE)
    assert walk.tick(dt=0.6).endswith("follow")
    assert walk.told() == ["ended done"]
    assert walk.tick("done") == "steps.1.calibrate"


def test_a_bad_outcome_beside_ends_all_once_the_robot_stands() -> None:
    beside = [{"wait": {"for": "run_s > 100", "at_most_s": 1.0}}]
    together = {"together": {"steps": [FOLLOW], "beside": beside}}
    walk = Walker({"try": {"steps": [together], "catch": {"timeout": [CALIBRATE]}}})
    assert walk.tick(dt=1.0, standing=False).endswith("follow")
    assert walk.rests
    assert walk.tick(dt=1.0, standing=False).endswith("follow")
    assert walk.tick(standing=True).endswith("catch.timeout.0.calibrate")


@pytest.mark.parametrize("outcome", ["done", "fault:DRV-25"])
def test_a_bad_outcome_beside_is_not_lost_when_the_steps_end_while_the_robot_comes_to_rest(outcome: str) -> None:
    beside = [{"wait": {"for": "run_s > 100", "at_most_s": 1.0}}]
    together = {"together": {"steps": [CALIBRATE], "beside": beside}}
    caught = {"timeout": [ASK], "fault": [WAIT]}
    walk = Walker({"try": {"steps": [together], "catch": caught}}, FOLLOW)
    assert walk.tick(dt=1.0, standing=False).endswith("calibrate")
    fault = outcome.partition(":")[2]
    assert walk.tick("" if fault else outcome, fault=fault, standing=False).endswith("catch.timeout.0.ask")


def test_an_end_beside_is_not_lost_when_the_steps_end_while_the_robot_comes_to_rest() -> None:
    end = {"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", "steps": [{"end": {"outcome": "failed"}}]}]}}
    walk = Walker({"together": {"steps": [CALIBRATE], "beside": [end]}}, FOLLOW)
    walk.tick(run_s=2.0, standing=False)
    assert walk.tick("done", standing=False) == "over"
    assert walk.position.ended == "failed"


def test_an_end_that_was_reported_is_not_undone_by_what_ended_beside() -> None:
    beside = [{"wait": {"for": "run_s > 100", "at_most_s": 1.0}}]
    end = {"choose": [{"if": "run_s < 99", "steps": [{"end": {}}]}]}
    together = {"together": {"steps": [CALIBRATE, end], "beside": beside}}
    walk = Walker({"try": {"steps": [together], "catch": {"timeout": [ASK]}}}, FOLLOW)
    walk.tick(dt=1.0, standing=False, run_s=2.0)
    assert walk.tick("done", standing=False, run_s=2.0) == "over"
    assert (walk.position.ended, walk.told()[-1]) == ("", "end done")


# ---------------------------------------------------------------------------------------------- the position


@pytest.mark.parametrize(("words", "largest"), [(6, 300), (9, 375)])
def test_a_position_is_small_also_deep_in_words_and_in_a_run_that_resumes_another(words: int, largest: int) -> None:
    step: Mapping[str, object] = FOLLOW
    for _ in range(words // 3):
        caught = {"try": {"retries": 3, "steps": [step], "catch": {"any": [WAIT]}}}
        step = {"during": {"at_most_s": 1e6, "steps": [{"repeat": {"times": 1000, "steps": [caught]}}]}}
    walk = Walker(ASK, step)
    walk.tick(answers=["right"])
    walk.tick(done=12.345678901234567, dt=1 / 3)
    whole = replace(walk.position, driven=1234.5678901234567, time=98765.43210987654)
    assert len(json.encode(whole)) <= largest


def test_a_position_without_what_plugins_tell_is_small_although_a_behaviour_keeps_much() -> None:
    state = state_text(("x" * (MAX_STATE_BYTES - 4),))
    assert state is not None
    acting = {"approach": {"until": "run_s > 99", "at_most_m": 9.0}}
    walk = Walker({"during": {"steps": [acting], "when": [{"if": "stick.done", "steps": [WAIT]}]}})
    walk.acted = {0: Acted(step=0, state=state, signals=(SignalValue(name="approached_m", value=1 / 3),))}
    walk.tick()
    walk.tick(stick__done=True)
    assert walk.present.endswith("when.0.steps.0.wait")
    assert dict(states_in(walk.position)) == {0: state}
    assert len(json.encode(walk.position)) > MAX_STATE_BYTES
    assert len(json.encode(without_plugin_data(walk.position))) <= 300


def without_plugin_data(position: Position) -> Position:
    """The position without the states and signals of behaviours."""
    place = position.place
    for _, state in states_in(position):
        place = place.replace(json.encode(state).decode(), "")
    return replace(position, place=place, state="", told=())


def test_the_states_of_behaviours_are_found_wherever_they_wait() -> None:
    inner = Place((0,), (Place((1.5, 2, "[1]")),))
    waiting = Place((1, 0, "timeout"), (inner, Place((0.5,))))
    position = Position(step=4, state="[7]", place=json.encode(waiting).decode())
    assert sorted(states_in(position)) == [(2, "[1]"), (4, "[7]")]
    assert list(states_in(Position(step=1))) == []
