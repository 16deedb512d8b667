"""`artemis map build`: a map of the scans of runs or of logs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
from rich.progress import Progress

from artemis.commands.map_files import refuse_output, write_map
from artemis.commands.map_kept import keep_zones, painted, say_moved
from artemis.commands.map_readings import readings_of
from artemis.commands.map_zones import zones_of
from artemis.errors import ConfigError
from artemis.localisation.scan_localizer import LocalizerSettings, ScanLocalizer
from artemis.localisation.scan_map import ScanMap
from artemis.mapping.carmen import read_carmen
from artemis.mapping.graph_file import SUFFIX, MapGraph, read_graph
from artemis.mapping.kernels import COMPILED, notice
from artemis.mapping.laser import Reading
from artemis.mapping.map_file import read_map
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import coarser, occupancy
from artemis.mapping.se2 import Array, between, compose, within
from artemis.mapping.settings import MapSettings
from artemis.mapping.tracking import Tracker
from artemis.route_planning.zones import zones_file
from artemis.yaml_file import read

LOGS = (".clf", ".log")
_NEAR = (0.7, 0.2)
"""Standard deviations of where a run begins from where the one before ended [m, rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """What a map is made of."""

    runs: Sequence[Path]
    scanner: str | None
    odometry: bool
    begun: Path | None = None
    """A map to continue."""


def build_map(sources: Sources, output: Path, resolution: float, *, force: bool) -> None:
    """Make a map, and write it with its graph beside it.

    Args:
        sources: runs or logs.
        output: the YAML file.
        resolution: side of a cell [m].
        force: overwrite.

    Raises:
        ConfigError: a source cannot be read or has no scans, or the map cannot be written.
    """
    refuse_output(output, force)
    if not 0.005 <= resolution <= 1:
        raise ConfigError(f"--resolution {resolution:g}: expected 0.005 to 1 m")
    if not COMPILED:
        sys.stderr.write(f"{notice()}\n")
    settings = MapSettings()
    opened = [_readings(run, settings, sources) for run in sources.runs]
    begun = _begun(sources.begun, force)
    before = begun.keys.poses.copy() if begun is not None else np.empty((0, 3))
    mapper = _mapped(sources, opened, begun, settings)
    if not len(mapper.keys):
        raise ConfigError(f"{sources.runs[0]}: no scan has a point")
    mapper.finish()
    try:
        content = occupancy(mapper.keys, resolution)
    except ValueError as error:
        raise ConfigError(f"{output}: {error}") from None
    counts = mapper.counts
    sys.stdout.write(
        f"scans       {counts.scans}, {counts.unmatched} matched nowhere; {len(mapper.keys)} make up the map\n"
        f"loops       {len(mapper.graph.loops)} of {mapper.searched} places searched\n"
    )
    if note := coarser(content, resolution):
        sys.stdout.write(f"notice      {note}\n")
    write_map(output, content, mapper.result())
    if sources.begun is not None:
        beside = Path(zones_file(str(sources.begun)))
        keep_zones(sources.begun, output, read(beside) if beside.exists() else b"")
        say_moved(zones_of(output), before, mapper.keys.poses[: len(before)], content.resolution)
    elif (zones := Path(zones_file(str(output)))).exists():
        sys.stdout.write(f"notice      {zones} stays: its zones and places count on the new map\n")


def _begun(file: Path | None, force: bool) -> MapGraph | None:
    """The graph of the map that is continued; None: there is none.

    Raises:
        ConfigError: it has no graph, its files cannot be read, or, without `force`, what was painted would be lost.
    """
    if file is None:
        return None
    graph_file = file.with_suffix(SUFFIX)
    if not graph_file.exists():
        raise ConfigError(f"{graph_file}: no such file; a map is continued from its graph")
    graph = read_graph(graph_file)
    zones_of(file)
    if lost := painted(file, read_map(file), graph):
        if not force:
            raise ConfigError(f"{lost}; with --force it is continued, and what was edited is lost")
        sys.stdout.write(f"notice      {lost}\n")
    return graph


def _mapped(
    sources: Sources, opened: Sequence[Iterator[Reading]], begun: MapGraph | None, settings: MapSettings
) -> Mapper:
    """A map of all runs, or one continued, before its last pass; `opened`: the readings of each run."""
    mapper = Mapper(settings)
    with Progress(disable=not sys.stdout.isatty()) as progress:
        bar = progress.add_task("scans", total=None)
        for number, (run, readings) in enumerate(zip(sources.runs, opened, strict=True)):
            if number:
                readings = _another(mapper, run, readings, settings)
            elif begun is not None:
                mapper, readings = _gone_on(begun, sources.begun, run, readings, settings)
            for reading in readings:
                mapper.add(reading)
                progress.advance(bar)
    return mapper


def _gone_on(
    begun: MapGraph, file: Path | None, run: Path, readings: Iterator[Reading], settings: MapSettings
) -> tuple[Mapper, Iterator[Reading]]:
    """A mapper that continues the map `file` from where a run begins on it, and all readings of the run.

    Raises:
        ConfigError: the run is not found on it.
    """
    known = ScanMap.of_scans(begun.keys.points, begun.keys.poses, settings)
    begins, readings = _located(ScanLocalizer(known, LocalizerSettings(matching=settings)), readings, settings)
    if begins is None:
        raise ConfigError(
            f"{run}: its first scans fit nowhere on {file}, or in several places; begin the run where the map is known"
        )
    return Mapper(settings, begun=begun, start=begins.pose), readings


def _another(mapper: Mapper, run: Path, readings: Iterator[Reading], settings: MapSettings) -> Iterator[Reading]:
    """Have a mapper take another run: about where the one before ended, or anywhere on the map so far.

    Returns all readings of the run.

    Raises:
        ConfigError: it is not found there, or in several places.
    """
    if not len(mapper.keys):
        return readings
    mapper.solve()
    known, ended = ScanMap.of_scans(mapper.keys.points, mapper.keys.poses, settings), mapper.pose
    localizer = ScanLocalizer(known, LocalizerSettings(matching=settings), ended, _NEAR)
    begins, readings = _located(localizer, readings, settings)
    if begins is None:
        raise ConfigError(
            f"{run}: its first scans fit neither where the run before ended nor, for sure, elsewhere on the map so "
            "far; name the runs in an order in which each begins where those before have been, or build a map of each"
        )
    away = between(ended, begins.pose)
    if begins.rival is not None:
        both = f"its first scans fit {_place(begins.pose)}, near where the run before ended, and as well"
        if begins.fit < localizer.settings.well or not within(away, *_NEAR):
            raise ConfigError(
                f"{run}: {both} {_place(begins.rival)}; begin it where nothing looks alike, or build a map of each"
            )
        sys.stdout.write(f"notice      {run}: {both} {_place(begins.rival)}: did it begin there?\n")
    sys.stdout.write(f"run         {run}: begins {np.hypot(*away[:2]):.1f} m from where the one before ended\n")
    mapper.begin_run(begins.pose)
    return readings


def _place(pose: Array) -> str:
    x, y, heading = pose
    return f"x {x:.2f} m, y {y:.2f} m, heading {round(np.degrees(heading))} deg"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Beginning:
    """Where a run begins on a map."""

    pose: Array
    """Shape (3,)."""
    fit: float
    """How well its scans fit there, 0 to 1."""
    rival: Array | None
    """Where it may begin as well, if it was searched near a place; None: nowhere."""


def _located(
    localizer: ScanLocalizer, readings: Iterator[Reading], settings: MapSettings
) -> tuple[_Beginning | None, Iterator[Reading]]:
    """Where a run begins on a map, None: it is not found there; and all readings of the run.

    It begins where a scan fits, after that place was compared with all others.
    """
    tracker, seen, fit, compared = Tracker(settings), list[Reading](), 0.0, False
    for reading in readings:
        seen.append(reading)
        tracker.add(reading)
        if reading.points is None or len(reading.points) < settings.least_points:
            continue
        found = localizer.update(reading.points, reading.odometry)
        if found.lost:
            fit = 0.0
        elif found.measured is not None:
            fit = found.quality
        if (wanted := localizer.wanted()) is not None:
            localizer.take(wanted, localizer.look(wanted))
            compared = True
        if fit and compared:
            back, rival = between(tracker.pose, np.zeros(3)), localizer.rival
            begins = _Beginning(
                pose=compose(found.pose, back), fit=fit, rival=None if rival is None else compose(rival, back)
            )
            return begins, chain(seen, readings)
    return None, iter(seen)


def _readings(run: Path, settings: MapSettings, sources: Sources) -> Iterator[Reading]:
    """Those of a run or a log, which is opened at once."""
    is_log = run.with_suffix("").suffix in LOGS if run.suffix == ".gz" else run.suffix in LOGS
    if is_log:
        given = read_carmen(run, settings)
        given = chain(list(islice(given, 1)), given)
    else:
        given = readings_of(run, settings, sources.scanner)
    return given if sources.odometry else (replace(reading, odometry=None) for reading in given)
