"""`artemis map edit`: a map with loops taken back, rotated, cropped, with zones to keep out of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from artemis.commands.map_files import numbers, refuse_output, write_map
from artemis.errors import ConfigError
from artemis.mapping.final_pass import matched_again
from artemis.mapping.graph_file import SUFFIX, MapGraph, read_graph
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OccupancyMap, occupancy
from artemis.mapping.se2 import between, compose
from artemis.mapping.settings import MapSettings

_ROUNDS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Edits:
    """What is to be done, in this order."""

    loops: Sequence[int]
    rotate: float
    """[deg]."""
    crop: str | None
    no_go: Sequence[str]


def edit_map(file: Path, output: Path, edits: Edits, *, force: bool) -> None:
    """Write a corrected map.

    Raises:
        ConfigError: it cannot be read or written, or an edit is not possible.
    """
    refuse_output(output, force)
    content, beside = read_map(file), file.with_suffix(SUFFIX)
    graph = read_graph(beside) if beside.exists() else None
    if edits.loops:
        if graph is None:
            raise ConfigError(f"{beside}: no such file; loops are taken back in the graph of a map")
        _undo(graph, edits.loops, beside)
        content = occupancy(graph.keys.points, graph.keys.poses, content.resolution)
    if edits.rotate:
        content = content.rotated(math.radians(edits.rotate))
        if graph is not None:
            graph.turned(math.radians(edits.rotate))
    if edits.crop is not None:
        content = _cropped(content, edits.crop)
    for zone in edits.no_go:
        corners = numbers(zone, "--no-go", 6, 2)
        content = content.closed(list(zip(corners[::2], corners[1::2], strict=True)))
    write_map(output, content, graph)


def _cropped(content: OccupancyMap, text: str) -> OccupancyMap:
    ax, ay, bx, by = numbers(text, "--crop", 4, 4)[:4]
    try:
        return content.cropped((min(ax, bx), min(ay, by)), (max(ax, bx), max(ay, by)))
    except ValueError as error:
        raise ConfigError(f"--crop {text}: {error}") from None


def _undo(graph: MapGraph, loops: Sequence[int], source: Path) -> None:
    """Take loops back, and move key scans and trajectory accordingly."""
    unknown = [number for number in loops if number not in graph.graph.loops]
    if unknown:
        raise ConfigError(f"{source}: no loop {', '.join(map(str, unknown))}; `artemis map show` lists them")
    for number in dict.fromkeys(loops):
        graph.graph.remove(number)
    settings, old = MapSettings(), graph.keys.poses.copy()
    graph.keys.poses = graph.graph.solve(old, _ROUNDS, settings.cauchy_loop, settings.cauchy_step)
    graph.keys.poses = matched_again(settings, graph.keys, graph.graph, LikelihoodGrid(settings))
    for pose in graph.trajectory:
        off = between(old, pose[1:])
        nearest = int((off[:, 0] ** 2 + off[:, 1] ** 2 + off[:, 2] ** 2).argmin())
        pose[1:] = compose(graph.keys.poses[nearest], off[nearest])
