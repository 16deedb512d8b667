"""The results as tables: plain text, Markdown, and one line for each run as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from textwrap import shorten

import numpy as np

from artemis.motion.arrays import Array
from artemis_lab.bench.cases import CASES, CLEAN, NOISY
from artemis_lab.bench.followers import FRAMES, RANDOM, Measurement
from artemis_lab.bench.judge import Figures

RATES = {
    "38 deg/s": (CLEAN, NOISY),
    "33 deg/s": ("33 deg/s", "33 deg/s, noise"),
    "29 deg/s": ("29 deg/s", "29 deg/s, noise"),
}
"""Steering rates of the virtual wheel, with the columns of `CASES` that have them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """A table with a title; the first column is text, the others are numbers."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def text(self) -> str:
        """For a terminal."""
        widths = [max(len(row[i]) for row in [self.head, *self.rows]) for i in range(len(self.head))]
        lines = [
            "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])])
            for row in [self.head, *self.rows]
        ]
        return "\n".join([self.title, "", *(line.rstrip() for line in lines), ""])

    def markdown(self) -> str:
        """For a page."""
        rule = ["---", *["--:"] * (len(self.head) - 1)]
        lines = ["| " + " | ".join(row) + " |" for row in [self.head, rule, *self.rows]]
        return "\n".join([self.title, "", *lines, ""])


def share_of(found: Sequence[float], share: float) -> float:
    """The least value that is not below a share, 0 to 1, of all; NaN, which no limit holds, where nothing was found."""
    return sorted(found)[min(int(share * len(found)), len(found) - 1)] if found else float("nan")


def times_in_words(milliseconds: Array) -> str:
    """How long something took [ms], shape (n,): half of the times, 99 % of them, the longest."""
    half, most, longest = np.quantile(milliseconds, (0.5, 0.99, 1.0))
    return f"half of them {half:.1f}, 99 % {most:.1f}, slowest {longest:.1f} ms"


class ResultTable:
    """Rows by follower, course and case."""

    def __init__(self, rows: Sequence[Measurement]) -> None:
        self._rows = {(row.task.follower, row.task.course, row.task.case): row for row in rows}
        self.rows = rows
        self.followers = list(dict.fromkeys(row.task.follower for row in rows))
        self.courses = list(dict.fromkeys(row.task.course for row in rows if row.task.case != RANDOM))

    def cell(self, follower: str, course: str, case: str, show: Callable[[Figures], str]) -> str:
        """A figure of a run; the first word of its problem if it has none, a dash if there was no such run."""
        row = self._rows.get((follower, course, case))
        if row is None:
            return "-"
        return row.problem.partition(":")[0] if row.figures is None else show(row.figures)


def grids(rows: Sequence[Measurement], steps: Mapping[str, Mapping[int, Array]]) -> list[Grid]:
    """All tables of a bench, without lines and tables of what was not run.

    `steps`: step times [s] by follower and points of the path.
    """
    results = ResultTable(rows)
    made = [_at_rate(results, *entry) for entry in RATES.items()]
    made += [_disturbed(results), _frames(results), _random(results), _steps(steps)]
    measured = [replace(grid, rows=[row for row in grid.rows if set(row[1:]) != {"-"}]) for grid in made]
    return [grid for grid in measured if grid.rows]


COLUMNS: list[tuple[str, str, bool, Callable[[Figures], str]]] = [
    ("figure-eight", "RMS/max", False, lambda run: f"{_mm(run.rms)}/{_mm(run.max)}"),
    ("slalom", "RMS/max", False, lambda run: f"{_mm(run.rms)}/{_mm(run.max)}"),
    ("circle", "RMS/max", False, lambda run: f"{_mm(run.rms)}/{_mm(run.max)}"),
    ("circle", "steady RMS", False, lambda run: _mm(run.steady_rms)),
    ("corner", "RMS/max", False, lambda run: f"{_mm(run.rms)}/{_mm(run.max)}"),
    ("corner", "settled [m]", False, lambda run: _metres(run.settling_distance)),
    ("corner", "time [s]", False, lambda run: f"{run.time:.1f}"),
    ("straight", "settled [m]", False, lambda run: _metres(run.settling_distance)),
    ("straight", "overshoot", False, lambda run: _mm(run.overshoot)),
    ("figure-eight", "noise: RMS", True, lambda run: _mm(run.steady_rms)),
    ("slalom", "noise: RMS", True, lambda run: _mm(run.steady_rms)),
    ("circle", "noise: RMS", True, lambda run: _mm(run.steady_rms)),
    ("corner", "noise: RMS", True, lambda run: _mm(run.steady_rms)),
    ("straight", "noise: residual RMS", True, lambda run: _mm(run.residual)),
]
"""Course, heading, with noise or clean, and what is shown."""


def _at_rate(results: ResultTable, rate: str, cases: tuple[str, str]) -> Grid:
    columns = [column for column in COLUMNS if column[0] in results.courses]
    return Grid(
        title=f"Cross-track error [mm], steering rate {rate}. Noise: 5 mm, 0.25 deg, steering zero 1 deg; after 3 m.",
        head=["follower", *(f"{course} {heading}" for course, heading, _, _ in columns)],
        rows=[
            [name, *(results.cell(name, course, cases[noise], show) for course, _, noise, show in columns)]
            for name in results.followers
        ],
    )


def _disturbed(results: ResultTable) -> Grid:
    cases = [case for case in CASES if case not in {name for pair in RATES.values() for name in pair[1:]}]
    cases.insert(1, NOISY)
    return Grid(
        title="Cross-track RMS after 3 m [mm], one disturbance each. `each wheel`: the robot as its file says.",
        head=["follower, course", *cases],
        rows=[
            [
                f"{name}, {course}",
                *(results.cell(name, course, case, lambda run: _mm(run.steady_rms)) for case in cases),
            ]
            for name in results.followers
            for course in results.courses
        ],
    )


def _frames(results: ResultTable) -> Grid:
    def shown(run: Figures) -> str:
        return f"{_mm(run.rms)}/{_mm(run.max)}, {run.time:.1f} s"

    return Grid(
        title="The whole stack, frame by frame, on odometry only; corners rounded: true cross-track RMS/max [mm], time",
        head=["follower", *results.courses],
        rows=[
            [name, *(results.cell(name, course, FRAMES, shown) for course in results.courses)]
            for name in results.followers
        ],
    )


def _random(results: ResultTable) -> Grid:
    rows = []
    for name in results.followers:
        mine = [row for row in results.rows if row.task.case == RANDOM and row.task.follower == name]
        words = [row.problem.partition(":")[0] for row in mine]
        done = [row.figures for row in mine if row.figures is not None]
        if mine:
            residual = _mm(float(np.median([run.residual for run in done]))) if done else "-"
            counts = [len(done), words.count("refused"), len(mine) - len(done) - words.count("refused")]
            rows.append([name, *map(str, [len(mine), *counts]), residual])
    return Grid(
        title="Random courses; starts up to 1 m off and 60 deg askew; 29 to 38 deg/s, delay to 100 ms, half noisy.",
        head=["follower", "runs", "finished", "refused", "not finished", "residual RMS, median [mm]"],
        rows=rows,
    )


def _steps(steps: Mapping[str, Mapping[int, Array]]) -> Grid:
    sizes = list(dict.fromkeys(size for times in steps.values() for size in times))
    return Grid(
        title="Time of a step [us], median/99th percentile, by points of the path.",
        head=["follower", *(f"{size:,}" for size in sizes)],
        rows=[[name, *(_microseconds(times.get(size)) for size in sizes)] for name, times in steps.items()],
    )


def problems(rows: Iterable[Measurement], most: int = 40) -> list[str]:
    """What did not go to its end, in words: the same words of one follower once, and at most so many lines."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.problem:
            found.setdefault((row.task.follower, row.problem), []).append(f"{row.task.course}, {row.task.case}")
    lines = [
        f"{follower}, {places[0]}{f' and {len(places) - 1} more' if len(places) > 1 else ''}: {shorten(problem, 200)}"
        for (follower, problem), places in found.items()
    ]
    return lines[:most] + ([f"and {len(lines) - most} more problems"] if len(lines) > most else [])


def as_csv(rows: Iterable[Measurement]) -> str:
    """One line for each run, in SI units."""
    units = {"time": "s", "steering_rate": "rad_s"}
    names = [field.name for field in fields(Figures)]
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["follower", "course", "case", *(f"{name}_{units.get(name, 'm')}" for name in names), "problem"])
    for row in rows:
        numbers = [""] * len(names) if row.figures is None else [f"{number:.6g}" for number in astuple(row.figures)]
        writer.writerow([row.task.follower, row.task.course, row.task.case, *numbers, row.problem])
    return file.getvalue()


def _mm(metres: float) -> str:
    return f"{metres * 1000:.1f}" if metres < 0.0995 else f"{metres * 1000:.0f}"


def _metres(distance: float) -> str:
    return f"{distance:.2f}" if math.isfinite(distance) else "never"


def _microseconds(times: Array | None) -> str:
    return "-" if times is None else f"{np.median(times) * 1e6:.0f}/{np.percentile(times, 99) * 1e6:.0f}"
