"""A run that was broken off goes on in another process: where it stopped, as if nothing had been."""

from __future__ import annotations

import itertools
import math
import shutil
from pathlib import Path

import pytest
from msgspec.structs import replace
from resuming import FAR, HALF, STEPS, Done, driven, line, of_a_robot, refused, resume_point, run, waited
from rig import CALIBRATE, follow, straight, write_mission

from artemis import app
from artemis.commands.replay import replay_run
from artemis.mission.loading import load_mission
from artemis.progress import Position
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.resume import unfinished_run
from artemis.values import Mode, Pose, Tick

pytestmark = pytest.mark.short_alignment


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return line(tmp_path_factory.mktemp("mission"))


@pytest.fixture(scope="module")
def first(mission: Path) -> Done:
    """Ended by somebody halfway."""
    return run(mission, until=driven(HALF))


@pytest.fixture(scope="module")
def second(mission: Path, first: Done) -> Done:
    """Goes on with the first to the end."""
    return run(mission, first.folder)


@pytest.fixture
def copied(mission: Path, first: Done, tmp_path: Path) -> tuple[Path, Path]:
    """The mission and the first run, to damage them."""
    shutil.copytree(mission.parent, tmp_path / "copy")
    return tmp_path / "copy" / mission.name, tmp_path / "copy" / "runs" / first.folder.name


# ---------------------------------------------------------------------------------------------- where it stopped


@pytest.mark.slow
def test_a_path_is_gone_on_with_where_the_robot_stopped(first: Done, second: Done) -> None:
    assert (first.outcome.exit_status, second.outcome.exit_status) == (1, 0)
    assert [tick.position.step for tick in second.ticks[:1]] == [1]
    assert second.arc_lengths()[0] == pytest.approx(first.arc_lengths()[-1], abs=0.2)  # the way to come to rest
    assert first.arc_lengths()[-1] > HALF
    assert second.arc_lengths()[-1] == pytest.approx(FAR, abs=0.03)
    assert all(tick.wish.tracking and tick.wish.tracking.length == pytest.approx(FAR) for tick in second.following())
    assert second.ticks[-1].snapshot.odometry.pose.x == pytest.approx(FAR, abs=0.03)


def test_the_robot_is_brought_up_from_the_start_and_its_odometry_goes_on(first: Done, second: Done) -> None:
    kinds = [entry.text.split(" ")[0] for entry in second.journal if entry.kind == "job"]
    assert {"secure", "configure", "reference", "clear", "disarm"} <= set(kinds)
    assert "proving the watchdog" in [entry.text for entry in second.journal if entry.kind == "phase"]
    ended, begun = first.recorded[-1], second.recorded[0]
    assert begun.snapshot.odometry.pose == ended.snapshot.odometry.pose
    assert ended.true_pose is not None
    assert begun.true_pose is not None
    assert begun.true_pose.x == pytest.approx(ended.true_pose.x, abs=1e-9)
    assert begun.true_pose.heading == pytest.approx(ended.true_pose.heading, abs=1e-9)
    error = second.recorded[-1]
    assert error.true_pose is not None
    pose = error.snapshot.odometry.pose
    assert math.hypot(pose.x - error.true_pose.x, pose.y - error.true_pose.y) < 0.02


@pytest.mark.slow
def test_a_run_can_be_gone_on_with_again_and_again(mission: Path, first: Done) -> None:
    again = run(mission, first.folder, until=driven(1.1))
    third = run(mission, again.folder, until=lambda tick: tick.mode is Mode.READY)  # before it moves
    last = run(mission, third.folder)

    assert [done.outcome.exit_status for done in (again, third, last)] == [1, 1, 0]
    assert last.arc_lengths()[0] == pytest.approx(again.arc_lengths()[-1], abs=0.2)
    assert last.ticks[-1].snapshot.odometry.pose.x == pytest.approx(FAR, abs=0.03)


@pytest.mark.slow
def test_laps_are_gone_on_with_in_their_lap(tmp_path: Path) -> None:
    angles = [math.tau * number / 60 for number in range(60)]
    ring = "x,y\n" + "".join(f"{0.8 * math.sin(a):.4f},{0.8 * (1 - math.cos(a)):.4f}\n" for a in angles)
    step = follow(0.6, "ring.csv")
    step["follow"]["laps"] = 2
    mission = write_mission(tmp_path, [CALIBRATE, step], {"ring.csv": ring}, supervision={"stop_distance_m": 0.6})
    lap = 0.8 * math.tau
    first = run(mission, until=driven(1.2 * lap))
    second = run(mission, first.folder)

    assert second.outcome.exit_status == 0
    assert second.arc_lengths()[0] == pytest.approx(first.arc_lengths()[-1], abs=0.4)
    assert second.arc_lengths()[-1] == pytest.approx(2 * lap, abs=0.05)
    assert min(second.arc_lengths()) > 1.1 * lap
    assert max(abs(tick.wish.tracking.cross_track) for tick in second.following() if tick.wish.tracking) < 0.1


def test_a_wait_is_gone_on_with_for_the_time_that_was_left(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [{"wait": {"seconds": 5.0}}])
    first = run(mission, until=waited(2.0))
    second = run(mission, first.folder)

    waiting = [tick.snapshot.time for tick in second.ticks if tick.wish.phase == "waiting"]
    assert second.outcome.exit_status == 0
    assert waiting[-1] - waiting[0] == pytest.approx(3.0, abs=0.1)


def test_a_run_that_stopped_before_it_moved_is_gone_on_with_from_the_start(tmp_path: Path) -> None:
    mission = line(tmp_path)
    first = run(mission, until=lambda tick: tick.snapshot.time > 1.0)
    found = resume_point(mission, first.folder)

    assert (found.position, found.pose) == (Position(time=first.ticks[-1].snapshot.time), Pose())
    assert run(mission, first.folder).outcome.exit_status == 0


def test_a_stopped_run_whose_process_goes_on_needs_no_resumption(tmp_path: Path) -> None:
    """The same progress in one process: stopped, armed, and on its way again."""
    operator = [{"at_s": 4.9, "do": "quickstop"}, {"at_s": 7.4, "do": "arm"}]
    mission = write_mission(tmp_path, STEPS, {"line.csv": straight(FAR)}, simulation={"operator": operator})
    done = run(mission)

    assert done.outcome.exit_status == 0
    assert Mode.QUICKSTOP in {tick.mode for tick in done.ticks}
    distances = done.arc_lengths()
    assert min(after - before for before, after in itertools.pairwise(distances)) > -0.01
    assert distances[-1] == pytest.approx(FAR, abs=0.03)


# ---------------------------------------------------------------------------------------------- what it leaves behind


def test_the_resumed_run_names_the_one_before_in_journal_and_recording(first: Done, second: Done) -> None:
    start, resume = second.journal[:2]
    assert (start.kind, start.data["mission"]) == ("start", "rig")
    assert (resume.kind, resume.text) == ("resume", f"resumes {first.folder.name}")
    assert resume.data["run"] == first.folder.name
    assert resume.data["step"] == 1
    assert resume.data["done"] == first.arc_lengths()[-1]
    found = Recording(second.folder).resume_point
    assert found is not None
    assert found.run == first.folder.name
    assert Recording(first.folder).resume_point is None


def test_a_resumed_run_replays_bit_for_bit(first: Done, second: Done) -> None:
    assert replay_run(first.folder) == 0
    assert replay_run(second.folder) == 0


# ---------------------------------------------------------------------------------------------- killed and damaged


def test_a_run_that_was_killed_is_gone_on_with_as_far_as_it_is_recorded(tmp_path: Path) -> None:
    """Its files are as they are while it still runs: the recording without an end, the journal with room to spare."""
    mission = line(tmp_path)
    killed = tmp_path / "runs" / "20260101T000000Z-rig"
    folders: list[Path] = []

    def copy(tick: Tick) -> bool:
        if not folders and driven(1.2)(tick):
            (folder,) = (tmp_path / "runs").iterdir()
            folders.append(Path(shutil.copytree(folder, killed)))
        return False

    run(mission, until=copy)
    loaded = load_mission(mission)
    found, notes = app.resume_point_of(loaded, mission, killed)
    last = list(Recording(killed).ticks())[-1]

    assert "the file is cut off" in notes[0]
    assert 0.0 < found.position.done < 1.2
    odometry, time = last.snapshot.odometry, last.snapshot.time
    assert (found.position, found.pose) == (replace(last.position, driven=odometry.driven, time=time), odometry.pose)
    second = run(mission, killed)
    assert second.outcome.exit_status == 0
    assert second.ticks[-1].snapshot.odometry.pose.x == pytest.approx(FAR, abs=0.03)


@pytest.mark.slow
def test_a_recording_cut_anywhere_is_refused_or_gone_on_with_from_what_is_whole(copied: tuple[Path, Path]) -> None:
    mission, folder = copied
    recording = folder / "recording.mcap"
    whole, at_most = recording.read_bytes(), resume_point(mission, folder).position.done
    done: list[float] = []
    for size in range(0, len(whole), len(whole) // 60):
        recording.write_bytes(whole[:size])
        if not done and size < len(whole) // 2 and (found := refused(mission, folder)):
            assert "omit --resume to start from the beginning" in found
        else:
            done.append(resume_point(mission, folder).position.done)
    assert done == sorted(done)
    assert 0.5 < done[-1] <= at_most


def test_where_a_real_robot_stands_is_not_guessed(tmp_path: Path) -> None:
    """The recording ends when it had driven half its distance; the journal knows that it went on."""
    mission = line(tmp_path)
    first = run(mission, until=driven(HALF), parts=app.Parts(machine=of_a_robot(mission)))
    assert resume_point(mission, first.folder).true_pose is None
    whole = (first.folder / "recording.mcap").read_bytes()
    (first.folder / "recording.mcap").write_bytes(whole[: len(whole) * 6 // 10])

    assert "the position of the robot is unknown" in refused(mission, first.folder)


# ---------------------------------------------------------------------------------------------- refused


def test_a_finished_run_is_not_resumed(mission: Path, second: Done, tmp_path: Path) -> None:
    assert "this run is complete" in refused(mission, second.folder)
    folder = Path(shutil.copytree(second.folder, tmp_path / "cut"))
    whole = (folder / "recording.mcap").read_bytes()
    (folder / "recording.mcap").write_bytes(whole[:-50_000])  # also where the end of the recording is lost
    assert "this run is complete" in refused(mission, folder)


@pytest.mark.parametrize("name", ["mission.yaml", "artemis.yaml", "line.csv"])
def test_a_run_of_another_mission_is_not_resumed(copied: tuple[Path, Path], name: str) -> None:
    mission, folder = copied
    with (mission.parent / name).open("a") as file:
        file.write("\n")

    said = refused(mission, folder)
    assert said.startswith(f"{name}: is not what it was in {folder}")
    assert len(said.splitlines()) == 1


def test_nothing_to_recover_is_said(mission: Path, tmp_path: Path) -> None:
    said = refused(mission, tmp_path)
    assert "cannot be resumed" in said
    assert "no recording here" in said
    assert "omit --resume to start from the beginning" in said


# ---------------------------------------------------------------------------------------------- the last run


def test_a_run_that_nobody_ended_is_found_until_another_has_ended(copied: tuple[Path, Path], tmp_path: Path) -> None:
    mission, folder = copied
    runs = folder.parent
    for other in runs.iterdir():
        if other != folder:
            shutil.rmtree(other)
    assert unfinished_run(runs, "rig", simulated=True) is None  # stopped in order

    journal = folder / "journal.jsonl"
    ended = journal.read_bytes()
    journal.write_bytes(ended[: ended.rindex(b"\n", 0, -1) + 1] + bytes(1000))
    last = read_journal(journal).entries[-1]
    assert last.kind != "end"
    assert unfinished_run(runs, "rig", simulated=True) == (folder, last.time)
    assert unfinished_run(runs, "ri", simulated=True) is None
    assert unfinished_run(runs, "rig", simulated=False) is None
    assert unfinished_run(tmp_path / "elsewhere", "rig", simulated=True) is None
    run(mission, folder)
    assert unfinished_run(runs, "rig", simulated=True) is None
