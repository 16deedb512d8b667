"""The page that a run leaves behind: one HTML file with everything inside, for light and dark screens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape
from math import degrees
from pathlib import Path

from artemis.errors import ConfigError
from artemis.motion.comparison import Comparison
from artemis.recording.disk import write_whole
from artemis.recording.journal import Entry, Level
from artemis.recording.mcap_reader import Recording
from artemis.report.fault_words import explained, histories
from artemis.report.known_map import made_map
from artemis.report.mission_boxes import boxes_of, is_list
from artemis.report.mission_chart import chart
from artemis.report.mission_times import MissionTimes
from artemis.report.series import Series, read_series
from artemis.report.summary import Summary, summary
from artemis.report.truth_words import comparison_rows

MAX_FAULTS = 20
"""Rows of the table of faults."""
MAX_STEPS, MAX_BOXES = 300, 300
"""Rows of the table of steps, and boxes of the mission's picture, if it has words."""
MAX_ENTRIES = 300
"""Rows of the table of events; the journal holds all."""

_STYLE = """
:root { color-scheme: light dark;
  --ink: #1d2125; --paper: #ffffff; --faint: #f3f5f7; --line: #dde1e6; --alarm: #c23b3b; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #d9dde2; --paper: #16191d; --faint: #1f2429; --line: #343b43; --alarm: #ef7d7d; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 32px 20px 64px; max-width: 1000px; color: var(--ink); background: var(--paper);
       font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 26px; font-weight: 600; margin: 0; }
h2 { font-size: 17px; font-weight: 600; margin: 40px 0 2px; }
p { margin: 2px 0 10px; opacity: .72; }
.warning { opacity: 1; margin: 12px 0; padding: 8px 12px; background: var(--faint);
           border-left: 3px solid var(--alarm); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 10px; margin: 20px 0 8px; }
.cards div { background: var(--faint); border-radius: 6px; padding: 10px 12px; }
.cards b { display: block; font-size: 20px; font-weight: 600; font-variant-numeric: tabular-nums; }
.cards span { font-size: 12.5px; opacity: .72; }
.chart { overflow-x: auto; }
.chart svg { max-width: none; }
svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 4px 10px 4px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; }
.number { text-align: right; white-space: nowrap; }
.warn td { font-weight: 600; }
.error td { color: var(--alarm); font-weight: 600; }
""".strip()


def write_report(
    recording: Recording, out: Path, series: Series | None = None, truth: tuple[str, Comparison] | None = None
) -> Summary:
    """Write the report of a run to `out`; returns the summary that stands in it.

    `series` saves reading the recording again; `truth`: where that comes from, and the comparison with it.

    Raises:
        RecordingError: the file cannot be written.
    """
    from artemis.report import figures, truth_figures  # matplotlib takes a third of a second to import

    run, sections = series or read_series(recording), list[str]()
    if run.map is None:
        try:
            run = replace(run, map=made_map(recording.path.parent, run.time[run.placed :], run.estimated[run.placed :]))
        except ConfigError as error:
            sections = [f'<p class="warning">The map is not drawn: {escape(str(error))}</p>']
    facts = summary(recording, run)
    if truth is not None:
        sections += [_truth_section(*truth), *_figures(truth_figures.truth_drawn(run, truth[1]))]
    page = _page(facts, [*sections, *_figures(figures.drawn(run))], run, recording)
    write_whole(out, page)
    return facts


def _figures(drawn: Iterable[tuple[str, str, str]]) -> list[str]:
    return [f"<h2>{title}</h2>\n<p>{caption}</p>\n{svg}" for title, caption, svg in drawn]


def _truth_section(source: str, comparison: Comparison) -> str:
    rows = (("", row) for row in comparison_rows(comparison, source))
    caption = "Odometry against the truth. Errors of the place in mm, of the heading in degrees."
    return f"<h2>Truth</h2>\n<p>{caption}</p>\n{_table(('', ''), rows, numbers=0)}"


def _page(facts: Summary, sections: Sequence[str], run: Series, recording: Recording) -> str:
    entries = run.entries
    title = f"{facts.mission or 'Run'} · {facts.start:%Y-%m-%d %H:%M:%S} UTC"
    missing = f'<p class="warning">The recording is not whole: {escape(facts.missing)}.</p>' if facts.missing else ""
    made_from = ", ".join(f"{key} {value}" for key, value in recording.versions.items() if not key.startswith("start"))
    parts = [
        f"<h1>{escape(facts.mission or 'Run')}</h1>",
        f"<p>{escape(facts.robot)} · {facts.start:%Y-%m-%d %H:%M:%S} UTC · {escape(facts.result)}</p>",
        f"<p>Resumes {escape(facts.resumed)}.</p>" if facts.resumed else "",
        missing,
        '<div class="cards">',
        *(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for name, value in _cards(facts)),
        "</div>",
        _faults_section(entries),
        *sections,
        "<h2>Summary</h2>",
        _table(("", ""), (("", (name, value)) for name, value in _rows(facts)), numbers=0),
        "<h2>Steps</h2>",
        _steps_table(facts) if is_list(recording.mission) else _mission_section(recording, run.mission),
        "<h2>Events</h2>",
        _entries_table(entries),
        f"<p>{escape(made_from)}</p>",
    ]
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n" + "\n".join(filter(None, parts)) + "\n</body>\n</html>\n"
    )


def _faults_section(entries: Sequence[Entry]) -> str:
    """Every fault with what to look for and what comes next, and what the drives remember of theirs."""
    rows = [("error", (what, advice, did, then, time)) for time, what, advice, did, then in explained(entries)]
    if not rows:
        return ""
    table = _table(("fault", "look for", "artemis", "next", "run time [s]"), rows[:MAX_FAULTS], numbers=1)
    more = f"<p>{len(rows) - MAX_FAULTS} more are among the events.</p>" if len(rows) > MAX_FAULTS else ""
    told = "".join(f"<p>Error history of {escape(history)}</p>" for history in histories(entries))
    return f"<h2>Faults</h2>\n{table}{more}{told}"


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
        ("highest speed: robot, a wheel", f"{facts.max_speed:.3f} m/s, {facts.max_wheel_speed:.3f} m/s"),
        ("largest steering angle of a wheel", f"{degrees(facts.max_steering):.1f}°"),
        ("stood for obstacles", _seconds(facts.waited) if facts.waited else ""),
        ("frames", str(facts.frames)),
        ("bus load: mean, highest", f"{100 * facts.bus_load_mean:.1f} %, {100 * facts.bus_load_max:.1f} %"),
    ]
    return [(name, value) for name, value in rows if value]


def _steps_table(facts: Summary) -> str:
    if not facts.steps:
        return "<p>No step began.</p>"
    rows = (("", (s.value, f"{s.begin:.2f}", f"{s.end:.2f}", _seconds(s.end - s.begin))) for s in facts.steps)
    return _table(("step", "begin [s]", "end [s]", "took"), rows, numbers=3)


def _mission_section(recording: Recording, run: MissionTimes) -> str:
    """The picture of a mission with words, and each step that ran."""
    rows = (
        ("", (step.name, step.path, step.left, str(step.number), f"{step.time:.1f}" if step.time else ""))
        for step in run.ran[:MAX_STEPS]
    )
    table = _table(("step", "in the mission", "ended with", "ran", "took [s]"), rows, numbers=2) if run.ran else ""
    more = f"<p>{len(run.ran) - MAX_STEPS} more ran.</p>" if len(run.ran) > MAX_STEPS else ""
    box = boxes_of(recording.mission)
    few = sum(1 for _ in box.inside()) <= MAX_BOXES
    picture = (
        f'<div class="chart">{chart(box, run.marks)}</div>'
        if few
        else "<p>Too large to be drawn here; artemis graph MISSION --svg FILE draws it.</p>"
    )
    words = "<p>The mission; pale steps did not run. Time counts while the mission runs: not in a stop or fault.</p>"
    return (table + more if run.ran else "<p>No step began.</p>") + words + picture


def _entries_table(entries: Sequence[Entry]) -> str:
    names = {Level.WARNING: "warn", Level.ERROR: "error"}
    rows = (
        (names.get(entry.level, ""), (entry.kind, entry.text, f"{entry.time:.2f}")) for entry in entries[:MAX_ENTRIES]
    )
    table = _table(("kind", "event", "run time [s]"), rows, numbers=1)
    more = len(entries) - MAX_ENTRIES
    return table + (f"\n<p>{more} more are in journal.jsonl.</p>" if more > 0 else "")


def _table(head: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]], *, numbers: int) -> str:
    """A table; each row comes with its class. The last `numbers` columns are numbers."""
    kinds = [""] * (len(head) - numbers) + [' class="number"'] * numbers
    lines = ["<table>"]
    if any(head):
        cells = "".join(f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, head, strict=True))
        lines.append(f"<tr>{cells}</tr>")
    for name, values in rows:
        cells = "".join(f"<td{kind}>{escape(value)}</td>" for kind, value in zip(kinds, values, strict=True))
        lines.append(f'<tr class="{name}">{cells}</tr>' if name else f"<tr>{cells}</tr>")
    return "\n".join([*lines, "</table>"])


def _seconds(duration: float) -> str:
    minutes, seconds = divmod(duration, 60)
    return f"{minutes:.0f} min {seconds:04.1f} s" if minutes else f"{seconds:.1f} s"


def _millimetres(length: float) -> str:
    return f"{1000 * length:.1f} mm"


def _known(length: float | None) -> str:
    return "" if length is None else _millimetres(length)


def _pair(rms: float | None, largest: float | None) -> str:
    return "" if rms is None or largest is None else f"{_millimetres(rms)}, {_millimetres(largest)}"
