"""How far a mission drives for certain after its present step, whatever its words are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from mission_trees import Walker, built

from artemis.progress import Position
from artemis.states.way_ahead import way_ahead

METRES = {"a.csv": 1.0, "b.csv": 10.0, "c.csv": 100.0, "d.csv": 1000.0}
WAIT = {"wait": {"seconds": 1}}
END = {"end": {"outcome": "failed"}}


def follow(path: str) -> dict[str, Any]:
    """A step along a path of so many metres, by its name."""
    return {"follow": {"path": f"{path}.csv", "follower": {"plugin": "frenet", "speed_m_s": 0.5}}}


A, B, C, D = map(follow, "abcd")
DURING = {"during": {"steps": [A, B], "when": [{"if": "run_s > 9", "steps": [C], "then": "resume"}]}}
LEFT = {"during": {"steps": [A, B], "when": [{"if": "run_s > 9", "then": "low"}]}}


def ahead(*steps: Mapping[str, Any], position: Position | None = None) -> float:
    """Of a mission, at a position in it."""
    made = built(*steps)
    paths = [str(step.follow.path) if step.follow is not None else "" for _, step in made.steps]
    return way_ahead(made.tree, position or Walker(*steps).position, lambda number: METRES.get(paths[number], 0.0))


@pytest.mark.parametrize(
    ("steps", "metres"),
    [
        ([A, WAIT, B, C], 110.0),
        ([A, {"try": {"steps": [B], "catch": {"blocked": [C]}}}], 10.0),
        ([A, {"repeat": {"times": 3, "steps": [B, C]}}], 330.0),
        ([A, {"repeat": {"until": "run_s > 9", "steps": [B]}}, C], 110.0),
        ([A, {"repeat": {"steps": [B]}}], 10.0),
        ([A, {"choose": [{"if": "run_s > 9", "steps": [B]}, {"steps": [C]}]}, D], 1010.0),
        ([A, {"choose": [{"if": "run_s > 9", "steps": [B]}]}, D], 1000.0),
        ([A, {"choose": [{"if": "run_s > 9", "steps": [END]}, {"steps": [C]}]}, D], 0.0),
        ([A, B, {"say": "there"}, C, END], 110.0),
        ([DURING, D], 1010.0),
        ([LEFT, D], 1000.0),
        ([A, LEFT, D], 1000.0),
        ([{"together": {"steps": [A, B], "beside": [WAIT]}}, C], 110.0),
        ([{"choose": [{"if": "run_s > 9", "steps": [D]}, {"steps": [A, B]}]}, C], 110.0),
        ([{"repeat": {"times": 3, "steps": [A, B]}}, C], 132.0),
        ([{"repeat": {"until": "run_s > 9", "steps": [A, B]}}, C], 110.0),
        ([{"repeat": {"steps": [A, B]}}], 10.0),
    ],
)
def test_paths_that_are_certain_to_follow_count(steps: list[dict[str, Any]], metres: float) -> None:
    assert ahead(*steps) == metres


def test_what_is_done_counts_no_more() -> None:
    steps = [{"repeat": {"times": 2, "steps": [A, B]}}, C]
    walker = Walker(*steps)
    found = []
    for _ in range(5):
        found.append(ahead(*steps, position=walker.position))
        walker.tick("done")
    assert found == [121.0, 111.0, 110.0, 100.0, 0.0]


def test_of_a_list_the_position_alone_tells() -> None:
    steps = [A, B, C]
    walker = Walker(*steps)
    walker.tick("done")
    assert ahead(*steps, position=walker.position) == 100.0


def test_what_follows_another_outcome_counts_once_it_is_there() -> None:
    steps = [{"try": {"retries": 1, "steps": [A], "between": [B], "catch": {"blocked": [C, C]}}}, D]
    walker = Walker(*steps)
    assert ahead(*steps, position=walker.position) == 1000.0
    walker.tick("blocked")
    assert ahead(*steps, position=walker.position) == 1001.0, "between, and then its step again"
    walker.tick("done")
    walker.tick("blocked")
    assert ahead(*steps, position=walker.position) == 1100.0


def test_steps_of_a_when_count_once_they_are_there() -> None:
    walker = Walker(DURING, D)
    walker.tick(run_s=1.0)
    walker.tick(run_s=10.0)
    assert walker.present == "steps.0.during.when.0.steps.0.follow"
    assert ahead(DURING, D, position=walker.position) == 1010.0


def test_steps_that_begin_anew_after_a_when_count_whole() -> None:
    during = {"during": {"steps": [A, B], "when": [{"if": "run_s > 9", "steps": [C], "then": "restart"}]}}
    walker = Walker(during, D)
    walker.tick("done", run_s=1.0)
    assert ahead(during, D, position=walker.position) == 1000.0
    walker.tick(run_s=10.0)
    assert walker.present == "steps.0.during.when.0.steps.0.follow"
    assert ahead(during, D, position=walker.position) == 1011.0


def test_before_the_first_step_nothing_counts() -> None:
    assert ahead({"repeat": {"times": 2, "steps": [A]}}, position=Position()) == 0.0
