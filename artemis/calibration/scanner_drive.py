"""What a drive tells of a scanner's mounting: the scanner's poses by its scans alone, and those of the odometry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from artemis.errors import CalibrationError
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.readings import ScanReadings
from artemis.mapping.se2 import Array, between, within
from artemis.mapping.settings import MapSettings
from artemis.motion.arrays import wrapped
from artemis.mounting import Mounting
from artemis.values import Tick
from artemis.vehicle import RobotFile

STEP, TURN = 0.06, 0.05
"""A scan counts after so much of a motion [m, rad]."""
LEAST = 20
"""Scans that have to count."""
UNMATCHED = 0.1
"""Where more of them fit nowhere, the scanner saw too little."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScannerDrive:
    """Poses at the same times, each in a frame of its own."""

    odometry: Array
    """Of the centre of the rear axle, by the wheels, shape (n, 3)."""
    scanner: Array
    """Of the scanner, by its scans, shape (n, 3)."""
    mirrored: bool
    """The scans turn against the odometry: the scanner is the other way up than the robot file says."""
    unmatched: int
    """Scans that fitted nowhere."""


def scanner_drive(ticks: Iterable[Tick], robot: RobotFile, name: str) -> ScannerDrive:
    """Follow a scanner by its scans alone through a recording.

    Args:
        ticks: of the run.
        robot: as it was recorded; of the scanner's mounting only the mask and the least range count.
        name: of the scanner.

    Raises:
        CalibrationError: it did not move, or its scans do not fit each other.
    """
    place = robot.scanners[name].model_copy(update={"x_m": 0.0, "y_m": 0.0, "heading_deg": 0.0})
    settings = MapSettings()
    upright, hanging = (ScanReadings(settings, robot, name, each) for each in (place, hung(place)))
    kept: list[tuple[Reading, Reading]] = []

    def moved(odometry: Array) -> bool:
        last = kept[-1][0].odometry if kept else None
        return last is None or not within(between(last, odometry), STEP, TURN)

    for tick in ticks:
        for pair in zip(upright.see(tick, moved), hanging.see(_hung_scans(tick), moved), strict=True):
            kept.append(pair)
    if len(kept) < LEAST:
        raise CalibrationError(f"{name}: {len(kept)} scans while the robot moved; expected {LEAST} or more")
    drive = _followed([first for first, _ in kept], mirrored=False)
    if _agreement(drive) < 0:
        drive = _followed([second for _, second in kept], mirrored=True)
    if drive.unmatched > UNMATCHED * len(kept):
        raise CalibrationError(
            f"{name}: {drive.unmatched} of {len(kept)} scans do not fit the others: drive slowly, with walls "
            "around and no people"
        )
    return drive


def hung(mounting: Mounting) -> Mounting:
    """The same, seen from below."""
    mask = tuple((-last, -first) for first, last in reversed(mounting.mask))
    return mounting.model_copy(update={"mask": mask})


def _hung_scans(tick: Tick) -> Tick:
    sensed = tick.snapshot.sensed
    scans = tuple(
        structs.replace(scan, start_angle=-scan.start_angle, increment=-scan.increment) for scan in sensed.scans
    )
    return structs.replace(tick, snapshot=structs.replace(tick.snapshot, sensed=structs.replace(sensed, scans=scans)))


def _followed(readings: list[Reading], *, mirrored: bool) -> ScannerDrive:
    mapper = Mapper()
    for reading in readings:
        mapper.add(replace(reading, odometry=None))
    mapper.finish()
    _, poses = mapper.trajectory()
    odometry = np.array([reading.odometry for reading in readings])
    return ScannerDrive(odometry=odometry, scanner=poses, mirrored=mirrored, unmatched=mapper.counts.unmatched)


def _agreement(drive: ScannerDrive) -> float:
    """Positive: scans and odometry turn the same way."""
    counted, seen = (wrapped(np.diff(poses[:, 2])) for poses in (drive.odometry, drive.scanner))
    return float(counted @ seen)
