"""`artemis bench localisation`: a robot on the first part of a log, on the map of the rest of it."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from artemis.clock import cpu_time
from artemis.errors import ConfigError
from artemis.localisation.scan_localizer import PlaceSearch, ScanLocalizer, ScanPose
from artemis.localisation.scan_map import ScanMap, common_covariance
from artemis.mapping import kernels
from artemis.mapping.carmen import read_carmen
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.likelihood import Match
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import occupancy
from artemis.mapping.se2 import Array, between
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations
from artemis_lab.bench.relations import errors, read_relations
from artemis_lab.bench.tables import times_in_words

_STARTS = (5.0, 200.0, 400.0, 600.0, 800.0)
"""Times [s of the log] at which a robot that knows nothing is switched on; it has `_PATIENCE` [s]."""
_PATIENCE, RIGHT = 60.0, 0.3
"""A found robot is right within so many metres."""
_CELL = 0.05
"""Of the map, or of the points that are made one [m]."""
_ELLIPSE = 5.99
"""Square of 2.45 standard deviations: chi-square with two degrees of freedom, 0.95."""
COMPARED = "0.0345 m, 0.92 deg; distance mean 0.114, 95 % 0.247, largest 0.58 m"
"""AMCL, the library of ROS 1, on a map with cells of 5 cm: `likelihood_field_prob`, 60 beams, 500 to 5,000 particles,
resampled at each update. With its defaults it lost the robot after some 300 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundAgain:
    """A robot that was switched on without any knowledge."""

    start: float
    after: float | None
    """[s]; None: it was not found."""
    off: float
    """[m]."""
    searches: list[float]
    """Processor time of each [s]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Localised:
    """A robot on the first part of a log, on the map of the rest."""

    scans: int
    keys: int
    """Key scans that make up the map."""
    lost: int
    metres: Array
    degrees: Array
    """Of the relations."""
    map_degrees: float
    """Mean error of the same relations by the map's own poses."""
    away: Array
    """Distance of each scan from the map's own pose [m]."""
    inside: float
    """Share of the matched scans within the ellipse that should hold 95 %."""
    milliseconds: Array
    found: list[FoundAgain]


def measure(log: Path, relations: Path, split: float, *, cells: bool) -> None:
    """Localise, and print the figures.

    Args:
        log: CARMEN log.
        relations: verified motions.
        split: time between both parts, from the beginning [s].
        cells: the map is an image with cells of 5 cm; else the key scans themselves.

    Raises:
        ConfigError: a file cannot be read, or a part is empty.
    """
    found = localised(log, relations, split, cells=cells)
    away = found.away
    sys.stdout.write(
        f"{found.scans} scans on a map of {found.keys} key scans, {'cells of 5 cm' if cells else 'as points'}, "
        f"{'with' if kernels.COMPILED else 'without'} numba\n"
        f"lost        {found.lost} scans\n"
        f"relations   {len(found.metres)}: {found.metres.mean():.4f} m, {found.degrees.mean():.3f} deg "
        f"(the map's own poses: {found.map_degrees:.3f} deg)\n"
        f"distance    mean {away.mean():.4f}, 95 % {np.quantile(away, 0.95):.4f}, largest {away.max():.3f} m\n"
        f"stated      {100 * found.inside:.1f} % within the ellipse for 95 %\n"
        f"one scan    {times_in_words(found.milliseconds)}\n"
        f"AMCL        {COMPARED}\n"
    )
    for each in found.found:
        words = "not found"
        if each.after is not None:
            verdict = "right" if each.off < RIGHT else "WRONG"
            words = f"found after {each.after:.1f} s, the last search took {each.searches[-1]:.1f} s, {verdict} "
            words += f"({each.off:.3f} m off)"
        sys.stdout.write(f"from {each.start:<6g} {words}; {len(each.searches)} searches\n")


def localised(log: Path, relations: Path, split: float, *, cells: bool, at_once: bool = False) -> Localised:
    """Map the log, keep what was seen after `split` [s], and localise what was seen before on it; as `measure`.

    A robot that knows nothing is found when its search is done on this computer, or `at_once`, as fast computers do.
    """
    verified, settings = read_relations(relations), MapSettings()
    readings = list(read_carmen(log, settings))
    mapper = Mapper(settings)
    for reading in readings:
        mapper.add(reading)
    mapper.finish()
    times, poses = mapper.trajectory()
    keys = KeyScans()
    for key, number in enumerate(mapper.key_readings):
        if readings[number].time - times[0] > split:
            keys.append(mapper.keys.points[key], mapper.keys.poses[key], mapper.keys.places[key])
    first = [n for n, each in enumerate(readings) if each.points is not None and each.time - times[0] < split]
    if not len(keys) or not first:
        raise ConfigError(f"--split {split:g}: one of the parts is empty")
    if cells:
        known = ScanMap.of_cells(occupancy(keys, _CELL), settings)
    else:
        known = ScanMap.of_scans(keys.points, keys.poses, settings)
    _driven(known, [readings[n] for n in first[:50]], poses[first[0]])  # compiles
    found, seconds, _ = _driven(known, [readings[n] for n in first], poses[first[0]])
    at = np.array([each.pose for each in found])
    stations = Stations()  # between the scans the poses follow the odometry
    for reading in readings[: first[-1] + 1]:
        if reading.points is None:
            stations.pass_by(reading.time, reading.odometry)
        else:
            stations.stop(reading, 0, at[0])
    until = verified.until(max(readings[n].time for n in first))
    metres, degrees = errors(until, *stations.trajectory(at))
    off = at - poses[first]
    rests = [
        (start, [n for n in first if start <= readings[n].time - times[0] < start + _PATIENCE]) for start in _STARTS
    ]
    return Localised(
        scans=len(first),
        keys=len(keys),
        lost=sum(each.doubt >= 1 for each in found),
        metres=metres,
        degrees=degrees,
        map_degrees=float(errors(until, times, poses)[1].mean()),
        away=np.hypot(off[:, 0], off[:, 1]),
        inside=_inside(off[:, :2], found),
        milliseconds=1e3 * seconds,
        found=[
            _found_again(known, [readings[n] for n in rest], poses[rest], start, at_once=at_once)
            for start, rest in rests
            if rest
        ],
    )


def _inside(off: Array, found: list[ScanPose]) -> float:
    """Share of the errors, shape (n, 2), within the ellipse that holds 95 % of a normal distribution."""
    common, _ = common_covariance(_CELL)
    stated = [each for each in zip(off, found, strict=True) if each[1].measured is not None]
    errors_in = np.array([error for error, _ in stated])
    own = [each.measured[:2, :2] for _, each in stated if each.measured is not None]
    square = np.einsum("ni,nij,nj->n", errors_in, np.linalg.inv(np.array(own) + common * np.eye(2)), errors_in)
    return float((square < _ELLIPSE).mean())


def _found_again(known: ScanMap, readings: list[Reading], true: Array, start: float, *, at_once: bool) -> FoundAgain:
    found, _, searches = _driven(known, readings, None, at_once=at_once)
    sure = [number for number, each in enumerate(found) if each.doubt < 1]
    if not sure:
        return FoundAgain(start=start, after=None, off=np.inf, searches=searches)
    off = between(true[sure[0]], found[sure[0]].pose)
    after = readings[sure[0]].time - readings[0].time
    return FoundAgain(start=start, after=after, off=float(np.hypot(off[0], off[1])), searches=searches)


def _driven(
    known: ScanMap, readings: list[Reading], start: Array | None, *, at_once: bool = True
) -> tuple[list[ScanPose], Array, list[float]]:
    """What was found by every scan, the time of computing [s]; and that of every search.

    Searches are done `at_once`, or the robot goes on until they would be done, as in a run.
    """
    localizer = ScanLocalizer(known, start=start)
    poses, seconds, searches = [], [], []
    done: tuple[float, PlaceSearch, Match | None] | None = None
    """The search under way: when it is done [s], what is looked for, and what it will find."""
    for reading in readings:
        if done is not None and reading.time >= done[0]:
            localizer.take(*done[1:])
            done = None
        begin = cpu_time()
        found = localizer.update(reading.points if reading.points is not None else np.empty((0, 4)), reading.odometry)
        seconds.append(cpu_time() - begin)
        if (wanted := localizer.wanted()) is not None:
            begin = cpu_time()
            place = localizer.look(wanted)
            searches.append(cpu_time() - begin)
            done = -inf if at_once else reading.time + searches[-1], wanted, place
        poses.append(found)
    return poses, np.array(seconds), searches
