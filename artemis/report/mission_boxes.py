"""A mission as nested boxes with arrows between them: what its pictures show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from msgspec import Struct

from artemis.plugins.registry import declarations
from artemis.progress import OWN_STEPS, TIMELESS, WORDS
from artemis.states.outcomes import StepFacts, outcomes_of, step_facts
from artemis.states.outline import Path, behaviours_in, step_of
from artemis.states.step_names import text_of, times
from artemis.states.tree import ANY, FAULT, LOST, LOST_FAULTS, RESTART, RESUME, TIMEOUT, is_fault, names_in
from artemis.vehicle import RobotFile
from artemis.yaml_file import dotted

AGAIN = "again"
"""Where an arrow leads back to the first of the steps that it comes from, as a retry."""
BACK = (RESUME, RESTART, AGAIN)
ELSE = "else"
FAILS = "mission failed"
Body = Any
"""Of a step, as its file writes it."""


class Arrow(Struct, frozen=True, kw_only=True):
    """What takes a mission out of the steps of a word."""

    label: str
    """An outcome, a condition, or a time."""
    steps: tuple[Box, ...] = ()
    """Done then."""
    then: str = ""
    """What follows: empty: the word is done; one of `BACK`; or the outcome that the word ends with."""

    @property
    def is_done(self) -> bool:
        """The word is done at its end."""
        return not self.then and ends_done(self.steps)


class Box(Struct, frozen=True, kw_only=True):
    """A step, or a word with the steps within."""

    path: str
    """Key path in the mission; empty: the mission."""
    word: str
    text: str = ""
    """What it does, in a few words after that."""
    steps: tuple[Box, ...] = ()
    beside: tuple[Box, ...] = ()
    arrows: tuple[Arrow, ...] = ()
    outcomes: tuple[str, ...] = ()
    """What it may end with besides `done` that a mission can name; faults only where it does."""
    done: bool = True
    """It may end with `done`."""

    @property
    def name(self) -> str:
        """In one line."""
        return f"{self.word} {self.text}".rstrip()

    def inside(self) -> Iterator[Box]:
        """The box and all within."""
        yield self
        for each in (*self.steps, *self.beside, *(step for arrow in self.arrows for step in arrow.steps)):
            yield from each.inside()


def ends_done(steps: Sequence[Box]) -> bool:
    """Whether steps one after the other may end with `done`."""
    return all(step.done for step in steps)


def boxes_of(mission: Mapping[str, Any], robot: RobotFile | None = None) -> Box:
    """The picture of a mission in its file's own form, parts put in; `robot`: which does it, if that is known."""
    behaviours = declarations(behaviours_in(mission["steps"]))
    steps = _Boxes(step_facts(behaviours, robot)).steps(mission["steps"], ("steps",))
    fails = tuple(Arrow(label=name, then=FAILS) for name in _outcomes(steps))
    return Box(path="", word="mission", text=str(mission["mission"]), steps=steps, arrows=fails, done=ends_done(steps))


def is_list(mission: Mapping[str, Any]) -> bool:
    """It has no words: nothing but steps that take time, and maybe the end."""
    return all(step_of(step)[0] not in (*WORDS, *TIMELESS[:-1]) for step in mission.get("steps") or ())


def _outcomes(*lists: Sequence[Box]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for steps in lists for step in steps for name in step.outcomes))


class _Boxes:
    def __init__(self, facts: StepFacts) -> None:
        self._facts = facts

    def steps(self, steps: Any, path: Path) -> tuple[Box, ...]:  # noqa: ANN401 (of a file)
        return tuple(self._box(*step_of(step), (*path, index)) for index, step in enumerate(steps or ()))

    def _box(self, word: str, body: Body, path: Path) -> Box:
        path = (*path, word)
        match word:
            case "repeat" | "call":
                steps = self.steps(body["steps"], (*path, "steps"))
                done = ends_done(steps) and (word == "call" or bool(body.get("times") or body.get("until")))
                return _made(path, body, steps=steps, outcomes=_outcomes(steps), done=done)
            case "try":
                return self._try(body, path)
            case "during":
                return self._during(body, path)
            case "choose":
                arrows = tuple(
                    Arrow(label=_if(branch.get("if")), steps=self.steps(branch["steps"], (*path, index, "steps")))
                    for index, branch in enumerate(body)
                )
                done = any(arrow.is_done for arrow in arrows) or all(branch.get("if") for branch in body)
                return _made(path, body, arrows=arrows, outcomes=_outcomes(*(a.steps for a in arrows)), done=done)
            case "together":
                steps, beside = (self.steps(body[key], (*path, key)) for key in ("steps", "beside"))
                ends = {"outcomes": _outcomes(steps, beside), "done": ends_done(steps)}
                return _made(path, body, steps=steps, beside=beside, **ends)
        found = outcomes_of(word, body, self._facts)
        leaves = tuple(name for name, never in found.items() if not never and name != LOST)
        limit = body.get("at_most_s") if word in OWN_STEPS and TIMEOUT in leaves else None
        late = () if limit is None else (Arrow(label=f"after {limit:g} s", then=TIMEOUT),)
        return _made(path, body, arrows=late, outcomes=leaves, done=word not in ("end", "stop"))

    def _try(self, body: Body, path: Path) -> Box:
        steps, arrows = self.steps(body["steps"], (*path, "steps")), []
        again, catch = body.get("again_on"), body.get("catch") or {}
        keys = [*(again or ()), *catch]
        possible = tuple(dict.fromkeys((*_outcomes(steps), *filter(is_fault, again or ()))))
        if retries := body.get("retries"):
            label = f"{', '.join(again or possible or [ANY])}: {times(retries)} at most"
            arrows.append(Arrow(label=label, steps=self.steps(body.get("between"), (*path, "between")), then=AGAIN))
        caught = [Arrow(label=name, steps=self.steps(of, (*path, "catch", name))) for name, of in catch.items()]
        left = tuple(name for name in possible if catch.keys().isdisjoint(_names(name, keys)))
        left += _outcomes(*(arrow.steps for arrow in (*arrows, *caught)))
        done = ends_done(steps) or any(arrow.is_done for arrow in caught)
        ends = {"outcomes": tuple(dict.fromkeys(left)), "done": done}
        return _made(path, body, steps=steps, arrows=(*arrows, *caught), **ends)

    def _during(self, body: Body, path: Path) -> Box:
        steps = self.steps(body["steps"], (*path, "steps"))
        arrows = [
            Arrow(
                label=_if(watch["if"]),
                steps=self.steps(watch.get("steps"), (*path, "when", index, "steps")),
                then=watch.get("then", RESUME),
            )
            for index, watch in enumerate(body.get("when") or ())
        ]
        if (limit := body.get("at_most_s")) is not None:
            arrows.append(Arrow(label=f"after {limit:g} s", then=TIMEOUT))
        own = (arrow.then for arrow in arrows if arrow.then not in BACK)
        outcomes = dict.fromkeys([*_outcomes(steps, *(arrow.steps for arrow in arrows)), *own])
        return _made(path, body, steps=steps, arrows=tuple(arrows), outcomes=tuple(outcomes), done=ends_done(steps))


def _made(path: Path, body: Body, **parts: Any) -> Box:  # noqa: ANN401 (fields of a box)
    word = str(path[-1])
    return Box(path=dotted(path), word=word, text=text_of(word, body), **parts)


def _names(outcome: str, keys: Sequence[str]) -> tuple[str, ...]:
    return names_in(f"{FAULT}:{LOST_FAULTS[0]}" if outcome == LOST else outcome, keys)


def _if(condition: str | None) -> str:
    return ELSE if condition is None else f"if {condition}"
