"""Where a mission is, in a few words: which round of a `repeat`, which attempt of a `try`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from msgspec import json

from artemis.progress import Position
from artemis.states.advance import Place
from artemis.states.outline import step_of


def counts(steps: Any, position: Position) -> list[str]:  # noqa: ANN401 (of a file)
    """Rounds and attempts around the present step, the outermost first; `steps`: in the mission file's own form."""
    return list(_counts(steps, json.decode(position.place, type=Place))) if position.place else []


def _counts(steps: Any, place: Place) -> Iterator[str]:  # noqa: ANN401 (of a file)
    """Of the words around the present one of these steps, at their place in the tree."""
    if not place.within:
        return
    word, body = step_of(steps[int(place.numbers[0])])
    inner = place.within[0]
    if word == "call":
        yield from _counts(body["steps"], inner)
    if not inner.within:
        return
    first, below = int(inner.numbers[0]) if inner.numbers else 0, inner.within[0]
    match word:
        case "repeat":
            yield f"round {first + 1}" + (f"/{times}" if (times := body.get("times")) else "")
            yield from _counts(body["steps"], below)
        case "try":
            branch, between = int(inner.numbers[1]), body.get("between")
            if first and branch <= 0:
                yield f"attempt {first + 1}/{body.get('retries', 0) + 1}"
            branches = (between or body["steps"], *(body.get("catch") or {}).values())
            yield from _counts(body["steps"] if branch < 0 else branches[branch], below)
        case "during":
            fired, watches = int(inner.numbers[1]), body.get("when") or []
            in_branch = 0 <= fired < len(watches) and len(inner.within) > 1
            yield from _counts(watches[fired]["steps"] if in_branch else body["steps"], inner.within[-1])
        case "choose":
            yield from _counts(body[first]["steps"], below)
        case "together":
            yield from _counts(body["steps"], below)
