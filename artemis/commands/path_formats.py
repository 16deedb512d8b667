"""The formats of others that a path file can be made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from artemis.commands.path_geojson import read_geojson
from artemis.commands.path_given import Given, text_of
from artemis.commands.path_poses import read_nav2
from artemis.commands.path_tables import read_csv
from artemis.commands.path_xml import read_gpx, read_kml

__all__ = ["READERS", "SUFFIXES", "Given", "read_csv", "read_gpx", "read_nav2", "text_of"]

READERS: Mapping[str, Callable[[bytes, str], Given]] = {
    "csv": read_csv,
    "gpx": read_gpx,
    "kml": read_kml,
    "geojson": read_geojson,
    "nav2": read_nav2,
}
SUFFIXES = (
    dict.fromkeys((".csv", ".txt", ".tsv", ".tum", ".dat"), "csv")
    | dict.fromkeys((".geojson", ".json"), "geojson")
    | dict.fromkeys((".yaml", ".yml"), "nav2")
    | {".gpx": "gpx", ".kml": "kml"}
)
