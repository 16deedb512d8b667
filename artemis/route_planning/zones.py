"""Zones and places on a map: the file `hall.zones.yaml` beside `hall.yaml`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import combinations
from math import fsum
from pathlib import PurePath
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from artemis.config import Config, Quantity

LEAST_AREA = 1e-4
"""Of a zone [m²]."""
SUFFIX = ".zones.yaml"
PLACE_NAME = "^[a-z0-9-]{1,64}$"
NO_MAP = "a map's zones and places have such a name; name the map otherwise"
"""Why a map is not called so."""
Coordinate = Annotated[float, Quantity(0.0, 1e6, "m", signed=True)]
Corner = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]


class MapZone(Config):
    """A polygon on the floor."""

    kind: Literal["keep-out", "slow", "prefer"]
    """keep-out: no route leads through it; slow: no faster than `speed_m_s` in it; prefer: routes like to."""
    corners: Annotated[tuple[Corner, ...], Field(strict=False, min_length=3)]
    """[x, y] of each in the frame of the map [m], one way around."""
    speed_m_s: Annotated[float, Field(gt=0, le=10)] | None = None
    """Of the virtual front wheel, in a slow zone."""
    name: Annotated[str, Field(min_length=1, max_length=64)] | None = None
    """For people."""

    @field_validator("name")
    @classmethod
    def _one_line(cls, name: str | None) -> str | None:
        if name is not None and not name.isprintable():
            raise ValueError("expected letters, digits, signs and blanks, on one line")
        return name

    @field_validator("corners")
    @classmethod
    def _one_way_around(cls, corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
        edges = list(zip(corners, (*corners[1:], corners[0]), strict=True))
        for one, other in combinations(range(len(edges)), 2):
            if _cross(edges[one], edges[other]):
                raise ValueError(
                    f"its edges from corner {one + 1} and from corner {other + 1} cross: list the corners in their "
                    "order around the zone"
                )
        if abs(fsum([ax * by - bx * ay for (ax, ay), (bx, by) in edges])) < 2.0 * LEAST_AREA:
            raise ValueError("the corners lie on one line")
        return corners

    @model_validator(mode="after")
    def _speed(self) -> Self:
        if (self.kind == "slow") != (self.speed_m_s is not None):
            raise ValueError("kind: slow and speed_m_s belong together")
        return self


class MapPose(Config):
    """A pose of the robot on a map: of the centre of its rear axle."""

    x_m: Coordinate
    """In the frame of the map."""
    y_m: Coordinate
    """Likewise."""
    heading_deg: Annotated[float, Quantity(0.0, 360.0, "degrees", signed=True)]
    """Counter-clockwise from the map's x axis."""


class MapZones(Config):
    """What people know of a map."""

    zones: Annotated[tuple[MapZone, ...], Field(strict=False)] = ()
    places: dict[Annotated[str, Field(pattern=PLACE_NAME)], MapPose] = Field(default_factory=dict)
    """By name: small letters, digits and hyphens."""

    @property
    def says_zones(self) -> bool:
        """Whether the file has the key `zones`, if only to say that there are none."""
        return "zones" in self.model_fields_set

    @model_validator(mode="after")
    def _names(self) -> Self:
        names = [zone.name for zone in self.zones if zone.name is not None]
        if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
            raise ValueError(f"two zones are called {twice[0]!r}")
        return self


def zone_line(zone: MapZone, corners: Sequence[Sequence[float]]) -> str:
    """A zone on one line."""
    name = f"name: {json.dumps(zone.name, ensure_ascii=False)}, " if zone.name is not None else ""
    speed = f", speed_m_s: {zone.speed_m_s:g}" if zone.speed_m_s is not None else ""
    points = ", ".join(f"[{in_digits(x)}, {in_digits(y)}]" for x, y in corners)
    return f"{{{name}kind: {zone.kind}{speed}, corners: [{points}]}}"


def in_digits(value: float) -> str:
    """A coordinate [m], or an angle [degrees], to four decimals, however large it is."""
    return f"{round(value, 4) + 0.0:.12g}"


def zone_changes(before: MapZones, now: MapZones) -> str:
    """Which zones are new, and which are no more, in words; empty: neither."""
    new = [f"new {zone_line(zone, zone.corners)}" for zone in now.zones if zone not in before.zones]
    gone = [f"no more {zone_line(zone, zone.corners)}" for zone in before.zones if zone not in now.zones]
    return f"zones changed: {', '.join([*new, *gone])}" if new or gone else ""


def zones_file(map_file: str) -> str:
    """Name of the file beside a map's YAML file."""
    return str(PurePath(map_file).with_suffix(SUFFIX))


def _cross(one: tuple[Corner, Corner], other: tuple[Corner, Corner]) -> bool:
    """Whether two edges cross, each with ends on both sides of the other's line."""
    return _side(one, other[0]) * _side(one, other[1]) < 0.0 and _side(other, one[0]) * _side(other, one[1]) < 0.0


def _side(edge: tuple[Corner, Corner], point: Corner) -> float:
    (ax, ay), (bx, by) = edge
    return (bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax)
