"""Points of a path from GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
import math
from typing import Any

from artemis.commands.path_given import Given, Place, from_places, text_of
from artemis.errors import ConfigError, shown
from artemis.motion.table import raise_first

LINES = {"LineString": 1, "MultiLineString": 2, "Point": 0, "MultiPoint": 1}
"""How deep lists are nested in the coordinates."""
GRAPH = "startid"
"""A property that edges of a route graph of Nav2 have."""


def read_geojson(raw: bytes, source: str) -> Given:
    """The lines of a GeoJSON file in their order, else its points: metres from the first point.

    Raises:
        ConfigError: no GeoJSON, no points, places that are not on Earth.
    """
    text = text_of(raw, source)
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise ConfigError(f"{source}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from None
    except RecursionError:
        raise ConfigError(f"{source}:1:1: not GeoJSON: nested too deep") from None
    geometries = list(_geometries(data, source, "$"))
    lines = [found for found in geometries if "Line" in found[1]]
    problems: list[str] = []
    segments: list[list[Place]] = [[]]
    for place, kind, coordinates in lines or geometries:
        pieces = coordinates if LINES[kind] == 2 else [coordinates] if LINES[kind] == 1 else [[coordinates]]
        if not isinstance(pieces, list) or not all(isinstance(piece, list) for piece in pieces):
            raise ConfigError(f"{place}: coordinates: expected lists of [longitude, latitude]")
        for piece in pieces:
            if lines:
                segments.append([])
            segments[-1] += _places(piece, place, problems)
    if not any(segments) and not problems:
        problems.append(f"{source}:1:1: no line and no point (LineString, MultiLineString, Point)")
    raise_first(problems, source)
    return from_places(segments)


def _geometries(data: Any, source: str, at: str) -> list[tuple[str, str, Any]]:  # noqa: ANN401 (JSON)
    """Place, type and coordinates of every geometry that has points of a path."""
    place = f"{source}: {at}"
    kind = data.get("type") if isinstance(data, dict) else None
    if kind in LINES:
        return [(place, kind, data.get("coordinates"))]
    if kind == "Feature":
        if GRAPH in (data.get("properties") or {}):
            raise ConfigError(f"{place}: a route graph of Nav2 is no path: save the path that was planned on it")
        return _geometries(data["geometry"], source, f"{at}.geometry") if data.get("geometry") else []
    listed = {"FeatureCollection": "features", "GeometryCollection": "geometries"}.get(str(kind))
    if listed is not None and isinstance(data.get(listed), list):
        found = (_geometries(item, source, f"{at}.{listed}[{i}]") for i, item in enumerate(data[listed]))
        return [geometry for part in found for geometry in part]
    if kind in ("Polygon", "MultiPolygon"):
        raise ConfigError(f"{place}: an area (Polygon) is no path: draw a line")
    raise ConfigError(f"{place}: expected GeoJSON with a type such as FeatureCollection, found {shown(kind)}")


def _places(piece: list[Any], place: str, problems: list[str]) -> list[Place]:
    found: list[Place] = []
    for index, item in enumerate(piece):
        numbers = [part for part in item if isinstance(part, int | float)] if isinstance(item, list) else []
        if len(numbers) < 2 or not (abs(numbers[0]) <= 180 and abs(numbers[1]) <= 90) or not math.isfinite(numbers[0]):
            problems.append(
                f"{place}.coordinates[{index}]: expected longitude and latitude in degrees, found {shown(item)}; "
                "metres belong into a table"
            )
        else:
            found.append((float(numbers[1]), float(numbers[0]), f"{place}.coordinates[{index}]"))
    return found
