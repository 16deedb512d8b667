"""The steps of a mission in its file's own form, as they stand there: the same numbers for whoever reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from artemis.progress import TIMELESS, WORDS

Path = tuple[str | int, ...]
"""Keys from the mission's root."""


def steps_in(steps: Any, path: Path = ("steps",)) -> Iterator[tuple[Path, str, Any]]:  # noqa: ANN401 (of a file)
    """Each step with its path (that of its word) and what stands there, words before the steps within.

    What is no list of steps is passed over: whoever reads the mission complains of it.
    """
    for index, step in enumerate(steps if isinstance(steps, list | tuple) else ()):
        if not isinstance(step, dict) or not step:
            continue
        word, body = step_of(step)
        at = (*path, index, word)
        yield at, word, body
        for below, inner in _within(word, body):
            yield from steps_in(inner, (*at, *below))


def step_of(step: Mapping[str, Any]) -> tuple[str, Any]:
    """The word of a step, and what stands there; as a recording has it, all other words stand beside it, empty."""
    word = next((key for key, body in step.items() if body is not None), next(iter(step)))
    return str(word), step[word]


def numbered(steps: Any) -> list[tuple[Path, str, Any]]:  # noqa: ANN401 (of a file)
    """The steps that take time, each at the place of its number."""
    return [found for found in steps_in(steps) if found[1] not in (*WORDS, *TIMELESS)]


def _within(word: str, body: Any) -> Iterator[tuple[Path, Any]]:  # noqa: ANN401 (of a file)
    """The lists of steps in a word."""
    if word == "choose" and isinstance(body, list | tuple):
        for index, branch in enumerate(body):
            if isinstance(branch, dict):
                yield (index, "steps"), branch.get("steps")
    if word not in WORDS or not isinstance(body, dict):
        return
    yield ("steps",), body.get("steps")
    if word == "try":
        yield ("between",), body.get("between")
        catch = body.get("catch")
        for name, steps in catch.items() if isinstance(catch, dict) else ():
            yield ("catch", name), steps
    if word == "during":
        for index, watch in enumerate(body.get("when") or ()) if isinstance(body.get("when"), list | tuple) else ():
            if isinstance(watch, dict):
                yield ("when", index, "steps"), watch.get("steps")
    if word == "together" and isinstance(body.get("beside"), list | tuple):
        yield ("beside",), body["beside"]
