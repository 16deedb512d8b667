"""The page that a run leaves behind: one HTML file with everything inside, for screens and for paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from math import degrees
from pathlib import Path

from artemis.errors import ConfigError
from artemis.motion.comparison import Comparison
from artemis.recording.disk import write_whole
from artemis.recording.journal import Entry, Level
from artemis.recording.mcap_reader import Recording
from artemis.report import truth_charts
from artemis.report.chart_data import ChartData, ShownRun
from artemis.report.fault_words import explained, histories
from artemis.report.known_map import made_map
from artemis.report.mission_boxes import boxes_of, is_list
from artemis.report.mission_chart import chart
from artemis.report.mission_times import MissionTimes
from artemis.report.page_parts import chart_sections, folded, framed, map_section, table
from artemis.report.path_map import PathMap
from artemis.report.series import Series, read_series
from artemis.report.summary import Summary, consumption, summary
from artemis.report.truth_words import comparison_rows

MAX_FAULTS = 20
"""Rows of the table of faults."""
MAX_STEPS, MAX_BOXES = 300, 300
"""Rows of the table of steps, and boxes of the mission's picture, if it has words."""
MAX_ENTRIES = 300
"""Rows of the table of events; the journal holds all."""
JOBS = ("job", "result")
"""Kinds of events with a table of their own."""


def write_report(
    recording: Recording, out: Path, series: Series | None = None, truth: tuple[str, Comparison] | None = None
) -> Summary:
    """Write the report of a run to `out`; returns the summary that stands in it.

    `series` saves reading the recording again; `truth`: where that comes from, and the comparison with it.

    Raises:
        RecordingError: the file cannot be written.
    """
    run, problem = with_map(recording, series or read_series(recording))
    facts = summary(recording, run)
    picture = PathMap([ShownRun(name="", series=run)])
    errors = [(truth_charts.TITLE, truth_charts.CAPTION, truth_charts.error_charts(truth[1]))] if truth else []
    data = ChartData([ShownRun(name="", series=run)], {}, picture.places(), errors)
    parts = [
        *heading(facts, f"{facts.robot} · {facts.start:%Y-%m-%d %H:%M:%S} UTC"),
        '<div class="cards">',
        *(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for name, value in _cards(facts)),
        "</div>",
        faults_section(run.entries),
        problem,
        *(_truth_sections(*truth) if truth is not None else ()),
        map_section(picture),
        *chart_sections(data),
        "<h2>Details</h2>",
        *details(recording, facts, run),
        f"<p>{escape(_versions(recording))}</p>",
    ]
    title = f"{facts.mission or 'Run'} · {facts.start:%Y-%m-%d %H:%M:%S} UTC"
    write_whole(out, framed(title, parts, data))
    return facts


def with_map(recording: Recording, run: Series) -> tuple[Series, str]:
    """The run on the map that it made, if it was localised on none; and in HTML why that is not drawn, or nothing."""
    if run.map is not None:
        return run, ""
    try:
        made = made_map(recording.path.parent, run.time[run.placed :], run.estimated[run.placed :])
    except ConfigError as error:
        return run, f'<p class="warning">The map is not drawn: {escape(str(error))}</p>'
    return replace(run, map=made), ""


def heading(facts: Summary, below: str) -> list[str]:
    """Which run it is, how it ended, and what is wrong with its recording."""
    bad = "" if facts.result.startswith(("done", "ended normally")) else " bad"
    faults = f", {len(facts.faults)} fault{'s' * (len(facts.faults) > 1)}" if facts.faults else ""
    missing = f'<p class="warning">The recording is not whole: {escape(facts.missing)}.</p>' if facts.missing else ""
    return [
        f"<h1>{escape(facts.mission or 'Run')}</h1>",
        f"<p>{escape(below)}</p>",
        f'<p class="result{bad}">{escape(facts.result + faults)}</p>',
        f"<p>Resumes {escape(facts.resumed)}.</p>" if facts.resumed else "",
        missing,
    ]


def _versions(recording: Recording) -> str:
    return ", ".join(f"{key} {value}" for key, value in recording.versions.items() if not key.startswith("start"))


def _truth_sections(source: str, comparison: Comparison) -> list[str]:
    from artemis.report.truth_figures import truth_drawn  # matplotlib takes a third of a second to import

    rows = (("", row) for row in comparison_rows(comparison, source))
    caption = "Odometry against the truth. Errors of the place in mm, of the heading in degrees."
    told = f"<h2>Truth</h2>\n<p>{caption}</p>\n{table(('', ''), rows, numbers=0)}"
    drawn = truth_drawn(comparison)
    return [told, *(f"<h2>{title}</h2>\n<p>{caption}</p>\n{svg}" for title, caption, svg in drawn)]


def faults_section(entries: Sequence[Entry], of: str = "") -> str:
    """Every fault with what to look for and what comes next, and what the drives remember of theirs."""
    rows = [("error", (what, advice, did, then, time)) for time, what, advice, did, then in explained(entries)]
    if not rows:
        return ""
    head = ("fault", "look for", "artemis", "next", "run time [s]")
    shown = table(head, rows[:MAX_FAULTS], numbers=1, stacking=True)
    more = f"<p>{len(rows) - MAX_FAULTS} more are among the events.</p>" if len(rows) > MAX_FAULTS else ""
    told = "".join(f"<p>Error history of {escape(history)}</p>" for history in histories(entries))
    return f"<h2>Faults{escape(of)}</h2>\n{shown}{more}{told}"


def details(recording: Recording, facts: Summary, run: Series, of: str = "") -> list[str]:
    """What few want to know, folded away."""
    jobs = [entry for entry in run.entries if entry.kind in JOBS]
    events = [entry for entry in run.entries if entry.kind not in JOBS]
    steps = _steps_table(facts) if is_list(recording.mission) else _mission_section(recording, run.mission)
    numbers = table(("", ""), (("", (name, value)) for name, value in _rows(facts)), numbers=0)
    return [
        folded(f"Summary{of}", "all numbers of the run", numbers, printed=True),
        folded(f"Steps{of}", f"{len(run.mission.ran) or len(facts.steps)} of the mission", steps, printed=True),
        folded(f"Events{of}", f"{len(events)}", _entries_table(events)),
        folded(f"Jobs of the drives{of}", f"{len(jobs)}", _entries_table(jobs)) if jobs else "",
    ]


def _cards(facts: Summary) -> list[tuple[str, str]]:
    """The few numbers on top: name and value."""
    cards = [
        ("duration", _seconds(facts.duration)),
        ("distance", f"{facts.distance:.2f} m"),
        ("highest speed", f"{facts.max_speed:.2f} m/s"),
    ]
    if facts.cross_track_rms is not None:
        cards.append((f"cross-track RMS, {facts.source}", _millimetres(facts.cross_track_rms)))
    if facts.true_cross_track_rms is not None:
        cards.append(("cross-track RMS, true", _millimetres(facts.true_cross_track_rms)))
    cards.append(("faults", str(len(facts.faults))))
    return cards


def _rows(facts: Summary) -> list[tuple[str, str]]:
    """Everything in the summary that is known: name and value."""
    rows = [
        ("mission", facts.mission),
        ("robot", facts.robot),
        ("result", facts.result),
        ("duration", _seconds(facts.duration)),
        ("real-time factor", f"{facts.real_time_factor:.1f}" if facts.real_time_factor else ""),
        ("ticks, latest", f"{facts.ticks}, {1000 * facts.max_late:.1f} ms"),
        ("distance", f"{facts.distance:.2f} m"),
        (f"cross-track error by {facts.source}: RMS, largest", _pair(facts.cross_track_rms, facts.cross_track_max)),
        ("cross-track error, true: RMS, largest", _pair(facts.true_cross_track_rms, facts.true_cross_track_max)),
        (f"distance from the path as given, by {facts.source}: RMS, largest", _pair(facts.given_rms, facts.given_max)),
        ("distance from the path as given, true: RMS, largest", _pair(facts.true_given_rms, facts.true_given_max)),
        (f"error of {facts.source} at the end", _known(facts.position_error_end)),
        ("error of odometry alone, largest", _known(facts.odometry_error_max)),
        ("highest speed: robot, a wheel", f"{facts.max_speed:.3f} m/s, {facts.max_wheel_speed:.3f} m/s"),
        ("largest steering angle of a wheel", f"{degrees(facts.max_steering):.1f}°"),
        ("may have touched obstacles", "; ".join(facts.ignored)),
        ("stood for obstacles", _seconds(facts.waited) if facts.waited else ""),
        ("battery", consumption(facts)),
        ("frames", str(facts.frames)),
        ("bus load: mean, highest", f"{100 * facts.bus_load_mean:.1f} %, {100 * facts.bus_load_max:.1f} %"),
    ]
    return [(name, value) for name, value in rows if value]


def _steps_table(facts: Summary) -> str:
    if not facts.steps:
        return "<p>No step began.</p>"
    rows = (("", (s.value, f"{s.begin:.2f}", f"{s.end:.2f}", _seconds(s.end - s.begin))) for s in facts.steps)
    return table(("step", "begin [s]", "end [s]", "took"), rows, numbers=3)


def _mission_section(recording: Recording, run: MissionTimes) -> str:
    """The picture of a mission with words, and each step that ran."""
    rows = (
        ("", (step.name, step.path, step.left, str(step.number), f"{step.time:.1f}" if step.time else ""))
        for step in run.ran[:MAX_STEPS]
    )
    ran = table(("step", "in the mission", "ended with", "ran", "took [s]"), rows, numbers=2) if run.ran else ""
    more = f"<p>{len(run.ran) - MAX_STEPS} more ran.</p>" if len(run.ran) > MAX_STEPS else ""
    box = boxes_of(recording.mission, recording.robot)
    few = sum(1 for _ in box.inside()) <= MAX_BOXES
    picture = (
        f'<div class="chart">{chart(box, run.marks)}</div>'
        if few
        else "<p>Too large to be drawn here; artemis graph MISSION --svg FILE draws it.</p>"
    )
    words = "<p>The mission; pale steps did not run. Time counts while the mission runs: not in a stop or fault.</p>"
    return (ran + more if run.ran else "<p>No step began.</p>") + words + picture


def _entries_table(entries: Sequence[Entry]) -> str:
    names = {Level.WARNING: "warn", Level.ERROR: "error"}
    rows = (
        (names.get(entry.level, ""), (entry.kind, entry.text, f"{entry.time:.2f}")) for entry in entries[:MAX_ENTRIES]
    )
    shown = table(("kind", "event", "run time [s]"), rows, numbers=1)
    more = len(entries) - MAX_ENTRIES
    return shown + (f"\n<p>{more} more are in journal.jsonl.</p>" if more > 0 else "")


def _seconds(duration: float) -> str:
    minutes, seconds = divmod(duration, 60)
    if minutes >= 60:
        return f"{minutes // 60:.0f} h {minutes % 60:02.0f} min"
    return f"{minutes:.0f} min {seconds:04.1f} s" if minutes else f"{seconds:.1f} s"


def _millimetres(length: float) -> str:
    return f"{1000 * length:.1f} mm"


def _known(length: float | None) -> str:
    return "" if length is None else _millimetres(length)


def _pair(rms: float | None, largest: float | None) -> str:
    return "" if rms is None or largest is None else f"{_millimetres(rms)}, {_millimetres(largest)}"
