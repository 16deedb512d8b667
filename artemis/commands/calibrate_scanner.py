"""`artemis calibrate scanner`: how a laser scanner is mounted, by a drive's recording; writes it down when told."""

from __future__ import annotations

import sys
from math import degrees
from pathlib import Path

from artemis.calibration.own_parts import own_parts
from artemis.calibration.scanner_drive import ScannerDrive, hung, scanner_drive
from artemis.calibration.scanner_fit import MountingFit, fit_mounting
from artemis.commands.map_readings import scanner_of
from artemis.commands.wholeness import tell_missing
from artemis.commands.written_values import check_yes, write_values
from artemis.errors import ConfigError
from artemis.mapping.kernels import COMPILED, notice
from artemis.mission.loading import load_model
from artemis.mounting import Mounting
from artemis.recording.mcap_reader import Recording
from artemis.vehicle import RobotFile
from artemis.yaml_edit import Keys
from artemis.yaml_file import Data

METRE_DIGITS, DEGREE_DIGITS = 4, 2
"""Of the numbers that are written."""


def calibrate_scanner(run: Path, scanner: str | None, robot_file: Path | None, *, yes: bool) -> None:
    """Fit the mounting of a scanner to a run, print old and new values, and write them if told so.

    Args:
        run: folder of the run, or its recording.
        scanner: its name; None: there is only one.
        robot_file: into which the values are written, once that is confirmed.
        yes: it is.

    Raises:
        ConfigError: wrong words or files, or nobody can confirm.
        RecordingError: the recording cannot be read.
        CalibrationError: the run does not show the mounting.
    """
    check_yes(robot_file, yes=yes)
    recording = Recording(run)
    name, old = scanner_of(recording.robot, run, scanner)
    if robot_file is not None and load_model(robot_file, RobotFile).scanners.get(name) != old:
        raise ConfigError(f"{robot_file}: its scanner {name!r} differs from that of the run; drive again")
    if not COMPILED:
        sys.stderr.write(f"{notice()}\n")
    seeing = old.model_copy(update={"mask": own_parts(recording.ticks(), name, old.mask)})
    robot = recording.robot.model_copy(update={"scanners": {name: seeing}})
    drive = scanner_drive(recording.ticks(), robot, name)
    tell_missing(recording, f"{recording.path}: ")
    found = fit_mounting(drive.odometry, drive.scanner)
    wanted = changes(name, old, seeing, drive, found)
    tell(name, old, drive, found, wanted)
    write_values("calibrate scanner", robot_file, wanted, yes=yes)


def changes(name: str, old: Mounting, seeing: Mounting, drive: ScannerDrive, found: MountingFit) -> dict[Keys, Data]:
    """New values of a robot file by their keys; `seeing`: with the mask that the drive shows.

    What is the other way up has its mask on the other side.
    """
    x, y, heading = found.mounting.tolist()
    new: dict[str, Data] = {
        "x_m": round(x, METRE_DIGITS),
        "y_m": round(y, METRE_DIGITS),
        "heading_deg": round(degrees(heading), DEGREE_DIGITS),
    }
    mask = seeing.mask
    if drive.mirrored:
        new["upside_down"] = not old.upside_down
        mask = hung(seeing).mask
    if mask != old.mask:
        new["mask"] = [list(sector) for sector in mask]
    return {("scanners", name, key): value for key, value in new.items()}


def tell(name: str, old: Mounting, drive: ScannerDrive, found: MountingFit, wanted: dict[Keys, Data]) -> None:
    """Print the drive, and old and new values with their intervals."""
    left, right = map(degrees, found.turned)
    distances, turns, bend = found.odometry.tolist()
    lines = [
        f"drive       {found.driven:.1f} m, {left:.0f} degrees to the left and {right:.0f} to the right; "
        f"{len(drive.scanner)} scans, {drive.unmatched} fit nowhere",
        f"odometry    distances {distances:+.2%}, turns {turns:+.2%} and {degrees(bend):+.2f} deg/m beside the scans'",
        f"{'scanner ' + name:<16}{'old':>10}{'new':>10}{'change':>10}{'95 %':>12}",
    ]
    widths = [*found.half_width[:2].tolist(), degrees(found.half_width[2])]
    digits = METRE_DIGITS, METRE_DIGITS, DEGREE_DIGITS
    for key, places, width in zip(("x_m", "y_m", "heading_deg"), digits, widths, strict=True):
        before, after = float(getattr(old, key)), float(str(wanted["scanners", name, key]))
        change = after - before if places == METRE_DIGITS else (after - before + 180.0) % 360.0 - 180.0
        lines.append(
            f"{key:<16}{before:>10.{places}f}{after:>10.{places}f}{change:>+10.{places}f}  +- {width:.{places}f}"
        )
    if drive.mirrored:
        lines.append(f"{'upside_down':<16}{str(old.upside_down).lower():>10}{str(not old.upside_down).lower():>10}")
        lines.append("            the scans turn against the odometry: it is the other way up than the robot file says")
    if ("scanners", name, "mask") in wanted:
        old_mask = [list(each) for each in old.mask] or "none"
        lines.append(
            f"mask        {old_mask} becomes {wanted['scanners', name, 'mask']}: there it sees the robot itself"
        )
    sys.stdout.write("\n".join([*lines, ""]))
