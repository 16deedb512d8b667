"""`artemis report RUN --with RUN2` on two circles made by hand: one whole, one with a fault on its way."""

from __future__ import annotations

import json
import re
from itertools import dropwhile
from pathlib import Path

import pytest
import synthetic_run
from test_report_page import Page, held

from artemis.commands.report import report_with
from artemis.errors import ConfigError


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The second one's recording begins 1.2 s later."""
    folder = tmp_path_factory.mktemp("runs")
    whole, stopped = folder / "whole", folder / "stopped"
    for each in (whole, stopped):
        each.mkdir()
    synthetic_run.record(whole / "recording.mcap", synthetic_run.run(hz=10.0))
    late = dropwhile(lambda each: each.tick.snapshot.sensed.time < 1.2, synthetic_run.run(hz=10.0, fault_at=9.0))
    synthetic_run.record(stopped / "recording.mcap", late)
    return whole, stopped


def test_two_runs_are_in_each_chart_on_one_map_and_in_one_table(
    runs: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    report_with(*runs, at="start")

    said = capsys.readouterr().out
    page = runs[0] / "with-stopped.html"
    assert said.splitlines()[-1] == str(page)
    assert re.search(r"^duration \[s\] +2\d\.\d0 +8\.90 +-\d+\.\d0$", said, re.MULTILINE)
    assert re.search(r"^faults +0 +1 +\+1$", said, re.MULTILINE)
    html = page.read_text()
    data, shown = held(html), Page(html)
    assert all([part["run"] for part in chart["parts"]] == [0, 1] for chart in data["charts"])
    assert data["begins"][0] == ["start", [0.0, 1.2]]
    assert [len(run["places"]) for run in data["runs"]] == [4, 4]
    for text in ("A: driven (odometry)", "B: driven (odometry)", "Faults of B", "Events of A", "aligned at"):
        assert text in shown.text
    assert "Faults of A" not in shown.text
    assert not (runs[0] / "report.html").exists()


def test_runs_are_aligned_at_a_step(runs: tuple[Path, Path]) -> None:
    report_with(*runs, at="follow")

    html = (runs[0] / "with-stopped.html").read_text()
    ((name, (first, second)),) = [begin for begin in held(html)["begins"] if begin[0] != "start"]
    assert name == "follow paths/circle.csv"
    assert first == second
    assert f'<option value="1" selected>{name}</option>' in html
    assert json.dumps(name) in html


def test_a_step_that_both_do_not_have_is_refused(runs: tuple[Path, Path]) -> None:
    expected = "--at teleop: no step of both runs begins so; expected start, follow paths/circle.csv"
    with pytest.raises(ConfigError, match=re.escape(expected)):
        report_with(*runs, at="teleop")
