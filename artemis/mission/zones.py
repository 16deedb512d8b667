"""The file of a map's zones and places, changed: by the command line, or by an operator who draws on the map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from artemis.errors import ConfigError, similar
from artemis.mission.loading import model_of
from artemis.recording.disk import write_whole
from artemis.route_planning.zones import MapZone, MapZones, zone_line
from artemis.whole_files import replace_content
from artemis.yaml_edit import is_blank, with_line, without_line
from artemis.yaml_file import read

HEAD = b"# Zones and places, in the frame of the map.\n"


def zones_in(raw: bytes, source: str) -> MapZones:
    """What a file holds; nothing, if it has comments alone. Raises ConfigError: all that is wrong in it."""
    return MapZones() if is_blank(raw) else model_of(raw, source, MapZones)


def with_zone(raw: bytes, source: str, zone: MapZone) -> bytes:
    """The content with one more zone. Raises ConfigError: there is one of its name."""
    if zone.name is not None and any(known.name == zone.name for known in zones_in(raw, source).zones):
        raise ConfigError(f"{source}: there is a zone {zone.name!r} already; remove it first")
    return with_line(raw, source, "zones", f"- {zone_line(zone, zone.corners)}")


def without_zones(raw: bytes, source: str, which: Sequence[str | int]) -> bytes:
    """The content without some zones, each by its name or its number from 1 in this content; an int is a number.

    Raises:
        ConfigError: there is no such zone, or the name of one is the number of another.
    """
    zones = zones_in(raw, source).zones
    found = {_number_of(each, zones, source) for each in which}
    for number in sorted(found, reverse=True):
        raw = without_line(raw, source, "zones", number)
    return raw


def _number_of(which: str | int, zones: Sequence[MapZone], source: str) -> int:
    """From 0."""
    named = [n for n, zone in enumerate(zones) if zone.name == which]
    numbered = [n for n in range(len(zones)) if which in (n + 1, str(n + 1))]
    if named and numbered and named != numbered:
        raise ConfigError(
            f"{source}: {which} is the name of zone {named[0] + 1}, and the number of another; give the number of the "
            "first, or remove the second by hand"
        )
    if found := named or numbered:
        return found[0]
    known = [zone.name or str(number) for number, zone in enumerate(zones, 1)]
    raise ConfigError(f"{source}: no zone {which!r}; {similar(str(which), known) or 'there are none'}")


def read_zones(beside: Path) -> bytes:
    """The content of the file; of one that is not there a line that says what it is. Raises ConfigError."""
    return read(beside) if beside.exists() else HEAD


def write_zones(beside: Path, content: bytes) -> None:
    """Write the file, all of it or nothing. Raises ConfigError, RecordingError: it cannot be."""
    if not beside.exists():
        write_whole(beside, HEAD.decode())
    replace_content(beside, content)
