"""Readings for a map out of the recording of a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from artemis.commands.wholeness import tell_missing
from artemis.errors import ConfigError
from artemis.mapping.laser import Reading
from artemis.mapping.readings import ScanReadings
from artemis.mapping.settings import MapSettings
from artemis.mounting import Mounting
from artemis.recording.mcap_reader import Recording
from artemis.vehicle import RobotFile


def readings_of(run: Path, settings: MapSettings, scanner: str | None) -> Iterator[Reading]:
    """Scans of one scanner, in the order in which they came; it is mounted as the robot file in the recording says.

    The recording is opened at once, and what it lacks is printed.

    Args:
        run: folder of the run, or its recording.
        settings: which returns count.
        scanner: its name; None: there is only one.

    Raises:
        RecordingError: the recording cannot be read.
        ConfigError: it has no scans, or those of several scanners.
    """
    recording = Recording(run)
    tell_missing(recording, f"{recording.path}: ")
    name, _ = scanner_of(recording.robot, run, scanner)
    return _scans(recording, name, run, settings)


def _scans(recording: Recording, name: str, run: Path, settings: MapSettings) -> Iterator[Reading]:
    readings, found = ScanReadings(settings, recording.robot, name), False
    for tick in recording.ticks():
        for reading in readings.see(tick):
            found = True
            yield reading
    if not found:
        raise ConfigError(f"{run}: no scans of {name!r} were recorded")


def scanner_of(robot: RobotFile, run: Path, scanner: str | None) -> tuple[str, Mounting]:
    """Name and mounting of a recorded robot's scanner; None: there is only one.

    Raises:
        ConfigError: it has none of this name, or several.
    """
    mounted = robot.scanners
    names = ", ".join(sorted(mounted))
    if scanner is None and len(mounted) > 1:
        raise ConfigError(f"{run}: scanners {names}: choose one with --scanner")
    name = next(iter(mounted), "") if scanner is None else scanner
    if name not in mounted:
        there = f"no scanner {name!r}; it has {names}" if names else "no scanner"
        raise ConfigError(f"{run}: the robot has {there}")
    return name, mounted[name]
