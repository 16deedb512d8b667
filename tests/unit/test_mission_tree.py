"""What is wrong with how a mission's words fit together; parts put in where they are called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mission_trees import built, checked, problems

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.mission.parts import expanded
from artemis.states.outline import numbered
from artemis.yaml_file import survey

WAIT = {"wait": {"seconds": 1.0}}
ASK = {"ask": {"question": "?", "answers": ["a"], "at_most_s": 5.0}}
FOLLOW = {"follow": {"path": "a.csv", "follower": {}}}
SAY = {"say": "x"}
ELSE = {"steps": [WAIT]}
ENDLESS = {"repeat": {"steps": [WAIT]}}
MISSIONS = Path(__file__).parents[2] / "missions"
NO_TIME = "no time passes in it on some way through: add a step that takes time, or a last branch without `if`"


@pytest.mark.parametrize(
    ("steps", "problem"),
    [
        ([ENDLESS, WAIT], "steps[1].wait: is never reached"),
        ([{"together": {"steps": [WAIT], "beside": [ASK]}}], "steps[0].together.beside[0].ask: asks"),
        (
            [{"together": {"steps": [FOLLOW], "beside": [{"try": {"steps": [WAIT], "catch": {"fault": [WAIT]}}}]}}],
            "steps[0].together.beside[0].try.catch.fault: a fault ends no step beside others: only the present one",
        ),
        ([{"end": {}}, WAIT], "steps[1].wait: is never reached"),
        ([{"try": {"steps": [{"end": {}}, FOLLOW], "retries": 1}}], "steps[0].try.steps[1].follow: is never reached"),
        ([{"repeat": {"times": 3, "steps": [SAY]}}], f"steps[0].repeat: {NO_TIME}"),
        ([{"repeat": {"steps": [{"choose": [{"if": "run_s > 1", "steps": [WAIT]}]}]}}], f"steps[0].repeat: {NO_TIME}"),
        (
            [{"repeat": {"steps": [{"choose": [{"if": "run_s > 1", "steps": [WAIT]}, {"steps": [SAY]}]}]}}],
            f"steps[0].repeat: {NO_TIME}",
        ),
        (
            [{"try": {"steps": [ASK], "catch": {"timeuot": [WAIT]}}}],
            "steps[0].try.catch.timeuot: no step within ends with timeuot; did you mean timeout?",
        ),
        ([{"try": {"steps": [WAIT], "catch": {"timeout": [WAIT]}}}], "no step within ends with timeout"),
        ([{"try": {"steps": [WAIT], "catch": {"lost": [WAIT]}}}], "no step within ends with lost"),
        ([{"try": {"steps": [WAIT], "catch": {"fault:DRV-99": [WAIT]}}}], "no fault DRV-99; did you mean"),
        ([{"try": {"steps": [ASK], "retries": 1, "again_on": ["nope"]}}], "steps[0].try.again_on[0]: no step within"),
        (
            [{"choose": [{"steps": [WAIT]}, {"if": "run_s > 1", "steps": [WAIT]}]}],
            "steps[0].choose[0]: without `if` it always holds: it can only be the last",
        ),
        (
            [{"together": {"steps": [WAIT], "beside": [WAIT, {"repeat": {"times": 2, "steps": [FOLLOW]}}]}}],
            "steps[0].together.beside[1].repeat.steps[0].follow: moves the robot",
        ),
        (
            [
                {
                    "during": {
                        "steps": [WAIT],
                        "when": [{"if": "run_s > 1", "then": "a"}, {"if": "run_s > 1", "then": "b"}],
                    }
                }
            ],
            "steps[0].during.when[1].if: the same condition as a watcher above",
        ),
        (
            [{"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", "then": "fault"}]}}],
            "fault is no outcome of your own",
        ),
        (
            [{"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", "then": "lost"}]}}],
            "lost is no outcome of your own",
        ),
        (
            [{"wait": {"for": "rum_s > 1"}}],
            "steps[0].wait.for: condition 'rum_s > 1': unknown signal 'rum_s'; nearest is 'run_s', there are run_s, ",
        ),
        ([{"wait": {"for": "round > 1"}}], "'round > 1': unknown signal 'round'; it exists only inside `repeat`"),
        ([{"wait": {"for": "answer == 'a'"}}], "unknown signal 'answer'"),
        ([ASK, {"wait": {"for": "answer == 'b'"}}], "answer is never 'b'"),
        ([{"wait": {"for": "stik.done"}}], "unknown signal 'stik.done'; nearest is 'stick.done'"),
    ],
)
def test_words_that_do_not_fit_are_refused_with_their_place(steps: list[Any], problem: str) -> None:
    assert any(problem in each for each in problems(*steps)), problems(*steps)


@pytest.mark.parametrize(
    "step",
    [
        {"repeat": {"steps": [ASK]}},
        {
            "repeat": {
                "until": "round == 3",
                "steps": [{"choose": [{"if": "run_s > 1", "steps": [WAIT]}, {"steps": [WAIT]}]}],
            }
        },
        {"try": {"steps": [FOLLOW], "catch": {"lost": [WAIT], "fault:DRV-25": [WAIT], "fault": [SAY], "any": [SAY]}}},
        {"try": {"steps": [ENDLESS], "catch": {"fault": [WAIT]}}},
        {"during": {"steps": [ENDLESS], "at_most_s": 5.0}},
        {"together": {"steps": [FOLLOW], "beside": [{"repeat": {"steps": [WAIT]}}]}},
    ],
)
def test_words_that_fit_are_accepted(step: dict[str, Any]) -> None:
    assert problems(step) == []


def test_a_battery_that_nobody_measures_is_refused() -> None:
    assert problems({"wait": {"for": "battery_v > 1"}}) == []
    assert problems({"wait": {"for": "battery_v > 1"}}, measures_supply=False) == [
        "steps[0].wait.for: battery_v: no drive of this robot measures the supply voltage: name an analog input that "
        "does (`battery.measured` of the robot file), or use a time, such as run_s > 3600"
    ]


FOR_EVER = ["steps[0].repeat: repeats for ever; only a person ends it"]


@pytest.mark.parametrize(
    ("step", "facts", "ends"),
    [
        (WAIT, {}, False),
        (ASK, {}, True),
        (FOLLOW, {}, True),
        (FOLLOW, {"has_scanner": False}, True),
        (FOLLOW, {"has_battery": False}, True),
        (FOLLOW, {"has_scanner": False, "has_battery": False}, False),
        (FOLLOW, {"has_scanner": False, "measures_supply": False}, False),
        ({"goto": {"map": "m.yaml", "to": "gate"}}, {"has_scanner": False, "has_battery": False}, True),
        (
            {"goto": {"map": "m.yaml", "to": {"from_input": "stick"}}},
            {"has_scanner": False, "has_battery": False},
            False,
        ),
        ({"approach": {"until": "driven_m > 1", "at_most_m": 2}}, {"has_scanner": False, "has_battery": False}, True),
    ],
)
def test_a_repeat_that_only_a_person_ends_is_a_remark(step: Any, facts: dict[str, bool], ends: bool) -> None:  # noqa: ANN401
    assert checked({"repeat": {"steps": [step]}}, **facts).remarks == ([] if ends else FOR_EVER)


@pytest.mark.parametrize("steps", [[{"end": {}}], [{"wait": {"for": "stick.record", "at_most_s": 3}}]])
def test_a_repeat_that_the_steps_of_a_watcher_leave_is_none(steps: list[Any]) -> None:
    during = {"steps": [ENDLESS], "when": [{"if": "stick.done", "steps": steps}]}
    assert checked({"during": during}).remarks == []
    assert checked({"during": {**during, "when": [{"if": "stick.done", "steps": [WAIT]}]}}).remarks != []


@pytest.mark.parametrize(
    ("catch", "fact", "why"),
    [
        ("blocked", "has_scanner", "the robot has no scanner"),
        ("battery-short", "has_battery", "the robot file describes no `battery`"),
        ("battery-short", "measures_supply", "no drive of this robot measures the supply voltage"),
    ],
)
def test_an_outcome_that_this_robot_does_not_have_is_refused_with_the_reason(catch: str, fact: str, why: str) -> None:
    attempt = {"try": {"steps": [FOLLOW], "catch": {catch: [SAY]}}}
    assert problems(attempt) == []
    (problem,) = problems(attempt, **{fact: False})
    assert problem.startswith(f"steps[0].try.catch.{catch}: no step within ends with {catch}: {why}")


def test_an_outcome_that_the_step_does_not_have_as_it_is_written_is_refused_with_the_reason() -> None:
    asked = {"goto": {"map": "m.yaml", "to": {"from_input": "stick"}}}
    (problem,) = problems({"try": {"steps": [asked], "catch": {"no-path": [SAY]}}})
    assert problem.endswith("ends with no-path: its goals come from an input, and it waits for another one")
    (problem,) = problems({"try": {"steps": [{"wait": {"for": "stick.done"}}], "catch": {"timeout": [SAY]}}})
    assert problem.endswith("ends with timeout: only `at_most_s` of `wait: {for: ...}` or `ask` ends a step so")


@pytest.mark.parametrize(
    ("then", "hint"), [("resumes", "; did you mean resume?"), ("restrat", "; did you mean restart?"), ("stop", "")]
)
def test_an_outcome_of_its_own_that_no_try_catches_is_a_remark(then: str, hint: str) -> None:
    during = {"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", "then": then}]}}
    words = f"no `try` catches {then}: it ends the mission as failed{hint}"
    assert checked(during).remarks == [f"steps[0].during.when[0].then: {words}"]
    ended = {"during": {"at_most_s": 5, "steps": [during]}}
    assert checked(ended).remarks == [f"steps[0].during.steps[0].during.when[0].then: {words}"]
    catching: dict[str, Any] = {"steps": [ended], "catch": {then: [SAY]}}
    assert checked({"try": catching}).remarks == []
    assert checked({"try": {**catching, "catch": {"any": [SAY]}}}).remarks == []
    other = {"try": {**catching, "catch": {"timeout": [SAY]}}}
    assert checked(other).remarks == [f"steps[0].try.steps[0].during.steps[0].during.when[0].then: {words}"]
    own_branch = {"try": {"steps": [during], "catch": {then: [during]}}}
    assert checked(own_branch).remarks == [f"steps[0].try.catch.{then}[0].during.when[0].then: {words}"]


def test_an_outcome_of_its_own_that_is_only_retried_ends_the_mission_after_its_retries() -> None:
    during = {"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", "then": "low"}]}}
    at = "steps[0].try.steps[0].during.when[0].then: no `try` catches low"
    for again in ({}, {"again_on": ["low"]}, {"again_on": ["any"]}):
        retried = {"try": {"steps": [during], "retries": 2, **again}}
        assert checked(retried).remarks == [f"{at}: after its retries it ends the mission as failed"]
        assert checked({"try": {"steps": [retried], "catch": {"low": [SAY]}}}).remarks == []
    another = {"try": {"steps": [during, FOLLOW], "retries": 2, "again_on": ["blocked"]}}
    assert checked(another).remarks == [f"{at}: it ends the mission as failed"]


def test_one_that_leads_on_or_that_cannot_happen_is_none() -> None:
    for watch in ({"then": "restart"}, {"steps": [WAIT]}, {"steps": [{"end": {}}], "then": "low"}):
        assert checked({"during": {"steps": [WAIT], "when": [{"if": "run_s > 1", **watch}]}}).remarks == []


def test_any_for_which_nothing_is_left_is_a_remark() -> None:
    nothing = "no step within ends with an outcome that is left for it; faults, only where a key names them"
    remarks = [f"steps[0].try.catch.any: {nothing}"]
    facts = {"has_scanner": False, "has_battery": False}
    steps = {"steps": [FOLLOW], "catch": {"any": [SAY]}}
    assert checked({"try": steps}, **facts).remarks == remarks
    assert checked({"try": steps}).remarks == []
    assert checked({"try": {**steps, "retries": 1, "again_on": ["fault:DRV-25"]}}, **facts).remarks == []
    assert checked({"try": {**steps, "retries": 1, "again_on": ["lost"]}}, **facts).remarks == []
    caught = {"steps": [ASK], "catch": {"timeout": [SAY], "any": [SAY]}}
    assert checked({"try": caught}).remarks == remarks
    assert checked({"try": {"steps": [FOLLOW], "catch": {"fault": [SAY], "any": [SAY]}}}, **facts).remarks == remarks


@pytest.mark.parametrize(
    ("one", "other"), [("run_s > 3", "(run_s > 3)"), ("run_s > 3 and stick.done", "(run_s>3.0) and (stick.done)")]
)
def test_conditions_that_are_written_in_different_ways_are_the_same(one: str, other: str) -> None:
    when = [{"if": one, "then": "a"}, {"if": other, "then": "b"}]
    assert problems({"during": {"steps": [WAIT], "when": when}}) == [
        "steps[0].during.when[1].if: the same condition as a watcher above: this one is never asked"
    ]


@pytest.mark.parametrize(
    ("condition", "ends"),
    [
        ("run_s < 1", False),
        ("run_s == 1", False),
        ("driven_m <= 1 and stick.done", False),
        ("not run_s > 1", False),
        ("not (run_s > 1 or stick.done)", False),
        ("run_s < 1 or driven_m < 1", False),
        ("run_s < 1 or stick.done", True),
        ("run_s > 1", True),
        ("run_s >= 1 and driven_m != 0", True),
        ("not run_s < 1", True),
        ("not stick.done", True),
        ("battery_v < 1", True),
    ],
)
def test_a_condition_that_lapses_as_time_goes_on_is_a_remark(condition: str, ends: bool) -> None:
    wait = {"for": condition}
    words = "does not hold any more once run_s or driven_m has grown, and then only a person ends the step: add"
    remarks = [] if ends else [f"steps[0].wait.for: {words} at_most_s"]
    assert checked({"wait": wait}).remarks == remarks
    assert checked({"wait": {**wait, "at_most_s": 5}}).remarks == []
    until = {"until": condition, "steps": [WAIT]}
    assert checked({"repeat": until}).remarks == ([] if ends else [f"steps[0].repeat.until: {words} times"])
    assert checked({"during": {"steps": [{"wait": wait}], "at_most_s": 5}}).remarks == []
    assert checked({"together": {"steps": [WAIT], "beside": [{"wait": wait}, ENDLESS]}}).remarks == []


def test_the_numbers_of_steps_are_those_of_their_order_in_the_file_for_every_reader() -> None:
    inner: Any = {"try": {"retries": 1, "between": [ASK], "steps": [WAIT], "catch": {"any": [FOLLOW, SAY]}}}
    when = [{"if": "run_s > 1", "then": "x"}, {"if": "run_s > 2", "steps": [inner]}]
    choose = {"choose": [{"if": "run_s > 1", "steps": [ASK]}, {"steps": [WAIT]}]}
    steps: list[Any] = [
        WAIT,
        {"during": {"steps": [FOLLOW], "when": when}},
        {"together": {"steps": [choose], "beside": [WAIT, WAIT]}},
    ]
    made = built(*steps)
    assert [path for path, _ in made.steps] == [path for path, _, _ in numbered(steps)]
    assert made.tree.size == 9


# ---------------------------------------------------------------------------------------------- parts

ROBOT = "mission: m\nrobot: artemis.yaml\nbus: simulation\n"


def refused(tmp_path: Path, text: str) -> str:
    (tmp_path / "artemis.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    (tmp_path / "m.yaml").write_text(ROBOT + text)
    with pytest.raises(ConfigError) as error:
        load_mission(tmp_path / "m.yaml")
    return str(error.value).replace(f"{tmp_path}/", "")


def test_arguments_are_put_in_whole_and_inside_texts() -> None:
    text = b"""
steps: [{call: {part: visit, with: {place: gate, seconds: 2.5}}}]
parts:
  visit: {takes: {place: , seconds: 20}, steps: [{say: "to the ${place}, $seconds s, $5"}, {wait: {seconds: $seconds}}]}
"""
    document, found = expanded(survey(text, "m")[0])
    assert found == []
    data: Any = document.data
    assert data["steps"][0]["call"]["steps"] == [{"say": "to the gate, 2.5 s, $5"}, {"wait": {"seconds": 2.5}}]


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        ("vist", "m.yaml:5:3: steps[0].call: no such part; did you mean visit?"),
        ("{part: visit}", "m.yaml:5:3: steps[0].call: part visit needs the argument seconds"),
        ("{part: visit, with: {seconds: 1, second: 2}}", "5:42: steps[0].call.with.second: part visit takes no second"),
        ("{part: visit, with: {seconds: soon}}", "m.yaml:9:21: parts.visit.steps[0].wait.seconds: expected a number"),
        ("{part: visit, with: {seconds: 1}, steps: []}", "steps[0].call: steps: unknown key; known keys: part, with"),
        ("{name: visit}", "steps[0].call.name: unknown key; known keys: part, with"),
        ("{part: 3}", "m.yaml:5:10: steps[0].call.part: expected text, found 3"),
    ],
)
def test_calls_that_do_not_fit_are_refused_where_they_stand(tmp_path: Path, call: str, problem: str) -> None:
    part = "  visit:\n    takes: {seconds: }\n    steps: [{wait: {seconds: $seconds}}]\n"
    assert problem in refused(tmp_path, f"steps:\n- call: {call}\nparts:\n{part}")


@pytest.mark.parametrize(
    ("parts", "problem"),
    [
        ("{a: {steps: [{call: b}]}, b: {steps: [{call: a}]}}", "a part cannot call itself: a -> b -> a"),
        ("{a: {steps: [{say: $x}]}}", "the part takes no x; there are no arguments"),
        ("{a: {steps: [{say: x}]}, b: {steps: [{say: x}]}}", "parts.b: no step calls this part"),
        ("{a: {takes: {1st: 2}, steps: [{say: x}]}}", "the name of an argument begins with a letter or _"),
        ("{a: {steps: []}}", "expected a list of at least 1"),
        ("{a: {step: []}}", "parts.a.step: unknown key; did you mean steps?"),
    ],
)
def test_parts_that_do_not_fit_are_refused(tmp_path: Path, parts: str, problem: str) -> None:
    assert problem in refused(tmp_path, f"steps: [{{call: a}}]\nparts: {parts}\n")


@pytest.mark.parametrize("call", ["{part: a}", "{part: a, with: {x: 1, y: 2}}", "aa", "{part: a, with: {x: $z}}"])
def test_a_call_that_does_not_fit_hides_no_part_that_is_not_called(tmp_path: Path, call: str) -> None:
    parts = "{a: {takes: {x: }, steps: [{wait: {seconds: $x}}]}, other: {steps: [{wait: {seconds: 1}}]}}"
    found = refused(tmp_path, f"steps: [{{call: {call}}}]\nparts: {parts}\n")
    assert "parts.other: no step calls this part" in found
    assert "parts.a:" not in found


def test_parts_that_double_each_other_do_not_fill_the_memory(tmp_path: Path) -> None:
    parts = [f"  p{n}: {{steps: [{{call: p{n + 1}}}, {{call: p{n + 1}}}]}}" for n in range(30)]
    text = "\n".join(["steps: [{call: p0}]", "parts:", *parts, "  p30: {steps: [{wait: {seconds: 1}}]}"])
    assert "more than 20000 steps, parts put in" in refused(tmp_path, text)


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ("{say: x}", "steps: no step takes time"),
        ("{wait: {}}", "wait has exactly one of seconds, for"),
        ("{wait: {seconds: 1, at_most_s: 3}}", "at_most_s belongs to wait: {for: ...}"),
        ("{repeat: {times: 0, steps: [{say: x}]}}", "repeat.times: expected at least 1"),
        ("{repeat: {steps: []}}", "expected a list of at least one"),
        ("{try: {steps: [{say: x}]}}", "neither retries nor catch"),
        (
            "{try: {steps: [{say: x}], catch: {any: [{say: x}]}, between: [{say: x}]}}",
            "again_on and between belong to retries",
        ),
        ("{try: {steps: [{say: x}], on: {any: []}}}", "try.on: unknown key; did you mean catch? (readers of YAML 1.1"),
        ("{during: {steps: [{say: x}]}}", "neither at_most_s nor when"),
        ("{during: {steps: [{say: x}], when: [{if: run_s > 1}]}}", "neither steps nor then"),
        ("{ask: {question: a, answers: [b, b]}}", "two answers are the same"),
        ("{repeet: {steps: [{say: x}]}}", "unknown key; did you mean repeat?"),
        ("{repeat: {stepz: [{say: x}]}}", "unknown key; did you mean steps?"),
        ("{end: {outcome: don}}", "did you mean done?"),
        ("{repeat: }", "repeat is empty"),
        ("{say: x, wait: {seconds: 1}}", "a step has exactly one key"),
        ("{repeat: {steps: [{stop: {}}]}}", "ends the mission: it can only be the last step"),
        ("{repeat: {steps: [{follow: {path: a.csv, follower: {}}}]}}", "calibrate first"),
        (
            "{choose: [{if: run_s > 1, steps: [{say: x}], else: [{say: y}]}]}",
            "choose[0].else: unknown key; write a last branch without `if`",
        ),
        (
            "{choose: [{if: run_s > 1, steps: [{say: x}]}], else: [{say: y}]}",
            "steps[0].else: unknown key; write a last branch without `if`",
        ),
        ("{goto: charger}", "steps[0].goto: expected a mapping, found 'charger': write {map: FILE, to: charger}"),
        ("{goto: [charger]}", "steps[0].goto: expected a mapping, found a list of 1"),
    ],
)
def test_what_a_word_cannot_take_is_refused(tmp_path: Path, step: str, problem: str) -> None:
    assert problem in refused(tmp_path, f"steps: [{step}]\n")


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        ("{repeet: {steps: [{say: x}]}}", "unknown key; did you mean repeat?"),
        (
            "{repeat: {steps: [{wait: {seconds: 1}}], tims: 3}}",
            "steps[1].repeat.tims: unknown key; did you mean times?",
        ),
        ("{wait: {secnds: 1}}", "did you mean seconds?"),
        ("{call: nowhere}", "no such part"),
    ],
)
def test_what_is_wrong_with_a_step_does_not_hide_what_is_wrong_with_others(
    tmp_path: Path, steps: str, told: str
) -> None:
    others = (
        '{try: {steps: [{wait: {seconds: 1}}], retries: 1, again_on: ["fault:DRV-255", nothing]}}',
        "{wait: {for: run_s >> 1}}",
        "{choose: [{steps: [{say: a}]}, {if: run_s > 1, steps: [{say: b}]}]}",
        "{during: {steps: [{wait: {seconds: 1}}], when: [{if: run_s > 1, then: a}, {if: (run_s > 1), then: b}]}}",
        "{repeat: {times: 2, steps: [{say: x}]}}",
    )
    found = refused(tmp_path, f"steps: [{{wait: {{seconds: 1}}}}, {steps}, {', '.join(others)}]\n")
    assert told in found
    for problem in (
        "steps[2].try.again_on[0]: no fault DRV-255; did you mean DRV-25?",
        "steps[2].try.again_on[1]: no step within ends with nothing",
        "steps[3].wait.for: condition 'run_s >> 1': run_s is a number, compared with >",
        "steps[4].choose[0]: without `if` it always holds",
        "steps[5].during.when[1].if: the same condition",
        "steps[6].repeat: no time passes",
    ):
        assert problem in found, found


@pytest.mark.parametrize(
    "wrong",
    [
        "{wait: {seconds: -1}}",
        "{repeat: {tims: 3, steps: [{wait: {for: run_s > 1}}]}}",
        "{approach: {until: run_s > 1}}",
        "{calibrate: {steering: from_nowhere}}",
        "{ask: {question: a, answers: [left], at_most: 3}}",
        "{ask: {question: a, answer: [left]}}",
        "{wate: {seconds: 1}}",
    ],
)
def test_what_is_wrong_with_a_step_does_not_hide_signals_that_are_unknown(tmp_path: Path, wrong: str) -> None:
    during = "{during: {at_most_s: -3, steps: [{wait: {for: batery_v < 22}}], when: [{if: round > 2, then: low}]}}"
    found = refused(tmp_path, f"steps: [{wrong}, {during}]\n")
    for problem in (
        "steps[1].during.at_most_s: expected more than 0, found -3",
        "unknown signal 'batery_v'; nearest is 'battery_v'",
        "unknown signal 'round'; it exists only inside `repeat`",
    ):
        assert problem in found, found


@pytest.mark.parametrize("wrong", ["{ask: {question: a}}", "{wate: {seconds: 1}}", "{call: nowhere}"])
def test_signals_that_a_step_which_cannot_be_read_may_have_are_not_called_unknown(tmp_path: Path, wrong: str) -> None:
    assert "unknown signal" not in refused(tmp_path, f"steps: [{wrong}, {{wait: {{for: answer == 'a'}}}}]\n")


def test_answers_that_cannot_be_read_are_any(tmp_path: Path) -> None:
    wait = "{wait: {for: answer == 'lift'}}"
    read = "{ask: {question: a, answers: [left, right], at_most: 3}}"
    assert "answer is never 'lift'; nearest is 'left'" in refused(tmp_path, f"steps: [{read}, {wait}]\n")
    for answers in ("[left, 3]", "left", "{left: right}"):
        assert "never" not in refused(tmp_path, f"steps: [{{ask: {{question: a, answers: {answers}}}}}, {wait}]\n")


@pytest.mark.parametrize("wrong", ["{follow: {pth: a.csv}}", "{approach: {untl: run_s > 1}}", "{ask: {question: a}}"])
def test_what_is_wrong_with_a_step_does_not_hide_outcomes_with_which_no_step_ends(tmp_path: Path, wrong: str) -> None:
    catch = "{bloked: [{say: x}], lost: [{say: y}], timeout: [{say: z}]}"
    steps = f"{{try: {{steps: [{wrong}], catch: {catch}}}}}"
    found = refused(tmp_path, f"steps: [{{calibrate: {{steering: from_potentiometers}}}}, {steps}]\n")
    possible = "timeout" if "ask" in wrong else "lost"
    told = [name for name in ("bloked", "lost", "timeout") if f"no step within ends with {name}" in found]
    assert told == [name for name in ("bloked", "lost", "timeout") if name != possible], found


def test_of_what_depends_on_a_step_that_cannot_be_read_nothing_is_said(tmp_path: Path) -> None:
    steps = (
        "{try: {steps: [{smel: {}}], catch: {gas: [{say: gas}]}}}",
        "{repeat: {times: 2, steps: [{wate: {seconds: 1}}]}}",
        "{wait: {for: gas_ppm > 1}}",
        "{wait: {for: answer == 'a'}}",
        "{repeat: {times: 2, steps: [{call: nowhere}]}}",
    )
    found = refused(tmp_path, f"steps: [{', '.join(steps)}]\n")
    assert [line.partition("steps")[2].partition(":")[0] for line in found.splitlines()] == [
        "[0].try.steps[0].smel",
        "[1].repeat.steps[0].wate",
        "[4].repeat.steps[0].call",
    ]
