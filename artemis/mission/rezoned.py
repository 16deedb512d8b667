"""What of the zones and places beside a mission's maps may change between a run and the one that resumes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from artemis.errors import ConfigError
from artemis.mission.goto import Goto
from artemis.mission.loading import LoadedMission
from artemis.mission.zones import zones_in
from artemis.route_planning.zones import zone_changes, zones_file


def zones_files(loaded: LoadedMission) -> dict[str, set[str]]:
    """The files of zones by their names in the mission, each with the places to which steps lead."""
    found: dict[str, set[str]] = {}
    for _, step in loaded.tree.steps:
        if isinstance(goto := step.action, Goto):
            places = found.setdefault(zones_file(goto.map), set())
            if isinstance(goto.to, str):
                places.add(goto.to)
    return found


def rezoned(loaded: LoadedMission, then: Mapping[str, bytes], run: Path) -> list[str]:
    """Which zones have changed since a run began whose files were `then`: one line for each map.

    Raises:
        ConfigError: a place to which a step leads has moved, or all zones are gone without a word.
    """
    told, problems = list[str](), list[str]()
    for name, places in zones_files(loaded).items():
        before, now = (zones_in(files.get(name, b""), name) for files in (then, loaded.files))
        for place in sorted(places):
            if before.places.get(place) != now.places.get(place):
                problems.append(
                    f"{name}: the place {place} is not where it was in {run}, so that run cannot be resumed; move it "
                    "back, or omit --resume to start from the beginning"
                )
        if before.zones and not now.says_zones:
            problems.append(
                f"{name}: has no zones any more, and had {len(before.zones)} in {run}; bring them back, or write "
                "`zones: []` if there are to be none"
            )
        if changed := zone_changes(before, now):
            told.append(f"{name}: {changed}")
    if problems:
        raise ConfigError(problems)
    return told
