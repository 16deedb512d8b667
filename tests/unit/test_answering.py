"""Answers that are typed at the terminal: each counts for the question for which it was typed, and for no other."""

from __future__ import annotations

import pytest
from core_builders import TRACTION
from live_core import Live

from artemis.commands.answering import READING, Answering
from artemis.progress import TypedAnswer
from artemis.states.plan import AskStep, WaitStep
from artemis.states.tree import Leaf, Node, Repeat, Say, Steps, Try, tree_of
from artemis.values import Mode, Request, Tick

ASK = AskStep(question="go on?", answers=("left", "right"), at_most=2.0)


def attempt(number: int) -> Node:
    """A question that may time out."""
    return Try(path="t", steps=Steps((Leaf(number, f"ask{number}"),)), catch=(("timeout", Steps((Say("s", "late"),))),))


class Typing:
    """Somebody at the terminal of a run with two questions, or with one in two rounds."""

    def __init__(self, *, repeated: bool = False) -> None:
        rounds = Repeat(path="r", steps=Steps((attempt(0),)), times=2)
        nodes = (rounds, Leaf(1, "wait")) if repeated else (attempt(0), attempt(1))
        steps = (ASK, WaitStep(seconds=99.0)) if repeated else (ASK, ASK)
        self.live = Live(*steps, tree=tree_of(Steps(nodes)))
        self.answering = Answering([0] if repeated else [0, 1])
        self.tick()

    def tick(self, *answers: TypedAnswer | str) -> Tick:
        texts = tuple(answer for answer in answers if isinstance(answer, str))
        typed = tuple(answer for answer in answers if not isinstance(answer, str))
        tick = self.live.tick(answers=texts, typed=typed, attended=True)
        self.answering.see(tick)
        return tick

    def until_late(self) -> None:
        """The first question is asked, and times out."""
        while not any(event.text == "late" for event in self.tick().events):
            assert self.live.time < 60.0

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            self.tick()

    def press(self, text: str) -> list[str]:
        """What happens after a key."""
        tick = self.tick(self.answering.answer(text))
        return [f"{event.kind} {event.text}" for event in tick.events]


@pytest.mark.parametrize("repeated", [False, True])
def test_an_answer_to_a_question_that_has_just_timed_out_is_not_for_the_next_one(repeated: bool) -> None:
    terminal = Typing(repeated=repeated)
    terminal.until_late()
    assert terminal.press("1") == ["answer 1 is ignored: its question is over"]
    terminal.wait(READING)
    assert terminal.live.ticks[-1].position.answer == ""
    assert "ended done" in terminal.press("1")
    assert terminal.live.ticks[-1].position.answer == "left"


@pytest.mark.parametrize("repeated", [False, True])
def test_an_answer_that_arrives_late_is_not_for_the_next_question(repeated: bool) -> None:
    terminal = Typing(repeated=repeated)
    while terminal.live.ticks[-1].position.done < 1.0:
        terminal.tick()
    typed = terminal.answering.answer("2")
    terminal.until_late()
    terminal.wait(1.0)
    tick = terminal.tick(typed)
    assert [event.text for event in tick.events] == ["2 is ignored: its question is over"]
    assert tick.position.answer == ""


def test_after_an_answer_the_next_question_is_answered_at_once() -> None:
    terminal = Typing()
    while terminal.live.ticks[-1].position.done < 0.5:
        terminal.tick()
    assert "ended done" in terminal.press("1")
    assert terminal.live.ticks[-1].position.step == 1
    assert "ended done" in terminal.press("2")
    assert terminal.live.ticks[-1].position.answer == "right"


def test_an_answer_before_the_first_question_is_ignored_and_an_operators_script_needs_no_question() -> None:
    terminal = Typing()
    typed = terminal.answering.answer("1")
    assert typed.step == -1
    while terminal.live.ticks[-1].position.done < 0.5:
        terminal.tick(typed)
    assert terminal.live.ticks[-1].position.answer == ""
    assert terminal.tick("left").position.answer == "left"


@pytest.mark.parametrize("fault", [False, True])
def test_an_answer_while_the_robot_is_stopped_is_ignored_and_this_is_reported(fault: bool) -> None:
    terminal = Typing()
    while terminal.live.ticks[-1].position.done < 0.5:
        terminal.tick()
    if fault:
        terminal.live.drives.changes[TRACTION[0]] = {"boots": 1}
        terminal.tick()
        terminal.live.drives.changes[TRACTION[0]] = {}
    else:
        terminal.live.tick(requests=(Request.QUICKSTOP,), attended=True)
    terminal.wait(0.5)
    assert terminal.press("1") == ["answer 1 is ignored: the mission does not run now"]
    assert terminal.live.ticks[-1].mode is (Mode.FAULT if fault else Mode.QUICKSTOP)
    (event,) = terminal.tick("left").events
    assert event.text == "left is ignored: the mission does not run now"
    assert terminal.live.ticks[-1].position.answer == ""
    assert terminal.tick().events == ()


def test_a_question_is_answered_after_a_stop_too() -> None:
    terminal = Typing()
    while terminal.live.ticks[-1].position.done < 0.5:
        terminal.tick()
    terminal.live.tick(requests=(Request.QUICKSTOP,), attended=True)
    terminal.wait(1.0)
    tick = terminal.live.tick(requests=(Request.ARM,), attended=True)
    while tick.mode is not Mode.READY:
        tick = terminal.tick()
    terminal.wait(0.5)
    assert "ended done" in terminal.press("1")
