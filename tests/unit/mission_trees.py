"""Missions as trees, built from their words alone, and driven from tick to tick by what a test says happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from artemis.mission.schema import Mission
from artemis.mission.tree import MissionTree, mission_tree, written
from artemis.mission.word_checks import WordChecks
from artemis.plugins.registry import declarations
from artemis.progress import Acted, MissionEvent, Position
from artemis.states.advance import MissionFacts, advance
from artemis.states.outcomes import StepFacts
from artemis.states.outline import behaviours_in
from artemis.yaml_file import dotted

DT = 0.02


def mission_of(*steps: Mapping[str, Any]) -> Mission:
    """A mission of these steps, with an input `stick`."""
    inputs = {"stick": {"plugin": "keyboard"}}
    words = {"mission": "m", "robot": "r.yaml", "bus": "simulation", "inputs": inputs, "steps": list(steps)}
    return Mission.model_validate(words)


def built(*steps: Mapping[str, Any]) -> MissionTree:
    """Its tree."""
    mission, checks = mission_of(*steps), checked(*steps)
    assert not checks.problems
    return mission_tree(mission, checks)


def checked(*steps: Mapping[str, Any], **facts: bool) -> WordChecks:
    """What its words say; `facts` that differ from those of a robot that has everything."""
    mission = mission_of(*steps)
    given = written(mission)
    return WordChecks(given, mission.inputs, StepFacts(behaviours=declarations(behaviours_in(given)), **facts))


def problems(*steps: Mapping[str, Any], **facts: bool) -> list[str]:
    """What is wrong in it, each as `path: words`."""
    return [f"{dotted(path)}: {text}" for path, text in checked(*steps, **facts).problems]


class Walker:
    """A mission under way."""

    def __init__(self, *steps: Mapping[str, Any]) -> None:
        made = built(*steps)
        self._tree, self._names = made.tree, [path for path, _ in made.steps]
        self._passive = made.passive
        self.position = Position()
        self.events: list[MissionEvent] = []
        self.acted: Mapping[int, Acted] = {}
        self.rests = self.begun = False
        self.tick()

    @property
    def present(self) -> str:
        """The path of the present step; `over` after the last."""
        number = self.position.step
        return ".".join(map(str, self._names[number])) if number < len(self._names) else "over"

    def tick(
        self,
        outcome: str = "",
        *,
        standing: bool = True,
        fault: str | Sequence[str] = (),
        answers: Sequence[str] = (),
        dt: float = DT,
        done: float | None = None,
        **signals: float | str | bool,
    ) -> str:
        """One tick; the path of the step that runs then."""
        faults = (fault,) if isinstance(fault, str) else tuple(fault)
        position = replace(self.position, faults=faults) if faults else self.position
        known = {name.replace("__", "."): value for name, value in signals.items()}
        facts = MissionFacts(
            signals=known,
            dt=dt,
            standing=standing,
            outcome=outcome,
            answers=tuple(answers),
            done=done,
            acted=self.acted,
        )
        if position.step < self._tree.size:
            advanced = advance(self._tree, self._passive, position, facts)
            self.position, self.rests, self.begun = advanced.position, advanced.rests, advanced.begun
            self.events += advanced.events
        return self.present

    def told(self) -> list[str]:
        """What happened since the last call, in words."""
        told = [f"{event.kind} {event.text}" for event in self.events]
        self.events.clear()
        return told
