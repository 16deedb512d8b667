"""`artemis bench localisation`: a robot on the first part of a log, on the map of the rest of it."""

from __future__ import annotations

import asyncio
import sys
from itertools import compress
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.localisation.scan_localizer import ScanLocalizer
from artemis.localisation.scan_map import ScanMap
from artemis.mapping import kernels
from artemis.mapping.carmen import read_carmen
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import occupancy
from artemis.mapping.se2 import Array, between
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations
from artemis_lab.bench.relations import errors, read_relations

_STARTS = (5.0, 200.0, 400.0, 600.0, 800.0)
"""Times [s of the log] at which a robot that knows nothing is switched on; it has `_PATIENCE` [s]."""
_PATIENCE, _RIGHT = 60.0, 0.3
"""A found robot is right within so many metres."""


def measure(log: Path, relations: Path, split: float, *, cells: bool) -> None:
    """Map the log, keep what was seen after `split` [s], and localise what was seen before on it.

    Args:
        log: CARMEN log.
        relations: verified motions.
        split: time between both parts, from the beginning [s].
        cells: the map is an image with cells of 5 cm; else the key scans themselves.

    Raises:
        ConfigError: a file cannot be read, or a part is empty.
    """
    verified, settings = read_relations(relations), MapSettings()
    readings = list(read_carmen(log, settings))
    mapper = Mapper(settings)
    for reading in readings:
        mapper.add(reading)
    mapper.finish()
    times, poses = mapper.trajectory()
    later = [readings[number].time - times[0] > split for number in mapper.key_readings]
    scans = list(compress(mapper.keys.points, later))
    first = [n for n, each in enumerate(readings) if each.points is not None and each.time - times[0] < split]
    if not scans or not first:
        raise ConfigError(f"--split {split:g}: one of the parts is empty")
    of = mapper.keys.poses[later]
    known = ScanMap.of_cells(occupancy(scans, of), settings) if cells else ScanMap.of_scans(scans, of, settings)
    _driven(known, [readings[n] for n in first[:50]], poses[first[0]])  # compiles
    found, doubts, seconds = _driven(known, [readings[n] for n in first], poses[first[0]])
    way = Stations()  # between the scans the odometry tells the way
    for reading in readings[: first[-1] + 1]:
        if reading.points is None:
            way.pass_by(reading.time, reading.odometry)
        else:
            way.stop(reading, 0, found[0])
    metres, degrees = errors(verified, *way.trajectory(found))
    off = between(poses[first], found)
    away = np.hypot(off[:, 0], off[:, 1])
    quantiles = np.quantile(1e3 * seconds, (0.5, 0.99, 1.0))
    sys.stdout.write(
        f"{len(first)} scans on a map of {len(scans)} key scans, {'cells of 5 cm' if cells else 'as points'}, "
        f"{'with' if kernels.COMPILED else 'without'} numba\n"
        f"lost        {int((doubts >= 1).sum())} scans\n"
        f"relations   {len(metres)}: {metres.mean():.4f} m, {degrees.mean():.3f} deg\n"
        f"distance    mean {away.mean():.4f}, 95 % {np.quantile(away, 0.95):.4f}, largest {away.max():.3f} m\n"
        f"one scan    half of them {quantiles[0]:.1f}, 99 % {quantiles[1]:.1f}, slowest {quantiles[2]:.1f} ms\n"
    )
    for start in _STARTS:
        rest = [n for n in first if start <= readings[n].time - times[0] < start + _PATIENCE]
        if rest:
            _say_found(known, [readings[n] for n in rest], poses[rest], start)


def _say_found(known: ScanMap, readings: list[Reading], true: Array, start: float) -> None:
    found, doubts, seconds = _driven(known, readings, None)
    sure = np.flatnonzero(doubts < 1)
    words = "not found"
    if len(sure):
        after = readings[int(sure[0])].time - readings[0].time
        off = between(true[sure[0]], found[sure[0]])
        away = float(np.hypot(off[0], off[1]))
        words = f"found after {after:.1f} s, {'right' if away < _RIGHT else 'WRONG'} ({away:.3f} m off)"
    sys.stdout.write(f"from {start:<6g} {words}; slowest search {seconds.max():.1f} s\n")


def _driven(known: ScanMap, readings: list[Reading], start: Array | None) -> tuple[Array, Array, Array]:
    """Pose, doubt and time of computing [s] of every scan."""
    localizer, clock = ScanLocalizer(known, start=start), asyncio.new_event_loop()
    poses, doubts, seconds = [], [], []
    for reading in readings:
        begin = clock.time()
        found = localizer.update(reading.points if reading.points is not None else np.empty((0, 4)), reading.odometry)
        seconds.append(clock.time() - begin)
        poses.append(found.pose)
        doubts.append(found.doubt)
    clock.close()
    return np.array(poses), np.array(doubts), np.array(seconds)
