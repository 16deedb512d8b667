"""How far a mission drives for certain after its present step, whatever its words are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from mission_trees import Walker, built

from artemis.progress import Position
from artemis.states.condition import asks_battery
from artemis.states.distance_left import distance_after

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

    def length(number: int) -> float | None:
        passive = made.passive[number]
        return None if passive and asks_battery(passive.condition) else METRES.get(paths[number], 0.0)

    return distance_after(made.tree, position or Walker(*steps).position, length)


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
        ([A, {"together": {"steps": [B], "beside": [WAIT]}}, C], 110.0),
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


CHARGE = {"wait": {"for": "charge_percent > 90"}}


def charging(then: str, **keys: Any) -> dict[str, Any]:  # noqa: ANN401 (as a file writes them)
    """A patrol of 20 rounds whose `when` drives to the charger."""
    when = {"if": "charge_percent < 30", "steps": [A, CHARGE], "then": then, **keys}
    return {"during": {"steps": [{"repeat": {"times": 20, "steps": [D]}}], "when": [when]}}


CAUGHT = {"steps": [D], "catch": {"battery-short": [A, CHARGE]}}
AGAIN = {"retries": 3, "again_on": ["battery-short"], "steps": [D], "between": [A, CHARGE]}


@pytest.mark.parametrize(
    ("steps", "metres"),
    [
        ([A, B, CHARGE, D], 10.0),
        ([A, {"wait": {"for": "run_s > 9"}}, B], 10.0),
        ([{"repeat": {"times": 20, "steps": [A, CHARGE, B]}}], 0.0),
        ([{"repeat": {"times": 20, "steps": [A, B, CHARGE]}}], 10.0),
        ([{"repeat": {"until": "charge_percent > 90", "steps": [A, B, WAIT]}}, D], 10.0),
        ([A, {"choose": [{"if": "charge_percent < 30", "steps": [B, CHARGE]}]}, D], 10.0),
        ([charging("restart"), D], 0.0),
        ([charging("resume"), D], 0.0),
        ([charging("resume", **{"if": "run_s > 99"}), D], 0.0),
        ([charging("resume", steps=[A, WAIT]), D], 0.0),
        ([A, charging("restart"), D], 0.0),
        ([A, charging("low", steps=None), D], 1000.0),
        ([A, {"during": {"at_most_s": 9, "steps": [B, CHARGE]}}, D], 0.0),
        ([A, {"try": CAUGHT}, D], 1000.0),
        ([{"repeat": {"times": 20, "steps": [{"try": CAUGHT}]}}], 0.0),
        ([{"repeat": {"times": 20, "steps": [{"try": AGAIN}]}}], 0.0),
        ([{"repeat": {"times": 20, "steps": [{"try": {**AGAIN, "again_on": ["blocked"]}}]}}], 19000.0),
        ([{"repeat": {"times": 20, "steps": [{"try": {**CAUGHT, "catch": {"blocked": [CHARGE]}}}]}}], 19000.0),
        ([{"repeat": {"times": 20, "steps": [{"try": {**CAUGHT, "catch": {"any": [CHARGE]}}}]}}], 0.0),
    ],
)
def test_what_follows_a_step_that_may_charge_counts_not(steps: list[dict[str, Any]], metres: float) -> None:
    assert ahead(*steps) == metres


def test_what_follows_the_last_charge_counts() -> None:
    steps = [CHARGE, A, {"try": {"retries": 1, "steps": [B], "between": [CHARGE, C], "again_on": ["battery-short"]}}, D]
    walker = Walker(*steps)
    assert ahead(*steps, position=walker.position) == 11.0
    walker.tick(charge_percent=95.0)
    walker.tick("done")
    walker.tick("battery-short", charge_percent=50.0)
    assert ahead(*steps, position=walker.position) == 110.0


def test_before_the_first_step_nothing_counts() -> None:
    assert ahead({"repeat": {"times": 2, "steps": [A]}}, position=Position()) == 0.0
