"""`artemis map show`: what is true of a map, of its loops, and a figure of it all."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.mapping.graph_file import SUFFIX, MapGraph, read_graph
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import FREE, OCCUPIED, OccupancyMap
from artemis.mapping.se2 import between, wrapped

_SHOWN = 10
"""Loops that fit worst."""


def show_map(file: Path, figure: Path | None) -> None:
    """Print facts of a map and of its graph, and draw them.

    Raises:
        ConfigError: a file cannot be read, the figure cannot be written.
    """
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"{figure}: no figure can be drawn as that: name it .png, .svg or .pdf")
    content = read_map(file)
    rows, columns = content.cells.shape
    size = f"{columns * content.resolution:.1f} x {rows * content.resolution:.1f} m"
    free, occupied = (float((content.cells == value).mean()) for value in (FREE, OCCUPIED))
    _row("map", f"{file}: {size}, cells of {content.resolution:g} m")
    _row("cells", f"{free:.1%} free, {occupied:.1%} occupied")
    beside = file.with_suffix(SUFFIX)
    graph = read_graph(beside) if beside.exists() else None
    if graph is None:
        _row("graph", f"none: there is no {beside.name}")
    else:
        _say(graph)
    if figure is not None:
        _draw(content, graph, figure)


def _say(graph: MapGraph) -> None:
    keys, loops = graph.keys, graph.graph.loops
    moved = between(graph.trajectory[:-1, 1:], graph.trajectory[1:, 1:])
    _row("driven", f"{float(np.hypot(moved[:, 0], moved[:, 1]).sum()):.1f} m, {len(graph.trajectory)} poses")
    _row("graph", f"{len(keys)} key scans, {len(loops)} loops")
    deviations = graph.graph.deviations(keys.poses)
    worst = sorted(loops, key=lambda number: -deviations[number])[:_SHOWN]
    for number in worst:
        link = loops[number]
        off = between(between(keys.poses[link.first], keys.poses[link.second]), link.motion)
        place = keys.poses[link.second]
        distance, turn = math.hypot(off[0], off[1]), math.degrees(abs(float(wrapped(off[2]))))
        at = f"x {place[0]:.1f} m, y {place[1]:.1f} m"
        _row("loop", f"{number}: off {1000 * distance:.0f} mm, {turn:.2f} deg, {deviations[number]:.1f} std, at {at}")


def _row(name: str, words: str) -> None:
    sys.stdout.write(f"{name:<12}{words}\n")


def _draw(content: OccupancyMap, graph: MapGraph | None, figure: Path) -> None:
    from artemis.report.figures import style
    from artemis.report.map_figure import map_figure

    try:
        with style():
            map_figure(content, graph).savefig(figure, facecolor="white", dpi=150)
    except OSError as error:
        raise ConfigError(f"{figure}: cannot be written: {error.strerror}") from error
    _row("figure", str(figure))
