"""What another map keeps of the one that it was made from: zones and places; what was painted is lost."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from artemis.commands.map_zones import say_zones, zones_of
from artemis.mapping.graph_file import MapGraph
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OccupancyMap, occupancy
from artemis.mapping.se2 import Array, between, compose
from artemis.recording.disk import write_whole
from artemis.route_planning.zones import MapZones, zones_file

_ROUNDED = 20
"""Cells may differ, as a graph keeps its points in single precision: single ones,"""
_PAINTED = 3
"""not so many side by side, of the same class."""


def painted(file: Path, content: OccupancyMap, graph: MapGraph) -> str:
    """Which cells of the map `file` are not as its graph draws them, for people; empty: none."""
    drawn = occupancy(graph.keys, content.resolution)
    if drawn.cells.shape != content.cells.shape or drawn.origin != content.origin:
        edited = f"{file} was edited by hand, or only rotated by an earlier version (then nothing is lost)"
    else:
        changed = drawn.cells != content.cells
        lost = int(np.count_nonzero(changed))
        if lost <= _ROUNDED and _side_by_side(np.argwhere(changed), content.cells[changed]) < _PAINTED:
            return ""
        edited = f"{lost} cells of {file} were edited by hand"
    return (
        f"{edited}: the image is drawn again from its graph, without that. State --crop and --no-go again, or use "
        "--zone for routes"
    )


def _side_by_side(places: NDArray[np.int64], cells: NDArray[np.int8]) -> int:
    """Of a few cells, shape (n,), at rows and columns, shape (n, 2): how many of one class touch one, with it."""
    touch = (np.abs(places[:, None] - places).max(2) <= 1) & (cells[:, None] == cells)
    return int(touch.sum(1).max(initial=0))


def keep_zones(file: Path, output: Path, content: bytes) -> None:
    """Write the file of zones and places beside the map `output`, made from the map `file`, and say so.

    Raises:
        ConfigError: it cannot be read again.
    """
    beside = Path(zones_file(str(output)))
    if content:
        write_whole(beside, content.decode())
        say_zones(output, zones_of(output), read_map(output))
    elif beside.exists():  # of another map
        beside.unlink()
        sys.stdout.write(f"{'zones':<12}{beside}: removed, as {file} has none\n")


def say_moved(known: MapZones, old: Array, new: Array, cell: float) -> None:
    """A line for each zone and place around which the map moved by more than a cell; zones and places stay.

    Args:
        known: zones and places.
        old: poses of the key scans before, shape (n, 3).
        new: of the same ones now, shape (n, 3).
        cell: side of a cell [m].
    """
    named = [(f"zone {zone.name or number}", zone.corners) for number, zone in enumerate(known.zones, 1)]
    named += [(f"place {name}", ((place.x_m, place.y_m),)) for name, place in known.places.items()]
    for name, points in named:
        moved = max(_moved(point, old, new) for point in points)
        if moved > cell:
            sys.stdout.write(f"{'notice':<12}{name}: the walls around it moved by {moved:.2f} m, it stays: check it\n")


def _moved(point: Sequence[float], old: Array, new: Array) -> float:
    """How far a point moved with the key scan that was nearest [m]."""
    nearest = int(np.hypot(*(old[:, :2] - point).T).argmin())
    at = compose(new[nearest], between(old[nearest], np.array([*point, 0.0])))
    return float(np.hypot(*(at[:2] - point)))
