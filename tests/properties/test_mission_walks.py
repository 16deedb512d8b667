"""Where a mission is, is all that it knows: written and read at every tick, it goes the same way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from artemis.mission.parts import expanded
from artemis.mission.random_walks import RandomWalk
from artemis.mission.schema import Mission
from artemis.mission.tree import MissionTree, mission_tree, written
from artemis.mission.word_checks import WordChecks
from artemis.plugins.registry import declarations
from artemis.progress import DONE, Position
from artemis.states.outcomes import StepFacts
from artemis.states.outline import behaviours_in
from artemis.yaml_file import load, survey

MISSIONS = sorted((Path(__file__).parents[2] / "missions").glob("*.yaml"))
LONGEST = 500
"""Ticks of a walk."""
EVERY_WORD = """
mission: every-word
robot: robots/artemis.yaml
bus: simulation
inputs: {stick: {plugin: keyboard}}
steps:
  - calibrate: {steering: from_potentiometers}
  - call: {part: round, with: {limit: 23}}
  - repeat:
      times: 2
      steps:
        - approach: {until: approached_m > 2, at_most_m: 3}
        - choose: [{if: approached_m > 2, steps: [{wait: {seconds: 2}}]}, {steps: [{wait: {for: stick.done}}]}]
  - try:
      retries: 2
      again_on: [lost, late, timeout]
      between: [{say: again}, {ask: {question: "again?", answers: [yes please, never], at_most_s: 9}}]
      steps:
        - together:
            steps:
              - during:
                  at_most_s: 99
                  steps: [{follow: {path: a.csv, follower: {}}}, {call: {part: round, with: {limit: 25}}}]
                  when:
                    - {if: stick.done, steps: [{wait: {seconds: 3}}]}
                    - {if: run_s > 1000 or answer == 'never', then: late}
                    - {if: driven_m > 10 or approached_m < 1.9, steps: [{wait: {seconds: 3}}], then: restart}
            beside: [{wait: {for: battery_v < 20, at_most_s: 500}}, {repeat: {times: 3, steps: [{wait: {seconds: 5}}]}}]
      catch:
        fault: [{calibrate: {steering: from_potentiometers}}]
        late: [{end: {outcome: failed, say: late}}]
        any: [{wait: {seconds: 1}}]
parts:
  round:
    takes: {limit: }
    steps:
      - repeat:
          until: round >= 4
          steps:
            - choose:
                - if: battery_v < $limit and not stick.record
                  steps: [{wait: {for: battery_v > 26, at_most_s: 60}}]
                - steps: [{follow: {path: a.csv, follower: {}}}]
"""


def tree_of(text: str) -> MissionTree:
    document, problems = survey(text.encode(), "mission.yaml")
    assert not problems
    assert isinstance(document.data, dict)
    parts: Any = document.data.get("parts", {})
    named = {name: MISSIONS[0].parent / part["file"] for name, part in parts.items() if "file" in part}
    document, misfits = expanded(document, {name: load(file) for name, file in named.items()})
    assert not misfits
    mission = Mission.model_validate(document.data)
    steps = written(mission)
    checks = WordChecks(steps, mission.inputs, StepFacts(behaviours=declarations(behaviours_in(steps))))
    assert not checks.problems
    return mission_tree(mission, checks)


def trace(walk: RandomWalk, *, stored: bool) -> list[object]:
    """Every position on the way, and what was told; where it fails early, it goes back and on another way."""
    found, past = [walk.position], [(walk.position, dict(walk.signals))]
    for _ in range(LONGEST):
        if walk.ended == DONE:
            break
        if walk.is_over:
            del past[len(past) // 2 + 1 :]
            walk.position, signals = past[-1]
            walk.signals = dict(signals)
        if stored:
            walk.position = msgspec.json.decode(msgspec.json.encode(walk.position), type=Position)
        walk.happen()
        assert len(msgspec.json.encode(replace(walk.position, told=()))) <= 300, "without what behaviours tell"
        found.append(walk.position)
        past.append((walk.position, dict(walk.signals)))
    return [*found, *walk.told, *walk.places]


def _check(text: str, walks: int) -> None:
    found = tree_of(text)
    for seed in range(walks):
        assert trace(RandomWalk(found, seed), stored=True) == trace(RandomWalk(found, seed), stored=False)


@pytest.mark.parametrize("mission", MISSIONS, ids=lambda path: path.name)
def test_walk_of_a_mission_is_the_same_with_its_position_through_json(mission: Path) -> None:
    _check(mission.read_text(), 300)


@pytest.mark.parametrize("walks", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_walk_through_every_word_is_the_same_with_its_position_through_json(walks: int) -> None:
    _check(EVERY_WORD, walks)
