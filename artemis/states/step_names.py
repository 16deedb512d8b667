"""The short names of a mission's steps, from its file's own form: for reports, pictures, the live view and tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from artemis.progress import WORDS


def name_of(word: str, body: Any) -> str:  # noqa: ANN401 (of a file)
    """A step in a few words, such as `follow paths/loop.csv`."""
    return f"{word} {text_of(word, body)}".rstrip()


def text_of(word: str, body: Any) -> str:  # noqa: ANN401 (of a file)
    """The same without the step's word."""
    if not isinstance(body, Mapping):
        return f"“{body}”" if isinstance(body, str) else ""
    if word in WORDS:
        return _word_text(word, body)
    match word, body:
        case "follow", {"path": path}:
            return _path(path) + (f", {laps} laps" if (laps := body.get("laps", 1)) > 1 else "")
        case "goto", {"to": to}:
            return destination(to)
        case "wait", {"seconds": float() | int() as seconds}:
            return f"{seconds:g} s"
        case "wait", {"for": condition}:
            return f"for {condition}"
        case "teleop", _:
            inputs = ", ".join(body.get("inputs") or [body["input"]])
            return inputs + (f", record {record}" if (record := body.get("record")) else "")
        case "ask", {"question": question}:
            return str(question)
        case "calibrate", _:
            return next((key for key, value in body.items() if value is not None), "")
        case "end", {"outcome": str(outcome)}:
            return outcome + (f": “{text}”" if (text := body.get("say")) else "")
    return next((value for value in body.values() if isinstance(value, str)), "")


def destination(to: object) -> str:
    """Where a `goto` leads."""
    match to:
        case {"x_m": x, "y_m": y, "heading_deg": heading}:
            return f"x {x:g} m, y {y:g} m, {heading:g} degrees"
        case {"from_input": name}:
            return f"a goal of {name}"
    return str(to)


def times(number: int) -> str:
    """How often."""
    return "once" if number == 1 else f"{number} times"


def _word_text(word: str, body: Mapping[str, Any]) -> str:
    if word == "call":
        given = ", ".join(f"{key}: {value}" for key, value in (body.get("with") or {}).items())
        return str(body["part"]) + (f" ({given})" if given else "")
    if word != "repeat":
        return ""
    rounds, until = body.get("times"), body.get("until")
    if until:
        return f"until {until}" + (f", {times(rounds)} at most" if rounds else "")
    return times(rounds) if rounds else "for ever"


def _path(path: Any) -> str:  # noqa: ANN401 (of a file)
    match path:
        case {"recorded": name}:
            return f"recorded {name}"
        case {"waypoints": points}:
            return f"{len(points)} waypoints"
    return str(PurePath(str(path)))
