"""Following the command table on a drive with the transitions of the firmware specification leads where it should."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from artemis.devices.epos_state import controlword
from artemis.drive_states import DriveState, Goal

S = DriveState
SWITCH_OFF = {S.READY: S.SWITCH_ON_DISABLED, S.SWITCHED_ON: S.SWITCH_ON_DISABLED}  # 7, 10
TRANSITIONS: dict[str, dict[DriveState, DriveState]] = {
    "shutdown": {S.SWITCH_ON_DISABLED: S.READY, S.SWITCHED_ON: S.READY, S.OPERATION_ENABLE: S.READY},  # 2, 6, 8
    "switch on": {S.READY: S.SWITCHED_ON, S.OPERATION_ENABLE: S.SWITCHED_ON},  # 3, 5
    "enable": {S.READY: S.SWITCHED_ON, S.SWITCHED_ON: S.REFRESH, S.QUICK_STOP_ACTIVE: S.OPERATION_ENABLE},  # 3, 4, 16
    "disable voltage": {
        **SWITCH_OFF,
        S.OPERATION_ENABLE: S.SWITCH_ON_DISABLED,  # 9
        S.QUICK_STOP_ACTIVE: S.SWITCH_ON_DISABLED,  # 12
    },
    "quick stop": {**SWITCH_OFF, S.OPERATION_ENABLE: S.QUICK_STOP_ACTIVE},  # 11
}
"""EPOS firmware specification 2010, 8.1.2."""
AUTOMATIC = {
    S.START: S.NOT_READY,  # 0
    S.NOT_READY: S.SWITCH_ON_DISABLED,  # 1
    S.REFRESH: S.MEASURE_INIT,  # 20
    S.MEASURE_INIT: S.OPERATION_ENABLE,  # 21
    S.FAULT_REACTION_DISABLED: S.FAULT,  # 14
    S.FAULT_REACTION_ENABLED: S.FAULT,  # 18
}
POWERED = {S.OPERATION_ENABLE, S.QUICK_STOP_ACTIVE}
"""States in which the motor may turn under power."""
STATES = [state for state in DriveState if state is not S.UNKNOWN]
WITHOUT_POWER = (Goal.DISABLED, Goal.QUICK_STOPPED, Goal.FAULT_RESET)
STEPS = 12

REACHED: dict[Goal, set[DriveState]] = {
    Goal.DISABLED: {S.SWITCH_ON_DISABLED, S.FAULT},
    Goal.ENABLED: {S.OPERATION_ENABLE},
    Goal.HOLD: {S.OPERATION_ENABLE, S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED, S.FAULT},
    Goal.QUICK_STOPPED: {S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED, S.FAULT},
    Goal.FAULT_RESET: {S.SWITCH_ON_DISABLED},
}


def command_in(word: int) -> str:
    """What the low byte of a controlword orders (14.59)."""
    if word & 0b0010 == 0:
        return "disable voltage"
    if word & 0b0110 == 0b0010:
        return "quick stop"
    if word & 0b0111 == 0b0110:
        return "shutdown"
    return "enable" if word & 0b1111 == 0b1111 else "switch on"


class AbstractDrive:
    def __init__(self, state: DriveState) -> None:
        self.state = state
        self.word = 0
        self.coasted = False
        """Power was cut while the motor may have turned."""

    def obey(self, word: int) -> None:
        rising, self.word = word & ~self.word & 0x80, word
        if rising:
            if self.state is S.FAULT:
                self.state = S.SWITCH_ON_DISABLED  # 15
        elif not word & 0x80:
            following = TRANSITIONS[command_in(word)].get(self.state, self.state)
            self.coasted |= self.state in POWERED and following not in POWERED
            self.state = following

    def proceed(self) -> None:
        self.state = AUTOMATIC.get(self.state, self.state)


def follow(start: DriveState, goal: Goal) -> tuple[AbstractDrive, list[DriveState]]:
    drive, passed, word = AbstractDrive(start), [start], 0
    for _ in range(STEPS):
        word = controlword(drive.state, goal, word)
        drive.obey(word)
        passed.append(drive.state)
        drive.proceed()
        passed.append(drive.state)
    return drive, passed


@pytest.mark.parametrize(("start", "goal"), list(itertools.product(STATES, Goal)))
def test_commands_lead_from_every_state_to_every_goal(start: DriveState, goal: Goal) -> None:
    drive, passed = follow(start, goal)
    in_fault = start in (S.FAULT, S.FAULT_REACTION_DISABLED, S.FAULT_REACTION_ENABLED)
    expected = {S.FAULT} if in_fault and goal is not Goal.FAULT_RESET else REACHED[goal]
    assert drive.state in expected
    assert len(set(passed[-4:])) == 1, "and there it stays"


@pytest.mark.parametrize(("start", "goal"), list(itertools.product(STATES, WITHOUT_POWER)))
def test_nothing_is_enabled_on_the_way_to_a_goal_without_power(start: DriveState, goal: Goal) -> None:
    if start in (S.REFRESH, S.MEASURE_INIT):  # these end in Operation Enable by themselves
        return
    _, passed = follow(start, goal)
    entered = [after for before, after in itertools.pairwise(passed) if after is not before]
    assert S.OPERATION_ENABLE not in entered


@pytest.mark.parametrize(("start", "goal"), list(itertools.product(STATES, (Goal.QUICK_STOPPED, Goal.HOLD))))
def test_a_moving_drive_is_never_left_to_coast(start: DriveState, goal: Goal) -> None:
    drive, _ = follow(start, goal)
    assert not drive.coasted


def test_holding_keeps_enabled_what_is_enabled_and_off_what_is_off() -> None:
    for start in (S.OPERATION_ENABLE, S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED, S.FAULT):
        drive, passed = follow(start, Goal.HOLD)
        assert set(passed) == {drive.state} == {start}
    assert follow(S.REFRESH, Goal.HOLD)[0].state is S.OPERATION_ENABLE
    assert follow(S.READY, Goal.HOLD)[0].state is S.SWITCH_ON_DISABLED


class Following(RuleBasedStateMachine):
    """Goals change, the drive is slow or fails: what holds in every case."""

    def __init__(self) -> None:
        super().__init__()
        self.drive = AbstractDrive(S.START)
        self.last = 0

    @rule(goal=st.sampled_from(Goal))
    def exchange(self, goal: Goal) -> None:
        before, self.drive.coasted = self.drive.state, False
        self.last = controlword(before, goal, self.last)
        self.drive.obey(self.last)
        assert not self.drive.coasted or goal in (Goal.DISABLED, Goal.FAULT_RESET)
        if self.drive.state in (S.SWITCHED_ON, S.REFRESH, S.OPERATION_ENABLE) and self.drive.state is not before:
            assert goal is Goal.ENABLED
        if before is S.FAULT and self.drive.state is not S.FAULT:
            assert goal is Goal.FAULT_RESET

    @rule()
    def proceed(self) -> None:
        self.drive.proceed()

    @rule()
    def fail(self) -> None:
        if self.drive.state in POWERED:
            self.drive.state = S.FAULT_REACTION_ENABLED  # 17
        elif self.drive.state is not S.START:
            self.drive.state = S.FAULT_REACTION_DISABLED  # 13

    @rule(goal=st.sampled_from([Goal.DISABLED, Goal.QUICK_STOPPED]))
    def insist_on_rest(self, goal: Goal) -> None:
        for _ in range(STEPS):
            self.exchange(goal)
            self.drive.proceed()
        assert self.drive.state in REACHED[goal]

    @rule()
    def insist_on_power(self) -> None:
        for goal in (Goal.FAULT_RESET, Goal.ENABLED):
            for _ in range(STEPS):
                self.exchange(goal)
                self.drive.proceed()
        assert self.drive.state is S.OPERATION_ENABLE


TestFollowing = Following.TestCase
TestFollowing.settings = settings(
    max_examples=max(60, settings().max_examples // 2), stateful_step_count=30, deadline=None
)
