"""Random walks through a mission: which of its steps they never reach."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from msgspec import Struct

from artemis.mission.loading import LoadedMission
from artemis.mission.tree import MissionTree
from artemis.mission.walking import DT, MissionWalk
from artemis.progress import DONE
from artemis.states.condition import Compare, Has, comparisons
from artemis.states.outline import steps_in
from artemis.states.tree import FAULT, LOST, LOST_FAULTS, During, Repeat, Try, inside
from artemis.yaml_file import KeyPath, dotted

_ROUNDS = 3
"""A random walk leaves a `repeat` that has more of them after so many."""
_BACK = 30
"""Where it has ended other than done, a walk goes back by up to so many ticks."""
_ANY_FAULT = "DRV-25"
_NAMED = {FAULT: _ANY_FAULT, LOST: LOST_FAULTS[0]}
"""Faults that are met by a `try` which names one of these."""


class RandomWalk(MissionWalk):
    """A mission in which random things happen that its words ask for: outcomes, answers, faults, signals, time."""

    def __init__(self, found: MissionTree, seed: object) -> None:
        """At the beginning; the same seed, the same walk."""
        self._dice = random.Random(f"{seed}")
        tests = [test for condition in found.asked for test in comparisons(condition)]
        self._tests = [test for test in tests if test.signal not in ("answer", "round")]
        rounds = [int(test.value) + 1 for test in tests if isinstance(test, Compare) and test.signal == "round"]
        nodes = list(inside(found.tree.root))
        self._faults = sorted({id for node in nodes if isinstance(node, Try) for id in _faults(node)})
        self._times = sorted({node.at_most for node in nodes if isinstance(node, During) and node.at_most})
        super().__init__(found, _shortened(found.tree, max([_ROUNDS, *rounds])))

    def happen(self) -> None:
        """Something happens."""
        dice, number = self._dice, self.position.step
        passive, chance = self.found.passive[number], dice.random()
        if self.beside and dice.random() < 0.1:
            number = dice.choice(self.beside)
            self.tick(dice.choice(sorted(self.found.outcomes[number] - {LOST})), of=number)
        elif self._tests and chance < 0.3:
            self._change(dice.choice(self._tests))
        elif self._faults and chance < 0.4:
            self.tick(fault=dice.choice(self._faults))
        elif self._times and chance < 0.45:
            self.tick(dt=dice.choice(self._times))
        elif passive is None:
            others = sorted(self.found.outcomes[number] - {DONE, LOST})
            self.tick(DONE if not others or dice.random() < 0.6 else dice.choice(others))
        elif passive.answers and dice.random() < 0.8:
            self.tick(answer=dice.choice(passive.answers))
        elif passive.condition is not None and dice.random() < 0.8:
            self._change(dice.choice(list(comparisons(passive.condition))))
        else:
            limit = passive.seconds if passive.seconds is not None else passive.at_most
            self.tick(dt=max(DT, (limit or 1.0) - self.position.done))

    def _change(self, test: Has | Compare) -> None:
        """A signal comes near to what it is compared with; a button is pressed."""
        if isinstance(test, Compare) and isinstance(test.value, float) and test.signal != "round":
            near = self._dice.choice((-1.0, 0.0, 1.0)) * max(1e-3, abs(test.value) / 100.0)
            self.signals[test.signal] = test.value + near
        self.tick(pressed=[test.signal] if isinstance(test, Has) else ())


def walked(loaded: LoadedMission, walks: int, seed: int) -> list[str]:
    """What so many random walks found, for people; nothing where there are none."""
    if not walks:
        return []
    missed = never_reached(loaded, walks, seed)
    return missed or [f"{walks} random walks reached every step"]


def never_reached(loaded: LoadedMission, walks: int, seed: int = 0) -> list[str]:
    """The steps that so many random walks never reached, one line each with file:line:column; the outermost only.

    A step of a part counts as reached where one of its calls was.
    """
    found, reached = loaded.tree, set[str]()
    for number in range(walks):
        made, dice = RandomWalk(found, f"{seed}/{number}"), random.Random(f"{seed}/{number}")
        past = []
        for _ in range(100 + 10 * found.tree.size):
            past.append((made.position, dict(made.signals)))
            made.happen()
            if made.ended == DONE:
                break
            if made.is_over:  # a long mission would end early in most walks: back, and another way
                del past[max(1, len(past) - dice.randrange(_BACK)) :]
                made.position, made.signals = past.pop()
        reached.update(made.places, (event.place for event in made.told if event.kind in ("said", "end")))
    document: Any = next(iter(loaded.documents.values()))
    steps = [(path, word) for path, word, _ in steps_in(document.data["steps"]) if word not in ("choose", "stop")]
    begun = {path[:end] for path, _ in steps if dotted(path) in reached for end in range(len(path) + 1)}
    missed, hit = dict[str, None](), set[str]()
    outer: KeyPath = ("",)
    for path, _ in steps:
        line = document.problem(path, f"never reached in {walks} random walks")
        if path in begun:
            hit.add(line)
        elif path[: len(outer)] != outer:
            missed[line], outer = None, path
    return [line for line in missed if line not in hit]


def _faults(node: Try) -> Iterator[str]:
    """Faults that it catches, by their ids."""
    for name in node.keys:
        kind, _, id = name.partition(":")
        if id and kind == FAULT:
            yield id
        elif name in _NAMED:
            yield _NAMED[name]


def _shortened(value: Any, rounds: int) -> Any:  # noqa: ANN401 (any part of a tree)
    """The same tree with no more than so many rounds of each `repeat`."""
    if isinstance(value, tuple):
        return tuple(_shortened(part, rounds) for part in value)
    if not isinstance(value, Struct):
        return value
    fields = {name: _shortened(getattr(value, name), rounds) for name in value.__struct_fields__}
    if isinstance(value, Repeat) and value.times is not None:
        fields["times"] = min(value.times, rounds)
    return type(value)(**fields)
