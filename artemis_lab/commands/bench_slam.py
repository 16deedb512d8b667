"""`artemis bench slam`: a map of a public log against its verified relations, beside what others published."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from artemis.clock import cpu_time
from artemis.errors import ConfigError
from artemis.mapping import kernels
from artemis.mapping.carmen import read_carmen
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations
from artemis_lab.bench.relations import ErrorSize, errors, read_relations

PUBLISHED = {
    "scan matching": "0.220 +- 0.296",
    "GMapping, 50 particles": "0.070 +- 0.083",
    "graph mapping": "0.031 +- 0.026     1.3   +- 4.7",
    "Cartographer": "0.0229 +- 0.0239   0.453 +- 1.335",
    "Graph FLIRT": "0.02 +- 0.02       0.3   +- 0.3",
}
"""Intel Research Lab, translation [m] and rotation [deg], mean and standard deviation of the size.

The first three: R. Kuemmerle et al., Autonomous Robots 27(4), 2009; the others, and the rotation of the third: W. Hess
et al., Real-time loop closure in 2D LIDAR SLAM, ICRA 2016, tables I to III.
"""
COMPARED = {"GMapping, 30 particles": "0.0278 +- 0.021    1.10  +- 1.03"}
"""Likewise, of the map that the library of ROS 1 made of the whole log with its defaults, once in 66 s; its poses were
carried from scan to scan by the odometry, as ours are."""
_WARM_UP = 300
"""Readings that are mapped before the clock runs: compiling is not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogDrive:
    """How the log is driven."""

    backwards: bool = False
    odometry: bool = True
    scale: float = 1.0
    turn_deg_m: float = 0.0
    numba: bool = True
    noise: float = 0.0
    """Standard deviation of what is added to each distance [m]."""
    seed: int = 1
    """Of that."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Mapped:
    """A map of a log, and how far it is from the relations."""

    mapper: Mapper
    seconds: float
    """Of processor time."""
    metres: Array
    degrees: Array


def measure(log: Path, relations: Path, drive: LogDrive) -> None:
    """Make the map, and print the table.

    Raises:
        ConfigError: a file cannot be read, or no relation has poses near.
    """
    verified = read_relations(relations)
    if not drive.numba:
        kernels.use_numpy()
    made = mapped(log, relations, drive)
    mapper, metres = made.mapper, made.metres
    words = [
        f"{log.name}: {mapper.counts.scans} scans, {len(mapper.keys)} key scans, {len(mapper.graph.loops)} loops, "
        f"{mapper.counts.unmatched} scans matched nowhere",
        f"{made.seconds:.1f} s of processor time {'with' if kernels.COMPILED else 'without'} numba; "
        "reading and compiling not counted",
        f"relations: {len(metres)} of {len(verified.first)}",
        "",
        *_table("translation [m]", ErrorSize.of(metres)),
        *_table("rotation [deg]", ErrorSize.of(made.degrees)),
        "",
        "published for the Intel Research Lab  [m]                [deg]",
        *(f"  {name:<34}  {figures}" for name, figures in PUBLISHED.items()),
        "measured with the same relations",
        *(f"  {name:<34}  {figures}" for name, figures in COMPARED.items()),
        "",
    ]
    sys.stdout.write("\n".join(words))


def mapped(log: Path, relations: Path, drive: LogDrive) -> Mapped:
    """Make the map of a log that is driven so.

    Relations also name instants of which the log has no scan. Without odometry a map has no pose there: the log's own
    odometry carries its poses from scan to scan, as those of other programs that are compared in this way.

    Raises:
        ConfigError: a file cannot be read, or no relation has poses near.
    """
    log_readings = list(read_carmen(log, MapSettings()))
    readings = list(_driven(log_readings, drive))
    if not readings:
        raise ConfigError(f"{log}: no scans")
    _mapped(readings[:_WARM_UP])
    begin = cpu_time()
    mapper, times, poses = _mapped(readings)
    seconds = cpu_time() - begin
    if not drive.odometry:
        poses = poses[::-1] if drive.backwards else poses
        times, poses = _along(log_readings, poses)
    metres, degrees = errors(read_relations(relations), times, poses)
    if not len(metres):
        raise ConfigError(f"{relations}: no relation of this log")
    return Mapped(mapper=mapper, seconds=seconds, metres=metres, degrees=degrees)


def _along(readings: Iterable[Reading], poses: Array) -> tuple[Array, Array]:
    """Times and poses of all readings of a log from those of its scans, shape (n, 3)."""
    stations, number = Stations(), 0
    for reading in readings:
        if reading.points is None:
            stations.pass_by(reading.time, reading.odometry)
        else:
            stations.stop(reading, 0, poses[number])
            number += 1
    return stations.trajectory(poses)


def _table(name: str, size: ErrorSize) -> Iterable[str]:
    yield f"{name:<16} {size.mean:.4f} +- {size.std:.4f}, median {size.median:.4f}, largest {size.max:.3f}"
    yield f"{'':<16} squared {size.square_mean:.4f} +- {size.square_std:.4f}"


def _mapped(readings: Iterable[Reading]) -> tuple[Mapper, Array, Array]:
    mapper = Mapper()
    for reading in readings:
        mapper.add(reading)
    mapper.finish()
    return mapper, *mapper.trajectory()


def _driven(readings: list[Reading], drive: LogDrive) -> Iterator[Reading]:
    """The readings as the robot would have given them on another drive."""
    if drive.backwards:
        readings = readings[::-1]
    if drive.noise > 0:
        readings = list(_shaken(readings, drive.noise, drive.seed))
    pose, last = np.zeros(3), None
    for reading in readings:
        if not drive.odometry:
            if reading.points is not None:
                yield replace(reading, odometry=None)
            continue
        if reading.odometry is not None:
            if last is not None:
                step = between(last, reading.odometry)
                turn = np.radians(drive.turn_deg_m) * np.hypot(step[0], step[1])
                pose = compose(pose, [drive.scale * step[0], drive.scale * step[1], step[2] + turn])
            last = reading.odometry
            yield replace(reading, odometry=pose)


def _shaken(readings: Iterable[Reading], noise: float, seed: int) -> Iterator[Reading]:
    """With noise [m] along each beam."""
    dice = np.random.default_rng(seed)
    for reading in readings:
        if reading.points is None:
            yield reading
            continue
        points = reading.points.copy()
        distance = np.hypot(points[:, 0], points[:, 1])
        points[:, :2] *= (1 + dice.normal(0, noise, len(points)) / distance)[:, None]
        yield replace(reading, points=points)
