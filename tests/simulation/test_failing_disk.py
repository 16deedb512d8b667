"""A disk that is full, broken or nearly full: what a run does about it. And what it writes, to the byte."""

from __future__ import annotations

import errno
import itertools
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, follow, write_mission

from artemis import app
from artemis.commands.replay import replay_run
from artemis.devices.can_bus import Traffic
from artemis.errors import RecordingError
from artemis.mission.loading import load_mission
from artemis.recording.journal import Entry, read_journal
from artemis.recording.mcap_reader import Recording
from artemis.values import Fault, Mode, Request, Severity, Tick
from artemis_lab.injections.failing_disk import FailingDisk

pytestmark = pytest.mark.short_alignment

STEPS = [CALIBRATE, follow(0.4)]
START = datetime(2026, 3, 1, 12, tzinfo=UTC)


def somebody(request: Callable[[Request], None], typed: object) -> Callable[[], None]:
    """At a terminal, who watches and does nothing."""
    return lambda: None


def run(
    folder: Path,
    disk: FailingDisk,
    *,
    attended: bool = False,
    act: Callable[[Tick], None] = lambda tick: None,
    **simulation: object,
) -> tuple[app.Outcome, list[Tick]]:
    """A short distance; `act` sees every tick."""
    mission = write_mission(folder, STEPS, simulation=simulation)
    ticks: list[Tick] = []

    def watch(tick: Tick, traffic: Traffic) -> None:
        assert tick.snapshot.time < 60.0
        ticks.append(tick)
        act(tick)

    operator = somebody if attended else None
    parts = app.Parts(disk=disk)
    return app.run_mission(
        load_mission(mission), mission, watch=watch, operator=operator, start=START, parts=parts
    ), ticks


def on_its_way(tick: Tick) -> bool:
    return tick.mode is Mode.FOLLOW and tick.position.done > 0.3


def while_following(disk: FailingDisk, name: str, error: int) -> Callable[[Tick], None]:
    def act(tick: Tick) -> None:
        if on_its_way(tick):
            disk.fail(name, error)

    return act


def faults(ticks: list[Tick]) -> set[tuple[str, Severity]]:
    return {(fault.id, fault.severity) for fault in found(ticks)}


def found(ticks: list[Tick]) -> set[Fault]:
    return {fault for tick in ticks for fault in tick.snapshot.verdict.faults}


def journal(outcome: app.Outcome) -> tuple[Entry, ...]:
    content = read_journal(outcome.run.journal)
    assert content.missing is None
    return content.entries


# ---------------------------------------------------------------------------------------------- in a run


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("error", "id", "attended"),
    [(errno.ENOSPC, "DSK-02", False), (errno.EIO, "DSK-05", True), (errno.EROFS, "DSK-05", False)],
)
def test_a_recording_that_the_disk_refuses_is_a_warning_and_the_run_goes_on(
    tmp_path: Path, error: int, id: str, attended: bool
) -> None:
    disk = FailingDisk()
    outcome, ticks = run(tmp_path, disk, attended=attended, act=while_following(disk, "recording", error))

    assert faults(ticks) == {(id, Severity.WARN)}
    (fault,) = found(ticks)
    assert "recording.mcap: " in fault.text
    assert outcome.exit_status == 0
    assert len(outcome.troubles) == 1
    warned = [tick for tick in ticks if tick.snapshot.verdict.faults]
    assert warned[-1] is ticks[-1]  # until the end
    first = next(tick.snapshot.time for tick in ticks if on_its_way(tick))
    assert warned[0].snapshot.time - first < 1.0

    entries = journal(outcome)
    assert [entry.text for entry in entries if entry.kind == "fault"] == [f"{id} {fault.text}"]
    assert [entry.kind for entry in entries[-2:]] == ["gap", "end"]
    assert entries[-1].text == "done"
    recording = Recording(outcome.run.path)
    assert 0 < len(list(recording.ticks())) < len(ticks)
    assert replay_run(outcome.run.path) == 0  # as far as it goes


def test_without_a_journal_an_unattended_run_stops_and_fails(tmp_path: Path) -> None:
    disk = FailingDisk()
    outcome, ticks = run(tmp_path, disk, act=while_following(disk, "", errno.EIO))

    assert faults(ticks) == {("DSK-05", Severity.WARN), ("DSK-05", Severity.CONTROLLED_STOP)}
    assert outcome.exit_status == 1
    assert [mode for mode in Mode if any(tick.mode is mode for tick in ticks)] == [
        Mode.INIT, Mode.READY, Mode.CALIBRATE, Mode.FOLLOW, Mode.QUICKSTOP, Mode.END
    ]  # fmt: skip
    stopping = [tick.set_points.speed for tick in ticks if tick.mode is Mode.QUICKSTOP]
    assert 0.1 < stopping[0]  # by the gate's ramp, from the speed that it had
    assert all(after <= before for before, after in itertools.pairwise(stopping))
    assert len(outcome.troubles) == 2


def test_without_a_journal_an_attended_run_goes_on_with_a_warning(tmp_path: Path) -> None:
    disk = FailingDisk()
    outcome, ticks = run(tmp_path, disk, attended=True, act=while_following(disk, "", errno.EIO))

    assert faults(ticks) == {("DSK-05", Severity.WARN)}
    assert outcome.exit_status == 0


def test_a_run_replays_whose_disk_failed(tmp_path: Path) -> None:
    """The journal alone fails: the recording holds the fault, the stop and the end."""
    disk = FailingDisk()
    outcome, ticks = run(tmp_path, disk, act=while_following(disk, "journal", errno.EIO))

    assert faults(ticks) == {("DSK-05", Severity.CONTROLLED_STOP)}
    assert len(list(Recording(outcome.run.path).ticks())) == len(ticks)
    assert replay_run(outcome.run.path) == 0


def test_a_disk_that_fails_from_the_start_refuses_the_run(tmp_path: Path) -> None:
    disk = FailingDisk()
    disk.fail("recording", errno.ENOSPC)
    with pytest.raises(RecordingError, match="cannot begin a recording"):
        run(tmp_path, disk)


# ---------------------------------------------------------------------------------------------- nearly full


def test_a_run_that_nobody_watches_is_refused_on_a_disk_that_is_nearly_full(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"DSK-01 .* 312 MB free .* 500 MB are needed; free space"):
        run(tmp_path, FailingDisk(free=312_000_000), pace="real_time")

    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("attended", [False, True])
def test_a_fast_simulation_or_an_attended_run_is_only_warned(tmp_path: Path, attended: bool) -> None:
    outcome, ticks = run(tmp_path, FailingDisk(free=312_000_000), attended=attended)

    (warning,) = [entry for entry in journal(outcome) if entry.kind == "warning"]
    assert warning.text.startswith("DSK-01 disk nearly full: 312 MB free")
    assert outcome.exit_status == 0
    assert faults(ticks) == set()


def test_a_disk_with_room_is_nothing_to_talk_about(tmp_path: Path) -> None:
    outcome, _ = run(tmp_path, FailingDisk(free=500_000_000))

    assert not [entry for entry in journal(outcome) if entry.kind == "warning"]


# ---------------------------------------------------------------------------------------------- the same to the byte


@pytest.mark.parametrize("injected", [[], [{"at_s": 4.4, "inject": "DRV-25", "node": "steer-left"}]])
def test_the_same_seed_writes_the_same_journal_byte_for_byte(tmp_path: Path, injected: list[object]) -> None:
    noisy: dict[str, Any] = {
        "seed": 5,
        "true_robot": {"potentiometer_noise_v": 0.005, "slip": 0.01},
        "faults": injected,
    }
    outcomes = [run(tmp_path / name, FailingDisk(), **noisy)[0] for name in ("one", "other")]

    one, other = (outcome.run.journal.read_bytes() for outcome in outcomes)
    assert one == other
    assert {outcome.run.path.name for outcome in outcomes} == {"20260301T120000Z-rig"}
