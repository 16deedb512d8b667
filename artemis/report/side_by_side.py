"""Two runs on one page: their numbers beside each other, both trajectories on one map, both in each chart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path

from artemis.errors import ConfigError
from artemis.recording.disk import write_whole
from artemis.recording.mcap_reader import Recording
from artemis.report.chart_data import ChartData, ShownRun
from artemis.report.fault_words import by_fault
from artemis.report.page import details, faults_section, with_map
from artemis.report.page_parts import chart_sections, framed, map_section, table
from artemis.report.path_map import PathMap
from artemis.report.series import Series, read_series
from artemis.report.summary import Summary, summary

NAMES = ("A", "B")
START = "start"
RESULT = "result"
"""A row in words: on the page it stands above, with the names of the runs."""
_MILLI, _DEGREES, _PERCENT = 1000.0, 57.29577951308232, 100.0
_ROWS: tuple[tuple[str, float, int, Callable[[Summary], float | None]], ...] = (
    ("duration [s]", 1.0, 2, lambda facts: facts.duration),
    ("distance [m]", 1.0, 3, lambda facts: facts.distance),
    ("highest speed [m/s]", 1.0, 3, lambda facts: facts.max_speed),
    ("largest steering angle of a wheel [°]", _DEGREES, 1, lambda facts: facts.max_steering),
    ("cross-track RMS, estimated [mm]", _MILLI, 2, lambda facts: facts.cross_track_rms),
    ("cross-track largest, estimated [mm]", _MILLI, 2, lambda facts: facts.cross_track_max),
    ("cross-track RMS, true [mm]", _MILLI, 2, lambda facts: facts.true_cross_track_rms),
    ("cross-track largest, true [mm]", _MILLI, 2, lambda facts: facts.true_cross_track_max),
    ("error of the pose at the end [mm]", _MILLI, 2, lambda facts: facts.position_error_end),
    ("stood for obstacles [s]", 1.0, 2, lambda facts: facts.waited or None),
    ("energy taken [J]", 1.0, 0, lambda facts: facts.joules),
    ("bus load, mean [%]", _PERCENT, 2, lambda facts: facts.bus_load_mean),
    ("latest tick [ms]", _MILLI, 2, lambda facts: facts.max_late),
)
"""Name, scale, decimals and value of each number of a run."""


def write_side_by_side(first: Recording, second: Recording, out: Path, at: str = START) -> list[tuple[str, ...]]:
    """Write a page of two runs to `out`; returns the differences: name, of the first, of the second, B - A.

    `at`: where both are at zero: `START`, or the beginning of the first step of both whose name begins so.

    Raises:
        ConfigError: no step of both runs begins so.
        RecordingError: a recording cannot be read, or the file not be written.
    """
    recordings, runs, problems = (first, second), [], []
    for recording in recordings:
        run, problem = with_map(recording, read_series(recording))
        runs.append(run)
        problems.append(problem)
    facts = [summary(recording, run) for recording, run in zip(recordings, runs, strict=True)]
    begins = _begins(runs)
    chosen = _chosen(list(begins), at)
    rows = _differences(facts, runs)
    shown = [ShownRun(name=name, series=run) for name, run in zip(NAMES, runs, strict=True)]
    picture = PathMap(shown)
    data = ChartData(shown, begins, picture.places())
    each = list(zip(NAMES, recordings, facts, runs, strict=True))
    kinds = [("warn" if cells[0].startswith("fault ") else "", cells) for cells in rows if cells[0] != RESULT]
    parts = [
        "<h1>Two runs</h1>",
        *(f'<p class="run r{number}">{_who(name, of, told)}</p>' for number, (name, of, told, _) in enumerate(each)),
        *problems,
        "<h2>Differences</h2>",
        f'<div class="wide">{table(("", *NAMES, "B - A"), kinds, numbers=3)}</div>',
        *(faults_section(run.entries, f" of {name}") for name, _, _, run in each),
        map_section(picture),
        *chart_sections(data, list(begins), chosen),
        "<h2>Details</h2>",
        *(part for name, of, told, run in each for part in details(of, told, run, f" of {name}")),
    ]
    write_whole(out, framed(" and ".join(of.path.parent.name for of in recordings), parts, data))
    return rows


def _who(name: str, recording: Recording, facts: Summary) -> str:
    return (
        f"<b>{name}</b> {escape(facts.mission)} · {facts.start:%Y-%m-%d %H:%M:%S} UTC · {escape(facts.robot)} · "
        f"{escape(facts.result)} · {escape(recording.path.parent.name)}"
    )


def _begins(runs: Sequence[Series]) -> dict[str, list[float]]:
    """Where the runs may be laid onto each other: run time of each [s], by name."""
    begins = {START: [float(run.time[0]) if len(run.time) else 0.0 for run in runs]}
    began: list[Mapping[str, float]] = [run.mission.began() for run in runs]
    for name in began[0]:
        if all(name in times for times in began):
            begins[name] = [times[name] for times in began]
    return begins


def _chosen(names: Sequence[str], at: str) -> int:
    for number, name in enumerate(names):
        if name.startswith(at):
            return number
    raise ConfigError(f"--at {at}: no step of both runs begins so; expected {', '.join(names)}")


def _differences(facts: Sequence[Summary], runs: Sequence[Series]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [(RESULT, facts[0].result, facts[1].result, "")]
    for name, scale, digits, value in _ROWS:
        rows.append(_row(name, [value(told) for told in facts], scale, digits))
    steps = [{step.name: step.time for step in reversed(run.mission.ran)} for run in runs]
    for name in dict.fromkeys(step.name for run in runs for step in run.mission.ran):
        rows.append(_row(f"time in {name} [s]", [each.get(name) for each in steps], 1.0, 2))
    faults = [Counter({name: len(times) for name, times in by_fault(run.entries).items()}) for run in runs]
    rows.append(_row("faults", [float(each.total()) for each in faults], 1.0, 0))
    for fault in dict.fromkeys([*faults[0], *faults[1]]):
        rows.append(_row(f"fault {fault}", [float(each[fault]) for each in faults], 1.0, 0))
    return [row for row in rows if any(row[1:3])]


def _row(name: str, values: Sequence[float | None], scale: float, digits: int) -> tuple[str, ...]:
    first, second = (None if value is None else scale * value for value in values)
    cells = ["" if value is None else f"{value:.{digits}f}" for value in (first, second)]
    difference = "" if first is None or second is None else f"{second - first:+z.{digits}f}"
    return name, *cells, difference
