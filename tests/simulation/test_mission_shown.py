"""What people see of a mission with words: the report's steps and picture, and why the run ended."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from resuming import Done, run
from rig import CALIBRATE, follow, write_mission

from artemis.commands.live import LiveView
from artemis.commands.run import run_and_report
from artemis.page.view import PageView
from artemis.recording.mcap_reader import Recording
from artemis.report.mission_times import MissionTimes
from artemis.report.page import write_report
from artemis.report.series import Series, read_series
from artemis.report.summary import summary
from artemis.states.modes import RUNNING
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment

WAIT = {"wait": {"seconds": 0.3}}
NEVER = {"wait": {"for": "run_s > 1000", "at_most_s": 0.3}}
LATE = {"try": {"retries": 1, "between": [WAIT], "steps": [NEVER], "catch": {"timeout": [{"say": "late"}]}}}
STEPS: list[Any] = [
    CALIBRATE,
    {"repeat": {"times": 2, "steps": [LATE]}},
    {"during": {"steps": [follow(0.4)], "when": [{"if": "driven_m > 0.4", "steps": [WAIT]}]}},
    {"choose": [{"if": "run_s > 1000", "steps": [{"wait": {"seconds": 9}}]}]},
    {"together": {"steps": [WAIT], "beside": [{"repeat": {"times": 2, "steps": [{"wait": {"seconds": 0.1}}]}}]}},
]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    return run(write_mission(tmp_path_factory.mktemp("mission"), STEPS))


@pytest.fixture(scope="module")
def shown(done: Done) -> Series:
    return read_series(Recording(done.folder))


def test_each_step_is_told_with_how_often_and_how_long_it_ran_and_its_outcome(done: Done, shown: Series) -> None:
    assert [(step.name, step.number, step.left) for step in shown.mission.steps] == [
        ("calibrate steering", 1, "done"),
        ("wait for run_s > 1000", 4, "timeout"),
        ("wait 0.3 s", 2, "done"),
        ("follow line.csv", 1, "done"),
        ("wait 0.3 s", 1, "done"),
        ("wait 9 s", 0, ""),
        ("wait 0.3 s", 1, "done"),
        ("wait 0.1 s", 2, "done"),
    ]
    times = [step.time for step in shown.mission.steps]
    ran = [tick.position.step for tick in done.ticks if tick.mode in RUNNING]
    assert times == pytest.approx([0.02 * ran.count(number) for number in range(len(times))])
    assert times[5] == times[7] == 0.0
    assert times[1] > 4 * 0.3
    assert shown.mission.failure == shown.mission.remedy == ""


def test_on_the_way_it_is_told_how_often_and_how_long_the_present_step_ran_and_how_the_one_before_ended(
    done: Done,
) -> None:
    times, seen = MissionTimes(Recording(done.folder).mission), dict[str, str]()
    for tick in done.ticks:
        times.see(tick)
        seen[re.sub(r"[0-9]+ s$", "", times.here)] = times.before
    assert seen == {
        "": "wait 0.3 s: done",
        "calibrate steering, 1x ": "",
        "wait for run_s > 1000, round 1/2, 1x ": "calibrate steering: done",
        "wait 0.3 s, round 1/2, attempt 2/2, 1x ": "wait for run_s > 1000: timeout",
        "wait for run_s > 1000, round 1/2, attempt 2/2, 2x ": "wait 0.3 s: done",
        "wait for run_s > 1000, round 2/2, 3x ": "wait for run_s > 1000: timeout",
        "wait 0.3 s, round 2/2, attempt 2/2, 2x ": "wait for run_s > 1000: timeout",
        "wait for run_s > 1000, round 2/2, attempt 2/2, 4x ": "wait 0.3 s: done",
        "follow line.csv, 1x ": "wait 0.3 s: done",
        "wait 0.3 s, 1x ": "follow line.csv: done",
    }


def test_a_view_shows_rounds_attempts_and_the_last_outcome(
    done: Done, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("artemis.commands.live.REFRESH", -1.0)
    monkeypatch.setenv("COLUMNS", "160")
    mission = Recording(done.folder).mission
    view = LiveView("title", "", lambda: None, 1_000_000, {}, MissionTimes(mission))
    page = PageView(Recording(done.folder).robot, mission, {})
    for tick in done.ticks:
        view.see(tick, [], tick.snapshot.time)
        page.show(tick)
        if tick.mode is Mode.FOLLOW:
            state, progress = page.state(tick), page.parts["progress"][1]
            assert state["ran"][0] == 1
    told = capsys.readouterr().out
    assert "wait for run_s > 1000, round 2/2, attempt 2/2, 4x 1 s  +0.00 m/s" in told
    assert "waiting  after wait 0.3 s: done" in told
    assert progress["before"] == "follow line.csv: done"
    assert progress["marks"]["steps[1].repeat.steps[0].try.steps[0].wait"] == "4x · 1.3 s · timeout"
    assert progress["marks"]["steps[1].repeat.steps[0].try"] == "retried 2x · caught 2x"
    assert progress["counts"] == []


def test_the_report_has_the_picture_with_what_ran(done: Done, shown: Series, tmp_path: Path) -> None:
    write_report(Recording(done.folder), tmp_path / "report.html", shown)
    page = (tmp_path / "report.html").read_text()
    (picture,) = re.findall(r'<div class="chart">(.*?)</div>', page, re.DOTALL)
    for mark in ("4x · 1.3 s · timeout", "retried 2x · caught 2x", "next round 1x", "condition met 1x", "2x · done"):
        assert f">{mark}</text>" in picture
    assert picture.count('opacity=".45"') == 1
    assert "<td>steps[1].repeat.steps[0].try.steps[0].wait</td><td>timeout</td>" in page


def test_a_list_of_steps_has_no_picture(tmp_path: Path) -> None:
    listed = run(write_mission(tmp_path, [CALIBRATE, WAIT]))
    write_report(Recording(listed.folder), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert 'class="chart"' not in page
    assert '<th>step</th><th class="number">begin [s]</th>' in page


END = {"end": {"outcome": "failed", "say": "nothing left to try"}}


@pytest.mark.parametrize(
    ("step", "why", "remedy"),
    [
        (NEVER, "step “wait for run_s > 1000” (steps[1].wait) ended with timeout, and no try catches that", "timeout"),
        (
            {"during": {"at_most_s": 0.5, "steps": [{"wait": {"seconds": 9}}]}},
            "steps[1].during (0.5 s) ended with timeout, and no try catches that",
            "timeout",
        ),
        (
            {"during": {"steps": [{"wait": {"seconds": 9}}], "when": [{"if": "run_s > 6", "then": "full"}]}},
            "steps[1].during (run_s > 6) ended with full, and no try catches that",
            "full",
        ),
        (END, "the mission ended itself at steps[1].end: nothing left to try", ""),
    ],
)
def test_the_result_says_which_outcome_ended_the_mission_and_how_to_catch_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], step: dict[str, Any], why: str, remedy: str
) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, step])
    assert run_and_report(mission, simulate=False) == 1
    lines = capsys.readouterr().out.splitlines()
    at = lines.index(f"result        FAILED: {why}")
    told = f"to continue then, write try: {{steps: [...], catch: {{{remedy}: [...]}}}} around it"
    assert (lines[at + 1].strip() == told) is bool(remedy)
    (folder,) = (tmp_path / "runs").iterdir()
    assert summary(Recording(folder)).result == f"failed: {why}"


FAULT = {"inject": "DRV-25", "node": "steer-left", "at_s": 8.0}


@pytest.mark.parametrize(
    ("faults", "asked", "why"),
    [
        ([FAULT], {}, "DRV-25 steer-left: cannot follow its set-point (EMCY 0x8611)"),
        ([], {8.0: "quickstop", 9.0: "end"}, "quick stop requested, then end requested"),
        ([FAULT], {11.0: "acknowledge", 13.0: "arm", 14.0: "end"}, "end requested"),
    ],
)
def test_the_result_says_what_stopped_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], faults: list[Any], asked: dict[float, str], why: str
) -> None:
    simulation = {"faults": faults, "operator": [{"at_s": at, "do": what} for at, what in asked.items()]}
    mission = write_mission(tmp_path, [CALIBRATE, follow(0.1)], simulation=simulation)
    assert run_and_report(mission, simulate=False) == 1
    assert f"result        FAILED: {why}\n" in capsys.readouterr().out
    (folder,) = (tmp_path / "runs").iterdir()
    assert summary(Recording(folder)).result == f"failed: {why}"
    assert f'<p class="result bad">failed: {why}' in (folder / "report.html").read_text()


def test_a_fault_that_no_try_catches_any_more_is_the_result(tmp_path: Path) -> None:
    fault = {"inject": "DRV-25", "node": "steer-left", "at_s": 10.0}
    by_hand = [{"at_s": 14.0, "do": "acknowledge"}, {"at_s": 16.0, "do": "arm"}]
    catch = {"try": {"steps": [follow(0.1)], "catch": {"fault": [NEVER]}}}
    failed = run(write_mission(tmp_path, [CALIBRATE, catch], simulation={"faults": [fault], "operator": by_hand}))
    seen = read_series(Recording(failed.folder)).mission
    assert [step.left for step in seen.ran] == ["done", "fault:DRV-25", "timeout"]
    assert seen.steps[1].time < 10.0, "time in the fault does not count"
    assert "steps[1].try.catch.fault[0].wait) ended with timeout" in seen.failure
