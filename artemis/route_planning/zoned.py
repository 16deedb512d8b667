"""Planning with the zones of the moment, in the planner's process: it reads their file and makes the floor of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from artemis.errors import ConfigError
from artemis.route_planning.floor import Floor, PackedMap, floor_from
from artemis.route_planning.planner import PlannedRoute, RouteRequest, plan_route
from artemis.route_planning.zones import MapZones, zone_changes

ZonesIn = Callable[[bytes, str], MapZones]
"""From the content of a file of zones, and its name, to what it holds; raises ConfigError."""
MOST_FLOORS = 2
"""Are kept: 9 bytes for each cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOrder:
    """What goes to the process for one plan: no floor, for that is large."""

    content: PackedMap
    beside: Path
    """The file of its zones."""
    known: bytes
    """Content of that file when it was read last; empty: there was none."""
    planned_for: bytes | None
    """The same when the present route was planned; None: there is none."""
    zones_in: ZonesIn
    request: partial[RouteRequest]
    """All of it but `floor` and `before`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonedPlan:
    """What came of it."""

    planned: PlannedRoute
    raw: bytes = b""
    """The content of the file of zones that counted."""
    wrong: str = ""
    """Why nothing was planned: the zones are not known. Empty: they are."""


def plan_zoned(order: PlanOrder) -> ZonedPlan:
    """Plan with the zones that the file beside the map holds now."""
    try:
        raw, changes = _zones_now(order)
        floor = _floor(order.content, raw, str(order.beside), order.zones_in)
    except ConfigError as error:
        return ZonedPlan(planned=PlannedRoute(detail=""), wrong="; ".join(error.problems))
    before = None
    if order.planned_for is not None and raw != order.planned_for:
        before = _floor(order.content, order.planned_for, str(order.beside), order.zones_in)
    planned = plan_route(order.request(floor=floor, before=before))
    return ZonedPlan(planned=planned.with_words(changes), raw=raw)


@lru_cache(maxsize=MOST_FLOORS)
def _floor(content: PackedMap, raw: bytes, source: str, zones_in: ZonesIn) -> Floor:
    return floor_from(content.content, zones_in(raw, source).zones)


def _zones_now(order: PlanOrder) -> tuple[bytes, str]:
    """The content of the file, and what is new in it, in words.

    Raises:
        ConfigError: it cannot be read, is wrong, or had zones before and says nothing of zones any more.
    """
    beside = order.beside
    try:
        raw, is_there = beside.read_bytes(), True
    except FileNotFoundError:
        raw, is_there = b"", False
    except OSError as error:
        raise ConfigError(f"{beside}: cannot be read: {error.strerror}") from error
    if raw == order.known:
        return raw, ""
    zones, known = order.zones_in(raw, str(beside)), order.zones_in(order.known, str(beside))
    if known.zones and not zones.says_zones:  # an empty file, or a part of one, is no decision
        lost = "has no zones any more" if is_there else "is not there any more"
        advice = "bring them back, or write `zones: []` if there are to be none"
        raise ConfigError(f"{beside}: {lost}, and had {len(known.zones)} when it was read last; {advice}")
    return raw, zone_changes(known, zones)
