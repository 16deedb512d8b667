"""Which question of a mission an answer is for, and what it means."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from artemis.progress import MissionEvent
from artemis.values import Sensed

IGNORED = "answer"
"""Kind of the events on answers that no question takes."""
_APART = 0.01
"""Two questions begin farther apart than this [s]."""


def answers_to(step: int, asked: float | None, sensed: Sensed) -> tuple[tuple[str, ...], tuple[MissionEvent, ...]]:
    """Answers to the question of a step that was `asked` for so long [s]; and words on those to another question."""
    since = sensed.time - (asked or 0.0) - _APART
    late = [answer.text for answer in sensed.typed if answer.step != step or answer.shown < since]
    typed = [answer.text for answer in sensed.typed if answer.step == step and answer.shown >= since]
    return (*sensed.answers, *typed), _ignored(late, "its question is over")


def answers_without_mission(sensed: Sensed) -> tuple[MissionEvent, ...]:
    """Words on those of a tick in which the mission does not run: they answer nothing."""
    given = (*sensed.answers, *(answer.text for answer in sensed.typed))
    return _ignored(given, "the mission does not run now")


def _ignored(answers: Iterable[str], why: str) -> tuple[MissionEvent, ...]:
    return tuple(MissionEvent(kind=IGNORED, place="", text=f"{answer} is ignored: {why}") for answer in answers)


def given_answer(given: str, answers: Sequence[str]) -> str:
    """What was meant by an answer, or by its number from 1; empty: none of these."""
    if given.isdecimal() and 1 <= int(given) <= len(answers):
        return answers[int(given) - 1]
    return given if given in answers else ""
