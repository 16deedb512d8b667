"""A mission as nested boxes with arrows between them: what its pictures show, and the short names of its steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from msgspec import Struct

from artemis.progress import TIMELESS, WORDS
from artemis.states.outline import Path, step_of
from artemis.states.tree import ANY, FAULT, RESTART, RESUME, TIMEOUT
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


def boxes_of(mission: Mapping[str, Any]) -> Box:
    """The picture of a mission in its file's own form, parts put in."""
    steps = _steps(mission["steps"], ("steps",))
    fails = tuple(Arrow(label=name, then=FAILS) for name in _outcomes(steps))
    return Box(path="", word="mission", text=str(mission["mission"]), steps=steps, arrows=fails, done=ends_done(steps))


def is_list(mission: Mapping[str, Any]) -> bool:
    """It has no words: nothing but steps that take time, and maybe the end."""
    return all(step_of(step)[0] not in (*WORDS, *TIMELESS[:-1]) for step in mission.get("steps") or ())


def _steps(steps: Any, path: Path) -> tuple[Box, ...]:  # noqa: ANN401 (of a file)
    return tuple(_box(*step_of(step), (*path, index)) for index, step in enumerate(steps or ()))


def _outcomes(*lists: Sequence[Box]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for steps in lists for step in steps for name in step.outcomes))


def _box(word: str, body: Body, path: Path) -> Box:
    path = (*path, word)
    match word:
        case "repeat" | "call":
            steps = _steps(body["steps"], (*path, "steps"))
            done = ends_done(steps) and (word == "call" or bool(body.get("times") or body.get("until")))
            return _made(path, body, steps=steps, outcomes=_outcomes(steps), done=done)
        case "try":
            return _try(body, path)
        case "during":
            return _during(body, path)
        case "choose":
            arrows = tuple(
                Arrow(label=_if(branch.get("if")), steps=_steps(branch["steps"], (*path, index, "steps")))
                for index, branch in enumerate(body)
            )
            done = any(arrow.is_done for arrow in arrows) or all(branch.get("if") for branch in body)
            return _made(path, body, arrows=arrows, outcomes=_outcomes(*(a.steps for a in arrows)), done=done)
        case "together":
            steps, beside = _steps(body["steps"], (*path, "steps")), _steps(body["beside"], (*path, "beside"))
            return _made(
                path, body, steps=steps, beside=beside, outcomes=_outcomes(steps, beside), done=ends_done(steps)
            )
    limit = body.get("at_most_s") if isinstance(body, dict) else None
    if limit is None:
        return _made(path, body, done=word not in ("end", "stop"))
    return _made(path, body, arrows=(Arrow(label=f"after {limit:g} s", then=TIMEOUT),), outcomes=(TIMEOUT,))


def _try(body: Body, path: Path) -> Box:
    steps, arrows = _steps(body["steps"], (*path, "steps")), []
    possible, again, catch = _outcomes(steps), body.get("again_on"), body.get("catch") or {}
    possible += tuple(name for name in again or () if name.startswith(FAULT) and name not in possible)
    if retries := body.get("retries"):
        label = f"{', '.join(again or possible or [ANY])}: {_times(retries)} at most"
        arrows.append(Arrow(label=label, steps=_steps(body.get("between"), (*path, "between")), then=AGAIN))
    caught = [Arrow(label=name, steps=_steps(of, (*path, "catch", name))) for name, of in catch.items()]
    left = () if ANY in catch else tuple(name for name in possible if name not in catch)
    left += _outcomes(*(arrow.steps for arrow in (*arrows, *caught)))
    done = ends_done(steps) or any(arrow.is_done for arrow in caught)
    return _made(path, body, steps=steps, arrows=(*arrows, *caught), outcomes=tuple(dict.fromkeys(left)), done=done)


def _during(body: Body, path: Path) -> Box:
    steps = _steps(body["steps"], (*path, "steps"))
    arrows = [
        Arrow(
            label=_if(watch["if"]),
            steps=_steps(watch.get("steps"), (*path, "when", index, "steps")),
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
    return Box(path=dotted(path), word=word, text=_text(word, body), **parts)


def _if(condition: str | None) -> str:
    return ELSE if condition is None else f"if {condition}"


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


# ------------------------------------------------------------------------------------------------------- short names


def name_of(word: str, body: Body) -> str:
    """A step in a few words, such as `follow paths/loop.csv`."""
    return f"{word} {_text(word, body)}".rstrip()


def _destination(to: object) -> str:
    match to:
        case {"x_m": x, "y_m": y}:
            return f"x {x:g} m, y {y:g} m"
        case {"from_input": name}:
            return f"a goal of {name}"
    return str(to)


def _text(word: str, body: Body) -> str:
    if not isinstance(body, dict):
        return f"“{body}”" if isinstance(body, str) else ""
    if word in WORDS:
        return _word_text(word, body)
    match word, body:
        case "follow", {"path": path}:
            return _path(path) + (f", {laps} laps" if (laps := body.get("laps", 1)) > 1 else "")
        case "goto", {"to": to}:
            return _destination(to)
        case "wait", {"seconds": float() | int() as seconds}:
            return f"{seconds:g} s"
        case "wait", {"for": condition}:
            return f"for {condition}"
        case "teleop", {"input": name}:
            return str(name) + (f", record {record}" if (record := body.get("record")) else "")
        case "ask", {"question": question}:
            return f"“{question}”"
        case "calibrate", _:
            return next((key for key, value in body.items() if value is not None), "")
        case "end", {"outcome": str(outcome)}:
            return outcome + (f": “{text}”" if (text := body.get("say")) else "")
    return next((value for value in body.values() if isinstance(value, str)), "")


def _word_text(word: str, body: Mapping[str, Any]) -> str:
    if word == "call":
        given = ", ".join(f"{key}: {value}" for key, value in (body.get("with") or {}).items())
        return str(body["part"]) + (f" ({given})" if given else "")
    if word != "repeat":
        return ""
    times, until = body.get("times"), body.get("until")
    if until:
        return f"until {until}" + (f", {_times(times)} at most" if times else "")
    return _times(times) if times else "for ever"


def _path(path: Any) -> str:  # noqa: ANN401 (of a file)
    match path:
        case {"recorded": name}:
            return f"recorded {name}"
        case {"waypoints": points}:
            return f"{len(points)} waypoints"
    return str(PurePath(str(path)))
