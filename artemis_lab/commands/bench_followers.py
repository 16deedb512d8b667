"""`artemis bench followers`: every follower on every course, tables and figures in a folder."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.progress import Progress

from artemis.errors import ConfigError, similar
from artemis.mission.loading import load_model
from artemis.motion.arrays import Array
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.report.drawing import check_figures
from artemis.testing.contracts import ROBOT
from artemis.vehicle import RobotFile
from artemis_lab.bench.cases import CASES, CLEAN
from artemis_lab.bench.courses import five_courses
from artemis_lab.bench.driving import FollowerRefused
from artemis_lab.bench.followers import Measurement, Task, follower, installed, run_all, tasks
from artemis_lab.bench.judge import RunTrack
from artemis_lab.bench.python_robotics import REFERENCES
from artemis_lab.bench.step_time import ROUNDS, SIZES, step_times, weaving_path
from artemis_lab.bench.tables import as_csv, grids, problems


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What is to be measured. Nothing in a list: all there are."""

    followers: Sequence[str]
    courses: Sequence[str]
    seed: int
    robot: Path | None
    random: int
    frames: bool
    checkout: Path | None


def measure(choice: Selection, output: Path) -> None:
    """Do all runs, print the tables, and leave them with the figures in `output`.

    Raises:
        ConfigError: a follower or a course that is not there, or a robot file that is refused.
    """
    check_figures("bench followers")
    known = [*installed(), *(REFERENCES if choice.checkout is not None else ())]
    followers = _chosen("follower", choice.followers, known)
    courses = _chosen("course", choice.courses, [course.name for course in five_courses()])
    robot = ROBOT if choice.robot is None else load_model(choice.robot, RobotFile)
    given = list(
        tasks(
            followers,
            courses,
            robot,
            seed=choice.seed,
            frames=choice.frames,
            random=choice.random,
            checkout=choice.checkout,
        )
    )
    with Progress(disable=not sys.stdout.isatty()) as progress:
        bar = progress.add_task("runs", total=len(given))
        rows = run_all(given, lambda row: progress.advance(bar))
    notes = problems(rows)
    if choice.checkout is None:
        notes.append("PythonRobotics: skipped, no checkout is given (--python-robotics DIR)")
    steps = _step_times(followers, robot, choice.checkout, notes)
    made = grids(rows, steps)
    output.mkdir(parents=True, exist_ok=True)
    text = "\n".join([*(grid.text() for grid in made), *notes, ""])
    (output / "followers.txt").write_text(text)
    (output / "followers.md").write_text("\n".join(grid.markdown() for grid in made))
    (output / "followers.csv").write_text(as_csv(rows))
    _draw(rows, output)
    sys.stdout.write(f"{text}\n{len(given)} runs; tables and figures: {output}\n")


def _chosen(kind: str, names: Sequence[str], known: Sequence[str]) -> Sequence[str]:
    """The names, or all that are known.

    Raises:
        ConfigError: one is not known.
    """
    unknown = [f"no {kind} {name!r}; {similar(name, known)}" for name in names if name not in known]
    if unknown:
        raise ConfigError(unknown)
    return names or known


def _step_times(
    followers: Sequence[str], robot: RobotFile, checkout: Path | None, notes: list[str]
) -> dict[str, dict[int, Array]]:
    """Step times of all followers, one after the other; of the outside reference only on the short path, once."""
    found: dict[str, dict[int, Array]] = {name: {} for name in followers}
    case = CASES[CLEAN]
    machine = case.robot(robot)
    for size in SIZES:
        path = weaving_path(size)
        for name in followers:
            task = Task(follower=name, course="", case=CLEAN, robot=robot, seed=1, checkout=checkout)
            outside = name in REFERENCES
            if outside and size > SIZES[0]:
                continue
            try:
                made = [follower(task, machine, case) for _ in range(1 if outside else ROUNDS)]
                found[name][size] = step_times(made, path, machine)
            except KeyboardInterrupt:
                raise
            except PLUGIN_ERRORS as error:  # the follower's: a stranger's code may raise anything
                words = error if isinstance(error, FollowerRefused) else told(error)
                notes.append(f"{name}, step time, {size} points: {words}")
    return found


def _draw(rows: Sequence[Measurement], output: Path) -> None:
    """A figure for each course that was driven."""
    from artemis.report.figures import style
    from artemis_lab.bench.figures import course_figure

    for course in five_courses():
        tracks = _tracks(rows, course.name)
        if tracks:
            with style():
                figure = course_figure(course, tracks, f"{course.name}, {CLEAN}: kinematic plant, 38 deg/s")
                figure.savefig(output / f"{course.name}.png", dpi=120, facecolor="white")


def _tracks(rows: Sequence[Measurement], course: str) -> dict[str, RunTrack]:
    return {row.task.follower: row.track for row in rows if row.task.course == course and row.track is not None}
