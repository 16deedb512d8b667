"""Whatever events come in whatever order, the modes keep the promises of the table."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from artemis.states.machine import TRANSITIONS, ModeMachine
from artemis.values import Event, Mode

RUNNING = {Mode.CALIBRATE, Mode.TELEOP, Mode.FOLLOW, Mode.ACT}


class Modes(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.machine = ModeMachine()
        self.rearmed = True
        """Since the last fault or stop the robot was brought up, or armed again."""

    @rule(event=st.sampled_from(Event))
    def fire(self, event: Event) -> None:
        before = self.machine.mode
        accepted = self.machine.fire(event)
        after = self.machine.mode
        assert accepted is ((before, event) in TRANSITIONS)
        assert accepted or after is before
        if after in (Mode.FAULT, Mode.QUICKSTOP):
            self.rearmed = False
        elif after is Mode.READY:
            self.rearmed = self.rearmed or event in (Event.ALIGNED, Event.REARMED)
        assert after is not Mode.READY or before in {Mode.INIT, Mode.QUICKSTOP, Mode.READY, *RUNNING}
        if after in RUNNING and before is not after:
            assert before is Mode.READY
        if before is Mode.FAULT and after is not before:
            assert (event, after) in ((Event.ACKNOWLEDGED, Mode.INIT), (Event.END, Mode.END))

    @precondition(lambda self: self.machine.mode is not Mode.END)
    @rule()
    def end(self) -> None:
        assert self.machine.fire(Event.END)
        assert self.machine.mode is Mode.END

    @rule()
    def stop(self) -> None:
        self.machine.fire(Event.STOP)
        assert self.machine.mode in (Mode.QUICKSTOP, Mode.FAULT, Mode.END)
        self.rearmed = self.rearmed and self.machine.mode is Mode.END

    @rule()
    def fail(self) -> None:
        self.machine.fire(Event.FAULT)
        assert self.machine.mode in (Mode.FAULT, Mode.END)
        self.rearmed = self.rearmed and self.machine.mode is Mode.END

    @invariant()
    def nothing_runs_after_a_stop_without_being_armed_again(self) -> None:
        assert self.rearmed or self.machine.mode not in {Mode.READY, *RUNNING}


TestModes = Modes.TestCase
TestModes.settings = settings(max_examples=max(60, settings().max_examples // 2), stateful_step_count=40, deadline=None)
