"""A disk that is slow, or refuses: what a recording does then."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from threading import Event

import pytest
import synthetic_run

from artemis.errors import RecordingError
from artemis.recording import mcap_writer
from artemis.recording.disk import Disk, Trouble, low_disk, write_all
from artemis.recording.journal import Entry, Journal, read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.values import Tick
from artemis_lab.injections.failing_disk import FailingDisk


def first(count: int) -> list[synthetic_run.Observed]:
    return list(islice(synthetic_run.run(), count))


class Stall:
    """Lets the thread wait at its next tick until it may go on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.stalled, self.goes_on = Event(), Event()
        write: Callable[..., None] = Recorder._write_tick

        def stalling(recorder: Recorder, *arguments: object) -> None:
            self.stalled.set()
            self.goes_on.wait()
            write(recorder, *arguments)

        monkeypatch.setattr(mcap_writer, "QUEUE_TICKS", 5)
        monkeypatch.setattr(Recorder, "_write_tick", stalling)


def test_a_stalled_disk_costs_the_oldest_ticks_and_delays_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stall = Stall(monkeypatch)
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=True)
    observed = first(20)
    recorder.observe(observed[0].tick, observed[0].frames)
    stall.stalled.wait()
    for each in observed[1:10]:  # the first is being written, five wait, four had to make room
        recorder.observe(each.tick, each.frames)
    assert (recorder.dropped, recorder.first_gap) == (4, 1)
    stall.goes_on.set()
    while recorder._beside._data:
        pass
    for each in observed[10:15]:
        recorder.observe(each.tick, each.frames)
    recorder.close()

    recording = Recording(tmp_path)
    assert [tick.snapshot.sensed.index for tick in recording.ticks()] == [0, *range(5, 15)]
    assert recording.missing == "4 ticks were not recorded, the first are 1 to 4"
    assert [entry.text for entry in recording.entries()][-2:] == ["4 ticks were not recorded, the first is 1", ""]


def test_a_stalled_disk_costs_no_event(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stall = Stall(monkeypatch)
    journal = Journal(tmp_path / "journal.jsonl")
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=True, journal=journal)
    for each in first(101):
        recorder.observe(each.tick, each.frames)
    stall.goes_on.set()
    recorder.close("done")

    assert recorder.dropped >= 101 - 6
    kinds = [entry.kind for entry in read_journal(tmp_path / "journal.jsonl").entries]
    assert [kinds.count(kind) for kind in ("mode", "phase", "job", "result", "boot-up", "request")] == [
        3,
        3,
        1,
        1,
        1,
        1,
    ]
    assert kinds[-2:] == ["gap", "end"]


def test_a_slow_disk_is_told_while_ticks_are_dropped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stall = Stall(monkeypatch)
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=True)
    told = []
    for each in first(10):
        recorder.observe(each.tick, each.frames)
        stall.stalled.wait()
        told.append([trouble.id for trouble in recorder.troubles()])
    assert told == [[]] * 6 + [["DSK-03"]] * 4
    assert recorder.troubles() == []
    stall.goes_on.set()
    recorder.close()


# --------------------------------------------------------------------------------------------- a disk that refuses


def record_on(disk: FailingDisk, folder: Path, count: int, *, threaded: bool, fail: Callable[[int], None]) -> Recorder:
    """Observe ticks; `fail` is called before each with its number. The thread keeps up."""
    journal = Journal(folder / "journal.jsonl", disk)
    recorder = Recorder(
        folder / "recording.mcap", synthetic_run.provenance(), threaded=threaded, journal=journal, disk=disk
    )
    for number, each in enumerate(first(count)):
        fail(number)
        recorder.observe(each.tick, each.frames, each.true_pose)
        while recorder._beside._data or recorder._beside._orders:
            pass
    return recorder


@pytest.mark.parametrize("threaded", [False, True])
@pytest.mark.parametrize(("error", "id"), [(errno.ENOSPC, "DSK-02"), (errno.EIO, "DSK-05"), (errno.EROFS, "DSK-05")])
def test_a_recording_that_cannot_be_written_ends_and_the_journal_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threaded: bool, error: int, id: str
) -> None:
    monkeypatch.setattr(mcap_writer, "CHUNK_SIZE", 12_000)
    disk = FailingDisk()
    recorder = record_on(
        disk,
        tmp_path,
        101,
        threaded=threaded,
        fail=lambda number: disk.fail("recording", error) if number == 50 else None,
    )

    (trouble,) = recorder.troubles()
    assert (trouble.id, trouble.journal) == (id, False)
    assert trouble.detail == f"recording.mcap: {os.strerror(error)}"
    recorder.close("done")
    recorder.close()

    recording, journal = Recording(tmp_path), read_journal(tmp_path / "journal.jsonl")
    read = [tick.snapshot.sensed.index for tick in recording.ticks()]
    assert 30 < len(read) <= 50
    assert read == list(range(len(read)))
    assert recorder.dropped == 101 - len(read)
    assert journal.missing is None
    assert [(entry.kind, entry.text) for entry in journal.entries[-3:]] == [
        ("mode", "ready -> follow"),
        ("gap", f"{101 - len(read)} ticks were not recorded, the first is {len(read)}"),
        ("end", "done"),
    ]


def test_a_recording_that_is_cut_off_by_the_disk_is_told_by_the_journal_how_it_ended(tmp_path: Path) -> None:
    disk = FailingDisk()
    recorder = record_on(disk, tmp_path, 15, threaded=False, fail=lambda number: None)
    disk.fail("recording", errno.ENOSPC)
    recorder.close("done")

    assert recorder.dropped == 15  # all waited in the first chunk
    assert Recording(tmp_path).outcome == ""
    assert [trouble.id for trouble in recorder.troubles()] == ["DSK-02"]
    assert read_journal(tmp_path / "journal.jsonl").entries[-1].text == "done"


def test_a_recording_survives_a_disk_that_takes_a_few_bytes_at_a_time(tmp_path: Path) -> None:
    recorder = record_on(FailingDisk(at_once=100), tmp_path, 20, threaded=False, fail=lambda number: None)
    recorder.close()

    assert Recording(tmp_path).missing is None
    assert len(list(Recording(tmp_path).ticks())) == 20


@pytest.mark.parametrize("threaded", [False, True])
def test_a_journal_that_cannot_be_written_is_told_and_the_recording_goes_on(tmp_path: Path, threaded: bool) -> None:
    disk = FailingDisk()
    recorder = record_on(
        disk,
        tmp_path,
        50,
        threaded=threaded,
        fail=lambda number: disk.fail("journal", errno.EIO) if number == 30 else None,  # results come at tick 40
    )

    assert recorder.troubles() == [Trouble("DSK-05", "journal.jsonl: Input/output error", journal=True)]
    recorder.close()
    assert len(list(Recording(tmp_path).ticks())) == 50


def test_a_journal_that_can_be_written_again_is_no_trouble_any_more(tmp_path: Path) -> None:
    disk = FailingDisk()
    recorder = record_on(disk, tmp_path, 2, threaded=False, fail=lambda number: None)
    disk.fail("journal", errno.ENOSPC)
    recorder.note(Entry(time=1.0, kind="note", text="lost"))
    assert [trouble.journal for trouble in recorder.troubles()] == [True]
    disk.heal()
    recorder.note(Entry(time=2.0, kind="note", text="kept"))
    assert recorder.troubles() == []
    recorder.close("done")

    journal = read_journal(tmp_path / "journal.jsonl")
    assert [entry.text for entry in journal.entries[-2:]] == ["kept", "done"]
    assert journal.missing is not None


@pytest.mark.parametrize("threaded", [False, True])
def test_the_journal_says_each_second_that_the_run_goes_on_also_when_the_recording_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threaded: bool
) -> None:
    monkeypatch.setattr("artemis.recording.journal.PREALLOCATED", 1 << 16)  # it is read 215 times
    disk, journal = FailingDisk(), tmp_path / "journal.jsonl"
    told: list[float] = []

    def look(number: int) -> None:
        if number == 60:
            disk.fail("recording", errno.ENOSPC)
        told.extend(entry.time for entry in read_journal(journal).entries if entry.kind == "running")

    recorder = record_on(disk, tmp_path, 215, threaded=threaded, fail=look)
    last = read_journal(journal).entries[-1]
    assert last.kind == "running"
    assert last.time == pytest.approx(4.0, abs=0.02)
    assert sorted({round(time) for time in told}) == [1, 2, 3, 4]
    recorder.close("done")
    assert "running" not in {entry.kind for entry in read_journal(journal).entries}


def test_a_journal_that_cannot_be_written_is_told_within_a_second_when_nothing_happens(tmp_path: Path) -> None:
    disk = FailingDisk()
    recorder = record_on(disk, tmp_path, 110, threaded=False, fail=lambda number: None)
    disk.fail("journal", errno.EIO)
    for each in first(160)[110:]:
        recorder.observe(each.tick, each.frames, each.true_pose)
    assert [trouble.journal for trouble in recorder.troubles()] == [True]
    recorder.close()


def test_a_disk_that_refuses_from_the_start_refuses_the_run(tmp_path: Path) -> None:
    disk = FailingDisk()
    journal = Journal(tmp_path / "journal.jsonl", disk)
    disk.fail("recording", errno.ENOSPC)
    with pytest.raises(RecordingError, match="cannot begin a recording: No space left"):
        Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False, journal=journal, disk=disk)

    assert (tmp_path / "journal.jsonl").stat().st_size == 0  # closed


# --------------------------------------------------------------------------------------------- a bug in the writing


def test_a_thread_that_dies_is_told_at_the_next_tick_and_what_it_left_is_written_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write: Callable[..., None] = Recorder._write_tick
    died: list[object] = []

    def failing(recorder: Recorder, tick: Tick, *arguments: object) -> None:
        if tick.snapshot.sensed.index == 20:
            raise TypeError("Encoding objects of type Foreign is unsupported")
        write(recorder, tick, *arguments)

    monkeypatch.setattr(Recorder, "_write_tick", failing)
    monkeypatch.setattr(threading, "excepthook", died.append)
    journal = Journal(tmp_path / "journal.jsonl")
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=True, journal=journal)
    observed = first(101)
    for each in observed[:21]:
        assert recorder.troubles() == []
        recorder.observe(each.tick, each.frames)
    assert recorder._beside._thread is not None
    recorder._beside._thread.join()
    (trouble,) = recorder.troubles()
    assert (trouble.id, trouble.journal) == ("DSK-05", True)
    assert "writing it has failed: TypeError(" in trouble.detail
    for each in observed[21:]:
        recorder.observe(each.tick, each.frames)
    recorder.close("failed")

    assert len(died) == 1, "the error itself is shown where those of all threads are"
    read = [tick.snapshot.sensed.index for tick in Recording(tmp_path).ticks()]
    assert 5 < len(read) <= 20
    assert read == list(range(len(read)))
    assert recorder.dropped == 101 - len(read)
    assert [trouble.id for trouble in recorder.troubles()] == ["DSK-05"]
    entries = read_journal(tmp_path / "journal.jsonl").entries
    assert [(entry.kind, entry.text) for entry in entries[-3:]] == [
        ("mode", "ready -> follow"),
        ("gap", f"{101 - len(read)} ticks were not recorded, the first is {len(read)}"),
        ("end", "failed"),
    ]


# --------------------------------------------------------------------------------------------- the disk itself


def test_the_room_of_a_folder_that_is_not_there_yet_is_that_of_its_place(tmp_path: Path) -> None:
    assert Disk().free(tmp_path / "runs" / "today") == pytest.approx(Disk().free(tmp_path), rel=0.01)


@pytest.mark.parametrize(("free", "low"), [(499_999_999, True), (500_000_000, False)])
def test_a_disk_is_low_below_500_mb(tmp_path: Path, free: int, low: bool) -> None:
    assert (low_disk(tmp_path, FailingDisk(free=free)) is not None) == low


def test_a_disk_that_does_not_tell_its_room_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def silent(*arguments: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(shutil, "disk_usage", silent)
    with pytest.raises(RecordingError, match="its free space cannot be read: Input/output error"):
        low_disk(tmp_path, Disk())


def test_a_file_that_takes_nothing_is_full() -> None:
    class Full:
        def write(self, data: memoryview) -> int:
            return 0

    with pytest.raises(OSError, match="No space left on device"):
        write_all(Full(), b"something")
