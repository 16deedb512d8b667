from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from datetime import timedelta
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import synthetic_run
from msgspec.structs import replace
from synthetic_run import Observed

from artemis.recording.journal import Journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.report.series import Interval, read_series
from artemis.report.summary import summary
from artemis.report.trajectories import true_trajectory
from artemis.values import LocatedPose, Mode, Pose


@pytest.fixture(scope="module")
def lap(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return Recording(
        synthetic_run.record(tmp_path_factory.mktemp("run") / "recording.mcap", synthetic_run.run(hz=25.0))
    )


def recorded(tmp_path: Path, observed: Iterator[Observed], outcome: str = "") -> Recording:
    return Recording(synthetic_run.record(tmp_path / "recording.mcap", observed, outcome=outcome))


def moved(observed: Observed, sideways: float) -> Observed:
    """The same tick, the robot truly `sideways` metres to the left of where odometry believes."""
    pose = observed.tick.snapshot.odometry.pose
    x, y = pose.x - sideways * math.sin(pose.heading), pose.y + sideways * math.cos(pose.heading)
    return dataclasses.replace(observed, true_pose=Pose(x=x, y=y, heading=pose.heading))


def test_cross_track_by_odometry_is_that_of_the_tracking(lap: Recording) -> None:
    run = read_series(lap)

    expected = [t.wish.tracking.cross_track if t.wish.tracking else math.nan for t in lap.ticks()]
    np.testing.assert_array_equal(run.cross_track, expected)


def test_cross_track_by_the_true_pose_is_projected(tmp_path: Path) -> None:
    run = read_series(recorded(tmp_path, (moved(each, 0.05) for each in synthetic_run.run(hz=25.0))))

    followed = np.isfinite(run.cross_track)
    assert np.array_equal(np.isfinite(run.true_cross_track), followed)
    np.testing.assert_allclose(run.true_cross_track[followed], run.cross_track[followed] + 0.05, atol=1e-3)
    np.testing.assert_allclose(run.true_arc_length[followed], run.arc_length[followed], atol=0.02)


def test_true_poses_are_of_the_moment_when_the_drives_measured(tmp_path: Path) -> None:
    """A robot at 0.5 m/s, whose feedback is 4 ms old at each tick: its odometry is right, and behind by 2 mm."""

    def straight() -> Iterator[Observed]:
        for each in islice(synthetic_run.run(), 50, 300):
            time = each.tick.snapshot.time
            odometry = replace(each.tick.snapshot.odometry, pose=Pose(x=0.5 * (time - 0.004)))
            snapshot = replace(each.tick.snapshot, odometry=odometry, pose=LocatedPose(pose=odometry.pose))
            yield dataclasses.replace(each, tick=replace(each.tick, snapshot=snapshot), true_pose=Pose(x=0.5 * time))

    run = read_series(recorded(tmp_path, straight()))
    true = true_trajectory(run)
    assert true is not None
    np.testing.assert_allclose(run.true[1:], run.estimated[1:], atol=1e-9)
    np.testing.assert_allclose(true.poses[1:, 0], 0.5 * true.time[1:], atol=1e-9)
    assert run.error_end == pytest.approx(0.0, abs=1e-9)


def test_the_error_of_odometry_alone_is_that_of_the_odometry_laid_onto_the_first_pose_on_the_map(
    tmp_path: Path,
) -> None:
    def on_map() -> Iterator[Observed]:
        for each in islice(synthetic_run.run(), 50, 300):
            time = each.tick.snapshot.time
            odometry = replace(each.tick.snapshot.odometry, pose=Pose(x=0.6 * (time - 1.0)))
            pose = LocatedPose(pose=Pose(x=2.0, y=0.5 * (time - 1.0), heading=math.pi / 2), frame="map", source="map")
            snapshot = replace(each.tick.snapshot, odometry=odometry, pose=pose)
            true_pose = Pose(x=2.0, y=0.5 * (time - 1.0), heading=math.pi / 2)
            yield dataclasses.replace(each, tick=replace(each.tick, snapshot=snapshot), true_pose=true_pose)

    run = summary(recorded(tmp_path, on_map()))
    assert run.odometry_error_max == pytest.approx(0.1 * (run.duration), abs=0.01)


def test_laps_are_counted_on(tmp_path: Path) -> None:
    run = read_series(recorded(tmp_path, synthetic_run.run(2, hz=10.0)))

    assert np.nanmax(run.true_arc_length) == pytest.approx(2 * math.tau * synthetic_run.RADIUS, abs=0.2)
    assert [path.laps for path in run.paths] == [2]


def test_a_run_without_a_true_pose_has_no_true_error(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    recorder = Recorder(path, synthetic_run.provenance(), threaded=False)
    for each in islice(synthetic_run.run(), 200):
        recorder.observe(each.tick, each.frames)
    recorder.close()
    facts = summary(Recording(path))

    assert facts.cross_track_rms is not None
    assert facts.true_cross_track_rms is None
    assert facts.position_error_end is None
    assert facts.odometry_error_max is None


def test_modes_and_states_become_intervals(lap: Recording) -> None:
    run = read_series(lap)

    assert [(each.value, each.begin) for each in run.modes[:3]] == [("init", 0.0), ("ready", 1.52), ("follow", 2.0)]
    assert [each.value for each in run.modes[3:]] == ["ready", "end"]
    assert [each.value for each in run.steps] == ["follow"]
    assert run.drive_states["steer-left"][:2] == (
        Interval(value="unknown", begin=0.0, end=0.12),
        Interval(value="switch on disabled", begin=0.12, end=1.0),
    )
    assert set(run.drive_states) == set(synthetic_run.DRIVES)


def test_wheels_show_nothing_before_they_were_heard(lap: Recording) -> None:
    wheel = read_series(lap).wheels["steer-right"]

    assert np.isnan(wheel.measured[:3]).all()
    assert np.isfinite(wheel.measured[3:]).all()
    assert np.isfinite(wheel.set_point).all()
    assert wheel.role == "steering"


def test_bus_load_counts_frames_with_their_most_stuff_bits(lap: Recording) -> None:
    run = read_series(lap)

    # SYNC, heartbeat, 8 PDOs of 8 bytes, 8 of 6 bytes: without stuff bits, and these
    bits = (47 + 8) + (55 + 10) + 8 * (111 + 24) + 8 * (95 + 20)
    assert run.bus_load == pytest.approx(bits * 25.0 / 1e6, rel=1e-9)
    assert run.frames == 18 * len(run.time)


def test_distance_ignores_a_reset_of_the_pose(tmp_path: Path) -> None:
    def observed() -> Iterator[Observed]:
        for index, each in enumerate(islice(synthetic_run.run(), 200, 210)):
            snapshot = each.tick.snapshot
            odometry = replace(snapshot.odometry, distance=float(index) if index < 5 else 0.25 * index)
            wish = replace(each.tick.wish, reset_pose=index == 4)
            tick = replace(each.tick, snapshot=replace(snapshot, odometry=odometry), wish=wish)
            yield dataclasses.replace(each, tick=tick)

    assert read_series(recorded(tmp_path, observed())).distance == pytest.approx(4 * 1.0 + 4 * 0.25)


def test_the_summary_of_a_lap(lap: Recording) -> None:
    facts = summary(lap)

    assert facts.mission == "circle"
    assert facts.robot == "ARTEMIS"
    assert facts.result == "done"
    assert facts.missing is None
    assert facts.distance == pytest.approx(math.tau * synthetic_run.RADIUS, abs=0.1)
    assert facts.max_speed == pytest.approx(synthetic_run.SPEED)
    assert facts.max_wheel_speed == pytest.approx(0.53)
    assert facts.cross_track_max == pytest.approx(0.06)
    assert facts.cross_track_rms is not None
    assert 0.005 < facts.cross_track_rms < 0.03
    assert facts.real_time_factor is not None
    assert facts.real_time_factor > 1
    assert facts.faults == ()


def test_a_fault_is_in_the_summary(tmp_path: Path) -> None:
    facts = summary(recorded(tmp_path, synthetic_run.run(fault_at=2.5)))

    assert facts.faults == ("DRV-25 steer-left: following error <too large>",)
    assert facts.result == "broken off in fault"


def test_a_run_that_nobody_commented_ended_in_order(tmp_path: Path) -> None:
    assert summary(recorded(tmp_path, synthetic_run.run(hz=10.0))).result == "ended normally"


def test_a_run_without_a_tick_has_a_summary(tmp_path: Path) -> None:
    facts = summary(recorded(tmp_path, iter(())))

    assert (facts.ticks, facts.duration, facts.distance, facts.frames) == (0, 0.0, 0.0, 0)
    assert facts.result == "broken off in the beginning"


def test_a_damaged_path_costs_only_the_projection(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    provenance = dataclasses.replace(synthetic_run.provenance(), files={"paths/circle.csv": b"x,y\n0,\xff"})
    recorder = Recorder(path, provenance, threaded=False)
    for each in islice(synthetic_run.run(), 150):
        recorder.observe(each.tick, each.frames, each.true_pose)
    recorder.close()
    facts = summary(Recording(path))

    assert facts.cross_track_rms is not None
    assert facts.true_cross_track_rms is None


def test_a_path_that_is_no_file_of_the_mission_has_no_projection(tmp_path: Path) -> None:
    def observed() -> Iterator[Observed]:
        for each in islice(synthetic_run.run(), 150):
            tracking = each.tick.wish.tracking
            wish = replace(each.tick.wish, tracking=replace(tracking, length=7.0) if tracking else None)
            yield dataclasses.replace(each, tick=replace(each.tick, wish=wish))

    run = read_series(recorded(tmp_path, observed()))

    assert run.modes[-1].value == Mode.FOLLOW.value
    assert np.isfinite(run.cross_track).any()
    assert not np.isfinite(run.true_cross_track).any()
    assert run.paths == ()


def test_how_a_run_ended_is_known_from_the_journal_where_the_recording_is_cut_off(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    path = synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(fault_at=3.0), journal=journal)
    path.write_bytes(path.read_bytes()[:-20_000])
    facts = summary(Recording(tmp_path))

    assert facts.result == "done"
    assert facts.missing is not None
    assert facts.faults == ("DRV-25 steer-left: following error <too large>",)


def test_a_journal_that_is_not_whole_gives_way_to_a_whole_recording_and_is_named(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(fault_at=3.0), journal=journal)
    whole = (tmp_path / "journal.jsonl").read_bytes()
    (tmp_path / "journal.jsonl").write_bytes(whole[: len(whole) // 2])
    facts = summary(Recording(tmp_path))

    assert facts.faults == ("DRV-25 steer-left: following error <too large>",)
    assert facts.missing is not None
    assert "journal.jsonl: line" in facts.missing


@pytest.mark.parametrize("content", [None, b"", b"rubbish"])
def test_a_run_folder_without_a_journal_that_can_be_read_says_so(tmp_path: Path, content: bytes | None) -> None:
    synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(fault_at=3.0))
    if content is not None:
        (tmp_path / "journal.jsonl").write_bytes(content)

    facts = summary(Recording(tmp_path))

    assert facts.faults == ("DRV-25 steer-left: following error <too large>",)
    assert facts.missing is not None
    assert facts.missing.startswith("journal.jsonl is missing, empty, damaged or of another run")
    assert summary(Recording(tmp_path / "recording.mcap")).missing is None


def test_the_journal_of_another_run_is_not_believed(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    synthetic_run.record(tmp_path / "recording.mcap", synthetic_run.run(fault_at=3.0), journal=journal)
    path = tmp_path / "other.mcap"
    Recorder(
        path,
        dataclasses.replace(synthetic_run.provenance(), start=synthetic_run.START + timedelta(days=1)),
        threaded=False,
    ).close("failed")

    assert Recording(path).journal is None
    assert summary(Recording(path)).faults == ()
