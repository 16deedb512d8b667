"""Missions as trees, built from their words alone, and driven from tick to tick by what a test says happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from artemis.mission.schema import Mission
from artemis.mission.tree import MissionTree, mission_tree
from artemis.progress import MissionEvent, Position
from artemis.states.advance import MissionFacts, advance
from artemis.yaml_file import dotted

DT = 0.02


def built(*steps: Mapping[str, Any], measured: bool = True, **keys: object) -> MissionTree:
    """The tree of a mission of these steps, with an input `stick`; `measured`: the supply voltage is."""
    inputs = {"stick": {"plugin": "keyboard"}}
    mission = {"mission": "m", "robot": "r.yaml", "bus": "simulation", "inputs": inputs, "steps": list(steps), **keys}
    return mission_tree(Mission.model_validate(mission), measured=measured)


def problems(*steps: Mapping[str, Any], measured: bool = True, **keys: object) -> list[str]:
    """What is wrong in it, each as `path: words`."""
    return [f"{dotted(path)}: {text}" for path, text in built(*steps, measured=measured, **keys).problems]


class Walker:
    """A mission under way."""

    def __init__(self, *steps: Mapping[str, Any]) -> None:
        made = built(*steps)
        assert not made.problems
        self._tree, self._names = made.tree, [path for path, _ in made.steps]
        self._passive = made.passive
        self.position = Position()
        self.events: list[MissionEvent] = []
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
        fault: str = "",
        answers: Sequence[str] = (),
        dt: float = DT,
        done: float | None = None,
        **signals: float | str | bool,
    ) -> str:
        """One tick; the path of the step that runs then."""
        position = replace(self.position, fault=fault) if fault else self.position
        known = {name.replace("__", "."): value for name, value in signals.items()}
        facts = MissionFacts(
            signals=known, dt=dt, standing=standing, outcome=outcome, answers=tuple(answers), done=done
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
