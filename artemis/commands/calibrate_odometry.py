"""`artemis calibrate odometry`: fit a machine's measures to its runs, check them, write them down when told."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path

import numpy as np

from artemis.calibration.closing import Closed, ClosingFit, fit_closing
from artemis.calibration.fit import Fit, clocks_of, fit
from artemis.calibration.fitted_run import Run
from artemis.calibration.increments import BIN
from artemis.calibration.kinematics import ONE_WHEEL, TWO_WHEELS, Kinematics, Parameter, parameters_of
from artemis.calibration.knowledge import Estimates
from artemis.calibration.machine_file import Machine, log_from_table
from artemis.calibration.plausibility import refuse_implausible, refuse_unexplained
from artemis.calibration.robot_file import changes
from artemis.calibration.score import Score, ScoredRun, checked, score, track
from artemis.calibration.wheel_log import WheelLog, recorded_log
from artemis.calibration.words import as_text, held_of, rows_of, score_rows
from artemis.commands.path_given import text_in
from artemis.commands.wholeness import tell_missing
from artemis.errors import ConfigError, RecordingError
from artemis.mission.loading import load_model
from artemis.motion.table import Table
from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import truth_from
from artemis.recording.disk import write_whole
from artemis.recording.mcap_reader import Recording
from artemis.report.drawing import check_figures
from artemis.vehicle import RobotFile
from artemis.yaml_edit import edit

SIMULATION = "simulation"
"""Instead of a file: the true poses of a simulated run."""
PAGE = "calibration.html"
VALUES = ("value", "nominal", "fitted", "95 %")
ERRORS = ("odometry", "runs", "distance", "mean error", "of distance", "largest", "at end")
ERRORS_TITLE = "Position errors of the odometry"
HELD_TITLE = "Not estimated (nominal value kept)"
CLOSING_NAMES = {
    name: column
    for column, names in {
        "run": ("run",),
        "x": ("x_m", "x"),
        "y": ("y_m", "y"),
        "heading_deg": ("heading_deg",),
    }.items()
    for name in names
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """The machine that drove, as it is described."""

    base: Kinematics
    parameters: tuple[Parameter, ...]
    metres_per_count: tuple[float, float]
    robot: RobotFile | None
    """None for a machine of somebody else."""


def calibrate_with_truth(
    runs: Sequence[Path],
    truths: Sequence[str],
    machine: Path | None,
    check: Sequence[Path],
    output: Path | None,
    robot_file: Path | None,
    same_clock: bool = False,
) -> None:
    """Fit to runs whose truth is known, print tables, write the page and, if told so, the robot file.

    Args:
        runs: folders of runs or recordings; with `machine`, tables.
        truths: a file for each run, those to check last; or `SIMULATION` alone; none where the tables hold it.
        machine: file that describes the machine of the tables.
        check: runs that are not fitted, only scored.
        output: folder of the page; beside the first run, if not said.
        robot_file: into which the values are written.
        same_clock: the truths' times are run times.

    Raises:
        ConfigError: wrong words or files.
        RecordingError: a recording cannot be read.
        CalibrationError: the runs show nothing.
    """
    check_figures("calibrate odometry")
    source, pairs = _read([*runs, *check], truths, machine)
    _refuse_writing(robot_file, source)
    given = [_run(log, truth, same_clock) for log, truth in pairs]
    refuse_implausible(given, source.base)
    found = fit(given[: len(runs)], source.base, source.parameters, on_axle=list(truths) == [SIMULATION])
    refuse_unexplained(found.runs, found.machine)
    machines = {"nominal": source.base, "fitted": found.machine}
    scores = [(name, score(_tracks(found, machine, BIN))) for name, machine in machines.items()]
    scores += _held_out(found, given[len(runs) :])
    tables = [_values(found, source), (ERRORS_TITLE, ERRORS, score_rows(scores)), _held(found)]
    _tell(tables, found)
    _noise(found)
    from artemis.calibration.page import DRAWN, styled_page  # matplotlib takes a third of a second to import

    before, after = (_tracks(found, machine, DRAWN) for machine in (source.base, found.machine))
    _write_page(styled_page(tables, before, after, found), output or _beside(runs[0]))
    _write_robot(robot_file, source, found)


def calibrate_closing(
    runs: Sequence[Path], closing: Path | None, machine: Path | None, output: Path | None, robot_file: Path | None
) -> None:
    """Fit to runs that end where they began, or where `closing` says (columns run, x_m, y_m, heading_deg).

    Raises:
        ConfigError: wrong words or files.
        RecordingError: a recording cannot be read.
        CalibrationError: the runs show nothing.
    """
    check_figures("calibrate odometry")
    source, pairs = _read(runs, (), machine)
    _refuse_writing(robot_file, source)
    ends = [(0.0, 0.0, 0.0)] * len(runs) if closing is None else _ends(closing, len(runs))
    closed = [Closed(log=log, end=end) for (log, _), end in zip(pairs, ends, strict=True)]
    found = fit_closing(closed, source.base, source.parameters)
    tables = [_values(found, source), ("Closing errors", ("run", "before", "after"), _end_rows(closed, found))]
    tables.append(_held(found))
    _tell(tables, found)
    from artemis.calibration.page import closing_page

    text = closing_page(tables, found.before, found.after, found)
    _write_page(text, output or _beside(runs[0]))
    _write_robot(robot_file, source, found)


# ------------------------------------------------------------------------------------------------------------ reading


def _read(
    runs: Sequence[Path], truths: Sequence[str], machine: Path | None
) -> tuple[Source, list[tuple[WheelLog, Trajectory | None]]]:
    """The machine, and each run with its truth."""
    if len(truths) not in (0, len(runs)) and list(truths) != [SIMULATION]:
        raise ConfigError(f"--truth: {len(truths)} for {len(runs)} runs; expected one for each, in their order")
    if machine is not None:
        described = load_model(machine, Machine)
        count = described.metres_per_count
        source = Source(
            base=described.kinematics,
            parameters=ONE_WHEEL if described.one_wheel else TWO_WHEELS,
            metres_per_count=(count, count),
            robot=None,
        )
        pairs = [log_from_table(text_in(run), str(run), described) for run in runs]
    else:
        source, pairs = _recorded(runs, truths)
    if not truths or list(truths) == [SIMULATION]:
        return source, pairs
    return source, [(log, truth_from(text_in(Path(file)), file)) for (log, _), file in zip(pairs, truths, strict=True)]


def _recorded(runs: Sequence[Path], truths: Sequence[str]) -> tuple[Source, list[tuple[WheelLog, Trajectory | None]]]:
    recordings = [Recording(run) for run in runs]
    robot = recordings[0].robot
    for run, recording in zip(runs, recordings, strict=True):
        other = recording.robot
        if (other.calibration, other.geometry) != (robot.calibration, robot.geometry):
            raise ConfigError(
                f"{run}: recorded with a different calibration than {runs[0]}; such runs cannot be fitted together"
            )
    pairs = [recorded_log(recording, str(run)) for run, recording in zip(runs, recordings, strict=True)]
    for recording in recordings:
        tell_missing(recording, f"{recording.path}: ")
    if list(truths) != [SIMULATION]:
        pairs = [(log, None) for log, _ in pairs]
    counts = robot.metres_per_count("left"), robot.metres_per_count("right")
    base, parameters = Kinematics.of(robot.geometry), parameters_of(robot.geometry)
    return Source(base=base, parameters=parameters, metres_per_count=counts, robot=robot), pairs


def _run(log: WheelLog, truth: Trajectory | None, same_clock: bool) -> Run:
    if truth is None:
        raise ConfigError(f"{log.name}: no true poses; give --truth FILE, or --returns-to-start")
    same_rows = len(truth.time) == len(log.time) and bool((truth.time == log.time).all())
    return Run(log=log, truth=truth, one_clock=same_clock or same_rows)


def _ends(file: Path, count: int) -> list[tuple[float, float, float]]:
    """Measured ends by the numbers of the runs, from 1."""
    table = Table(text_in(file), str(file), CLOSING_NAMES, required=("run", "x", "y", "heading_deg"))
    rows = list(zip(*(table.columns.get(name, []) for name in ("run", "x", "y", "heading_deg")), strict=True))
    if table.complete and [row[0] for row in rows] != list(range(1, count + 1)):
        table.report_file(f"run: expected the numbers 1 to {count}, in this order")
    table.raise_problems()
    return [(x, y, radians(heading)) for _, x, y, heading in rows]


# ------------------------------------------------------------------------------------------------------------ telling


def _tracks(found: Fit, machine: Kinematics, period: float) -> list[ScoredRun]:
    return [track(run, machine, found.sensor, found.clock_of(run), period) for run in found.runs]


def _held_out(found: Fit, check: Sequence[Run]) -> list[tuple[str, Score]]:
    """Scores of runs that a fit did not see: each fitted run by a fit without it, then every run to check."""
    rows: list[tuple[str, Score]] = []
    if pairs := checked(found):
        tracks = [track(run, machine, found.sensor, found.clock_of(run)) for run, machine in pairs]
        rows.append(("each run with a fit of the others", score(tracks)))
    if not found.knows_heading:
        check = [replace(run, truth=run.truth.places()) for run in check]
    if check:
        for run, clock in zip(check, clocks_of(found, check), strict=True):
            for name, machine in (("nominal", found.base), ("fitted", found.machine)):
                tracks = [track(run, machine, found.sensor, clock)]
                rows.append((f"check {Path(run.log.name).name}, {name}", score(tracks)))
    return rows


def _values(found: Estimates, source: Source) -> tuple[str, Sequence[str], list[tuple[str, ...]]]:
    rows = rows_of(found, source.metres_per_count)
    return "Values", VALUES, [(row.name, row.nominal, row.fitted, f"+- {row.half_width}") for row in rows]


def _held(found: Estimates) -> tuple[str, Sequence[str], list[tuple[str, ...]]]:
    return HELD_TITLE, ("parameter", "reason"), list(held_of(found))


def _tell(tables: Sequence[tuple[str, Sequence[str], list[tuple[str, ...]]]], found: Estimates) -> None:
    for title, head, rows in tables:
        if rows:
            sys.stdout.write(f"{title}\n{as_text(head, rows)}\n")
    sys.stdout.write(f"condition number of the fit: {found.condition:.0f}\n")


def _noise(found: Fit) -> None:
    position, heading, along, _, turn = found.noise
    of_truth = f"{1000 * position:.1f} mm, "
    of_truth += f"{np.degrees(heading):.2f} deg" if found.knows_heading else "no headings"
    sys.stdout.write(
        f"noise of the truth, means over {BIN:g} s: {of_truth}\n"
        f"random walk of the odometry: {1000 * along:.1f} mm and {np.degrees(turn):.2f} deg in 1 m\n"
        f"outliers: {found.left_out} of {found.moments} motions not used\n"
    )


def _end_rows(closed: Sequence[Closed], found: ClosingFit) -> list[tuple[str, ...]]:
    def words(end: np.ndarray) -> str:
        return f"{1000 * end[0]:.0f} mm, {1000 * end[1]:.0f} mm, {np.degrees(end[2]):.2f} deg"

    ends = zip(closed, found.before, found.after, strict=True)
    return [(run.log.name, words(before), words(after)) for run, before, after in ends]


# ------------------------------------------------------------------------------------------------------------ writing


def _beside(run: Path) -> Path:
    return run if run.is_dir() else run.parent


def _write_page(text: str, folder: Path) -> None:
    page = folder / PAGE
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be created: {error.strerror}") from error
    write_whole(page, text)
    sys.stdout.write(f"{page}\n")


def _refuse_writing(robot_file: Path | None, source: Source) -> None:
    """Before minutes of fitting."""
    if robot_file is None:
        return
    if source.robot is None:
        raise ConfigError("--write: the machine of these runs has no robot file")
    present = load_model(robot_file, RobotFile)
    if (present.calibration, present.geometry) != (source.robot.calibration, source.robot.geometry):
        raise ConfigError(f"{robot_file}: its calibration differs from that of the runs; drive again")


def _write_robot(robot_file: Path | None, source: Source, found: Estimates) -> None:
    if source.robot is None:
        return
    wanted = changes(source.robot, found.machine)
    for keys, value in wanted.items():
        sys.stdout.write(f"{'.'.join(keys)}: {value}\n")
    if robot_file is None:
        sys.stdout.write("not written; --write ROBOT writes these values into the robot file\n")
        return
    edit(robot_file, wanted)
    sys.stdout.write(f"written: {robot_file}\n")
    if any(keys[-1] == "zero_v" for keys in wanted):
        sys.stdout.write(
            "the steering drives still store the old zeros; update them: artemis calibrate steering MISSION --store\n"
        )
