"""A map's files are written whole or not at all; numbers that are given on the command line."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from artemis.commands.path_files import refuse_taken
from artemis.errors import ConfigError, shown
from artemis.mapping.graph_file import MapGraph, files_of, saved_files
from artemis.mapping.occupancy import OccupancyMap
from artemis.route_planning.zones import NO_MAP, zones_file
from artemis.route_planning.zones import SUFFIX as ZONES
from artemis.whole_files import write_bytes


def refuse_output(path: Path, force: bool) -> None:
    """Refuse a name that cannot be written.

    Raises:
        ConfigError: it is no name of a map, or is taken.
    """
    if path.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"{path}: name the map .yaml; its image and its graph are written beside it")
    if path.name.endswith(ZONES):
        raise ConfigError(f"{path}: {NO_MAP}")
    refuse_taken([*files_of(path), Path(zones_file(str(path)))], force)


def write_map(path: Path, content: OccupancyMap, graph: MapGraph | None) -> None:
    """Write image and graph, then the YAML file, and say so.

    Raises:
        ConfigError: they cannot be written.
    """
    write_bytes(saved_files(path, content, graph))
    rows, columns = content.cells.shape
    size = f"{columns * content.resolution:.1f} x {rows * content.resolution:.1f} m"
    sys.stdout.write(f"map         {path}: {size}, cells of {content.resolution:g} m\n")


def numbers(text: str, option: str, count: int, *, more: bool = False) -> list[float]:
    """Numbers out of an option, `count` of them; with `more` also more pairs.

    Raises:
        ConfigError: it has others.
    """
    found = list[float]()
    for word in text.split(","):
        try:
            found.append(float(word))
        except ValueError:
            raise ConfigError(f"{option} {text}: {shown(word)} is no number") from None
        if not math.isfinite(found[-1]):
            raise ConfigError(f"{option} {text}: {shown(word)} is no finite number")
    if len(found) != count and not (more and len(found) > count and (len(found) - count) % 2 == 0):
        several = " or more, in pairs," if more else ""
        wanted = f"{count} numbers{several} with commas" if count > 1 else "1 number"
        raise ConfigError(f"{option} {text}: expected {wanted}, not {len(found)}")
    return found
