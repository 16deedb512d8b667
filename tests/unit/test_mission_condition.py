"""Conditions of a mission: what they mean, and what is refused."""

from __future__ import annotations

import pytest

from artemis.errors import ConfigError
from artemis.states.condition import Compare, Has, SignalKind, Signals, comparisons, holds, names_asked, parse

DECLARED = {
    "battery_v": SignalKind(kind=float),
    "run_s": SignalKind(kind=float),
    "stick.done": SignalKind(kind=bool),
    "blocked": SignalKind(kind=bool),
    "answer": SignalKind(kind=str, values=("left", "right")),
}
LOW: Signals = {"battery_v": 22.0, "run_s": 10.0, "blocked": True, "answer": "left"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("battery_v < 23.2", True),
        ("battery_v<22", False),
        ("battery_v <= 22", True),
        ("battery_v >= 22.0", True),
        ("battery_v > 22", False),
        ("battery_v == 22", True),
        ("battery_v != 22", False),
        ("battery_v > -3", True),
        ("blocked", True),
        ("not blocked", False),
        ("stick.done", False),
        ("not stick.done", True),
        ("answer == 'left'", True),
        ("answer != 'left'", False),
        ("run_s > 5 and battery_v > 23", False),
        ("run_s > 5 or battery_v > 23", True),
        ("run_s > 50 and blocked or blocked", True),
        ("run_s > 50 and (blocked or blocked)", False),
        ("not not blocked", True),
        ("not (run_s > 50 or stick.done)", True),
        ("  run_s  >  5  ", True),
    ],
)
def test_a_condition_means_what_it_says(text: str, expected: bool) -> None:
    assert holds(parse(text, DECLARED), LOW) is expected


@pytest.mark.parametrize(
    "text",
    [
        "battery_v < 23",
        "battery_v > 23",
        "battery_v != 23",
        "answer == 'left'",
        "blocked",
        "not battery_v < 23",
        "not (battery_v < 23 and not blocked)",
        "not (blocked or battery_v < 23)",
        "not blocked and battery_v < 23",
        "blocked or not battery_v < 23",
    ],
)
def test_a_signal_that_nobody_has_given_yet_makes_it_false(text: str) -> None:
    assert not holds(parse(text, DECLARED), {})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("batery_v < 23", "unknown signal 'batery_v'; nearest is 'battery_v'"),
        ("battery < 23", "unknown signal 'battery'; nearest is 'battery_v'"),
        ("battery_v", "battery_v is a number: compare it"),
        ("battery_v < low", "battery_v is a number, compared with low"),
        ("battery_v < '23'", "battery_v is a number, compared with '23'"),
        ("battery_v <", "battery_v is a number, compared with the end"),
        ("battery_v = 23", "cannot read '='"),
        ("battery_v < 23 24", "unexpected '24'"),
        ("battery_v < 1 and", "expected a signal, found 'the end'"),
        ("", "expected a signal"),
        ("and", "expected a signal, found 'and'"),
        ("(blocked", "a parenthesis is not closed"),
        ("blocked)", "unexpected ')'"),
        ("blocked == 1", "blocked is true or false: write blocked, or not blocked"),
        ("answer", "answer is a text: compare it with =="),
        ("answer == left", "answer is a text, compared with left: texts stand in single quotes"),
        ("answer < 'left'", "answer is a text: it can only be compared by == and !="),
        ("answer == 'letf'", "answer is never 'letf'; nearest is 'left'"),
        ("answer == 'left", 'cannot read "\'"'),
        ("not " * 60 + "blocked", "too many parentheses"),
        ("__import__('os')", "cannot read '_'"),
        ("3 < battery_v", "expected a signal, found '3'"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_reason(text: str, problem: str) -> None:
    with pytest.raises(ConfigError) as refused:
        parse(text, DECLARED)
    assert str(refused.value).startswith(f"condition {text!r}: {problem}")


@pytest.mark.parametrize("text", ["not blocked", "not blocked or battery_v < 23", "not (blocked and battery_v < 23)"])
def test_what_is_true_whatever_an_unknown_signal_is_holds(text: str) -> None:
    assert holds(parse(text, DECLARED), {})


def test_what_it_asks_of_single_signals_is_known_from_left_to_right() -> None:
    condition = parse("not (blocked and run_s > 5) or answer == 'left'", DECLARED)
    asked = [Has("blocked"), Compare("run_s", ">", 5.0), Compare("answer", "==", "left")]
    assert list(comparisons(condition)) == asked


def test_names_in_a_broken_text_are_those_of_signals() -> None:
    assert names_asked("not (run_s > 5 and stick.done) or answer == 'left' and )") == {"run_s", "stick.done", "answer"}
