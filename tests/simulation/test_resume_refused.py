"""A run on a robot is gone on with only where it is sure that the robot still stands where that run left it."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import resuming
from resuming import FAR, HALF, STEPS, Done, driven, line, of_a_robot, refused
from rig import straight, write_mission

from artemis.app import Parts
from artemis.clock import SimulatedLoop
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording
from artemis.values import Mode, Tick
from artemis_lab.injections.failing_disk import FailingDisk

pytestmark = pytest.mark.short_alignment

BUS = {"interface": "udp_multicast", "channel": "239.74.163.77"}


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """Of a real robot."""
    return write_mission(tmp_path, STEPS, {"line.csv": straight(FAR)}, bus=BUS)


def run(
    mission: Path, *, until: Callable[[Tick], bool], simulate: bool = False, disk: FailingDisk | None = None
) -> Done:
    """Run it; what answers on its bus are simulated drives all the same, on virtual time."""
    machine = None if simulate else of_a_robot(mission)
    parts = Parts(machine=machine, loop=SimulatedLoop, disk=disk)
    return resuming.run(mission, until=until, simulate=simulate, parts=parts)


def as_if_killed(folder: Path, when: Callable[[Tick], bool]) -> tuple[Path, Callable[[Tick], bool]]:
    """Where a run is copied to, as it is after the first tick that is `when`; what does it, asked at every tick."""
    killed = folder / "runs" / "20260101T000000Z-rig"

    def copy(tick: Tick) -> bool:
        if when(tick) and not killed.exists():
            (running,) = (folder / "runs").iterdir()
            shutil.copytree(running, killed)
        return False

    return killed, copy


# ---------------------------------------------------------------------------------------------- simulated, or not


def test_a_simulated_run_is_not_gone_on_with_on_the_robot(mission: Path) -> None:
    simulated = run(mission, until=driven(HALF), simulate=True)

    assert refused(mission, simulated.folder, simulate=True) == ""
    said = refused(mission, simulated.folder)
    assert "cannot be resumed: it was simulated, and this run is not" in said
    assert "--simulate" in said


def test_a_run_of_the_robot_is_not_gone_on_with_in_simulation(mission: Path) -> None:
    real = run(mission, until=driven(HALF))

    assert refused(mission, real.folder) == ""
    assert "cannot be resumed: it was not simulated, and this run is" in refused(mission, real.folder, simulate=True)


# ---------------------------------------------------------------------------------------------- how long it lasted


@pytest.mark.parametrize(("error", "id"), [(errno.ENOSPC, "DSK-02"), (errno.EIO, "DSK-05")])
def test_where_a_robot_stands_whose_recording_ended_before_its_run_is_not_guessed(
    mission: Path, error: int, id: str
) -> None:
    disk = FailingDisk()
    fails: list[float] = []

    def soon_after(tick: Tick) -> bool:
        if driven(0.3)(tick) and not fails:
            disk.fail("recording", error)
        fails.extend(tick.snapshot.time for fault in tick.snapshot.verdict.faults if fault.id == id)
        return bool(fails) and tick.snapshot.time >= fails[0] + 0.1

    killed, copy = as_if_killed(mission.parent, soon_after)
    run(mission, until=copy, disk=disk)

    last = Recording(killed).last_tick()
    assert last is not None
    assert fails[0] - 1.0 < last.snapshot.time < fails[0]
    said = refused(mission, killed)
    assert f"{id} at {fails[0]:.2f} s" in said
    assert "the position of the robot is unknown" in said


def test_a_run_whose_recording_ended_before_the_robot_drove_is_not_gone_on_with(mission: Path) -> None:
    disk = FailingDisk()

    def fail(tick: Tick) -> bool:
        if tick.snapshot.time > 1.0:
            disk.fail("recording", errno.EIO)
        return driven(HALF)(tick)

    seen = run(mission, until=fail, disk=disk)
    assert not Recording(seen.folder).places_robot()
    assert "the position of the robot is unknown" in refused(mission, seen.folder)


def test_the_journal_of_a_killed_run_knows_how_long_it_lasted(mission: Path) -> None:
    killed, copy = as_if_killed(mission.parent, driven(1.2))
    whole = run(mission, until=copy)
    at = next(tick.snapshot.time for tick in whole.ticks if driven(1.2)(tick))

    entries = read_journal(killed / "journal.jsonl").entries
    assert entries[-1].kind == "running"
    assert at - 1.02 < entries[-1].time <= at
    assert [entry.kind for entry in entries].count("running") == 1
    assert "running" not in {entry.kind for entry in whole.journal}
    assert refused(mission, killed) == ""

    recording = killed / "recording.mcap"
    size = recording.stat().st_size
    while "the position of the robot is unknown" not in (said := refused(mission, killed)):
        size -= 20_000
        recording.write_bytes(recording.read_bytes()[:size])
    assert f"the run lasted until {entries[-1].time:.2f} s" in said


def test_a_recording_without_an_end_and_without_a_journal_is_not_trusted(mission: Path) -> None:
    killed, copy = as_if_killed(mission.parent, driven(1.2))
    run(mission, until=copy)
    (killed / "journal.jsonl").unlink()

    assert "the position of the robot is unknown" in refused(mission, killed)


# ---------------------------------------------------------------------------------------------- driven since


@pytest.mark.slow
def test_a_run_is_not_gone_on_with_once_another_has_driven_the_robot(mission: Path) -> None:
    first = run(mission, until=driven(HALF))
    assert refused(mission, first.folder) == ""
    run(mission, until=driven(HALF), simulate=True)
    assert refused(mission, first.folder) == "", "a simulated run moves no robot"
    run(mission, until=lambda tick: tick.snapshot.time > 1.0)
    assert refused(mission, first.folder) == "", "nor does one that ended while it was brought up"

    second = run(mission, until=driven(HALF))
    said = refused(mission, first.folder)
    assert f"{second.folder.name} has driven the robot since" in said
    assert refused(mission, second.folder) == ""


@pytest.mark.parametrize("elsewhere", ["", ', "record": "elsewhere"'], ids=["beside it", "elsewhere"])
def test_another_mission_drives_the_robot_away_as_well(mission: Path, elsewhere: str) -> None:
    first = run(mission, until=driven(HALF))
    other = mission.with_name("other.yaml")
    other.write_text(mission.read_text().replace('"mission": "rig"', f'"mission": "other"{elsewhere}'))
    second = run(other, until=driven(HALF))
    assert f"{second.folder.name} has driven the robot since" in refused(mission, first.folder)


def test_a_simulated_robot_is_put_where_the_run_left_it(tmp_path: Path) -> None:
    mission = line(tmp_path)
    first = run(mission, until=driven(HALF))
    assert Mode.FOLLOW in {tick.mode for tick in run(mission, until=driven(HALF)).ticks}
    assert refused(mission, first.folder) == ""
