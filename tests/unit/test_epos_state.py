"""Statusword and controlword of the EPOS against the patterns of its specification, bit by bit."""

from __future__ import annotations

import itertools

import pytest

from artemis.devices.epos_state import COMMANDS, Controlword, controlword
from artemis.drive_states import DriveState, Goal
from artemis.families.epos1 import EPOS1

STATUSWORDS = {
    "start": "x0xx xxx0 x000 0000",
    "not ready to switch on": "x0xx xxx1 x000 0000",
    "switch on disabled": "x0xx xxx1 x100 0000",
    "ready to switch on": "x0xx xxx1 x010 0001",
    "switched on": "x0xx xxx1 x010 0011",
    "refresh": "x1xx xxx1 x010 0011",
    "measure init": "x1xx xxx1 x011 0011",
    "operation enable": "x0xx xxx1 x011 0111",
    "quick stop active": "x0xx xxx1 x001 0111",
    "fault reaction active (disabled)": "x0xx xxx1 x000 1111",
    "fault reaction active (enabled)": "x0xx xxx1 x001 1111",
    "fault": "x0xx xxx1 x000 1000",
}
"""EPOS firmware specification 2010, 8.1.1, table 1: bits 15 to 0."""

CONTROLWORDS = {
    Controlword.DISABLE_VOLTAGE: "xxxx xx0x",
    Controlword.SHUTDOWN: "0xxx x110",
    Controlword.QUICK_STOP: "0xxx x01x",
    Controlword.ENABLE_OPERATION: "0xxx 1111",
    Controlword.FAULT_RESET: "1xxx xxxx",
}
"""14.59: bits 7 to 0."""

GOALS = ["disabled", "enabled", "hold", "quick stopped", "fault reset"]
COMMANDED = {
    #                                   disabled enabled hold    quick stopped  fault reset
    "start":                            [0x00,   0x00,   0x00,   0x00,          0x00],
    "not ready to switch on":           [0x00,   0x00,   0x00,   0x00,          0x00],
    "switch on disabled":               [0x00,   0x06,   0x00,   0x00,          0x00],
    "ready to switch on":               [0x00,   0x0F,   0x00,   0x00,          0x00],
    "switched on":                      [0x00,   0x0F,   0x00,   0x00,          0x00],
    "refresh":                          [0x00,   0x0F,   0x0F,   0x0B,          0x00],
    "measure init":                     [0x00,   0x0F,   0x0F,   0x0B,          0x00],
    "operation enable":                 [0x00,   0x0F,   0x0F,   0x0B,          0x00],
    "quick stop active":                [0x00,   0x0F,   0x0B,   0x0B,          0x00],
    "fault reaction active (disabled)": [0x00,   0x00,   0x00,   0x00,          0x00],
    "fault reaction active (enabled)":  [0x00,   0x0B,   0x0B,   0x0B,          0x0B],
    "fault":                            [0x00,   0x00,   0x00,   0x00,          0x80],
    "unknown":                          [0x00,   0x0B,   0x0B,   0x0B,          0x00],
}  # fmt: skip
"""Controlword by state and goal: off 00, shutdown 06, enable 0F, quick stop 0B, reset 80."""


def words(pattern: str) -> set[int]:
    """Every number that fits a pattern of 0, 1 and x."""
    choices = ("01" if bit == "x" else bit for bit in pattern.replace(" ", ""))
    return {int("".join(bits), 2) for bits in itertools.product(*choices)}


def test_every_statusword_tells_the_state_of_its_pattern_and_no_other() -> None:
    expected = ["unknown"] * 0x10000
    for state, pattern in STATUSWORDS.items():
        for word in words(pattern):
            assert expected[word] == "unknown", "the patterns themselves exclude each other"
            expected[word] = state
    assert [EPOS1.state(word).value for word in range(0x10000)] == expected


def test_every_state_but_unknown_has_a_pattern() -> None:
    assert {*STATUSWORDS, "unknown"} == {state.value for state in DriveState}


@pytest.mark.parametrize(("command", "pattern"), CONTROLWORDS.items())
def test_every_command_has_the_bits_of_the_specification(command: Controlword, pattern: str) -> None:
    assert command in words(pattern)


def test_every_command_is_specified() -> None:
    assert set(CONTROLWORDS) == set(Controlword)


def test_every_state_has_the_expected_command_for_every_goal() -> None:
    assert {
        state.value: [int(COMMANDS[state][Goal[goal.replace(" ", "_").upper()]]) for goal in GOALS]
        for state in DriveState
    } == COMMANDED
    assert all(len(commands) == len(Goal) for commands in COMMANDS.values())


@pytest.mark.parametrize("goal", Goal)
def test_a_drive_whose_state_means_nothing_is_never_switched_on(goal: Goal) -> None:
    assert controlword(DriveState.UNKNOWN, goal) in (Controlword.DISABLE_VOLTAGE, Controlword.QUICK_STOP)


@pytest.mark.parametrize(("state", "goal"), list(itertools.product(DriveState, Goal)))
def test_a_fault_is_reset_only_where_that_is_the_goal(state: DriveState, goal: Goal) -> None:
    reset = bool(controlword(state, goal) & Controlword.FAULT_RESET)
    assert reset is (state is DriveState.FAULT and goal is Goal.FAULT_RESET)


def test_fault_reset_is_a_rising_edge_that_is_repeated() -> None:
    sent = [0]
    for _ in range(6):
        sent.append(controlword(DriveState.FAULT, Goal.FAULT_RESET, sent[-1]))
    assert sent[1:] == [0x80, 0x00, 0x80, 0x00, 0x80, 0x00]


def test_last_controlword_matters_for_nothing_but_the_edge() -> None:
    for state, goal in itertools.product(DriveState, Goal):
        if (state, goal) != (DriveState.FAULT, Goal.FAULT_RESET):
            assert controlword(state, goal, 0x80) == controlword(state, goal, 0x00)
