"""`artemis bench hall`: how well a simulated robot localises on a map by its scanner; one table with bars."""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from artemis.mapping import kernels
from artemis.report.summary import Summary
from artemis_lab.bench.hall import STANDS, GlobalStart, begun, copied, followed, places
from artemis_lab.bench.tables import Grid

MOST_RMS, LEAST_DRIFT, RIGHT = 0.020, 1.0, 0.3
"""Of the true rear axle from its path; of the odometry from the true place; so near the true pose one is right [m]."""


def measure(mission: Path, minutes: float, starts: int, seed: int) -> bool:
    """Run the drives, print the table; returns whether all bars hold.

    Args:
        mission: simulated, with the localizer `scan_map` and a step that follows a path.
        minutes: of run time that the path is followed.
        starts: robots that are switched on somewhere.
        seed: of these places.

    Raises:
        ConfigError: the mission has errors, or is not of this kind.
    """
    if not kernels.COMPILED:
        sys.stderr.write(f"{kernels.notice()}\n")
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as scratch:
        copy = copied(mission, Path(scratch) / "mission")
        found = [begun(copy, place) for place in places(copy, starts, seed)]
        drive = followed(copy, minutes)
    sys.stdout.write(grid(drive, found).text())
    return is_good(drive, found)


def is_right(start: GlobalStart) -> bool:
    """Whether a robot was found in time, and no pose was wrong."""
    return start.after <= STANDS and start.off <= RIGHT


def is_good(drive: Summary, starts: Sequence[GlobalStart]) -> bool:
    """Whether all bars hold."""
    rms, drift = drive.true_cross_track_rms, drive.odometry_error_max
    held = rms is not None and rms <= MOST_RMS and drift is not None and drift >= LEAST_DRIFT
    return held and not drive.faults and all(map(is_right, starts))


def grid(drive: Summary, starts: Sequence[GlobalStart]) -> Grid:
    """All figures."""
    right = [start for start in starts if is_right(start)]
    rows = [
        ("followed [min]", f"{drive.duration / 60:.1f}", ""),
        ("driven [m]", f"{drive.distance:.0f}", ""),
        ("faults", str(len(drive.faults)), "0"),
        ("true distance from the path, RMS [mm]", _scaled(drive.true_cross_track_rms, 1e3), f"<= {1e3 * MOST_RMS:.0f}"),
        ("error of odometry alone, largest [m]", _scaled(drive.odometry_error_max, 1.0), f">= {LEAST_DRIFT:.0f}"),
        ("started without a hint, found", f"{len(right)} of {len(starts)}", "all"),
        ("latest [s]", f"{max((start.after for start in right), default=math.nan):.1f}", f"<= {STANDS:.0f}"),
        ("pose then, farthest off [cm]", f"{100 * max((start.off for start in right), default=math.nan):.1f}",
         f"<= {100 * RIGHT:.0f}"),
    ]  # fmt: skip
    return Grid(title="Localised on a map by a laser scanner, in simulation", head=["", "measured", "bar"], rows=rows)


def _scaled(length: float | None, scale: float) -> str:
    return "unknown" if length is None else f"{scale * length:.1f}"
