"""The steps of a mission in its file's own form, as they stand there: the same numbers for whoever reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from artemis.progress import OWN_STEPS, TIMELESS, WORDS

Path = tuple[str | int, ...]
"""Keys from the mission's root."""


def steps_in(steps: Any, path: Path = ("steps",)) -> Iterator[tuple[Path, str, Any]]:  # noqa: ANN401 (of a file)
    """Each step with its path (that of its word) and what stands there, words before the steps within.

    What is no list of steps is passed over: whoever reads the mission complains of it.
    """
    for index, step in enumerate(parts_of(steps)):
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


def keys_of(body: Any) -> Mapping[str, Any]:  # noqa: ANN401 (of a file)
    """What stands at a step's word, if it is a mapping; else nothing."""
    return body if isinstance(body, dict) else {}


def parts_of(given: Any) -> Sequence[Any]:  # noqa: ANN401 (of a file)
    """A list of a file; of what is none, nothing."""
    return given if isinstance(given, list | tuple) else ()


def numbered(steps: Any) -> list[tuple[Path, str, Any]]:  # noqa: ANN401 (of a file)
    """The steps that take time, each at the place of its number."""
    return [found for found in steps_in(steps) if found[1] not in (*WORDS, *TIMELESS)]


def is_beside(place: str) -> bool:
    """Whether what stands at a key path runs beside other steps."""
    return ".together.beside[" in place


def behaviours_in(steps: Any) -> list[str]:  # noqa: ANN401 (of a file)
    """Names of the behaviours that do steps among these, each once; also of what is none."""
    return list(dict.fromkeys(word for _, word, _ in steps_in(steps) if word not in OWN_STEPS))


def _within(word: str, body: Any) -> Iterator[tuple[Path, Any]]:  # noqa: ANN401 (of a file)
    """The lists of steps in a word."""
    keys = keys_of(body)
    if word == "choose":
        for index, branch in enumerate(parts_of(body)):
            yield (index, "steps"), keys_of(branch).get("steps")
    elif word in WORDS:
        yield ("steps",), keys.get("steps")
    if word == "try":
        yield ("between",), keys.get("between")
        for name, steps in keys_of(keys.get("catch")).items():
            yield ("catch", name), steps
    if word == "during":
        for index, watch in enumerate(parts_of(keys.get("when"))):
            yield ("when", index, "steps"), keys_of(watch).get("steps")
    if word == "together":
        yield ("beside",), keys.get("beside")
