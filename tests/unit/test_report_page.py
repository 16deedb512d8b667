from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
import re
from html.parser import HTMLParser
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import synthetic_run
from msgspec.structs import replace

from artemis.errors import RecordingError
from artemis.progress import Position
from artemis.recording.journal import Entry, Journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.recording.provenance import ResumePoint
from artemis.report.chart_data import ROWS, thinned_rows
from artemis.report.charts import charts_of
from artemis.report.figures import thinned
from artemis.report.page import MAX_ENTRIES, MAX_FAULTS, write_report
from artemis.report.series import read_series
from artemis.supervision.catalogue import ROWS as FAULTS
from artemis.values import JobKind, JobResult, Pose

VOID = {"meta", "!doctype"}


class Page(HTMLParser):
    """Checks that every element is closed, and collects the text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[str] = []
        self.text = ""
        self.outside: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.outside += [value for name, value in attrs if name in {"src", "href"} and value and "#" not in value]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def report(tmp_path: Path, count: int | None = None, fault_at: float | None = None) -> tuple[str, Page]:
    path = synthetic_run.record(
        tmp_path / "recording.mcap", islice(synthetic_run.run(hz=10.0, fault_at=fault_at), count)
    )
    write_report(Recording(path), tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    return html, Page(html)


def held(html: str) -> Any:  # noqa: ANN401  JSON
    """What the page's script reads; columns are unpacked as it does."""
    text = html.partition('<script type="application/json" id="data">')[2].partition("</script>")[0]
    data = json.loads(text)
    data["columns"] = [unpacked(*column) for column in data["columns"]]
    return data


def unpacked(digits: int, *steps: int | None) -> list[float]:
    total, values = 0, []
    for step in steps:
        total += step or 0
        values.append(math.nan if step is None else total / 10**digits)
    return values


def test_a_run_gives_one_page_with_all_charts(tmp_path: Path) -> None:
    html, page = report(tmp_path)

    titles = re.findall("<h2>(.*?)</h2>", html)
    assert titles == [
        *("Path and trajectory", "Modes, drives and events", "Cross-track error", "Wheel speeds"),
        *("Steering angles", "Bus load", "Details"),
    ]
    assert html.count("data-chart=") == len(held(html)["charts"]) == 7
    for text in (
        "circle",
        "ARTEMIS",
        "cross-track RMS, odometry",
        "cross-track RMS, true",
        "Bus load",
        "init -> ready",
    ):
        assert text in page.text
    assert page.outside == []
    for part in html.split("<svg")[1:]:
        ElementTree.fromstring("<svg" + part[: part.index("</svg>")] + "</svg>")  # or it raises


def test_nothing_but_its_own_script_runs_on_a_page_and_nothing_is_loaded(tmp_path: Path) -> None:
    html, _ = report(tmp_path, 5)

    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in html
    assert "Permission is hereby granted, free of charge" in script
    assert not re.search(r"(src|href)=.http|url\(|@import|fetch\(|XMLHttpRequest|import\(", html)


def test_a_page_without_scripts_says_what_is_missing(tmp_path: Path) -> None:
    _, page = report(tmp_path, 5)

    assert "The charts below are drawn by JavaScript" in page.text


def test_a_line_of_which_nothing_is_known_is_not_in_the_legend(tmp_path: Path) -> None:
    run = read_series(Recording(synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(hz=10.0))))
    untold = dataclasses.replace(run, true_cross_track=np.full(len(run.time), np.nan))

    for each, expected in ((run, ["true", "by odometry"]), (untold, ["by odometry"])):
        charts = charts_of(each)["Cross-track error"]
        assert [[line.name for line in chart.lines] for chart in charts] == [expected, expected]


def test_charts_hold_what_was_recorded(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(hz=10.0, fault_at=9.0))
    run = read_series(Recording(path))
    write_report(Recording(path), tmp_path / "report.html")
    data = held((tmp_path / "report.html").read_text())
    columns = data["columns"]

    part = data["charts"][0]["parts"][0]
    assert [line["name"] for line in part["lines"]] == ["true", "by odometry"]
    rows = np.searchsorted(run.time, np.array(columns[part["x"]]) - 5e-4)
    np.testing.assert_allclose(columns[part["lines"][1]["y"]], 1000 * run.cross_track[rows], atol=0.0051)
    assert np.isnan(columns[part["lines"][1]["y"]]).any(), "before and after the path nothing is known"
    (of,) = data["runs"]
    robot = of["lanes"][0]
    assert [robot["words"][int(n)] for n in columns[robot["word"]]] == [each.value for each in run.modes]
    assert columns[robot["begins"]] == pytest.approx([each.begin for each in run.modes])
    assert of["events"][0]["texts"] == ["DRV-25 steer-left: following error <too large>"]
    time, x, y, heading = (np.array(columns[number]) for number in of["places"])
    assert time[0] == run.time[0]
    steps = np.hypot(np.diff(x), np.diff(y))
    driven = np.hypot(*np.diff(run.estimated[:, :2], axis=0).T)
    scale = steps.sum() / driven.sum()
    np.testing.assert_allclose(steps, scale * driven, atol=0.3)
    np.testing.assert_allclose(heading, -np.degrees(run.estimated[:, 2]), atol=0.06)


def test_every_measured_line_has_a_colour_of_its_own(tmp_path: Path) -> None:
    run = read_series(Recording(synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(hz=10.0))))
    warm = {name: dataclasses.replace(wheel, temperature=20.0 + run.time) for name, wheel in run.wheels.items()}
    style = (Path(__file__).parents[2] / "artemis/static/report/report.css").read_text()

    charts = [chart for charts in charts_of(dataclasses.replace(run, wheels=warm)).values() for chart in charts]

    assert len(charts) == 7 + 2
    for chart in charts:
        colours = [re.findall(f"--{line.ink}: (#[0-9a-f]{{6}})", style) for line in chart.lines]
        assert all(len(of_both_themes) == 2 for of_both_themes in colours), chart.name
        assert len({light for light, _ in colours}) == len(chart.lines), chart.name


def test_equal_runs_give_equal_figures(tmp_path: Path) -> None:
    pages = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        pages.append(report(tmp_path / name, 40)[0])

    for part in ('<svg class="map".*?</svg>', '<script type="application/json".*?</script>'):
        assert re.findall(part, pages[0]) == re.findall(part, pages[1]) != []


@pytest.mark.parametrize("lines", [1, 2])
def test_a_thinned_chart_keeps_the_extremes_of_every_stretch_and_its_gaps(lines: int) -> None:
    waves = [np.sin(np.arange(200_000) / (3000 + number)) for number in range(lines)]
    for wave in waves:
        wave[12_345], wave[77_777], wave[50_000:51_000] = 9.0, -9.0, np.nan

    rows = thinned_rows(waves)

    assert len(rows) <= 1.01 * ROWS
    assert (rows[0], rows[-1]) == (0, 199_999)
    assert {12_345, 77_777, 50_000} <= set(rows.tolist())
    for wave in waves:
        known = np.flatnonzero(np.isfinite(wave))
        whole, at = wave[known], np.searchsorted(known, rows[np.isfinite(wave[rows])])
        for begin in range(0, len(known), 1000):  # its extremes are kept, or higher and lower ones next to it
            part, kept = whole[begin : begin + 1000], whole[at[(at >= begin - 200) & (at < begin + 1200)]]
            assert kept.min() <= part.min() <= part.max() <= kept.max()
    assert not np.isfinite(waves[0][rows[(rows >= 50_000) & (rows < 51_000)]]).any()


def test_rows_where_nothing_is_known_are_one_gap() -> None:
    line = np.array([np.nan, np.nan, 1.0, np.nan, np.nan, np.nan, 2.0, np.nan])

    assert thinned_rows([line]).tolist() == [0, 2, 3, 6, 7]


def test_text_from_a_run_is_escaped(tmp_path: Path) -> None:
    html, page = report(tmp_path, fault_at=3.0)

    assert "<too large>" not in html
    assert "following error <too large>" in page.text


CLEARED = JobResult(id=2, kind=JobKind.CLEAR_TARGET, drive="traction-left", ok=True, values=(7,))
HISTORY = JobResult(id=1, kind=JobKind.READ_HISTORY, drive="steer-left", ok=True, values=(0x8611,))


@pytest.mark.parametrize("journalled", [True, False])
def test_a_fault_is_explained(tmp_path: Path, journalled: bool) -> None:
    observed = list(synthetic_run.run(hz=10.0, fault_at=3.0))
    tick = observed[-1].tick
    told = replace(
        tick, snapshot=replace(tick.snapshot, sensed=replace(tick.snapshot.sensed, results=(HISTORY, CLEARED)))
    )
    observed[-1] = dataclasses.replace(observed[-1], tick=told)
    journal = Journal(tmp_path / "journal.jsonl") if journalled else None
    synthetic_run.record(tmp_path / "recording.mcap", iter(observed), journal=journal)
    write_report(Recording(tmp_path), tmp_path / "report.html")

    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert text.count("DRV-25 steer-left: following error <too large>") == 2  # and among the events
    assert FAULTS["DRV-25"].advice in text
    assert ("drives off: the robot can roll" if journalled else "quick stop by the drives, then off") in text
    assert "fix the cause, acknowledge, arm" in text
    assert "Error history of steer-left: 0x8611 following error" in text
    assert text.count("Error history of") == 1, "other jobs bring other things back"


def test_a_run_without_a_fault_has_no_table_of_them(tmp_path: Path) -> None:
    html, _ = report(tmp_path, 20)

    assert "<h2>Faults</h2>" not in html


def test_many_faults_are_cut_short(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False)
    for number in range(MAX_FAULTS + 2):
        for _ in range(3):
            recorder.note(Entry(time=0.5 * number, kind="fault", text=f"DRV-25 drive-{number}: blocked"))
    recorder.close()
    write_report(Recording(tmp_path), tmp_path / "report.html")

    table = (tmp_path / "report.html").read_text().partition("<h2>Faults</h2>")[2].partition("</table>")[0]
    assert table.count("blocked (3 times)") == MAX_FAULTS
    assert table.index("drive-0:") < table.index("drive-1:")


def test_the_page_of_a_resumed_run_names_the_run_before(tmp_path: Path) -> None:
    resume_point = ResumePoint(run="20260301T110000Z-circle", position=Position(done=1.5), pose=Pose())
    path = synthetic_run.record(tmp_path / "recording.mcap", islice(synthetic_run.run(), 5), resume_point=resume_point)
    write_report(Recording(path), tmp_path / "report.html")

    assert "Resumes 20260301T110000Z-circle." in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("count", [0, 1, 19])
def test_a_run_that_stopped_early_has_a_page(tmp_path: Path, count: int) -> None:
    _, page = report(tmp_path, count)

    assert "Bus load" in page.text or count < 2
    assert "Cross-track error" not in page.text
    assert "No step began." in page.text


def test_a_damaged_recording_says_so_on_the_page(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(hz=10.0))
    path.write_bytes(path.read_bytes()[:-30_000])
    write_report(Recording(path), tmp_path / "report.html")

    assert "The recording is not whole: the file is cut off" in (tmp_path / "report.html").read_text()


def test_many_events_are_cut_short(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False)
    for number in range(MAX_ENTRIES + 7):
        recorder.note(Entry(time=0.0, kind="note", text=f"note number {number}"))
    recorder.close()
    write_report(Recording(tmp_path), tmp_path / "report.html")

    text = (tmp_path / "report.html").read_text()
    assert f"note number {MAX_ENTRIES - 1}<" in text
    assert f"note number {MAX_ENTRIES}<" not in text
    assert "8 more are in journal.jsonl." in text


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", iter(()))
    with pytest.raises(RecordingError, match=r"cannot be written: No such file"):
        write_report(Recording(path), tmp_path / "nowhere" / "report.html")


def test_a_thinned_line_keeps_its_extremes_and_its_ends() -> None:
    x = np.arange(100_000.0)
    y = np.sin(x / 3000)
    y[12_345], y[77_777], y[50_000:51_000] = 9.0, -9.0, np.nan

    thin_x, thin_y = thinned(x, y)

    assert len(thin_x) < 4000
    assert (np.nanmax(thin_y), np.nanmin(thin_y)) == (9.0, -9.0)
    assert thin_x[0] < 100
    assert thin_x[-1] > 99_900
    assert np.isnan(thin_y[(thin_x > 50_100) & (thin_x < 50_900)]).all()
    assert np.all(np.diff(thin_x) > 0)


def test_a_short_line_is_left_alone() -> None:
    x = np.arange(1000.0)

    assert thinned(x, 2 * x)[0] is x
