"""`artemis map build`: a map of the scans of runs or of logs."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.progress import Progress

from artemis.commands.map_files import numbers, refuse_output, write_map
from artemis.commands.map_readings import readings_of
from artemis.errors import ConfigError
from artemis.mapping.carmen import read_carmen
from artemis.mapping.graph_file import MapGraph
from artemis.mapping.kernels import COMPILED, NOTICE
from artemis.mapping.laser import Reading, ScannerPlace
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import occupancy

LOGS = (".clf", ".log")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """What a map is made of."""

    runs: Sequence[Path]
    scanner: str | None
    mounting: str
    upside_down: bool
    odometry: bool


def build_map(sources: Sources, output: Path, resolution: float, *, force: bool) -> None:
    """Make a map, and write it with its graph beside it.

    Args:
        sources: runs or logs, and how their scanner is mounted.
        output: the YAML file.
        resolution: side of a cell [m].
        force: overwrite.

    Raises:
        ConfigError: a source cannot be read or has no scans, or the map cannot be written.
    """
    refuse_output(output, force)
    if not 0.005 <= resolution <= 1:
        raise ConfigError(f"--resolution {resolution:g}: expected 0.005 to 1 m")
    x, y, degrees = numbers(sources.mounting, "--mounting", 3, 3)[:3]
    mounting = ScannerPlace(x=x, y=y, heading=math.radians(degrees), upside_down=sources.upside_down)
    if not COMPILED:
        sys.stderr.write(f"{NOTICE}\n")
    mapper = Mapper()
    with Progress(disable=not sys.stdout.isatty()) as progress:
        bar = progress.add_task("scans", total=None)
        for number, run in enumerate(sources.runs):
            if number:
                mapper.begin_run()
            for reading in _readings(run, mapper, sources, mounting):
                mapper.add(reading)
                progress.advance(bar)
    if not len(mapper.keys):
        raise ConfigError(f"{sources.runs[0]}: no scan has a point")
    mapper.finish()
    times, poses = mapper.trajectory()
    try:
        content = occupancy(mapper.keys.points, mapper.keys.poses, resolution)
    except ValueError as error:
        raise ConfigError(f"{output}: {error}") from None
    counts = mapper.counts
    sys.stdout.write(
        f"scans       {counts.scans}, {counts.unmatched} matched nowhere; {len(mapper.keys)} make up the map\n"
        f"loops       {len(mapper.graph.loops)} of {mapper.searched} places searched\n"
    )
    write_map(output, content, MapGraph(mapper.keys, mapper.graph, np.c_[times, poses]))


def _readings(run: Path, mapper: Mapper, sources: Sources, mounting: ScannerPlace) -> Iterator[Reading]:
    is_log = run.with_suffix("").suffix in LOGS if run.suffix == ".gz" else run.suffix in LOGS
    if is_log:
        given = read_carmen(run, mapper.settings)
    else:
        given = readings_of(run, mapper.settings, sources.scanner, mounting)
    return given if sources.odometry else (replace(reading, odometry=None) for reading in given)
