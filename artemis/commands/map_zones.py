"""Zones and places of a map on the command line: read, listed, added, removed, turned with the map."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from artemis.commands.map_files import numbers
from artemis.errors import ConfigError, shown, similar
from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.loading import load_model
from artemis.mission.problems import checked
from artemis.mission.zones import read_zones, with_zone, without_zones, write_zones, zones_in
from artemis.route_planning.floor import outside
from artemis.route_planning.zones import PLACE_NAME, MapPose, MapZone, MapZones, in_digits, zones_file
from artemis.yaml_edit import with_line, with_words, without_line
from artemis.yaml_file import KeyPath, scalar


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneEdits:
    """What is to be done, in this order; zones are removed by their numbers of before."""

    remove_zones: Sequence[str] = ()
    remove_places: Sequence[str] = ()
    zones: Sequence[str] = ()
    """NAME=KIND:X,Y,X,Y,X,Y; of a slow one KIND is slow@SPEED."""
    places: Sequence[str] = ()
    """NAME=X,Y,DEG."""

    def __bool__(self) -> bool:
        return any((self.remove_zones, self.remove_places, self.zones, self.places))


def zones_of(file: Path) -> MapZones:
    """Those beside a map's YAML file; none where there is no such file.

    Raises:
        ConfigError: it cannot be read, or is wrong.
    """
    beside = Path(zones_file(str(file)))
    return load_model(beside, MapZones) if beside.exists() else MapZones()


def edited_zones(raw: bytes, source: str, edits: ZoneEdits) -> bytes:
    """The content of a file of zones and places with what was added, and without what was removed.

    Raises:
        ConfigError: it would be wrong, what is to be removed is not there, or what is to be added is.
    """
    raw = without_zones(raw, source, edits.remove_zones)
    for name in edits.remove_places:
        known = list(zones_in(raw, source).places)
        if name not in known:
            raise ConfigError(f"{source}: no place {name!r}; {similar(name, known) or 'there are none'}")
        raw = without_line(raw, source, "places", name)
    for text in edits.zones:
        raw = with_zone(raw, source, _zone(text))
    for text in edits.places:
        name, line = _place(text)
        if name in zones_in(raw, source).places:
            raise ConfigError(f"{source}: there is a place {name!r} already; remove it first: --remove-place {name}")
        raw = with_line(raw, source, "places", line)
    zones_in(raw, source)
    return raw


def edit_zones(file: Path, edits: ZoneEdits, on: OccupancyMap) -> None:
    """Change the zones and places beside a map, and say so.

    Raises:
        ConfigError: as `edited_zones`; or the file cannot be read or written.
    """
    beside = Path(zones_file(str(file)))
    content = edited_zones(read_zones(beside), str(beside), edits)
    write_zones(beside, content)
    say_zones(file, zones_in(content, str(beside)), on)


def turned_zones(raw: bytes, source: str, turn: float) -> bytes:
    """The file of zones and places of a map, once the map was turned by `turn` [rad] around its origin.

    Raises:
        ConfigError: it is wrong, or an anchor gives two values one number that would differ.
    """
    known, c, s = zones_in(raw, source), math.cos(turn), math.sin(turn)

    def at(x: float, y: float) -> list[str]:
        return [in_digits(c * x - s * y), in_digits(s * x + c * y)]

    words: dict[KeyPath, str] = {}
    for number, zone in enumerate(known.zones):
        for corner, (x, y) in enumerate(zone.corners):
            words |= {("zones", number, "corners", corner, axis): word for axis, word in enumerate(at(x, y))}
    for name, place in known.places.items():
        heading = math.degrees(math.remainder(math.radians(place.heading_deg) + turn, math.tau))
        keys = ("x_m", "y_m", "heading_deg")
        pose = [*at(place.x_m, place.y_m), in_digits(round(heading, 3))]
        words |= {("places", name, key): word for key, word in zip(keys, pose, strict=True)}
    return with_words(raw, source, words) if words else raw


def say_zones(file: Path, known: MapZones, on: OccupancyMap) -> None:
    """A line for each zone and each place, and for each that lies outside of the map."""
    beside = Path(zones_file(str(file)))
    sys.stdout.write(f"{'zones':<12}{beside}: {len(known.zones)} zones, {len(known.places)} places\n")
    for number, zone in enumerate(known.zones, 1):
        speed = f" {zone.speed_m_s:g} m/s" if zone.speed_m_s is not None else ""
        corners = ", ".join(f"{in_digits(x)} {in_digits(y)}" for x, y in zone.corners)
        sys.stdout.write(f"{'zone':<12}{number} {zone.name or '(no name)'}: {zone.kind}{speed}, corners {corners}\n")
    for name, place in known.places.items():
        pose = f"x {in_digits(place.x_m)} m, y {in_digits(place.y_m)} m, {in_digits(place.heading_deg)} degrees"
        sys.stdout.write(f"{'place':<12}{name}: {pose}\n")
    for line in outside(on, known):
        sys.stdout.write(f"{'notice':<12}{line}\n")


def _zone(text: str) -> MapZone:
    name, _, words = text.partition("=")
    kind, _, corners = words.partition(":")
    kind, _, speed = kind.partition("@")
    if not (name and kind and corners):
        raise ConfigError(
            f"--zone {text}: expected NAME=KIND:X,Y,X,Y,X,Y with the kind keep-out, prefer, or slow@SPEED in m/s"
        )
    given = numbers(corners, f"--zone {name}", 6, more=True)
    points = [[x, y] for x, y in zip(given[::2], given[1::2], strict=True)]
    slow = {"speed_m_s": numbers(speed, f"--zone {name}, speed", 1)[0]} if speed else {}
    return checked(MapZone, {"name": name, "kind": kind, "corners": points, **slow}, f"--zone {name}")


def _place(text: str) -> tuple[str, str]:
    """Its name, and its line in the file."""
    name, _, pose = text.partition("=")
    if not (name and pose):
        raise ConfigError(f"--place {text}: expected NAME=X,Y,DEG")
    if not re.fullmatch(PLACE_NAME, name):
        raise ConfigError(f"--place {shown(name)}: expected a name of small letters, digits and hyphens, 64 at most")
    x, y, heading = numbers(pose, f"--place {name}", 3)
    checked(MapPose, {"x_m": x, "y_m": y, "heading_deg": heading}, f"--place {name}")
    return name, _place_line(name, x, y, heading)


def _place_line(name: str, x: float, y: float, heading: float) -> str:
    pose = f"{{x_m: {in_digits(x)}, y_m: {in_digits(y)}, heading_deg: {in_digits(heading)}}}"
    return f"{name if _is_text(name) else repr(name)}: {pose}"


def _is_text(name: str) -> bool:
    """Whether YAML takes it for text also without quotes."""
    try:
        return scalar(name) == name
    except ConfigError:
        return False
