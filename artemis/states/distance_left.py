"""How far a mission is certain to drive after its present step, if every step ends with `done`. Pure.

Counted are paths of files, as far as they are certain to follow: all of a sequence and of the rounds that a `repeat`
has by number, one round of any other, of `choose` the shortest branch. Not counted is what is not known before it
is driven, or may not come: routes of a `goto`, paths that are recorded first, driving by hand, behaviours; what
`try` does after another outcome, the steps of a `when`; and the steps of a `during` that may be left before they are
done, by its time or by a `when` that charges, or has another `then` than to resume or restart.

Nor is what follows a step in which the battery may be charged: the sum ends there. Such steps are those for which
`Length` tells None, a `repeat` until a condition that asks for the battery, a `try` that charges after `battery-short`
and a `during` that charges in a `when`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf
from typing import NamedTuple

from msgspec import json

from artemis.progress import SHORT, Position
from artemis.states.advance import Place
from artemis.states.condition import asks_battery
from artemis.states.tree import (
    ANY,
    RESTART,
    RESUME,
    Choose,
    During,
    End,
    Leaf,
    Node,
    Repeat,
    Steps,
    Together,
    Tree,
    Try,
    Watch,
    inside,
)

Length = Callable[[int], float | None]
"""Of the path of a step, by its number [m]; 0: it has none, or none that is known; None: the battery may be charged
meanwhile."""
_DECODER = json.Decoder(Place)


class Ahead(NamedTuple):
    """The least distance [m] through a part of a mission; infinite: it cannot be passed so."""

    done: float
    """To what follows it."""
    ended: float
    """To where the sum ends in it: the mission's end, or a step that may charge."""


NOTHING, END = Ahead(0.0, inf), Ahead(inf, 0.0)


def distance_after(tree: Tree, position: Position, length: Length) -> float:
    """Distance that is certain after the present step [m]."""
    if tree.is_list:
        place = Place((position.step,), (Place((position.done,)),))
    elif position.place:
        place = _DECODER.decode(position.place)
    else:
        return 0.0  # no step has begun
    return min(_left(tree.root, place, length))


def _all(parts: Iterable[Ahead]) -> Ahead:
    """One after the other."""
    done, ended = NOTHING
    for part in parts:
        ended = min(ended, done + part.ended)
        done += part.done
    return Ahead(done, ended)


def _one(parts: Iterable[Ahead]) -> Ahead:
    """The shortest of them."""
    found = list(parts)
    return Ahead(min(part.done for part in found), min(part.ended for part in found))


def _whole(node: Node, length: Length) -> Ahead:
    """Of a part that has not begun."""
    match node:
        case Leaf():
            metres = length(node.number)
            return END if metres is None else Ahead(metres, inf)
        case End():
            return END
        case Steps():
            return _all(_whole(step, length) for step in node.of)
        case Repeat():
            return _rounds(node, _whole(node.steps, length), 0, length)
        case Try():
            return _all([_whole(node.steps, length), _after_try(node, length)])
        case Together():
            return _whole(node.steps, length)
        case During():
            return _of_left(node, length) or _whole(node.steps, length)
        case Choose():
            always = any(condition is None for condition, _ in node.branches)
            return _one([*(_whole(steps, length) for _, steps in node.branches), *([] if always else [NOTHING])])
    return NOTHING


def _left(node: Node, place: Place, length: Length) -> Ahead:
    """Of a part in which the present step is, without that step."""
    within = place.within
    match node:
        case Steps():
            index = int(place.numbers[0])
            return _all([_left(node.of[index], within[0], length), *(_whole(s, length) for s in node.of[index + 1 :])])
        case Repeat():
            return _rounds(node, _left(node.steps, within[0], length), int(place.numbers[0]), length)
        case Try():
            return _left_of_try(node, place, length)
        case During():
            return _of_left(node, length) or _left_of_during(node, place, length)
        case Choose():
            return _left(node.branches[int(place.numbers[0])][1], within[0], length)
        case Together():
            return _left(node.steps, within[0], length)
    return NOTHING


def _rounds(node: Repeat, present: Ahead, done: int, length: Length) -> Ahead:
    """The present round, and those that are certain to follow the `done` ones before it."""
    if node.times is not None and node.until is None:
        whole, more = _whole(node.steps, length), node.times - done - 1
        return _all([present, Ahead(more * whole.done, whole.ended)]) if more > 0 else present
    if node.times is None and node.until is None:  # for ever, or until a person ends it
        return Ahead(inf, min(present))
    return _all([present, END]) if asks_battery(node.until) else present


def _left_of_try(node: Try, place: Place, length: Length) -> Ahead:
    inner, branch = place.within[0], int(place.numbers[1])
    after = _after_try(node, length)
    if branch < 0:
        return _all([_left(node.steps, inner, length), after])
    if branch > 0:
        return _left(node.catch[branch - 1][1], inner, length)
    assert node.between is not None, "it is in there"
    return _all([_left(node.between, inner, length), _whole(node.steps, length), after])


def _after_try(node: Try, length: Length) -> Ahead:
    """What is certain after its steps: it may have charged after `battery-short`, and not have ended with it."""
    branches = [node.between if node.retries and node.tries_again(SHORT) else None]
    branches += [steps for name, steps in node.catch if name in (SHORT, ANY)]
    return END if _charges(tuple(branches), length) else NOTHING


def _left_of_during(node: During, place: Place, length: Length) -> Ahead:
    body, *branch = place.within
    if not branch:
        return _left(node.steps, body, length)
    watch = node.when[int(place.numbers[1])]
    assert watch.steps is not None, "they run"
    after = _whole(node.steps, length) if watch.then == RESTART else _left(node.steps, body, length)
    return _all([_left(watch.steps, branch[0], length), after])


def _of_left(node: During, length: Length) -> Ahead | None:
    """What is certain of one that may end, or charge, before its steps are done; None: it does not."""
    if any(_watch_charges(watch, length) for watch in node.when):
        return END
    if node.at_most is None and all(watch.then in (RESUME, RESTART) for watch in node.when):
        return None
    return END if _charges(node.steps, length) else NOTHING


def _watch_charges(watch: Watch, length: Length) -> bool:
    return watch.steps is not None and (asks_battery(watch.condition) or _charges(watch.steps, length))


def _charges(part: object, length: Length) -> bool:
    """Whether the battery may be charged somewhere in it."""
    return any(
        length(node.number) is None if isinstance(node, Leaf) else isinstance(node, Repeat) and asks_battery(node.until)
        for node in inside(part)
    )
