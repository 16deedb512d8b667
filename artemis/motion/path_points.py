"""The points of a path file, checked one by one; which curve they make is said elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from artemis.motion.arrays import Array, wrapped
from artemis.motion.columns import layout_of
from artemis.motion.noise import apart, averaged
from artemis.motion.table import Table, without_rows

MIN_STEP = 0.001
"""Points closer to the one before [m] are standstill or duplicates."""
MAX_GAP = 1.0
WAYPOINTS = (
    ": waypoints are joined by `artemis path import`, or by straight lines in the mission: path: {{waypoints: [{}]}}"
)
WAYPOINTS_SHOWN = 8
"""At most, in that message."""
MAX_LENGTH = 20_000.0
"""Longer paths [m] are a mistake of units, and would fill the memory with samples."""
MAX_SPEED = 20.0
"""More [m/s] is another mistake of units."""
MAX_TURN = math.radians(120)
"""A sharper turn between three points is a reversal (a cusp), not a curve."""

COLUMNS = {"x": "x", "y": "y", "heading": "heading", "speed": "speed"} | {
    "x_m": "x", "y_m": "y", "heading_rad": "heading", "speed_m_s": "speed"
}  # fmt: skip
"""What a header may call a column."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """The distinct points of a path file; problems with them go to its table, which the reader raises in the end."""

    table: Table
    kept: list[int]
    """Which rows of the table they are, or of an average the middle one."""
    x: Array
    """[m], like `y`, shape (n,), n >= 2."""
    y: Array
    heading: Array | None
    """Of the robot [rad]."""
    speed: Array | None
    """Of the virtual front wheel [m/s]."""

    def report(self, index: int, problem: str, column: str | None = None) -> None:
        """Something is wrong with a point."""
        self.table.report(self.kept[index], problem, column)


def path_table(text: str, source: str) -> Table:
    """The table of a path file; its problems are noted in it."""
    table = Table(text, source, COLUMNS, required=("x", "y"), layout=_layout)
    if table.header and not {"x", "y"} & table.columns.keys():
        table.report_file("tables of others are read by `artemis path import`")
    return table


def _layout(columns: Sequence[Sequence[float]]) -> tuple[str, ...] | str:
    """Of a path file without a header."""
    names = layout_of(columns)
    if isinstance(names, str) or set(names) <= set(COLUMNS.values()):
        return names
    return f"columns without names that can only be {', '.join(names)}: `artemis path import` reads them"


def read_points(text: str, source: str) -> Points:
    """Read the points of a path file; whether they reverse is not looked at.

    Raises:
        ConfigError: what leaves no points to look at.
    """
    table = path_table(text, source)
    if not table.complete:
        table.raise_problems()
    points = points_of(table)
    _check_points(points)
    return points


def points_of(table: Table) -> Points:
    """The distinct points of a table.

    Raises:
        ConfigError: what is wrong with the table, if there are fewer than two.
    """
    x, y = np.array(table.columns["x"]), np.array(table.columns["y"])
    px, py, kept = distinct(x, y)
    if len(kept) < 2:
        table.raise_problems()
        table.report_file(f"{len(kept)} distinct points; expected at least 2" if kept else without_rows(("x", "y")))
        table.raise_problems()
    heading, speed = (
        np.array(table.columns[name])[kept] if name in table.columns else None for name in ("heading", "speed")
    )
    return Points(table=table, kept=kept, x=px, y=py, heading=heading, speed=speed)


def moving(x: Array, y: Array) -> list[int]:
    """Indices of the points that are at least `MIN_STEP` from the last one kept."""
    return apart(x, y, MIN_STEP)


def distinct(x: Array, y: Array) -> tuple[Array, Array, list[int]]:
    """The points [m] that are `moving`; averages of them, if they are nearer to each other than their noise allows.

    And which of the given points each of them is, or has in its middle.
    """
    kept = moving(x, y)
    x, y = x[kept], y[kept]
    if (means := averaged(x, y)) is None:
        return x, y, kept
    return means[0], means[1], [kept[index] for index in means[2].tolist()]


def cusps(x: Array, y: Array) -> list[tuple[int, float]]:
    """Points at which a path reverses, and by how much it turns there [rad]."""
    turns = np.abs(wrapped(np.diff(np.arctan2(np.diff(y), np.diff(x)))))
    return [(int(index) + 1, float(turns[index])) for index in np.flatnonzero(turns > MAX_TURN)]


def _check_points(points: Points) -> None:
    """Report what makes readable points no path: too far apart, too long, no speed."""
    table, gaps = points.table, np.hypot(np.diff(points.x), np.diff(points.y))
    if gaps.sum() > MAX_LENGTH:
        table.report_file(
            f"path of {_metres(gaps.sum(), 0)} m; expected at most {MAX_LENGTH:.0f} m, coordinates in metres"
        )
    wide = [index for index in np.flatnonzero(gaps > MAX_GAP).tolist() if not table.is_torn(points.kept[index + 1])]
    waypoints = bool(wide) and bool(np.median(gaps) > MAX_GAP)
    for index in wide[:1] if waypoints else wide:
        problem = f"{_metres(gaps[index], 2)} m from the point before; expected at most {MAX_GAP:g} m"
        points.report(index + 1, problem + (WAYPOINTS.format(_shown(points)) if waypoints else ""))
    if points.speed is not None:
        for index in np.flatnonzero((points.speed <= 0) | (points.speed > MAX_SPEED)).tolist():
            bound = "more than 0" if points.speed[index] <= 0 else f"at most {MAX_SPEED:g}"
            points.report(index, f"speed: expected {bound} m/s, found {points.speed[index]:g}", "speed")


def _metres(length: float, digits: int) -> str:
    return f"{length:.{digits}f}" if length < 1e9 else f"{length:.3g}"


def _shown(points: Points) -> str:
    """The points as a mission has them, the first ones of many."""
    found = [f"[{x:g}, {y:g}]" for x, y in zip(points.x.tolist(), points.y.tolist(), strict=True)]
    return ", ".join([*found[:WAYPOINTS_SHOWN], *["..."] * (len(found) > WAYPOINTS_SHOWN)])
