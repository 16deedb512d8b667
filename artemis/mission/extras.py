"""What a mission takes longer for because an optional package is not installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from artemis.build import install

if TYPE_CHECKING:
    from artemis.mission.loading import LoadedMission

MAPPING = "mapping takes five times as long"
MATCHING = "matching a scan on a map, and searching the map, take five times as long"
ROUTES = "planning a route takes two to seven times as long, and up to two minutes where there is none"
SLOWER = (MAPPING, MATCHING, ROUTES)
SCAN_MAP = "scan_map"
"""Name of the plugin that matches scans on a map."""


def slower_without_numba(loaded: LoadedMission) -> list[str]:
    """One remark on what takes longer; none if numba is installed, or the mission needs it for nothing."""
    if find_spec("numba") is not None:
        return []
    mission = loaded.mission
    localizers = mission.localizer, mission.simulation.localizer
    costs = [MAPPING] if mission.mapping is not None else []
    costs += [MATCHING] if any(use is not None and use.plugin == SCAN_MAP for use in localizers) else []
    costs += [ROUTES] if loaded.destinations else []
    return [f"numba is not installed: {'; '.join(costs)}: {install('slam')}"] if costs else []
