"""What is done before each step of a mission on every path to it, and what its writer is told where it is not."""

from __future__ import annotations

from typing import Any

import pytest

from artemis.mission.order import CALIBRATED, Order, why_not
from artemis.plugins.contracts import Declared
from artemis.states.outcomes import StepFacts
from artemis.states.outline import steps_in

ALIGN: Any = {"calibrate": {"steering": "from_potentiometers"}}
SHOW: Any = {"teleop": {"input": "stick", "record": "shown"}}
WAIT: Any = {"wait": {"for": "run_s > 9", "at_most_s": 3}}
ASK: Any = {"ask": {"question": "?", "answers": ["a"]}}
DRIVE: Any = {"follow": {"path": {"recorded": "shown"}}}
SAY: Any = {"say": "x"}
SNIFF: Any = {"sniff": {}}
CLOSER: Any = {"closer": {}}
FACTS = StepFacts(
    behaviours={"sniff": Declared(outcomes=("gas",), moves=False), "closer": Declared(outcomes=("too-far",))}
)


def why(*steps: dict[str, Any], fact: str = CALIBRATED) -> str:
    """Why the wheels may not be aligned at the last `follow`; empty: they are; `never`: no step before does."""
    path = [path for path, word, _ in steps_in(steps) if word == "follow"][-1]
    if fact in Order(steps, FACTS).before[path]:
        return ""
    return why_not(steps, fact, path) or "never"


CHOICE: Any = {"choose": [{"if": "run_s > 1", "steps": [ALIGN]}, {"steps": [WAIT]}]}


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        ([ALIGN, DRIVE], ""),
        ([DRIVE, ALIGN], "never"),
        ([DRIVE], "never"),
        ([CHOICE, DRIVE], "steps[0].choose[0].steps[0].calibrate only runs if run_s > 1"),
        (
            [{"choose": [{"if": "run_s > 1", "steps": [WAIT]}, {"steps": [ALIGN]}]}, DRIVE],
            "steps[0].choose[1].steps[0].calibrate only runs if no condition above it holds",
        ),
        (
            [{"choose": [{"if": "run_s > 1", "steps": [ALIGN]}]}, DRIVE],
            "steps[0].choose[0].steps[0].calibrate only runs",
        ),
        ([{"choose": [{"if": "run_s > 1", "steps": [ALIGN]}, {"steps": [ALIGN]}]}, DRIVE], ""),
        ([{"choose": [{"if": "run_s > 1", "steps": [ALIGN]}, {"steps": [{"end": {}}]}]}, DRIVE], ""),
        ([{"choose": [{"if": "run_s > 1", "steps": [ALIGN, DRIVE]}]}], ""),
        (
            [{"choose": [{"if": "run_s > 1", "steps": [ALIGN]}, {"steps": [DRIVE]}]}],
            "steps[0].choose[0].steps[0].calibrate only runs if run_s > 1",
        ),
        ([{"repeat": {"times": 2, "steps": [ALIGN]}}, DRIVE], ""),
        ([{"repeat": {"until": "run_s > 1", "steps": [DRIVE, ALIGN]}}], "never"),
        ([{"call": {"part": "a", "steps": [ALIGN]}}, DRIVE], ""),
        ([{"try": {"steps": [ALIGN], "retries": 1}}, DRIVE], ""),
        (
            [{"try": {"steps": [ALIGN], "catch": {"fault": [SAY]}}}, DRIVE],
            "steps[0].try.steps[0].calibrate may be left before it is done, as steps[0].try says",
        ),
        ([{"try": {"steps": [ALIGN, WAIT], "catch": {"timeout": [SAY]}}}, DRIVE], ""),
        (
            [{"try": {"steps": [WAIT, ALIGN], "catch": {"timeout": [SAY]}}}, DRIVE],
            "steps[0].try.steps[1].calibrate may be",
        ),
        ([{"try": {"steps": [WAIT, ALIGN], "catch": {"timeout": [ALIGN]}}}, DRIVE], ""),
        ([{"try": {"steps": [WAIT, ALIGN], "catch": {"timeout": [{"end": {}}]}}}, DRIVE], ""),
        ([{"try": {"steps": [WAIT], "catch": {"timeout": [ALIGN]}}}, DRIVE], "calibrate only runs after timeout"),
        ([{"try": {"steps": [ALIGN, CLOSER], "catch": {"lost": [DRIVE]}}}], ""),
        ([{"try": {"steps": [ALIGN, CLOSER], "catch": {"too-far": [DRIVE]}}}], ""),
        ([{"try": {"steps": [ALIGN, CLOSER], "catch": {"any": [DRIVE]}}}], ""),
        (
            [{"try": {"steps": [ALIGN, CLOSER], "retries": 1, "again_on": ["fault"], "catch": {"any": [DRIVE]}}}],
            "calibrate may be left before it is done",
        ),
        (
            [{"try": {"steps": [ALIGN, CLOSER], "catch": {"fault": [{"end": {}}], "any": [DRIVE]}}}],
            "",
        ),
        ([{"try": {"steps": [ALIGN, SNIFF], "catch": {"fault:DRV-25": [DRIVE]}}}], "calibrate may be left before"),
        (
            [{"try": {"steps": [WAIT], "retries": 1, "between": [ALIGN]}}, DRIVE],
            "steps[0].try.between[0].calibrate only runs before a retry",
        ),
        ([{"try": {"steps": [WAIT], "retries": 1, "between": [ALIGN, DRIVE]}}], ""),
        ([{"try": {"steps": [ALIGN, WAIT], "retries": 1, "between": [DRIVE]}}], ""),
        (
            [{"try": {"steps": [SNIFF, ALIGN], "retries": 1, "again_on": ["fault"], "between": [DRIVE]}}],
            "calibrate may be",
        ),
        (
            [{"try": {"steps": [WAIT, ALIGN], "retries": 1, "again_on": ["any"], "between": [DRIVE]}}],
            "calibrate may be left before",
        ),
        ([{"during": {"steps": [ALIGN], "at_most_s": 9}}, DRIVE], ""),
        (
            [{"during": {"steps": [ASK], "when": [{"if": "run_s > 1", "steps": [ALIGN]}]}}, DRIVE],
            "only runs once run_s > 1",
        ),
        (
            [{"during": {"steps": [ALIGN], "when": [{"if": "run_s > 1", "steps": [DRIVE]}]}}],
            "steps[0].during.steps[0].calibrate may be left before it is done, as steps[0].during says",
        ),
        (
            [
                {
                    "try": {
                        "steps": [{"during": {"steps": [ASK], "when": [{"if": "a", "steps": [ALIGN], "then": "x"}]}}],
                        "catch": {"x": [DRIVE]},
                    }
                }
            ],
            "",
        ),
        ([{"together": {"steps": [ALIGN], "beside": [WAIT]}}, DRIVE], ""),
    ],
)
def test_only_what_every_path_does_counts(steps: list[Any], reason: str) -> None:
    found = why(*steps)
    assert reason in found if reason else not found, found


def test_what_is_recorded_counts_by_its_name() -> None:
    assert why(SHOW, DRIVE, fact="shown") == ""
    assert why(SHOW, DRIVE, fact="other") == "never"
    assert "may be left" in why({"try": {"steps": [WAIT, SHOW], "catch": {"timeout": [SAY]}}}, DRIVE, fact="shown")


@pytest.mark.parametrize("first", [{"repeat": {"steps": [WAIT]}}, {"end": {}}, {"stop": {}}])
def test_of_what_is_never_reached_nothing_is_said(first: Any) -> None:  # noqa: ANN401
    steps = [first, DRIVE, {"try": {"steps": [WAIT], "catch": {"gas": [DRIVE]}}}]
    assert not [path for path in Order(steps, FACTS).before if path[-1] == "follow"]


@pytest.mark.parametrize(
    "steps",
    [
        None,
        7,
        [None, {}, {"try": None}, {"during": 5}, {"choose": 3}, {"choose": [None, {}]}, {"together": []}],
        [{"try": {"steps": 3, "catch": [1], "again_on": 4}}, {"try": {"steps": [WAIT], "again_on": [[1], None]}}],
        [{"during": {"steps": {}, "when": [None, {"then": [2]}]}}, {"together": {"beside": [3, {}]}}],
    ],
)
def test_what_is_no_mission_is_passed_over(steps: Any) -> None:  # noqa: ANN401
    assert Order(steps, StepFacts()).ends["steps",]
