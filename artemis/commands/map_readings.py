"""Readings for a map out of the recording of a run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.mapping.laser import Reading, ScannerPlace, surface_points
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.settings import MapSettings
from artemis.recording.mcap_reader import Recording
from artemis.scan import Scan

_KEPT = 150
"""Ticks whose odometry is kept: a scan comes later than it was measured, by less."""


def readings_of(run: Path, settings: MapSettings, scanner: str | None, mounting: ScannerPlace) -> Iterator[Reading]:
    """Scans of one scanner, each with the odometry at its middle, in the order in which they came.

    The bearings of a scan are corrected for the turn of the robot while it was measured.

    Args:
        run: folder of the run, or its recording.
        settings: which returns count.
        scanner: its name; None: there is only one.
        mounting: of the scanner.

    Raises:
        RecordingError: the recording cannot be read.
        ConfigError: it has no scans, or those of several scanners.
    """
    way: deque[tuple[float, Array]] = deque(maxlen=_KEPT)
    names: set[str] = set()
    found = False
    for tick in Recording(run).ticks():
        pose = tick.snapshot.odometry.pose
        way.append((tick.snapshot.time, np.array([pose.x, pose.y, pose.heading])))
        for scan in tick.snapshot.sensed.scans:
            names.add(scan.source)
            if scanner is None and len(names) > 1:
                raise ConfigError(f"{run}: scanners {', '.join(sorted(names))}: choose one with --scanner")
            if scanner in (None, scan.source):
                found = True
                yield _reading(scan, way, settings, mounting)
    if not found:
        there = f"; there are scans of {', '.join(sorted(names))}" if names else ""
        raise ConfigError(f"{run}: no scans{f' of {scanner!r}' if scanner else ''} were recorded{there}")


def _reading(scan: Scan, way: deque[tuple[float, Array]], settings: MapSettings, mounting: ScannerPlace) -> Reading:
    ranges = scan.millimetres * 1e-3
    lasting = scan.beam_time * max(0, len(ranges) - 1)
    begin, middle, end = (_at(way, scan.time + share * lasting) for share in (0.0, 0.5, 1.0))
    turned = float(between(begin, end)[2]) * (-1 if mounting.upside_down else 1)
    angles = scan.start_angle + scan.increment * np.arange(len(ranges))
    if len(ranges) > 1:
        angles = angles + turned * (np.arange(len(ranges)) / (len(ranges) - 1) - 0.5)
    points = surface_points(ranges, angles, settings, mounting)
    return Reading(time=scan.time + lasting / 2, odometry=middle, points=points)


def _at(way: deque[tuple[float, Array]], time: float) -> Array:
    """The odometry at a time, between two ticks; the nearest where there is none around."""
    later = way[-1]
    for earlier in reversed(way):
        if earlier[0] <= time:
            if later[0] <= earlier[0]:
                return earlier[1]
            share = min(1.0, (time - earlier[0]) / (later[0] - earlier[0]))
            return compose(earlier[1], share * between(earlier[1], later[1]))
        later = earlier
    return later[1]
