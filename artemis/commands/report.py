"""`artemis report`: the page of a run, or of two; compared with the truth, if asked for; its trajectories as files."""

from __future__ import annotations

import sys
from math import isfinite, radians
from pathlib import Path
from textwrap import shorten

from artemis.commands.path_given import text_in
from artemis.errors import ConfigError
from artemis.motion.comparison import ALIGNMENTS, Alignment, Comparison, compare
from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import as_tum, truth_from
from artemis.recording.disk import write_whole
from artemis.recording.mcap_reader import Recording
from artemis.report.drawing import check_figures
from artemis.report.page import write_report
from artemis.report.series import Series, read_series
from artemis.report.side_by_side import write_side_by_side
from artemis.report.trajectories import estimated_trajectory, true_trajectory
from artemis.report.truth_words import comparison_rows
from artemis.values import Pose

MOST = 48
"""Characters of a cell that is printed."""
SIMULATION = "simulation"
"""Instead of a file: the true poses of a simulated run."""


def report(
    run: Path, truth: str | None, align: str | None, sensor: str | None, same_clock: bool, export: str | None
) -> None:
    """Write report.html beside the recording, print its name, and the errors if there is a truth.

    Args:
        run: folder of the run, or its recording.
        truth: file with the true poses, or `SIMULATION`.
        align: how the frames of both are made one; if not said, by the best fit, and not at all in a simulation.
        sensor: where the truth's tracker is on the robot: x, y [m] and heading [deg], with commas.
        same_clock: the truth's times are of the run's clock.
        export: format in which the trajectories are written beside the page.

    Raises:
        ConfigError: an option, the truth, or what they have to do with each other is wrong.
        RecordingError: the recording cannot be read, or a file not be written.
    """
    if truth is None and (align is not None or sensor is not None or same_clock):
        raise ConfigError("--align, --sensor and --same-clock are about a truth: name it with --truth")
    if export not in (None, "tum"):
        raise ConfigError(f"--export {export}: expected tum")
    if truth is not None:
        check_figures("--truth")
    alignment = _alignment(align or ("none" if truth == SIMULATION else "best"))
    place = _sensor(sensor)
    given = None if truth is None or truth == SIMULATION else truth_from(text_in(Path(truth)), str(Path(truth)))
    recording = _opened(run)
    folder = run if run.is_dir() else run.parent
    series = read_series(recording, every_tick=truth is not None or export is not None)
    compared = None
    if truth is not None:
        same_clock = same_clock or truth == SIMULATION
        compared = truth, _compared(series, given, str(truth), alignment, place, same_clock)
    page = folder / "report.html"
    write_report(recording, page, series, compared)
    lines = [] if compared is None else comparison_rows(compared[1], compared[0])
    lines += [("written", str(file)) for file in (_export(series, folder) if export else [])]
    sys.stdout.writelines(f"{name:12}  {text}\n" for name, text in lines)
    sys.stdout.write(f"{page}\n")


def report_with(run: Path, other: Path, at: str) -> None:
    """Write a page of two runs beside the first one's recording; print the differences and the page's name.

    Args:
        run: folder of the first run, or its recording.
        other: of the second.
        at: where both are at zero: `start`, or the beginning of the name of a step.

    Raises:
        ConfigError: no step of both begins so.
        RecordingError: a recording cannot be read, or the page not be written.
    """
    first, second = _opened(run), _opened(other)
    folder = run if run.is_dir() else run.parent
    page = folder / f"with-{second.path.resolve().parent.name}.html"
    rows = [("", run.name, other.name, "difference"), *write_side_by_side(first, second, page, at)]
    rows = [tuple(shorten(cell, MOST, placeholder="…") for cell in cells) for cells in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for name, *cells in rows:
        told = "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths[1:], strict=True))
        sys.stdout.write(f"{name:{widths[0]}}  {told}".rstrip() + "\n")
    sys.stdout.write(f"{page}\n")


def _opened(run: Path) -> Recording:
    """The recording of a run; that it is not whole is printed."""
    recording = Recording(run)
    if recording.incomplete:
        sys.stdout.write(f"{run}: the recording is not whole: {recording.incomplete}\n")
    return recording


def _alignment(word: str) -> Alignment:
    for known in ALIGNMENTS:
        if word == known:
            return known
    raise ConfigError(f"--align {word}: expected {', '.join(ALIGNMENTS)}")


def _sensor(written: str | None) -> Pose:
    """The tracker's pose, seen from the centre of the rear axle."""
    if written is None:
        return Pose()
    try:
        numbers = [float(cell) for cell in written.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(isfinite, numbers)):
        raise ConfigError(
            f"--sensor {written}: expected X,Y or X,Y,DEG: metres ahead and left of the rear axle's centre"
        )
    return Pose(x=numbers[0], y=numbers[1], heading=radians(numbers[2]) if len(numbers) == 3 else 0.0)


def _compared(
    run: Series, truth: Trajectory | None, name: str, alignment: Alignment, sensor: Pose, same_clock: bool
) -> Comparison:
    estimated = estimated_trajectory(run)
    if truth is None:
        true = true_trajectory(run)
        if true is None:
            raise ConfigError(f"--truth {SIMULATION}: the run was not simulated; name a file with its true poses")
        truth = true.of_point(sensor)
    try:
        return compare(estimated, truth, alignment=alignment, sensor=sensor, same_clock=same_clock)
    except ConfigError as error:
        raise ConfigError([f"{name}: {problem}" for problem in error.problems]) from None


def _export(run: Series, folder: Path) -> list[Path]:
    """Write the trajectories as TUM; the files."""
    written = []
    for name, what, trajectory in (
        ("estimated.tum", f"by the {run.source}", estimated_trajectory(run)),
        ("true.tum", "as simulated", true_trajectory(run)),
    ):
        if trajectory is None:
            continue
        frame = "odom" if run.source == "odometry" else "map"
        head = f"# {folder.resolve().name}: centre of the rear axle {what}; frame {frame}, run time [s]\n"
        file = folder / name
        write_whole(file, f"{head}# timestamp tx ty tz qx qy qz qw\n{as_tum(trajectory)}")
        written.append(file)
    return written
