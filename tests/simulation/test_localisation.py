"""A robot whose odometry drifts follows a path by what a simulated tracker sees of it."""

from __future__ import annotations

import json
import math
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, MISSIONS, Rig, Run, run, straight, write_mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.motion.localisation import CORRECTION, TURNING
from artemis.motion.path import path_from_csv
from artemis.motion.poses import placed, seen_from
from artemis.planning import setup_for
from artemis.plugins.localizers.simulated_tracker import SimulatedTracker, SimulatedTrackerConfig
from artemis.recording.mcap_reader import Recording
from artemis.values import Mode
from artemis.yaml_file import load

pytestmark = pytest.mark.slow

MISSION = MISSIONS / "follow_by_tracker.yaml"
COURSE = MISSIONS / "paths" / "figure_eight.csv"
DRIFTING = {
    "steering_zero_left_deg": 0.8,
    "steering_zero_right_deg": 0.4,
    "wheel_scale_left": 1.02,
    "wheel_scale_right": 1.01,
}


@cache
def tracked() -> Run:
    return run(MISSION, longest=120.0)


def true_errors(seen: Run, file: Path = COURSE) -> list[tuple[float, float]]:
    """Run time [s], and distance of the true rear axle from the path as it lies on the map [m]."""
    path = path_from_csv(file.read_text(), file.name, smoothing=0.0, spacing=0.005)
    errors = []
    for tick in seen.in_mode(Mode.FOLLOW):
        if (tracking := tick.tick.wish.tracking) is not None:
            found = path.project(tick.pose.x, tick.pose.y, near=tracking.arc_length % path.length, window=0.5)
            errors.append((tick.time, math.hypot(tick.pose.x - found.x, tick.pose.y - found.y)))
    return errors


@pytest.mark.slow
def test_the_robot_stays_on_its_path_where_its_odometry_alone_would_leave_it() -> None:
    seen = tracked()
    assert (seen.status, seen.fault_ids) == (0, [])
    last = seen.in_mode(Mode.FOLLOW)[-1]
    astray = [math.dist((s.pose.x, s.pose.y), _odometry(s)) for s in seen.in_mode(Mode.FOLLOW)]
    assert max(astray) > 0.5
    assert astray[-1] > 0.1
    errors = true_errors(seen)
    assert errors[-1][1] <= 0.02
    known = [error for time, error in errors if not 14.0 <= time <= 24.0]  # it is seen again from 20 s on
    assert max(known) <= 0.02
    assert max(error for _, error in errors) <= 0.08, "unseen for 6 s"
    pose = last.tick.snapshot.pose
    assert (pose.frame, pose.source, pose.lost) == ("map", "simulated_tracker", False)
    assert math.dist((pose.pose.x, pose.pose.y), (last.pose.x, last.pose.y)) <= 0.02


def _odometry(seen: Any) -> tuple[float, float]:  # noqa: ANN401 (of the rig)
    pose = seen.tick.snapshot.odometry.pose
    return pose.x, pose.y


@pytest.mark.exhaustive
def test_by_its_odometry_alone_it_leaves_the_path(tmp_path: Path) -> None:
    mission: Any = load(MISSION).data
    del mission["simulation"]["localizer"]
    files = {"path.csv": COURSE.read_text()}
    step = {"follow": {**mission["steps"][1]["follow"], "path": "path.csv"}}
    seen = run(write_mission(tmp_path, [CALIBRATE, step], files, simulation=mission["simulation"]), longest=120.0)
    assert seen.status == 0
    assert max(error for _, error in true_errors(seen)) > 0.1
    assert all(tick.snapshot.pose.pose == tick.snapshot.odometry.pose for tick in seen.ticks)


def test_the_pose_never_jumps_while_the_robot_moves() -> None:
    following = [s.tick.snapshot for s in tracked().in_mode(Mode.FOLLOW)]
    for before, now in pairwise(following):
        if now.standing and now.set_points.speed == 0.0:
            continue
        expected = placed(before.pose.pose, seen_from(before.odometry.pose, now.odometry.pose))
        off = seen_from(expected, now.pose.pose)
        assert math.hypot(off.x, off.y) <= CORRECTION * now.dt + 1e-9
        assert abs(off.heading) <= TURNING * now.dt + 1e-9


def test_what_the_tracker_sees_wrongly_is_not_believed_and_its_silence_is_told() -> None:
    poses = [(s.time, s.tick.snapshot.pose) for s in tracked().in_mode(Mode.FOLLOW)]
    (before,) = {pose.unused for time, pose in poses if 29.9 < time < 30.09}
    after = next(pose for time, pose in poses if time > 30.6)
    assert after.unused - before == 3
    assert max(pose.age or 0.0 for time, pose in poses if 14.0 <= time <= 20.5) == pytest.approx(6.1, abs=0.2)
    unsure = max(pose.covariance[0] for time, pose in poses if 14.0 <= time <= 20.5)
    assert unsure > 100 * next(pose.covariance[0] for time, pose in poses if time > 25.0)


def test_a_replay_gives_the_same_poses_and_commands() -> None:
    seen = tracked()
    replayed = seen.recompute()
    assert (replayed.ticks, replayed.difference) == (len(seen.ticks), None)


def test_the_recording_holds_what_the_tracker_found_and_the_true_poses_on_its_map() -> None:
    seen = tracked()
    assert seen.outcome is not None
    recording = Recording(seen.outcome.run.path)
    last = recording.last_tick()
    assert last is not None
    assert last.true_pose is not None
    true = seen.seen[-1].pose
    assert (last.true_pose.x, last.true_pose.y) == (true.x, true.y)
    assert sum(len(tick.snapshot.sensed.fixes) for tick in recording.ticks()) > 600


# ---------------------------------------------------------------------------------------------- without fixes


def line(folder: Path, length: float = 8.0, **localizer: object) -> Path:
    """A robot that starts beside a straight path, under a tracker."""
    following: dict[str, Any] = {"follow": {"path": "line.csv", "follower": {"speed_m_s": 0.5}}}
    return write_mission(
        folder,
        [CALIBRATE, following],
        {"line.csv": straight(length)},
        simulation={
            "true_robot": {**DRIFTING, "y_m": 0.2},
            "localizer": {"plugin": "simulated_tracker", **localizer},
        },
    )


def test_a_path_lies_on_the_map_and_not_where_the_robot_starts(tmp_path: Path) -> None:
    seen = run(line(tmp_path, 3.0))
    assert seen.status == 0
    following = seen.in_mode(Mode.FOLLOW)
    assert following[0].tick.snapshot.pose.pose.y == pytest.approx(0.2, abs=0.01)
    assert following[-1].pose.y == pytest.approx(0.0, abs=0.02)


def test_a_robot_that_is_not_seen_any_more_stops_after_some_metres(tmp_path: Path) -> None:
    seen = run(line(tmp_path, drop_out=[[9.0, 1000.0]]))
    assert (seen.status, seen.fault_ids) == (1, ["LOC-01"])
    stopped = seen.seen[-1].pose.x
    unseen = next(s.pose.x for s in seen.seen if s.time >= 9.0)
    assert 4.8 < stopped - unseen < 5.8


def test_a_robot_that_was_never_seen_does_not_drive_off(tmp_path: Path) -> None:
    seen = run(line(tmp_path, drop_out=[[0.0, 1000.0]]))
    assert (seen.status, seen.fault_ids) == (1, ["LOC-01"])
    assert "no fix yet" in seen.faults[0].text
    assert abs(seen.seen[-1].pose.x) < 0.02


def test_what_a_tracker_recorded_is_followed(tmp_path: Path) -> None:
    """Here of a robot that stands: its map is turned by a right angle."""
    rows = "".join(f"{0.1 * row:.1f},1.0,-2.0,{math.pi / 2}\n" for row in range(300))
    files = {"fixes.csv": "t,x,y,heading\n" + rows}
    steps: list[dict[str, Any]] = [CALIBRATE, {"wait": {"seconds": 1.0}}]
    seen = run(write_mission(tmp_path, steps, files, localizer={"plugin": "tracker", "file": "fixes.csv"}))
    pose = seen.ticks[-1].snapshot.pose
    assert (seen.status, pose.source) == (0, "tracker")
    assert (pose.pose.x, pose.pose.y, pose.pose.heading) == pytest.approx((1.0, -2.0, math.pi / 2), abs=1e-3)


def test_a_run_that_was_broken_off_is_gone_on_with_on_the_map(tmp_path: Path) -> None:
    from artemis import app

    mission = line(tmp_path, 6.0)
    rig = Rig(mission)
    rig.while_following(rig.kill, 2.0)
    broken = rig.run_until_killed()
    (folder,) = (tmp_path / "runs").iterdir()
    loaded = load_mission(mission)
    resume_point, _ = app.resume_point_of(loaded, mission, folder)
    there = broken.ticks[-1].snapshot.pose.pose
    assert resume_point.pose.x == pytest.approx(there.x, abs=0.2)
    done: list[Any] = []
    app.run_mission(loaded, mission, resume_point=resume_point, watch=lambda tick, traffic: done.append(tick))
    first = next(tick for tick in done if tick.mode is Mode.FOLLOW)
    assert first.snapshot.pose.frame == "map"
    assert first.snapshot.pose.pose.x == pytest.approx(resume_point.pose.x, abs=0.05)
    assert done[-1].snapshot.pose.pose.x == pytest.approx(6.0, abs=0.06)
    assert not done[-1].snapshot.pose.lost


# ---------------------------------------------------------------------------------------------- wrong missions


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ("0,0,0,0\n1,0,0,0\n0.5,0,0,0\n", "times run backwards"),
        ("0,0,0,0\n1,0,zero,0\n", "zero"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path: Path, rows: str, problem: str) -> None:
    files = {"fixes.csv": "t,x,y,heading\n" + rows}
    mission = write_mission(tmp_path, [CALIBRATE], files, localizer={"plugin": "tracker", "file": "fixes.csv"})
    with pytest.raises(ConfigError, match=problem) as found:
        load_mission(mission)
    assert "fixes.csv:" in str(found.value)


def test_a_misspelt_key_of_a_localizer_is_named(tmp_path: Path) -> None:
    mission = line(tmp_path, delay=0.1)
    with pytest.raises(ConfigError, match="delay_s"):
        load_mission(mission)
    assert json.loads(mission.read_text())["simulation"]["localizer"]["delay"] == 0.1


def test_a_simulated_tracker_sees_no_real_robot(tmp_path: Path) -> None:
    setup = setup_for(load_mission(line(tmp_path)), "simulated_tracker")
    with pytest.raises(ConfigError, match="simulated robots only"):
        SimulatedTracker(SimulatedTrackerConfig(), setup)
