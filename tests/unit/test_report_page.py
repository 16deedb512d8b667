from __future__ import annotations

import dataclasses
from html.parser import HTMLParser
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
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
from artemis.report import figures
from artemis.report.figures import thinned
from artemis.report.page import MAX_ENTRIES, MAX_FAULTS, write_report
from artemis.supervision.catalogue import ROWS
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


@pytest.fixture
def text_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes most of the time: only where figures matter."""
    monkeypatch.setattr(figures, "FIGURES", ())


def report(tmp_path: Path, count: int | None = None, fault_at: float | None = None) -> tuple[str, Page]:
    path = synthetic_run.record(
        tmp_path / "recording.mcap", islice(synthetic_run.run(hz=10.0, fault_at=fault_at), count)
    )
    write_report(Recording(path), tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    return html, Page(html)


def test_a_run_gives_one_page_with_all_figures(tmp_path: Path) -> None:
    html, page = report(tmp_path)

    assert page.elements.count("svg") == 6
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
        assert "currentColor" in part


@pytest.mark.usefixtures("text_only")
def test_text_from_a_run_is_escaped(tmp_path: Path) -> None:
    html, page = report(tmp_path, fault_at=3.0)

    assert "<too large>" not in html
    assert "following error <too large>" in page.text


CLEARED = JobResult(id=2, kind=JobKind.CLEAR_TARGET, drive="traction-left", ok=True, values=(7,))
HISTORY = JobResult(id=1, kind=JobKind.READ_HISTORY, drive="steer-left", ok=True, values=(0x8611,))


@pytest.mark.usefixtures("text_only")
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
    assert ROWS["DRV-25"].advice in text
    assert ("drives off: the robot can roll" if journalled else "quick stop by the drives, then off") in text
    assert "fix the cause, acknowledge, arm" in text
    assert "Error history of steer-left: 0x8611 following error" in text
    assert text.count("Error history of") == 1, "other jobs bring other things back"


@pytest.mark.usefixtures("text_only")
def test_a_run_without_a_fault_has_no_table_of_them(tmp_path: Path) -> None:
    html, _ = report(tmp_path, 20)

    assert "<h2>Faults</h2>" not in html


@pytest.mark.usefixtures("text_only")
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


@pytest.mark.usefixtures("text_only")
def test_the_page_of_a_resumed_run_names_the_run_before(tmp_path: Path) -> None:
    resume_point = ResumePoint(run="20260301T110000Z-circle", position=Position(done=1.5), pose=Pose())
    path = synthetic_run.record(tmp_path / "recording.mcap", islice(synthetic_run.run(), 5), resume_point=resume_point)
    write_report(Recording(path), tmp_path / "report.html")

    assert "Resumes 20260301T110000Z-circle." in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("count", [0, 1, 19])
def test_a_run_that_stopped_early_has_a_page(tmp_path: Path, count: int) -> None:
    _, page = report(tmp_path, count)

    assert page.elements.count("svg") == 5
    assert "Cross-track error" not in page.text
    assert "No step began." in page.text


@pytest.mark.usefixtures("text_only")
def test_a_damaged_recording_says_so_on_the_page(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(hz=10.0))
    path.write_bytes(path.read_bytes()[:-30_000])
    write_report(Recording(path), tmp_path / "report.html")

    assert "The recording is not whole: the file is cut off" in (tmp_path / "report.html").read_text()


@pytest.mark.usefixtures("text_only")
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


@pytest.mark.usefixtures("text_only")
def test_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", iter(()))
    with pytest.raises(RecordingError, match=r"cannot be written: No such file"):
        write_report(Recording(path), tmp_path / "nowhere" / "report.html")


def test_the_users_matplotlib_settings_stay(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    report(tmp_path, 0)

    assert dict(mpl.rcParams) == before


def test_equal_runs_give_equal_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FIGURES", figures.FIGURES[4:5])
    pages = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        html, _ = report(tmp_path / name, 40)
        pages.append(html[html.index("<svg") : html.index("</svg>")])

    assert pages[0] == pages[1]


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
