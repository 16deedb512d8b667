"""What the steps of a mission may end with besides `done`, and where they may not: known here alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from msgspec import Struct

from artemis.plugins.contracts import Declared
from artemis.progress import BLOCKED, NO_PATH, SHORT
from artemis.states.tree import LOST, LOST_FAULTS, TIMEOUT
from artemis.vehicle import RobotFile

FOLLOWING = ("follow", "goto")
"""Artemis' own steps that drive along a path."""
MOVING = ("calibrate", *FOLLOWING, "teleop")
"""Artemis' own steps that move the robot, or turn its wheels."""
_OWN: Mapping[str, tuple[str, ...]] = {
    "follow": (BLOCKED, SHORT, LOST),
    "goto": (BLOCKED, NO_PATH, SHORT, LOST),
    "wait": (TIMEOUT,),
    "ask": (TIMEOUT,),
}
_OF_MOVING = (BLOCKED, LOST)
"""Of behaviours that move the robot, beside their own."""
WHEN: Mapping[str, str] = {
    BLOCKED: "where a scanner saw an obstacle in the way for `blocked_after_s`",
    NO_PATH: "where no route leads to a goal that the mission states",
    SHORT: "where the battery does not reach to its end",
    TIMEOUT: "after `at_most_s`",
    LOST: f"where a `try` names it: the faults {', '.join(LOST_FAULTS)}",
}
"""When a step ends with them, for people."""
NO_BATTERY = "the robot file describes no `battery`"
NOT_MEASURED = (
    "no drive of this robot measures the supply voltage: name an analog input that does "
    "(`battery.measured` of the robot file)"
)


class StepFacts(Struct, frozen=True, kw_only=True):
    """What outcomes depend on beside the steps."""

    behaviours: Mapping[str, Declared] = {}
    """What those among the steps state of themselves, by name."""
    has_scanner: bool = True
    has_battery: bool = True
    """The robot file describes it."""
    measures_supply: bool = True
    """Something measures the battery's voltage."""

    def moves(self, word: str) -> bool:
        """Whether a step moves the robot, or turns its wheels."""
        return word in MOVING or (word in self.behaviours and self.behaviours[word].moves)

    def follows(self, word: str) -> bool:
        """Whether a step drives by where the robot is."""
        return word in FOLLOWING or (word not in MOVING and self.moves(word))


def step_facts(behaviours: Mapping[str, Declared], robot: RobotFile | None) -> StepFacts:
    """The facts of a mission's behaviours and robot; None: it is not known, so it may have everything."""
    if robot is None:
        return StepFacts(behaviours=behaviours)
    return StepFacts(
        behaviours=behaviours,
        has_scanner=bool(robot.scanners),
        has_battery=robot.battery is not None,
        measures_supply=robot.supply_source is not None,
    )


def outcomes(word: str, behaviours: Mapping[str, Declared]) -> tuple[str, ...]:
    """What such a step may end with in some mission, besides `done`."""
    if (own := behaviours.get(word)) is None:
        return _OWN.get(word, ())
    return tuple(dict.fromkeys((*own.outcomes, *(_OF_MOVING if own.moves else ()))))


def outcomes_of(word: str, body: Any, facts: StepFacts) -> dict[str, str]:  # noqa: ANN401 (of a file)
    """What this step may end with besides `done`, each with why it cannot in this mission; empty: it may."""
    own = facts.behaviours.get(word)
    return {
        name: "" if own is not None and name in own.outcomes else _why_not(name, body, facts)
        for name in outcomes(word, facts.behaviours)
    }


def _why_not(name: str, body: Any, facts: StepFacts) -> str:  # noqa: ANN401 (of a file)
    keys: Mapping[str, Any] = body if isinstance(body, Mapping) else {}
    if name == BLOCKED and not facts.has_scanner:
        return "the robot has no scanner"
    if name == SHORT and not (facts.has_battery and facts.measures_supply):
        return NOT_MEASURED if facts.has_battery else NO_BATTERY
    if name == NO_PATH and isinstance(to := keys.get("to"), Mapping) and to.get("from_input"):
        return "its goals come from an input, and it waits for another one"
    return (
        "only `at_most_s` of `wait: {for: ...}` or `ask` ends a step so"
        if name == TIMEOUT and not keys.get("at_most_s")
        else ""
    )


def ends_words(names: Iterable[str]) -> str:
    """How a step may end besides `done`, for people; each after a semicolon."""
    return "".join(f"; `{name}`" + (f" {WHEN[name]}" if name in WHEN else "") for name in names)
