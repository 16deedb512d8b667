"""Zones that operators draw on the maps of a run's routes: shown, added and removed in the file beside each map."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from artemis.bridges.page.session import ZoneChange
from artemis.errors import ArtemisError, ConfigError
from artemis.mission.problems import checked
from artemis.mission.zones import read_zones, with_zone, without_zones, write_zones, zones_in
from artemis.page.view import Part
from artemis.route_planning.zones import MapZone, zones_file
from artemis.states.outline import numbered

DIGITS = 3
"""Corners are kept to the millimetre."""


class ZoneFiles:
    """The files of one run, by their maps as the mission names them. They are read from the disk whenever asked for."""

    def __init__(self, folder: Path, mission: Mapping[str, Any]) -> None:
        """`mission` in its file's own form, whose files are in `folder`."""
        self._files: dict[str, Path] = {}
        self._steps: dict[str, list[int]] = {}
        for number, (_, word, body) in enumerate(numbered(mission.get("steps") or ())):
            if word == "goto" and isinstance(body, Mapping):
                name = str(body["map"])
                self._files[name] = folder / zones_file(name)
                self._steps.setdefault(name, []).append(number)

    def told(self) -> list[Part]:
        """All zones, with the steps whose routes avoid them."""
        return [self._of(name) for name in self._files]

    def change(self, change: ZoneChange) -> None:
        """Add a zone to keep out of, or remove one.

        Raises:
            ArtemisError: it cannot be; the file is as it was.
        """
        if (beside := self._files.get(change.map)) is None:
            raise ConfigError(f"no step plans routes on {change.map}")
        raw = read_zones(beside)
        if _tag(raw) != change.known:
            raise ConfigError("another operator has changed the zones meanwhile: load them again")
        if change.remove:
            raw = without_zones(raw, str(beside), [change.remove])
        else:
            raw = with_zone(raw, str(beside), _zone(change))
        zones_in(raw, str(beside))
        write_zones(beside, raw)

    def _of(self, name: str) -> Part:
        beside = self._files[name]
        try:
            raw = read_zones(beside)
            zones = zones_in(raw, str(beside)).zones
        except ArtemisError as error:
            return {"map": name, "steps": self._steps[name], "tag": "", "zones": [], "problem": str(error)}
        return {
            "map": name,
            "steps": self._steps[name],
            "tag": _tag(raw),
            "zones": [
                {"name": zone.name or "", "kind": zone.kind, "speed": zone.speed_m_s, "corners": zone.corners}
                for zone in zones
            ],
        }


def _zone(change: ZoneChange) -> MapZone:
    """A zone that was drawn. Raises ConfigError: it is none."""
    corners = [[round(x, DIGITS), round(y, DIGITS)] for x, y in change.corners]
    return checked(MapZone, {"kind": "keep-out", "name": change.name or None, "corners": corners})


def _tag(raw: bytes) -> str:
    return sha256(raw).hexdigest()[:16]
