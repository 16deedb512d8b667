"""`artemis check --json`: what is known of missions, and what is wrong with them, for programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from artemis.devices.multicast import place_of
from artemis.errors import ConfigError
from artemis.mission.extras import slower_without_numba
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import BusWords, SerialWords
from artemis.planning import check_drivable, is_simulated
from artemis.run_record import content_hash
from artemis.yaml_file import read, survey

MOST_ABOUT = 400
"""Characters of a description."""


def tell_as_json(missions: Sequence[Path], *, page: bool) -> bool:
    """Print one line of JSON for each mission as soon as it is checked; whether all may be run.

    With `page`: as `artemis run --page` runs it.
    """
    well = True
    for mission in missions:
        told = facts_of(mission, page=page)
        well &= not told["problems"]
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()
    return well


def facts_of(mission: Path, *, page: bool) -> dict[str, Any]:
    """What is known of the mission in a file; where it cannot be run, as much as can be read."""
    facts = {"file": str(mission), "mission": "", "about": "", "robot": "", "bus": "", "simulated": False, "hash": ""}
    try:
        raw = read(mission)
        facts["about"] = description(raw)
        document, _ = survey(raw, str(mission))
        name = document.data.get("mission") if isinstance(document.data, dict) else None
        facts["mission"] = name if isinstance(name, str) else ""
        loaded = load_mission(mission, page={} if page else None)
        simulated = is_simulated(loaded)
        facts |= {"mission": loaded.mission.mission, "robot": loaded.robot.robot, "simulated": simulated}
        facts |= {"bus": bus_of(loaded), "hash": content_hash(loaded, mission)}
        check_drivable(loaded, mission, simulated)
    except ConfigError as error:
        return {**facts, "remarks": [], "problems": error.problems}
    return {**facts, "remarks": [*loaded.remarks, *slower_without_numba(loaded)], "problems": []}


def bus_of(loaded: LoadedMission) -> str:
    """Where a mission's drives are, in words."""
    match loaded.mission.bus:
        case BusWords() as bus:
            return place_of(bus.words)
        case SerialWords() as bus:
            return bus.serial
        case simulated:
            return simulated


def description(raw: bytes) -> str:
    """The first paragraph of the comment that a mission's file begins with; empty: it has none."""
    lines: list[str] = []
    for line in raw.decode(errors="replace").splitlines():
        words = line.removeprefix("#").strip()
        if not line.startswith("#") or (lines and not words):
            break
        lines += [words] if words else []
    text = " ".join(lines)
    return text if len(text) <= MOST_ABOUT else text[: MOST_ABOUT - 1] + "…"
