"""Where a mission is, in a few words: which round of a `repeat`, which attempt of a `try`."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import json

from artemis.progress import Position
from artemis.states.advance import Place
from artemis.states.tree import Choose, During, Node, Repeat, Steps, Together, Tree, Try


def counts(tree: Tree, position: Position) -> list[str]:
    """Rounds and attempts around the present step, the outermost first."""
    place = json.decode(position.place, type=Place) if position.place else Place()
    return list(_counts(tree.root, place))


def _counts(node: Node, place: Place) -> Iterator[str]:
    if not place.within:
        return
    first, inner = (int(place.numbers[0]) if place.numbers else 0), place.within[0]
    match node:
        case Steps(of):
            yield from _counts(of[first], inner)
        case Repeat():
            yield f"round {first + 1}" + (f"/{node.times}" if node.times else "")
            yield from _counts(node.steps, inner)
        case Try():
            branch = int(place.numbers[1])
            if first and branch <= 0:
                yield f"attempt {first + 1}/{node.retries + 1}"
            branches = (node.between or node.steps, *(steps for _, steps in node.catch))
            yield from _counts(node.steps if branch < 0 else branches[branch], inner)
        case During():
            fired = int(place.numbers[1])
            steps = node.when[fired].steps if 0 <= fired < len(node.when) and len(place.within) > 1 else node.steps
            yield from _counts(steps or node.steps, place.within[-1])
        case Choose():
            yield from _counts(node.branches[first][1], inner)
        case Together():
            yield from _counts(node.steps, inner)
