"""The numbers of charts as a page holds them: rounded, thinned with lowest and highest kept, differences as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from artemis.drive_states import DriveState
from artemis.motion.arrays import Array
from artemis.recording.journal import Entry
from artemis.report.charts import SECTIONS, TIME, Chart, charts_of
from artemis.report.series import Interval, Series

ROWS = 6000
"""A chart has at most about so many rows of a run."""
EVENTS = 1500
"""Of each kind of events the first is shown in each such part of the run."""
POSES = 2000
"""Places of the robot that the cursor can show on the map, at most."""
TIME_DIGITS = 3
KINDS = {"fault": "faults", "request": "requests", "job": "jobs"}
"""Of events that are shown below the modes."""
STATE_GROUPS = {
    DriveState.UNKNOWN.value: "unknown",
    DriveState.START.value: "off",
    DriveState.NOT_READY.value: "off",
    DriveState.SWITCH_ON_DISABLED.value: "off",
    DriveState.READY.value: "rising",
    DriveState.SWITCHED_ON.value: "rising",
    DriveState.REFRESH.value: "rising",
    DriveState.MEASURE_INIT.value: "rising",
    DriveState.OPERATION_ENABLE.value: "enabled",
    DriveState.QUICK_STOP_ACTIVE.value: "stopping",
    DriveState.FAULT_REACTION_DISABLED.value: "stopping",
    DriveState.FAULT_REACTION_ENABLED.value: "stopping",
    DriveState.FAULT.value: "fault",
}
"""States of one colour."""


class Columns:
    """Columns of numbers, each once however many charts have it."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def add(self, values: Array, digits: int) -> int:
        """The column's number; `values` are rounded to `digits` decimals."""
        text = _differences(values, digits)
        return self._numbers.setdefault(text, len(self._numbers))

    def texts(self) -> list[str]:
        """Each as a JSON array: differences of rounded numbers, null for unknown, behind the digits."""
        return list(self._numbers)


def _differences(values: Array, digits: int) -> str:
    known = np.isfinite(values)
    steps = np.diff(np.rint(values[known] * 10.0**digits).astype(np.int64), prepend=0)
    cells: list[int | None] = [None] * len(values)
    for at, step in zip(np.flatnonzero(known).tolist(), steps.tolist(), strict=True):
        cells[at] = step
    return json.dumps([digits, *cells], separators=(",", ":"))


def thinned_rows(lines: Sequence[Array]) -> NDArray[np.int64]:
    """Rows that show the lines, shape (n,) each: of every stretch the lowest and the highest of each, and its first.

    Of rows where nothing is known only the first stays, which breaks the lines.
    """
    count = len(lines[0])
    known = np.zeros(count, dtype=np.bool_)
    for line in lines:
        known |= np.isfinite(line)
    rows = np.flatnonzero(known | np.append(True, known[:-1]))
    if len(rows) <= ROWS:
        return rows
    stretch = -(-len(rows) * (1 + 2 * len(lines)) // ROWS)
    starts = np.arange(0, len(rows), stretch)
    padded = np.append(rows, np.full(len(starts) * stretch - len(rows), count))
    kept = [rows[starts], rows[-1:]]
    for line in lines:
        block = np.append(line, np.nan)[padded].reshape(len(starts), stretch)
        for best in (
            np.argmin(np.where(np.isnan(block), np.inf, block), axis=1),
            np.argmax(np.where(np.isnan(block), -np.inf, block), axis=1),
        ):
            kept.append(padded[starts + best])
    breaks = np.flatnonzero(~known[rows])
    return np.unique(np.concatenate([*kept, rows[breaks] if len(breaks) < ROWS else rows[:0]]))


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownRun:
    """One of the runs of a page."""

    name: str
    series: Series


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedChart:
    """Where a chart stands on the page: the charts of one heading follow each other."""

    number: int
    title: str
    """Of the heading."""
    caption: str
    name: str
    label: str
    """What it shows, for who does not see it."""


class ChartData:
    """The charts of a page.

    Attributes:
        placed: Where each stands.
    """

    def __init__(
        self,
        runs: Sequence[ShownRun],
        begins: Mapping[str, Sequence[float]],
        places: Sequence[Array] = (),
        more: Sequence[tuple[str, str, Sequence[Chart]]] = (),
    ) -> None:
        """Read all there is to draw.

        Args:
            runs: one, or several in the same charts.
            begins: by name, run times of each run that may be laid onto each other; the first is.
            places: of each run, where it was on the page's map: time [s], x, y [px], heading there [deg], shape (n, 4).
            more: title, caption and charts of the first run that come before the others.
        """
        self._columns = Columns()
        self._runs = [self._run(each) for each in runs]
        for run, table in zip(self._runs, places, strict=False):
            rows = np.unique(np.linspace(0, len(table) - 1, min(len(table), POSES)).astype(int))
            run["places"] = [
                self._columns.add(column, TIME_DIGITS if not n else 1) for n, column in enumerate(table[rows].T)
            ]
        self._begins = [[name, list(times)] for name, times in begins.items()]
        self.placed: list[PlacedChart] = []
        self._charts: list[dict[str, Any]] = []
        for title, caption, charts in more:
            for chart in charts:
                self._add(title, caption, [(0, runs[0].name, chart)])
        found: dict[str, dict[tuple[str, str, str], list[tuple[int, Chart]]]] = {title: {} for title, *_ in SECTIONS}
        captions = {title: caption for title, caption, _ in SECTIONS}
        for number, each in enumerate(runs):
            for title, shown in charts_of(each.series).items():
                for chart in shown:
                    found[title].setdefault((chart.title, chart.name, chart.over), []).append((number, chart))
        for title, same in found.items():
            for parts in same.values():
                self._add(title, captions[title], [(number, runs[number].name, chart) for number, chart in parts])

    def _add(self, title: str, caption: str, parts: Sequence[tuple[int, str, Chart]]) -> None:
        """One chart, of each run that has it: number, name and chart of that."""
        chart = parts[0][2]
        name = " · ".join(filter(None, [chart.title, chart.name, chart.over if chart.over != TIME else ""]))
        label = f"{name}: " + "; ".join(_label(run, part) for _, run, part in parts)
        number = len(self._charts)
        self.placed.append(PlacedChart(number=number, title=title, caption=caption, name=name, label=label))
        held = [{"run": run, **self._part(part)} for run, _, part in parts]
        self._charts.append({"digits": chart.digits, "over": chart.over, "zero": chart.from_zero, "parts": held})

    def text(self) -> str:
        """As JSON that may stand in a page."""
        held = {"runs": self._runs, "begins": self._begins, "charts": self._charts, "columns": 0}
        text = json.dumps(held, separators=(",", ":"), ensure_ascii=False)
        text = text.replace('"columns":0}', f'"columns":[{",".join(self._columns.texts())}]}}')
        return text.replace("<", "\\u003c")

    def _part(self, chart: Chart) -> dict[str, Any]:
        rows = thinned_rows([line.values for line in chart.lines])
        lines = [
            {"name": line.name, "ink": line.ink, "y": self._columns.add(line.values[rows], chart.digits)}
            for line in chart.lines
        ]
        return {"x": self._columns.add(chart.x[rows], TIME_DIGITS), "lines": lines}

    def _run(self, shown: ShownRun) -> dict[str, Any]:
        run = shown.series
        begin, end = (float(run.time[0]), float(run.time[-1])) if len(run.time) else (0.0, 0.0)
        lanes = [self._lane("robot", run.modes, {each.value: f"mode-{each.value}" for each in run.modes})]
        for name, states in run.drive_states.items():
            lanes.append(self._lane(name, states, {each.value: f"state-{STATE_GROUPS[each.value]}" for each in states}))
        events = [self._events(run.entries, kind, begin, end) for kind in KINDS]
        return {"name": shown.name, "begin": begin, "end": end, "lanes": lanes, "events": events}

    def _lane(self, name: str, intervals: Sequence[Interval], inks: Mapping[str, str]) -> dict[str, Any]:
        number = {value: at for at, value in enumerate(inks)}
        begins = self._columns.add(np.array([each.begin for each in intervals]), TIME_DIGITS)
        words = self._columns.add(np.array([number[each.value] for each in intervals], dtype=np.float64), 0)
        return {"name": name, "words": list(inks), "inks": list(inks.values()), "begins": begins, "word": words}

    def _events(self, entries: Sequence[Entry], kind: str, begin: float, end: float) -> dict[str, Any]:
        stretch = max(end - begin, 1e-3) / EVENTS
        first = {int((each.time - begin) // stretch): each for each in reversed(entries) if each.kind == kind}
        kept = [first[at] for at in sorted(first)]
        times = self._columns.add(np.array([each.time for each in kept]), TIME_DIGITS)
        return {"name": KINDS[kind], "kind": kind, "times": times, "texts": [each.text for each in kept]}


def _label(name: str, chart: Chart) -> str:
    """Lines with their lowest and highest values."""
    lines = []
    for line in chart.lines:
        known = line.values[np.isfinite(line.values)]
        if len(known):
            lines.append(f"{line.name} {np.min(known):.{chart.digits}f} to {np.max(known):.{chart.digits}f}")
    return ", ".join(lines) + (f" ({name})" if name else "")
