"""The conditions of a mission: which signals they may ask for, and what is wrong in them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

from artemis.errors import ConfigError
from artemis.progress import MEASURED, OF_BATTERY, OWN_STEPS
from artemis.states.condition import (
    ROUND,
    Compare,
    Condition,
    Either,
    Has,
    Not,
    SignalKind,
    comparisons,
    names_asked,
    parse,
)
from artemis.states.outcomes import NO_BATTERY, NOT_MEASURED, StepFacts
from artemis.states.outline import Path, keys_of, parts_of, steps_in

UNTIL = "until"
"""The key of a behaviour that artemis reads as a condition."""
LONGEST = 1000
"""Characters."""
GROWING = ("run_s", "driven_m")
"""Signals that never sink."""
_BELOW, _ABOVE = ("<", "<=", "=="), (">", ">=", "!=")
_NUMBER, _TRUTH = SignalKind(kind=float), SignalKind(kind=bool)


def lapses(condition: Condition, at_last: bool = False) -> bool:
    """Whether it is `at_last` for ever, once the signals that only grow have grown enough, whatever the others are."""
    match condition:
        case Compare(signal, relation):
            return signal in GROWING and relation in (_ABOVE if at_last else _BELOW)
        case Has():
            return False
        case Not(of):
            return lapses(of, not at_last)
    parts = [lapses(part, at_last) for part in condition.of]
    return any(parts) if isinstance(condition, Either) is at_last else all(parts)


def declared_signals(steps: Any, inputs: Iterable[str], facts: StepFacts) -> dict[str, SignalKind]:  # noqa: ANN401
    """What conditions of a mission may ask for, `round` apart; `steps`: in its file's own form."""
    asks = [parts_of(keys_of(body).get("answers")) for _, word, body in steps_in(steps) if word == "ask"]
    answers = dict.fromkeys(answer for given in asks for answer in given if isinstance(answer, str))
    readable = all(given and all(isinstance(answer, str) for answer in given) for given in asks)
    return {
        **dict.fromkeys(MEASURED, _NUMBER),
        **({"answer": SignalKind(kind=str, values=tuple(answers) if readable else ())} if asks else {}),
        **{f"{name}.{button}": _TRUTH for name in inputs for button in ("done", "record")},
        **{name: _NUMBER for behaviour in facts.behaviours.values() for name in behaviour.signals},
    }


def conditions_in(
    steps: Any,  # noqa: ANN401 (of a file)
    declared: Mapping[str, SignalKind],
    facts: StepFacts,
    *,
    complete: bool,
) -> tuple[dict[Path, Condition], list[tuple[Path, str]]]:
    """The conditions of a mission by their paths, and what is wrong with them.

    Args:
        steps: in its file's own form.
        declared: what they may ask for.
        facts: which of that is measured.
        complete: `declared` is all of them. Else steps that cannot be read may declare more.
    """
    found: dict[Path, Condition] = {}
    problems: list[tuple[Path, str]] = []
    for path, text in _texts(steps):
        known = {**declared, **({ROUND: _NUMBER} if _repeats(path) else {})}
        if not complete and not known.keys() >= names_asked(text):
            continue
        try:
            found[path] = parse(text, known)
        except ConfigError as error:
            problems += [(path, problem) for problem in error.problems]
            continue
        asked = {part.signal for part in comparisons(found[path])}
        if not facts.has_battery:
            problems += [(path, f"{name}: {NO_BATTERY}") for name in sorted(asked.intersection(OF_BATTERY))]
        if not facts.measures_supply:
            measured = asked.intersection(("battery_v", *(OF_BATTERY if facts.has_battery else ())))
            problems += [
                (path, f"{name}: {NOT_MEASURED}, or use a time, such as run_s > 3600") for name in sorted(measured)
            ]
    return found, problems


def _texts(steps: Any) -> Iterator[tuple[Path, str]]:  # noqa: ANN401 (of a file)
    for path, word, body in steps_in(steps):
        keys = keys_of(body)
        given: list[tuple[Path, Any]] = []
        if word == "wait":
            given = [((*path, "for"), keys.get("for"))]
        elif word == "repeat" or word not in OWN_STEPS:
            given = [((*path, UNTIL), keys.get(UNTIL))]
        elif word in ("during", "choose"):
            at, branches = ((*path, "when"), keys.get("when")) if word == "during" else (path, body)
            given = [((*at, index, "if"), keys_of(each).get("if")) for index, each in enumerate(parts_of(branches))]
        for place, text in given:
            if isinstance(text, str) and 0 < len(text) <= LONGEST:
                yield place, text


def _repeats(path: Path) -> bool:
    """Whether a condition is asked in a `repeat`, or ends it."""
    return any(word == "repeat" and isinstance(index, int) for index, word in pairwise(path))
