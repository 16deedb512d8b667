"""Which beams of a laser scanner see the robot itself: what they measure stays the same wherever the robot is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import ceil, floor, tau

import numpy as np

from artemis.calibration.scanner_drive import STEP, TURN
from artemis.errors import CalibrationError
from artemis.mapping.se2 import Array, between, within
from artemis.motion.beams import seeing
from artemis.mounting import LARGEST_MASK
from artemis.scan import Scan
from artemis.values import Tick

Sectors = tuple[tuple[float, float], ...]

FULL_TURNS = 1.0
"""The robot has to turn so often: on a straight drive the walls beside it stay the same, too."""
SAME, SHARE = 60, 0.9
"""So near to its middle value [mm] is a beam in so large a share of the scans that sees the robot."""
NEAR = 3000
"""No part of the robot is farther away [mm]."""
BESIDE = 1.0
"""Beams so near to these see an edge of the part [degrees]."""
ROUNDING = 1e-6
"""Directions of beams are so far from exact [degrees]."""


def own_parts(ticks: Iterable[Tick], name: str, known: Sectors) -> Sectors:
    """The mask of a scanner by a drive.

    Args:
        ticks: of the run.
        name: of the scanner.
        known: its mask until now; what it hides stays hidden.

    Returns:
        Sectors [degrees], as of `Mounting.mask`; `known` itself where the drive shows no other parts, or too little.

    Raises:
        CalibrationError: the scanner sees more of the robot than can be masked.
    """
    turned = 0.0
    scans: list[Scan] = []
    for turn, scan in _apart(ticks, name):
        turned += turn
        if not scans or scan.millimetres.shape == scans[0].millimetres.shape:
            scans.append(scan)
    if turned < FULL_TURNS * tau:
        return known
    ranges = np.array([scan.millimetres for scan in scans], np.int32)
    middle = np.median(ranges, axis=0)
    same = np.mean(np.abs(ranges - middle) <= SAME, axis=0) >= SHARE
    angles = np.degrees(scans[0].start_angle + scans[0].increment * np.arange(ranges.shape[1]))
    angles = (angles + 180.0) % 360.0 - 180.0
    own = angles[same & (middle > 0) & (middle < NEAR) & seeing(angles, known)]
    if not own.size:
        return known
    found = _joined([*known, *((max(each - BESIDE, -180.0), min(each + BESIDE, 180.0)) for each in own.tolist())])
    masked = sum(stop - start for start, stop in found)
    if masked > LARGEST_MASK:
        raise CalibrationError(
            f"{name}: it sees the robot itself in {masked:g} degrees, {[list(each) for each in found]}; at most "
            f"{LARGEST_MASK:g} can be masked: mount it where it sees less of the robot"
        )
    return found


def _apart(ticks: Iterable[Tick], name: str) -> Iterator[tuple[float, Scan]]:
    """Scans between which the robot moved, each with how far it turned since the one before [rad]."""
    last: Array | None = None
    for tick in ticks:
        scans = [scan for scan in tick.snapshot.sensed.scans if scan.source == name]
        pose = tick.snapshot.odometry.pose
        here = np.array([pose.x, pose.y, pose.heading])
        motion = between(here if last is None else last, here)
        if scans and (last is None or not within(motion, STEP, TURN)):
            yield abs(float(motion[2])), scans[-1]
            last = here


def _joined(sectors: list[tuple[float, float]]) -> Sectors:
    """From right to left, in half degrees; those that touch are one."""
    found: list[tuple[float, float]] = []
    for start, stop in sorted(sectors):
        start, stop = floor(2.0 * start + ROUNDING) / 2.0, ceil(2.0 * stop - ROUNDING) / 2.0
        if found and start <= found[-1][1]:
            found[-1] = found[-1][0], max(stop, found[-1][1])
        else:
            found.append((start, stop))
    return tuple(found)
