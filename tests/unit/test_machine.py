"""The table of robot modes: every mode with every event, and the diagram made from it."""

from __future__ import annotations

import itertools
import logging
import re

import pytest

from artemis.states.machine import TRANSITIONS, ModeMachine, mermaid
from artemis.values import Event, Mode

EVENTS = ["aligned", "calibrate", "teleop", "follow", "act", "done", "stop", "fault", "rearmed", "acknowledged", "end"]
EXPECTED = {
 #             aligned  calibrate    teleop    follow    act    done     stop         fault    rearmed  acknowl. end
 "init":      ["ready", "",          "",       "",       "",    "",      "quickstop", "fault", "",      "",      "end"],
 "ready":     ["",      "calibrate", "teleop", "follow", "act", "",      "quickstop", "fault", "",      "",      "end"],
 "calibrate": ["",      "",          "",       "",       "",    "ready", "quickstop", "fault", "",      "",      "end"],
 "teleop":    ["",      "",          "",       "",       "",    "ready", "quickstop", "fault", "",      "",      "end"],
 "follow":    ["",      "",          "",       "",       "",    "ready", "quickstop", "fault", "",      "",      "end"],
 "act":       ["",      "",          "",       "",       "",    "ready", "quickstop", "fault", "",      "",      "end"],
 "quickstop": ["",      "",          "",       "",       "",    "",      "quickstop", "fault", "ready", "init",  "end"],
 "fault":     ["",      "",          "",       "",       "",    "",      "",          "",      "",      "init",  "end"],
 "end":       ["",      "",          "",       "",       "",    "",      "",          "",      "",      "",      ""],
}  # fmt: skip
"""Next mode by mode and event; empty: refused."""

WAYS: dict[str, list[Event]] = {
    "init": [],
    "ready": [Event.ALIGNED],
    "calibrate": [Event.ALIGNED, Event.CALIBRATE],
    "teleop": [Event.ALIGNED, Event.TELEOP],
    "follow": [Event.ALIGNED, Event.FOLLOW],
    "act": [Event.ALIGNED, Event.ACT],
    "quickstop": [Event.STOP],
    "fault": [Event.FAULT],
    "end": [Event.END],
}
"""How to get into each mode from the start."""


def machine_in(mode: str) -> ModeMachine:
    machine = ModeMachine()
    for event in WAYS[mode]:
        assert machine.fire(event)
    assert machine.mode.value == mode
    return machine


def test_the_expected_table_names_every_mode_and_every_event() -> None:
    assert sorted(EXPECTED) == sorted(mode.value for mode in Mode)
    assert sorted(EVENTS) == sorted(event.name.lower() for event in Event)


def test_a_machine_starts_in_init() -> None:
    assert ModeMachine().mode is Mode.INIT


@pytest.mark.parametrize(("mode", "event"), list(itertools.product(EXPECTED, EVENTS)))
def test_every_mode_answers_every_event_as_expected(mode: str, event: str) -> None:
    machine = machine_in(mode)
    following = EXPECTED[mode][EVENTS.index(event)]
    assert machine.fire(Event[event.upper()]) is bool(following)
    assert machine.mode.value == (following or mode)


def test_refusal_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    machine = machine_in("fault")
    with caplog.at_level(logging.DEBUG):
        assert not machine.fire(Event.STOP)  # asked at every tick as long as the verdict lasts
    assert [record.message for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_a_machine_knows_no_way_but_the_events() -> None:
    machine = ModeMachine()
    assert set(machine._machine.get_triggers(*Mode)) == set(EVENTS)


def test_machines_share_nothing() -> None:
    one, other = ModeMachine(), ModeMachine()
    assert one.fire(Event.FAULT)
    assert other.mode is Mode.INIT


# ---------------------------------------------------------------------------------------------- diagram

RESERVED = {"end", "state", "note", "as", "direction", "class", "classDef", "style", "default"}
HEADER = re.compile(r"stateDiagram-v2")
NAMED = re.compile(r'    state "([^"]+)" as (\w+)')
ARROW = re.compile(r"    (\[\*\]|\w+) --> (\[\*\]|\w+)(?:: ([^:;#\"{}]+))?")


def parsed() -> tuple[dict[str, str], list[tuple[str, str, str]]]:
    """Labels by identifier, and the arrows; every line must be one or the other."""
    first, *lines = mermaid().splitlines()
    assert HEADER.fullmatch(first)
    labels: dict[str, str] = {}
    arrows: list[tuple[str, str, str]] = []
    for line in lines:
        if named := NAMED.fullmatch(line):
            labels[named[2]] = named[1]
        else:
            arrow = ARROW.fullmatch(line)
            assert arrow, f"not Mermaid: {line!r}"
            arrows.append((arrow[1], arrow[2], arrow[3] or ""))
    return labels, arrows


def test_diagram_uses_no_reserved_word_and_labels_every_mode_with_its_name() -> None:
    labels, arrows = parsed()
    used = {name for source, target, _ in arrows for name in (source, target)} - {"[*]"}
    assert not used & RESERVED
    assert {labels.get(name, name) for name in used} == {mode.value for mode in Mode}


def test_diagram_has_exactly_the_arrows_of_the_table() -> None:
    labels, arrows = parsed()
    drawn = sorted(
        (labels.get(source, source), labels.get(target, target), event)
        for source, target, events in arrows
        if "[*]" not in (source, target)
        for event in events.split(", ")
    )
    expected = sorted(
        (mode, following, Event[event.upper()].value)
        for mode, row in EXPECTED.items()
        for event, following in zip(EVENTS, row, strict=True)
        if following
    )
    assert drawn == expected
    assert len(TRANSITIONS) == len(expected)


def test_diagram_starts_at_init_and_ends_at_end() -> None:
    labels, arrows = parsed()
    assert [labels.get(target, target) for source, target, _ in arrows if source == "[*]"] == ["init"]
    assert [labels.get(source, source) for source, target, _ in arrows if target == "[*]"] == ["end"]
