"""Which question of a mission an answer is for, and what it means."""

from __future__ import annotations

from collections.abc import Sequence

from artemis.progress import MissionEvent
from artemis.values import Sensed

_APART = 0.01
"""Two questions begin farther apart than this [s]."""


def answers_to(step: int, asked: float | None, sensed: Sensed) -> tuple[tuple[str, ...], tuple[MissionEvent, ...]]:
    """Answers to the question of a step that was `asked` for so long [s]; and words on those to another question."""
    since = sensed.time - (asked or 0.0) - _APART
    late = [answer.text for answer in sensed.typed if answer.step != step or answer.shown < since]
    typed = [answer.text for answer in sensed.typed if answer.step == step and answer.shown >= since]
    text = "is ignored: its question is over"
    events = tuple(MissionEvent(kind="answer", place="", text=f"{answer} {text}") for answer in late)
    return (*sensed.answers, *typed), events


def given_answer(given: str, answers: Sequence[str]) -> str:
    """What was meant by an answer, or by its number from 1; empty: none of these."""
    if given.isdecimal() and 1 <= int(given) <= len(answers):
        return answers[int(given) - 1]
    return given if given in answers else ""
