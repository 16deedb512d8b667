"""Paths with reversals and paths driven backwards, by whole missions on simulated drives."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest
import resuming
from rig import CALIBRATE, MISSIONS, Run, run, straight, write_mission

from artemis.commands.path_record import Drawing, RecordedPart, record_path
from artemis.commands.replay import replay_run
from artemis.motion.route import route_from_csv
from artemis.recording.mcap_reader import Recording
from artemis.report.series import read_series
from artemis.values import Mode
from artemis_lab.campaign.one_run import run_scenario
from artemis_lab.campaign.scenario import Scenario

pytestmark = [pytest.mark.slow, pytest.mark.short_alignment]
STICK = {"stick": {"plugin": "scripted", "file": "stick.csv"}}
SHOW: dict[str, Any] = {"teleop": {"input": "stick", "until": {"button": "done"}, "record": "shown"}}


def follow(path: object = "line.csv", speed: float = 0.3, plugin: str = "indiveri", **keys: object) -> dict[str, Any]:
    return {"follow": {"path": path, "follower": {"plugin": plugin, "speed_m_s": speed}, **keys}}


def directions(seen: Run) -> list[int]:
    """In which directions it was followed, one after the other: 1 forwards, -1 backwards."""
    speeds = [s.tick.set_points.speed for s in seen.in_mode(Mode.FOLLOW) if s.tick.set_points.speed]
    return [int(math.copysign(1, sign)) for sign, _ in itertools.groupby(speeds, key=lambda v: math.copysign(1, v))]


def arc_lengths(seen: Run) -> list[float]:
    return [s.tick.wish.tracking.arc_length for s in seen.in_mode(Mode.FOLLOW) if s.tick.wish.tracking]


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("turn") / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    return run(folder / "three_point_turn.yaml", longest=120.0)


@pytest.mark.slow
def test_a_three_point_turn_is_driven_to_its_end(turned: Run) -> None:
    assert (turned.status, turned.fault_ids) == (0, [])
    assert directions(turned) == [1, -1, 1]
    assert turned.cross_track() < 0.02
    end = turned.seen[-1].tick.snapshot.odometry.pose
    assert (end.x, end.y) == pytest.approx((0.0, 0.065), abs=0.04)
    assert abs(end.heading) == pytest.approx(math.pi, abs=0.06)


def test_its_arc_length_counts_on_and_it_stands_at_each_reversal(turned: Run) -> None:
    distances = arc_lengths(turned)
    assert all(later > sooner - 0.01 for sooner, later in itertools.pairwise(distances))
    assert distances[-1] == pytest.approx(3.663, abs=0.03)
    lengths = [s.tick.wish.tracking.length for s in turned.in_mode(Mode.FOLLOW) if s.tick.wish.tracking]
    assert max(lengths) - min(lengths) < 1e-6
    for cusp in (1.504, 2.159):
        near = [s for s in turned.in_mode(Mode.FOLLOW) if abs((arc_of(s) or 0.0) - cusp) < 0.04]
        assert any(s.tick.snapshot.standing for s in near)
        steered = [s.tick.snapshot.odometry.steering for s in near]
        assert min(steered) < -0.4 < 0.4 < max(steered), "the wheels are turned from one side to the other"


def arc_of(seen: Any) -> float | None:  # noqa: ANN401
    return None if seen.tick.wish.tracking is None else seen.tick.wish.tracking.arc_length


def test_its_recording_replays_and_its_report_has_the_error_on_every_part(turned: Run) -> None:
    assert turned.outcome is not None
    assert turned.recompute().difference is None
    series = read_series(Recording(turned.outcome.run.path))
    assert len(series.paths) == 3
    known = series.cross_track == series.cross_track
    assert abs(series.true_cross_track[known]).max() < 0.03
    assert series.true_arc_length[known] == pytest.approx(series.arc_length[known], abs=0.03)


@pytest.mark.parametrize("plugin", ["frenet"])
def test_other_followers_reverse_as_well(plugin: str, tmp_path: Path) -> None:
    table = (MISSIONS / "paths/three_point_turn.csv").read_text()
    seen = run(write_mission(tmp_path, [CALIBRATE, follow("turn.csv", plugin=plugin)], {"turn.csv": table}))
    assert (seen.status, seen.fault_ids) == (0, [])
    assert directions(seen) == [1, -1, 1]
    assert seen.cross_track() < 0.2


@pytest.mark.slow
def test_a_straight_is_driven_backwards_by_the_mission_or_by_the_headings(tmp_path: Path) -> None:
    behind = "x,y\n" + "".join(f"{-x / 10},0\n" for x in range(16))
    headings = "x,y,heading\n" + "".join(f"{-x / 10},0,0\n" for x in range(16))
    cases: list[tuple[str, str, dict[str, Any]]] = [("a", behind, BACKWARD), ("b", headings, {})]
    for folder, table, keys in cases:
        seen = run(write_mission(tmp_path / folder, [CALIBRATE, follow(**keys)], {"line.csv": table}))
        assert (seen.status, seen.fault_ids, directions(seen)) == (0, [], [-1])
        assert seen.cross_track() < 0.005
        end = seen.seen[-1].tick.snapshot.odometry
        assert (end.pose.x, end.pose.heading, end.distance) == pytest.approx((-1.5, 0.0, -1.5), abs=0.03)


def test_a_path_is_driven_back_out_from_its_end(tmp_path: Path) -> None:
    steps = [CALIBRATE, follow(), follow(from_end=True)]
    seen = run(write_mission(tmp_path, steps, {"line.csv": straight(1.5)}))
    assert (seen.status, seen.fault_ids, directions(seen)) == (0, [], [1, -1])
    end = seen.seen[-1].tick.snapshot.odometry.pose
    assert (end.x, end.heading) == pytest.approx((0.0, 0.0), abs=0.03)
    assert seen.outcome is not None
    series = read_series(Recording(seen.outcome.run.path))
    known = series.cross_track == series.cross_track
    assert series.true_arc_length[known] == pytest.approx(series.arc_length[known], abs=0.03)


TO_AND_FRO = """time_s, x, y, enable, done
0.0, 0, 0, 0, 0
6.4, 0, 0.4, 1, 0
9.4, -0.15, 0.4, 1, 0
12.4, -0.15, 0, 1, 0
14.4, 0.15, -0.4, 1, 0
17.4, 0.15, 0, 1, 0
19.4, 0, 0.4, 1, 0
22.4, 0, 0, 1, 0
24.4, 0, 0, 0, 0
25.4, 0, 0, 0, 1
"""
"""Ahead and to the left, back to the right, and ahead."""


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A way in is shown by hand, and driven back out in reverse."""
    folder = tmp_path_factory.mktemp("in-and-out") / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    return folder / "record_and_return.yaml"


def test_a_way_that_was_shown_is_driven_back_out_in_reverse(mission: Path) -> None:
    seen = run(mission)
    assert (seen.status, seen.fault_ids, directions(seen)) == (0, [], [-1])
    deepest = seen.in_mode(Mode.TELEOP)[-1].tick.snapshot.odometry
    assert deepest.distance > 2.0
    assert deepest.pose.heading > 0.8
    end = seen.seen[-1].tick.snapshot.odometry
    assert (end.pose.x, end.pose.y, end.pose.heading) == pytest.approx((0.0, 0.0, 0.0), abs=0.06)
    assert end.distance == pytest.approx(0.0, abs=0.06)
    assert seen.cross_track() < 0.06


@pytest.mark.slow
def test_a_run_that_stopped_in_a_backward_part_is_gone_on_with(mission: Path) -> None:
    first = resuming.run(mission, until=resuming.driven(1.2))
    second = resuming.run(mission, first.folder)
    assert (first.outcome.exit_status, second.outcome.exit_status) == (1, 0)
    assert second.arc_lengths()[0] == pytest.approx(first.arc_lengths()[-1], abs=0.1)
    assert first.arc_lengths()[-1] > 1.2
    assert {math.copysign(1, t.set_points.speed) for t in second.following() if t.set_points.speed} == {-1.0}
    end = second.ticks[-1].snapshot.odometry.pose
    assert (end.x, end.y) == pytest.approx((0.0, 0.0), abs=0.06)
    assert replay_run(second.folder) == 0


@pytest.mark.slow
def test_what_was_shown_to_and_fro_is_followed_so_and_becomes_one_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = [CALIBRATE, SHOW, *(follow({"recorded": "shown"}, 0.15, from_end=out) for out in (True, False))]
    seen = run(write_mission(tmp_path, steps, {"stick.csv": TO_AND_FRO}, inputs=STICK), longest=150.0)
    assert (seen.status, seen.fault_ids) == (0, [])
    assert directions(seen) == [-1, 1, -1, 1, -1, 1], "back out, and in again"
    assert seen.cross_track() < 0.06
    assert seen.outcome is not None
    kept = (seen.outcome.run.path / "paths/shown.csv").read_text()
    assert [part.backward for part in route_from_csv(kept, "shown.csv").parts] == [False, True, False]
    file = tmp_path / "again.csv"
    assert record_path(seen.outcome.run.path, file, RecordedPart(name="shown"), Drawing(), speed=0.2) == 0
    assert "driven forwards, backwards, forwards, " in capsys.readouterr().out
    made = route_from_csv(file.read_text(), "again.csv")
    assert [part.backward for part in made.parts] == [False, True, False]
    assert made.length == pytest.approx(route_from_csv(kept, "shown.csv").length, abs=0.1)


# ---------------------------------------------------------------------------------------------- stopped in between

BACK = "x,y\n" + "".join(f"{-x / 10},{(x / 10) ** 2 / 8:.4f}\n" for x in range(26))
BACKWARD: dict[str, Any] = {"direction": "backward"}
OPERATOR = [{"at_s": 12.4, "do": "acknowledge"}, {"at_s": 18.4, "do": "arm"}, {"at_s": 24.4, "do": "arm"}]


@pytest.mark.parametrize("fault", [{"inject": "DRV-18", "node": "steer-left"}, None], ids=["drive fault", "quick stop"])
def test_after_a_stop_in_a_backward_part_it_is_gone_on_with_backwards(
    tmp_path: Path, fault: dict[str, Any] | None
) -> None:
    operator = OPERATOR if fault else [{"at_s": 7.4, "do": "quickstop"}, *OPERATOR]
    simulation = {"operator": operator, "faults": [{"at_s": 7.4, **fault}] if fault else []}
    mission = write_mission(tmp_path, [CALIBRATE, follow(**BACKWARD)], {"line.csv": BACK}, simulation=simulation)
    seen = run(mission, longest=200.0)
    assert seen.status == 0
    assert any(s.mode in (Mode.QUICKSTOP, Mode.FAULT) for s in seen.seen)
    assert directions(seen) == [-1, -1] or directions(seen) == [-1]
    assert arc_lengths(seen)[-1] == pytest.approx(route_from_csv(BACK, "b.csv").length, abs=0.03)
    assert seen.cross_track() < 0.1
    assert seen.seen[-1].tick.snapshot.odometry.pose.x == pytest.approx(-2.5, abs=0.04)


def judged(steps: list[dict[str, Any]], files: dict[str, str], faults: list[dict[str, Any]], folder: Path) -> Any:  # noqa: ANN401
    operator = [{"at_s": time, "do": what} for time in (12.4, 16.4, 20.4) for what in ("acknowledge", "arm")]
    simulation = {"seed": 1, "true_robot": {"slip": 0.005}, "operator": operator, "faults": faults}
    mission = {
        "mission": "reversing", "robot": "robot.yaml", "bus": "simulation", "inputs": {},
        "steps": steps, "simulation": simulation,
    }  # fmt: skip
    robot = (MISSIONS / "robots/artemis.yaml").read_bytes()
    return run_scenario(Scenario(seed=1, mission=json.loads(json.dumps(mission)), files=files), robot, folder)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "faults",
    [
        [],
        [{"at_s": 8.4, "inject": "DRV-18", "node": "steer-left"}],
        [{"at_s": 8.4, "inject": "PTH-08", "duration_s": 6.0}],
        [{"at_s": 8.4, "inject": "RUN-11"}],
    ],
    ids=["sound", "drive fault", "overrun", "no number"],
)
def test_who_judges_from_outside_finds_nothing_wrong_with_driving_backwards(
    faults: list[dict[str, Any]], tmp_path: Path
) -> None:
    result = judged([CALIBRATE, follow(**BACKWARD)], {"line.csv": BACK}, faults, tmp_path)
    assert result.violations == ()
    assert result.status == 0 or faults


def test_who_judges_from_outside_finds_nothing_wrong_with_a_three_point_turn(tmp_path: Path) -> None:
    table = (MISSIONS / "paths/three_point_turn.csv").read_text()
    result = judged([CALIBRATE, follow("turn.csv")], {"turn.csv": table}, [], tmp_path)
    assert (result.status, result.violations) == (0, ())


def test_the_report_knows_where_a_loop_was_begun(tmp_path: Path) -> None:
    angles = [math.tau * number / 80 for number in range(80)]
    ring = "x,y\n" + "".join(f"{math.cos(a):.4f},{math.sin(a) - 1.05:.4f}\n" for a in angles)
    step = follow("ring.csv", 0.5, start="nearest", direction="backward")
    seen = run(write_mission(tmp_path, [CALIBRATE, step], {"ring.csv": ring}))
    assert (seen.status, directions(seen)) == (0, [-1])
    assert seen.outcome is not None
    series = read_series(Recording(seen.outcome.run.path))
    known = series.cross_track == series.cross_track
    assert series.true_arc_length[known] == pytest.approx(series.arc_length[known], abs=0.05)
    assert abs(series.true_cross_track[known] - series.cross_track[known]).max() < 0.03
