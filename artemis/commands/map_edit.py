"""`artemis map edit`: a map with loops taken back, rotated, cropped, with zones to keep out of."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from artemis.commands.map_files import numbers, refuse_output, write_map
from artemis.commands.map_kept import keep_zones, painted, say_moved
from artemis.commands.map_zones import ZoneEdits, edit_zones, edited_zones, turned_zones, zones_of
from artemis.errors import ConfigError
from artemis.mapping.final_pass import matched_again
from artemis.mapping.graph_file import SUFFIX, MapGraph, read_graph
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OccupancyMap, coarser, occupancy
from artemis.mapping.settings import MapSettings
from artemis.route_planning.zones import zones_file
from artemis.yaml_file import read

_ROUNDS = 20
_FARTHEST = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class Edits:
    """What is to be done, in this order."""

    loops: Sequence[int]
    rotate: float
    """[deg]."""
    crop: str | None
    no_go: Sequence[str]
    zones: ZoneEdits = field(default_factory=ZoneEdits)

    def __bool__(self) -> bool:
        return bool(self.loops or self.rotate or self.crop or self.no_go)


def edit_map(file: Path, output: Path | None, edits: Edits, *, force: bool) -> None:
    """Write a corrected map with its zones and places; without an output only these are changed, beside the map.

    Raises:
        ConfigError: it cannot be read or written, or an edit is not possible.
    """
    if output is None:
        if edits:
            raise ConfigError("--output MAP: name the corrected map; only zones and places are changed in place")
        if not edits.zones:
            raise ConfigError(f"{file}: nothing to be done; `artemis map edit --help` lists what can be")
        edit_zones(file, edits.zones, read_map(file))
        return
    if not math.isfinite(edits.rotate) or abs(edits.rotate) > 360.0:
        raise ConfigError(f"--rotate {edits.rotate:g}: expected degrees from -360 to 360")
    refuse_output(output, force)
    zones = edited_zones(_zones(file, edits.rotate), zones_file(str(output)), edits.zones)
    _edit_cells(file, output, edits)
    keep_zones(file, output, zones)


def _zones(file: Path, rotate: float) -> bytes:
    """The file of zones and places as it will be beside the output."""
    beside = Path(zones_file(str(file)))
    if not beside.exists():
        return b""
    content = read(beside)
    return turned_zones(content, str(beside), math.radians(rotate)) if rotate else content


def _edit_cells(file: Path, output: Path, edits: Edits) -> None:
    content, beside = read_map(file), file.with_suffix(SUFFIX)
    graph, wanted = read_graph(beside) if beside.exists() else None, content.resolution
    if edits.loops:
        if graph is None:
            raise ConfigError(f"{beside}: no such file; loops are taken back in the graph of a map")
        if lost := painted(file, content, graph):
            sys.stdout.write(f"{'notice':<12}{lost}\n")
        before = graph.keys.poses.copy()
        _undo(graph, edits.loops, beside)
        say_moved(zones_of(file), before, graph.keys.poses, content.resolution)
        content = occupancy(graph.keys, content.resolution)
    if edits.rotate:
        content = _turned(file, content, graph, edits.rotate)
    if edits.crop is not None:
        content = _cropped(content, edits.crop)
    for zone in edits.no_go:
        content = _closed(content, zone)
    if note := coarser(content, wanted):
        sys.stdout.write(f"{'notice':<12}{note}\n")
    write_map(output, content, graph)


def _turned(file: Path, content: OccupancyMap, graph: MapGraph | None, degrees: float) -> OccupancyMap:
    """The map `file` and its graph turned; one that is as its graph draws it is drawn again."""
    turn = math.radians(degrees)
    as_drawn = graph is not None and not painted(file, content, graph)
    if graph is not None:
        graph.turned(turn)
    try:
        if graph is not None and as_drawn:
            return occupancy(graph.keys, content.resolution)
        return content.rotated(turn)
    except ValueError as error:
        raise ConfigError(f"--rotate {degrees:g}: {error}") from None


def _cropped(content: OccupancyMap, text: str) -> OccupancyMap:
    ax, ay, bx, by = _coordinates(text, "--crop", 4)
    if ax == bx or ay == by:
        raise ConfigError(f"--crop {text}: expected two opposite corners X,Y,X,Y")
    try:
        return content.cropped((min(ax, bx), min(ay, by)), (max(ax, bx), max(ay, by)))
    except ValueError as error:
        raise ConfigError(f"--crop {text}: {error}") from None


def _coordinates(text: str, option: str, count: int, *, more: bool = False) -> list[float]:
    """As `numbers`, none farther than maps are [m]."""
    found = numbers(text, option, count, more=more)
    for each in found:
        if abs(each) > _FARTHEST:
            raise ConfigError(f"{option} {text}: {each:g} is farther than {_FARTHEST:g} m")
    return found


def _closed(content: OccupancyMap, text: str) -> OccupancyMap:
    corners = _coordinates(text, "--no-go", 6, more=True)
    try:
        return content.closed(list(zip(corners[::2], corners[1::2], strict=True)))
    except ValueError as error:
        raise ConfigError(f"--no-go {text}: {error}") from None


def _undo(graph: MapGraph, loops: Sequence[int], source: Path) -> None:
    """Take loops back, and move key scans and trajectory accordingly."""
    unknown = [number for number in loops if number not in graph.graph.loops]
    if unknown:
        raise ConfigError(f"{source}: no loop {', '.join(map(str, unknown))}; `artemis map show` lists them")
    for number in dict.fromkeys(loops):
        graph.graph.remove(number)
    settings, trajectory = MapSettings(), graph.nearest_keys()
    graph.keys.poses = graph.graph.solve(graph.keys.poses, _ROUNDS, settings.cauchy_loop, settings.cauchy_step)
    graph.keys.poses = matched_again(settings, graph.keys, graph.graph, LikelihoodGrid(settings))
    graph.trajectory[:, 1:] = trajectory.poses(graph.keys.poses)
