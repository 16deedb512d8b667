from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import core_builders
import pytest
from msgspec.structs import replace

from artemis.commands.live import LiveView, status
from artemis.commands.terminal import lose_output
from artemis.plugins.observing import QUEUE_TICKS, Observation
from artemis.supervision import catalogue
from artemis.values import (
    Fault,
    JobKind,
    JobResult,
    LocatedPose,
    Mode,
    Odometry,
    Request,
    Sensed,
    SetPoints,
    Severity,
    Snapshot,
    Tick,
    Tracking,
    Verdict,
    Wish,
)

OVERHEATED = Fault(id="DRV-06", severity=Severity.QUICK_STOP, text="steer-left: too hot", device="steer-left")
BITRATE = 1_000_000
LINE = 30
"""A line that is said here has more characters."""
EXPLAINED = [
    "                 look  wait five minutes; is a wheel dragging?",
    "              artemis  quick stop by the drives, then off",
    "                 next  fix the cause, acknowledge, arm",
]


def tick(
    time: float = 0.0,
    mode: Mode = Mode.FOLLOW,
    phase: str = "following",
    *,
    requests: tuple[Request, ...] = (),
    results: tuple[JobResult, ...] = (),
    faults: tuple[Fault, ...] = (),
    tracking: Tracking | None = None,
) -> Tick:
    verdict = Verdict(severity=max((fault.severity for fault in faults), default=Severity.NONE), faults=faults)
    snapshot = Snapshot(
        sensed=Sensed(index=0, time=time, requests=requests, results=results),
        dt=0.02,
        pose=LocatedPose(),
        odometry=Odometry(speed=0.2, steering=0.1),
        standing=False,
        set_points=SetPoints(),
        verdict=verdict,
    )
    wish = Wish(phase=phase, tracking=tracking)
    return Tick(snapshot=snapshot, mode=mode, wish=wish, set_points=SetPoints())


def said(capsys: pytest.CaptureFixture[str], *ticks: Tick) -> list[str]:
    view = LiveView("title", "", lambda: None, BITRATE, core_builders.ROBOT.errors)
    for seen in ticks:
        view.see(seen, (), seen.snapshot.time)
    view.close()
    return capsys.readouterr().out.splitlines()[1:]


def test_a_line_comes_with_each_change_of_mode_or_phase_and_not_otherwise(capsys: pytest.CaptureFixture[str]) -> None:
    ticks = [tick(1.0), tick(1.02), tick(1.04, Mode.READY, ""), tick(1.06, Mode.QUICKSTOP, "stopping")]
    assert said(capsys, *ticks, tick(1.08, Mode.QUICKSTOP, "stopped"), tick(1.1)) == [
        "    1.00 s  follow     following",
        "    1.06 s  quickstop  stopping",
        "    1.08 s  quickstop  stopped",
        "    1.10 s  follow     following",
    ]


def test_the_cause_comes_before_its_effect_and_each_fault_once(capsys: pytest.CaptureFixture[str]) -> None:
    history = JobResult(id=1, kind=JobKind.READ_HISTORY, drive="steer-left", ok=True, values=(0x4210,))
    ticks = [
        tick(1.0, requests=(Request.QUICKSTOP,), mode=Mode.QUICKSTOP, phase="stopping"),
        tick(2.0, faults=(OVERHEATED,), mode=Mode.FAULT, phase="stopping"),
        tick(2.1, faults=(OVERHEATED,), mode=Mode.FAULT, phase="stopping", results=(history,)),
        tick(3.0, mode=Mode.INIT, phase="listening"),
        tick(4.0, faults=(OVERHEATED,), mode=Mode.FAULT, phase="stopping"),
    ]
    assert said(capsys, *ticks) == [
        "    1.00 s  request    quick stop",
        "    1.00 s  quickstop  stopping",
        "    2.00 s  FAULT      DRV-06 steer-left: too hot",
        *EXPLAINED,
        "    2.00 s  fault      stopping",
        "    2.10 s  history    steer-left: 0x4210 over-temperature",
        "    3.00 s  cleared    DRV-06 steer-left",
        "    3.00 s  init       listening",
        "    4.00 s  FAULT      DRV-06 steer-left: too hot",
        *EXPLAINED,
        "    4.00 s  fault      stopping",
    ]


def test_a_request_that_an_input_repeats_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    asked = [(Request.DONE,), (Request.DONE,), (Request.DONE, Request.QUICKSTOP), (), (Request.DONE,)]
    lines = said(
        capsys, *(tick(float(number), Mode.TELEOP, requests=requests) for number, requests in enumerate(asked))
    )
    assert [line.split() for line in lines if "request" in line] == [
        ["0.00", "s", "request", "done"],
        ["2.00", "s", "request", "quick", "stop"],
        ["4.00", "s", "request", "done"],
    ]


def test_the_view_of_a_scanner_that_was_accepted_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    blind, asks = catalogue.fault("LAS-06", "front"), (Request.ACKNOWLEDGE,)
    lines = said(
        capsys,
        tick(1.0, Mode.QUICKSTOP, faults=(blind,)),
        tick(2.0, Mode.QUICKSTOP, requests=asks, faults=(blind,)),
        tick(3.0, Mode.QUICKSTOP, requests=asks),
    )
    assert [line.split("request    ")[1] for line in lines if "request" in line] == [
        f"acknowledge: ignored, its cause is still present: {blind.text}",
        "acknowledge: the view of scanner front is taken as it is",
    ]


def test_a_fault_that_came_once_too_often_says_that_this_run_is_over(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, tick(1.0, faults=(replace(OVERHEATED, final=True),)))
    assert lines[3] == "                 next  not in this run: fix the cause, then continue with --resume"


def test_a_fault_that_became_worse_is_explained_again(capsys: pytest.CaptureFixture[str]) -> None:
    warning = Fault(id="DSK-02", severity=Severity.WARN, text="recording.mcap: full")
    worse = replace(warning, severity=Severity.CONTROLLED_STOP, text="journal.jsonl: full")
    lines = said(capsys, tick(), tick(faults=(warning,)), tick(faults=(worse,)), tick(faults=(worse,)))
    assert [line[12:] for line in lines if "FAULT" in line] == [
        "FAULT      DSK-02 recording.mcap: full",
        "FAULT      DSK-02 journal.jsonl: full",
    ]
    assert [line.strip() for line in lines if "artemis  " in line] == [
        "artemis  nothing: the run continues",
        "artemis  controlled stop, drives stay on",
    ]


def test_a_warning_asks_for_no_acknowledgment(capsys: pytest.CaptureFixture[str]) -> None:
    """An observer's failure, whose row stops the robot for other plugins."""
    failed = Fault(id="PLG-01", severity=Severity.WARN, text="page: it failed")
    assert said(capsys, tick(), tick(faults=(failed,)))[-1].strip() == "next  fix the cause before the next run"


def test_a_stale_set_point_that_was_cleared_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    cleared = JobResult(id=1, kind=JobKind.CLEAR_TARGET, drive="traction-left", ok=True, values=(250,))
    lines = said(capsys, tick(1.0, results=(cleared,)))
    assert lines[0] == "    1.00 s  target     traction-left: stale set-point 250 cleared"


def test_a_robot_that_does_not_stop_raises_the_alarm_once(capsys: pytest.CaptureFixture[str]) -> None:
    def alarmed(time: float) -> Tick:
        seen = tick(time)
        return replace(seen, snapshot=replace(seen.snapshot, verdict=Verdict(alarm=True)))

    lines = said(capsys, tick(1.0), alarmed(2.0), alarmed(3.0))
    assert lines[1:] == ["    2.00 s  ALARM      the robot does not stop: PRESS THE EMERGENCY STOP"]


@pytest.mark.parametrize("width", [0, 5, 30, 60, 75, 76, 77, 78, 100, 200])
def test_the_changing_line_fits(width: int) -> None:
    tracking = Tracking(arc_length=1.0, length=4.0, cross_track=-0.012)
    line = status(tick(12.5, tracking=tracking), width)
    assert len(line) <= width
    whole = "   12.50 s  follow     +0.20 m/s   +5.7°  cross-track  -12 mm    1.0 of 4.0 m"
    assert line.startswith(whole[:width])


@pytest.mark.parametrize(
    ("where", "head"),
    [("follow paths/a.csv, round 2/3", "follow paths/a.csv, round 2/3  +0"), ("wait 1 s", "follow     wait 1 s  +0")],
)
def test_the_changing_line_names_the_step_of_a_mission_with_words(where: str, head: str) -> None:
    tracking = Tracking(arc_length=1.0, length=4.0, cross_track=-0.012)
    assert status(tick(12.5, tracking=tracking), 100, where=where).startswith(f"   12.50 s  {head}")
    assert len(status(tick(12.5, tracking=tracking), 40, where=where)) == 40
    assert "  after wait 1 s: timeout  █" in status(tick(12.5, tracking=tracking), 160, 0.0, where, "wait 1 s: timeout")
    assert status(tick(12.5), 160, 0.0, where, "wait 1 s: timeout").endswith("following  after wait 1 s: timeout")


@pytest.mark.parametrize(("arc_length", "full"), [(-0.1, 0), (0.0, 0), (1.0, 8), (4.0, 30), (4.1, 30)])
def test_the_bar_shows_the_way_gone(arc_length: float, full: int) -> None:
    bar = re.search("[█░]+", status(tick(tracking=Tracking(arc_length=arc_length, length=4.0, cross_track=0.0)), 120))
    assert bar is not None
    assert bar[0] == "█" * full + "░" * (30 - full)


def test_output_that_nobody_reads_never_holds_up_a_tick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A pipe holds 64 KiB at most; without a thread of its own the view would wait here for ever."""
    lost: list[str] = []
    source, sink = os.pipe()
    monkeypatch.setattr(sys, "stdout", os.fdopen(sink, "w"))
    with sys.stdout:
        view = Observation(
            "live view",
            LiveView("title", "", lambda: lost.append("lost"), BITRATE, core_builders.ROBOT.errors),
            threaded=True,
            patience=None,
        )
        for number in range(5000):
            request = Request.QUICKSTOP if number % 2 else Request.ACKNOWLEDGE
            view.see(tick(float(number), requests=(request,)), (), float(number))
        assert lost == []
        os.close(source)
        for number in range(3):
            view.see(tick(float(number), requests=(Request.END,)), (), float(number))
        view.close()
    assert lost == ["lost"]
    assert view.dropped >= 5000 - 64 * 1024 // LINE - QUEUE_TICKS
    assert [id for id, _, _ in view.take_problems()].count("PLG-03") == 2  # when it began, and how many at the end


def test_a_closed_standard_output_is_lost_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "out").open("w") as file:
        os.close(file.fileno())
        monkeypatch.setattr(sys, "stdout", file)
        lose_output()
        file.write("goes nowhere")
        file.flush()
    assert not (tmp_path / "out").read_bytes()
