"""A mission to which a page for operators was added by the command line: an observer, and an input that drives, too."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from artemis.bridges.poses import GOAL_POSE, INITIAL_POSE
from artemis.errors import ConfigError
from artemis.plugins.contracts import TakesInitialPose
from artemis.plugins.used import localizer_used
from artemis.states.outline import steps_in

PAGE = "page"
"""The plugins' name, and theirs in the mission."""
STARTED_BY_PAGE = "started_by_page"
"""The observer's key in a run that `artemis page` started."""


def has_page(mission: Mapping[str, Any]) -> bool:
    """Whether one of a mission's inputs is a page."""
    inputs = mission.get("inputs")
    uses = inputs.values() if isinstance(inputs, Mapping) else ()
    return any(isinstance(use, Mapping) and use.get("plugin") == PAGE for use in uses)


def add_page(mission: dict[str, Any], options: Mapping[str, Any]) -> None:
    """Add a page to a mission as its file has it.

    An input `page` becomes the last, by priority, of every step by hand; it drives no faster than the slowest of the
    mission's inputs. On its map may be set what a step or the localizer takes. What the mission says of a page itself
    stays, but for the `options` of its observer. A run that a page started waits for arm.

    Raises:
        ConfigError: the mission has something else of that name.
    """
    inputs = _section(mission, "inputs")
    name = next((name for name, use in inputs.items() if isinstance(use, dict) and use.get("plugin") == PAGE), None)
    if name is None:
        name = PAGE
        if PAGE in inputs:
            raise ConfigError(f"inputs.{PAGE}: --page adds an input of this name: give that one another")
        speeds = [use.get("max_speed_m_s") for use in inputs.values() if isinstance(use, dict)]
        stated = [speed for speed in speeds if isinstance(speed, int | float)]
        slow, allow = {"max_speed_m_s": min(stated)} if stated else {}, _allowed(mission)
        inputs[PAGE] = {"plugin": PAGE, "required": False, **slow, **({"allow": allow} if allow else {})}
        for _, word, body in list(steps_in(mission.get("steps"))):
            if word == "teleop" and isinstance(body, dict):
                _drive_too(body)
    observers = _section(mission, "observers")
    used = next((use for use in observers.values() if isinstance(use, dict) and use.get("plugin") == PAGE), None)
    if used is None and PAGE in observers:
        raise ConfigError(f"observers.{PAGE}: --page adds an observer of this name: give that one another")
    if used is None:
        used = observers[PAGE] = {"plugin": PAGE, "input": name}
    used.update(options)
    if options.get(STARTED_BY_PAGE):  # by an operator who may be far away: an operator's own act arms
        _section(mission, "supervision")["wait_for_arm"] = True
    simulation = mission.get("simulation")
    if isinstance(simulation, dict) and simulation.get("pace") == "fast":
        simulation["pace"] = "real_time"


def _section(mission: dict[str, Any], name: str) -> dict[str, Any]:
    """A mapping of the mission, made where it is not there; of another kind: the mission's reader complains of it."""
    found = mission.get(name)
    if found is None:
        found = mission[name] = {}
    return found if isinstance(found, dict) else {}


def _allowed(mission: Mapping[str, Any]) -> list[str]:
    """What may be set on the map of a page that is added: a goal that a step asks of it, and an initial pose."""
    from artemis.plugins.registry import LOCALIZERS, load

    bodies = [body for _, word, body in steps_in(mission.get("steps")) if word == "goto" and isinstance(body, Mapping)]
    asked = [body["to"].get("from_input") for body in bodies if isinstance(body.get("to"), Mapping)]
    allowed = [GOAL_POSE] * (PAGE in asked)
    for simulated in (False, True):
        use = localizer_used(mission, simulated=simulated)
        name = use.get("plugin") if isinstance(use, Mapping) else None
        with suppress(ConfigError):  # the mission's reader complains of it
            if isinstance(name, str) and isinstance(load(LOCALIZERS, name), TakesInitialPose):
                return [*allowed, INITIAL_POSE]
    return allowed


def _drive_too(body: dict[str, Any]) -> None:
    named = body.get("inputs")
    if isinstance(named, list) and PAGE not in named:
        body["inputs"] = [*named, PAGE]
    elif isinstance(name := body.pop("input", None), str):
        body["inputs"] = [name, PAGE]
