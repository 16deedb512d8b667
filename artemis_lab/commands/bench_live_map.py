"""`artemis bench live-map`: how long a scan takes while a map is made, with the search for loops beside it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from threading import Event

import numpy as np

from artemis.clock import stopwatch
from artemis.localisation.scan_localizer import ScanLocalizer
from artemis.localisation.scan_map import ScanMap
from artemis.localisation.warming import warm_up
from artemis.mapping import kernels
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.tracking import NewKey
from artemis.plugins.observing import Beside
from artemis_lab.bench import laser_worlds
from artemis_lab.bench.buildings import BLOCK, CORRIDOR, WIDE, building_walls
from artemis_lab.bench.laser_worlds import SETTINGS, driven, odometry
from artemis_lab.bench.tables import times_in_words

BEAMS, FIELD, PERIOD = 541, np.radians(135.0), 0.02
"""Of an LMS100 at 50 Hz [rad, s]."""
SPEED, TURN = 1.5, 1.0
"""Of the robot [m/s, rad/s]."""
NEVER = Event()
"""Nothing sets it."""
LONGEST, LONGEST_ON_MAP = 20.0, 10.0
"""99 % of the scans are to take no longer, where a map is made and where the robot is localised on it [ms]."""


def measure(seconds: float, wait: Callable[[float], object] = NEVER.wait) -> int:
    """Map in real time, then localise on the map; print how long the scans took; 1: longer than they may.

    A robot drives round a block of a building of equal corridors, 3 % of its distance and 0.5 degrees per metre wrong.
    `wait` does so until the next scan [s].
    """
    if not kernels.COMPILED:
        sys.stderr.write(f"{kernels.notice()}\n")
    warm_up()
    given = readings(seconds)
    searches: list[float] = []
    broken: list[BaseException] = []
    beside: Beside[None] = Beside("loops", lambda nothing: None, threaded=True, failed=broken.append)
    mapper = Mapper(SETTINGS, later=lambda work, key: beside.order(_timed, work, key, searches))
    taken = _fed(mapper, given, wait)
    begin = stopwatch()
    beside.close()
    late = stopwatch() - begin
    if broken:
        raise broken[0]
    mapper.finish()
    on_map = _localised(mapper, given)
    sys.stdout.write(
        f"{len(given)} scans of {BEAMS} beams, {1 / PERIOD:.0f} a second, {'with' if kernels.COMPILED else 'without'} "
        f"numba: {len(mapper.keys)} key scans, {len(mapper.graph.loops)} loops\n"
        f"one scan   {_words(taken, LONGEST)}\n"
        f"loops      slowest search {1e3 * max(searches):.0f} ms, in all {sum(searches):.1f} s of {seconds:g} s; "
        f"done {late:.1f} s after the last scan\n"
        f"on the map {_words(on_map, LONGEST_ON_MAP)}\n"
    )
    return int(_most(taken) > LONGEST or _most(on_map) > LONGEST_ON_MAP)


def readings(seconds: float) -> list[Reading]:
    """What the robot sees and counts, one every `PERIOD`."""
    low, right, high = CORRIDOR / 2, CORRIDOR * 1.5 + BLOCK, WIDE - CORRIDOR / 2
    corners = [(low, low), (right, low), (right, high), (low, high)]
    rounds = 2 + int(seconds * SPEED / (2 * (right + high)))
    poses = driven([*corners * rounds, corners[0]], step=SPEED * PERIOD, turn=TURN * PERIOD)[: round(seconds / PERIOD)]
    counted = odometry(poses, [1.03] * (len(poses) - 1), np.radians(0.5))
    angles = np.linspace(-FIELD, FIELD, BEAMS)
    return laser_worlds.readings(building_walls(), poses, counted, 0.012, angles=angles, farthest=20.0, period=PERIOD)


def _fed(mapper: Mapper, given: Sequence[Reading], wait: Callable[[float], object]) -> list[float]:
    """How long each reading took [s], each at its time."""
    begin, taken = stopwatch(), []
    for reading in given:
        wait(max(0.0, begin + reading.time - stopwatch()))
        start = stopwatch()
        mapper.add(reading)
        taken.append(stopwatch() - start)
    return taken


def _timed(work: Callable[[NewKey], None], key: NewKey, searches: list[float]) -> None:
    begin = stopwatch()
    work(key)
    searches.append(stopwatch() - begin)


def _localised(mapper: Mapper, given: Sequence[Reading]) -> list[float]:
    """How long each reading takes on the finished map [s]."""
    known = ScanMap.of_scans(mapper.keys.points, mapper.keys.poses, SETTINGS)
    localizer, taken = ScanLocalizer(known, start=mapper.keys.poses[0]), []
    for reading in given:
        assert reading.points is not None
        start = stopwatch()
        localizer.update(reading.points, reading.odometry)
        taken.append(stopwatch() - start)
    return taken


def _most(taken: Sequence[float]) -> float:
    return 1e3 * float(np.quantile(taken, 0.99))


def _words(taken: Sequence[float], bar: float) -> str:
    return f"{times_in_words(1e3 * np.array(taken))} (bar for 99 %: {bar:g} ms)"
