"""A distance that is shown by hand is recorded, kept, and followed in the same run; and as a file in another one."""

from __future__ import annotations

import itertools
import math
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from rig import CALIBRATE, MISSIONS, Run, run, write_mission

from artemis.commands.path_record import Drawing, RecordedPart, record_path
from artemis.motion.path import path_from_csv
from artemis.values import Mode, Request

pytestmark = [pytest.mark.slow, pytest.mark.short_alignment]
SHOW = {"teleop": {"input": "stick", "until": {"button": "done"}, "record": "shown"}}
STICK = {"stick": {"plugin": "scripted", "file": "stick.csv"}}


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("shown") / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    return run(folder / "record_and_follow.yaml", longest=300.0)


def kept(seen: Run) -> Path:
    assert seen.outcome is not None
    return seen.outcome.run.path / "paths" / "shown.csv"


def points(text: str) -> list[tuple[float, float]]:
    rows = [line.split(",") for line in text.splitlines() if line[:1] in "-0123456789"]
    return [(float(row[0]), float(row[1])) for row in rows]


def presses(seen: Run) -> list[float]:
    """Times at which the record button went down."""
    return [
        s.time
        for s in seen.in_mode(Mode.TELEOP)
        if any(Request.RECORD in sample.requests for sample in s.tick.snapshot.sensed.inputs)
    ]


def poses_between(seen: Run, begin: float, end: float) -> list[tuple[float, float]]:
    return [
        (s.tick.snapshot.odometry.pose.x, s.tick.snapshot.odometry.pose.y)
        for s in seen.in_mode(Mode.TELEOP)
        if begin <= s.time < end
    ]


def farthest(some: list[tuple[float, float]], others: list[tuple[float, float]]) -> float:
    """The largest distance [m] of one of some points from the nearest of others."""
    distances = [min(math.dist(point, other) for other in others) for point in some]
    return max(distances)


@pytest.mark.slow
def test_the_mission_is_done_and_stays_on_what_it_was_shown(seen: Run) -> None:
    assert (seen.status, seen.fault_ids) == (0, [])
    assert seen.is_done
    assert seen.ticks[-1].wish.finished
    assert seen.cross_track() < 0.02
    tracking = seen.in_mode(Mode.FOLLOW)[-1].tick.wish.tracking
    assert tracking is not None
    assert tracking.arc_length == pytest.approx(2 * math.tau * 1.414, abs=0.2)  # two laps of the circle


def test_the_path_that_was_shown_is_kept(seen: Run) -> None:
    begin, end = presses(seen)
    driven = poses_between(seen, begin, end)
    written = points(kept(seen).read_text())
    assert farthest(written, driven) < 1e-3
    assert farthest(driven, written) < 0.055  # the last point is up to a spacing before the end
    steps = [math.dist(a, b) for a, b in itertools.pairwise(written)]
    assert min(steps) > 0.04


@pytest.mark.slow
def test_its_recording_replays_bit_for_bit(seen: Run) -> None:
    result = seen.recompute()
    assert (result.difference, result.ticks) == (None, len(seen.seen))


@pytest.mark.slow
def test_a_path_file_of_the_run_is_followed_by_another_run(
    seen: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert seen.outcome is not None
    file = tmp_path / "mission" / "loop.csv"
    file.parent.mkdir()
    status = record_path(seen.outcome.run.path, file, RecordedPart(name="shown"), Drawing(close_within=1.0), speed=0.3)
    assert status == 0
    assert "closed" in capsys.readouterr().out
    by_hand = poses_between(seen, *presses(seen))
    assert farthest(by_hand, points(file.read_text())) < 0.03
    path = path_from_csv(file.read_text(), "loop.csv")
    assert path.closed
    step = {
        "follow": {
            "path": "loop.csv",
            "start": "nearest",
            "follower": {"plugin": "indiveri", "speed_m_s": 0.3},
        }
    }
    again = run(write_mission(file.parent, [CALIBRATE, step]), longest=120.0)
    assert (again.status, again.fault_ids) == (0, [])
    assert again.in_mode(Mode.FOLLOW)[-1].tick.snapshot.odometry.distance > 8.0
    last = [s.tick.wish.tracking for s in again.in_mode(Mode.FOLLOW)][-500:]
    assert max(abs(tracking.cross_track) for tracking in last if tracking) < 0.02


Shown = Callable[..., Run]


@pytest.fixture(scope="module")
def shown_with(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """A run with presses of the record button at these times, made once."""
    return cache(lambda *presses_at: straight_on(presses_at, tmp_path_factory.mktemp("straight_on")))


def straight_on(presses_at: tuple[float, ...], folder: Path) -> Run:
    """Drive straight on from 6.4 s to 16.4 s, with presses of the record button."""
    rows = [(0.0, 0, 0, 0), (5.4, 1, 0, 0), (6.4, 1, 0.5, 0), (16.4, 1, 0.0, 0), (18.4, 0, 0.0, 0)]
    for time in presses_at:
        rows += [(time, 1, 0.5, 1), (time + 0.1, 1, 0.5, 0)]
    lines = [f"{time},0,{y},{enable},{record},0" for time, enable, y, record in sorted(rows)]
    table = "\n".join(["time_s,x,y,enable,record,done", *lines, "18.9,0,0,0,0,1"]) + "\n"
    return run(write_mission(folder, [CALIBRATE, SHOW], {"stick.csv": table}, inputs=STICK))


@pytest.mark.parametrize(("presses_at", "from_press", "to_press"), [([7.4, 11.4], 0, 1), ([7.4, 9.4, 12.4], 2, None)])
def test_a_second_press_ends_the_recording_and_a_third_begins_it_anew(
    shown_with: Shown, presses_at: list[float], from_press: int, to_press: int | None
) -> None:
    seen = shown_with(*presses_at)
    assert seen.status == 0
    times = presses(seen)
    assert len(times) == len(presses_at)
    end = math.inf if to_press is None else times[to_press]
    driven = poses_between(seen, times[from_press], end)
    written = points(kept(seen).read_text())
    assert math.dist(written[0], driven[0]) < 1e-3
    assert math.dist(written[-1], driven[-1]) < 0.06
    assert farthest(written, driven) < 1e-3


def test_nobody_who_presses_records_the_whole_step(shown_with: Shown) -> None:
    seen = shown_with()
    written = points(kept(seen).read_text())
    assert written[0] == pytest.approx((0.0, 0.0), abs=1e-3)
    driven = poses_between(seen, 0.0, math.inf)
    assert math.dist(written[-1], driven[-1]) < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("presses_at", [[], [7.4, 11.4], [7.4, 9.4, 12.4], [8.4]])
def test_a_path_by_its_name_is_what_the_run_has_kept(
    shown_with: Shown, tmp_path: Path, presses_at: list[float]
) -> None:
    seen = shown_with(*presses_at)
    assert seen.outcome is not None
    record_path(seen.outcome.run.path, tmp_path / "again.csv", RecordedPart(name="shown"), Drawing())
    again, written = points((tmp_path / "again.csv").read_text()), points(kept(seen).read_text())
    assert math.dist(again[0], written[0]) < 1e-3
    assert math.dist(again[-1], written[-1]) < 0.06
    assert farthest(written, again) < 0.03
