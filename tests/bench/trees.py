"""What a mission's words cost a tick, in a tree of 200 nodes; and how soon a long mission is loaded."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from artemis.mission.loading import load_mission
from artemis.mission.schema import Mission
from artemis.mission.tree import MissionTree, mission_tree, written
from artemis.mission.word_checks import WordChecks
from artemis.progress import Position
from artemis.states.advance import MissionFacts, advance
from artemis.states.outcomes import StepFacts
from artemis.states.tree import inside

from .composition import missions
from .measure import Row, interleaved, microseconds
from .ticks import exchange

NODES = 200
STEPS = 500
"""Of the mission that is loaded."""


def rows() -> list[Row]:
    """The rows of the table."""
    found, position = tree()
    one, other = tree(nodes=20)
    small, large = interleaved([ticked(one, other), ticked(found, position)], rounds=25, calls=400)
    _, theirs = exchange()
    with missions() as mission:
        mission.write_text(json.dumps(long_mission(STEPS)))
        (loading,) = interleaved([partial(load_mission, Path(mission))], rounds=3, calls=1)
    size = len(msgspec.json.encode(position))
    return [
        Row(
            name=f"a mission's words, per tick, in a tree of {NODES} nodes, {size} bytes of position",
            measured=f"{microseconds(large)}, of 20 nodes {microseconds(small)}",
            budget="<= 15 us, position <= 300 bytes",
            held=large <= 15e-6 and size <= 300,
            peer=f"{large / theirs:.2f} x canopen's exchange",
        ),
        Row(
            name=f"loading and checking a mission of {STEPS} steps",
            measured=f"{loading:.2f} s",
            budget="<= 1 s",
            held=loading <= 1.0,
        ),
    ]


def tree(nodes: int = NODES) -> tuple[MissionTree, Position]:
    """A mission of at least so many nodes, and the position of a step in the middle of it, four words deep."""
    number = 1
    while len(list(inside((found := _tree(number)).tree.root))) < nodes:
        number += 1
    position = Position()
    for _ in range(3 * number):  # the first two of the five steps in each part of it
        position = advance(found.tree, found.passive, position, _facts(outcome="done")).position
    return found, position


def ticked(found: MissionTree, position: Position) -> Callable[[], object]:
    """One tick in which nothing ends."""
    return partial(advance, found.tree, found.passive, position, _facts())


def long_mission(steps: int) -> dict[str, Any]:
    """A mission of at least so many steps."""
    each = 8
    parts = [_part(number) for number in range(-(-steps // each))]
    calibrate = {"calibrate": {"steering": "from_potentiometers"}}
    return {"mission": "m", "robot": "robots/artemis.yaml", "bus": "simulation", "steps": [calibrate, *parts]}


def _tree(parts: int) -> MissionTree:
    mission = Mission.model_validate(long_mission(8 * parts))
    return mission_tree(mission, WordChecks(written(mission), (), StepFacts()))


def _facts(outcome: str = "") -> MissionFacts:
    return MissionFacts(signals={"run_s": 1.0, "driven_m": 1.0}, dt=0.02, outcome=outcome)


def _part(number: int) -> Mapping[str, Any]:
    wait = {"wait": {"seconds": 1.0 + number}}
    attempt = {"try": {"retries": 2, "between": [wait], "steps": [wait, wait], "catch": {"any": [{"say": "caught"}]}}}
    branches = [{"if": f"run_s > {1000 + number}", "steps": [wait]}, {"steps": [wait]}]
    inner = {"repeat": {"times": 2, "steps": [attempt, {"choose": branches}]}}
    when = [{"if": "driven_m > 23", "steps": [wait]}]
    return {"during": {"at_most_s": 1000.0 + number, "steps": [inner], "when": when}}
