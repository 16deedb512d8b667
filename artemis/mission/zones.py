"""The file of a map's zones and places, changed: by the command line, or by an operator who draws on the map."""

from __future__ import annotations

from pathlib import Path

from artemis.errors import ConfigError, similar
from artemis.mission.loading import model_of
from artemis.recording.disk import write_whole
from artemis.route_planning.zones import MapZone, MapZones, zone_line
from artemis.yaml_edit import is_blank, replace_content, with_line, without_line
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


def without_zone(raw: bytes, source: str, name: str | int) -> bytes:
    """The content without a zone, by its name or its number from 1. Raises ConfigError: there is none."""
    zones = zones_in(raw, source).zones
    found = [n for n, zone in enumerate(zones) if name == n + 1 or name in (zone.name, str(n + 1))]
    if not found:
        known = [zone.name or str(number) for number, zone in enumerate(zones, 1)]
        raise ConfigError(f"{source}: no zone {name!r}; {similar(str(name), known) or 'there are none'}")
    return without_line(raw, source, "zones", found[0])


def read_zones(beside: Path) -> bytes:
    """The content of the file; of one that is not there a line that says what it is. Raises ConfigError."""
    return read(beside) if beside.exists() else HEAD


def write_zones(beside: Path, content: bytes) -> None:
    """Write the file, all of it or nothing. Raises ConfigError, RecordingError: it cannot be."""
    if not beside.exists():
        write_whole(beside, HEAD.decode())
    replace_content(beside, content)
