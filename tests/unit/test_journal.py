from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from artemis.errors import RecordingError
from artemis.recording import journal as module
from artemis.recording.journal import Entry, Journal, JournalContent, Level, is_under_way, read_journal
from artemis_lab.injections.failing_disk import FailingDisk

ENTRIES = (
    Entry(time=0.0, kind="start", text="mission circle", data={"robot": "ARTEMIS"}),
    Entry(time=1.25, kind="fault", text="DRV-25: «too far»\nsecond line", level=Level.ERROR, data={"id": "DRV-25"}),
    Entry(time=2.5, kind="note", text='a text with ,"crc32":1} in it'),
    Entry(time=3.0, kind="end", text=""),
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    journal = Journal(tmp_path / "journal.jsonl")
    for entry in ENTRIES:
        journal.write(entry)
    journal.close()
    return tmp_path / "journal.jsonl"


def test_entries_come_back(path: Path) -> None:
    content = read_journal(path)

    assert content.entries == ENTRIES
    assert content.missing is None


def test_an_entry_is_in_the_file_when_write_returns(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    journal.write(ENTRIES[0])

    assert read_journal(tmp_path / "journal.jsonl").entries == ENTRIES[:1]
    journal.close()


def test_a_cut_at_any_byte_leaves_every_whole_line(path: Path) -> None:
    whole = path.read_bytes()
    ends = [index for index, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        content = read_journal(path)
        count = sum(end <= size for end in ends)  # a line is whole without its newline
        assert content.entries == ENTRIES[:count], size
        if size in {0, *ends, *(end + 1 for end in ends)}:
            assert content.missing is None
        else:
            lost = size - (ends[count - 1] + 1 if count else 0)
            assert content.missing == f"journal.jsonl: line {count + 1} is damaged: {lost} bytes from there on are lost"


def test_any_flipped_byte_is_noticed(path: Path) -> None:
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x20
        path.write_bytes(damaged)
        content = read_journal(path)
        assert content.entries == ENTRIES[: len(content.entries)]
        assert len(content.entries) < len(ENTRIES) or content.missing is not None


def test_missing_entries_are_named(path: Path) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[3])

    content = read_journal(path)

    assert content.entries == (ENTRIES[0], ENTRIES[3])
    assert content.missing == "journal.jsonl: entries 1 to 2 are missing before line 2"


def test_a_journal_is_never_overwritten(path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot begin a journal: File exists"):
        Journal(path)


def test_a_missing_journal_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot read the journal: No such file"):
        read_journal(tmp_path / "journal.jsonl")


def test_a_time_is_written_to_the_microsecond(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    journal.write(Entry(time=0.1 + 0.2, kind="note", text=""))
    journal.close()

    assert b'"time_s":0.3,' in (tmp_path / "journal.jsonl").read_bytes()


# ------------------------------------------------------------------------------------------- room of its own


def killed(tmp_path: Path, entries: tuple[Entry, ...] = ENTRIES) -> bytes:
    """What is in the file while the run still goes on: it was never closed."""
    journal = Journal(tmp_path / "killed.jsonl")
    for entry in entries:
        journal.write(entry)
    content = (tmp_path / "killed.jsonl").read_bytes()
    journal.close()
    return content


def test_a_journal_has_room_of_its_own_until_it_is_closed(tmp_path: Path) -> None:
    content = killed(tmp_path)

    assert len(content) == module.PREALLOCATED == 16 * 1024 * 1024
    assert content.rstrip(b"\0") == (tmp_path / "killed.jsonl").read_bytes()


def test_of_a_killed_run_nothing_is_lost(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_bytes(killed(tmp_path))

    content = read_journal(tmp_path / "journal.jsonl")

    assert (content.entries, content.missing) == (ENTRIES, None)


def test_a_run_killed_while_a_line_was_written_loses_that_line_only(tmp_path: Path) -> None:
    whole = killed(tmp_path).rstrip(b"\0")
    ends = [index for index, byte in enumerate(whole) if byte == ord("\n")]
    path = tmp_path / "journal.jsonl"
    for size in range(len(whole)):
        path.write_bytes(whole[:size] + bytes(50))
        content = read_journal(path)
        count = sum(end <= size for end in ends)
        assert content.entries == ENTRIES[:count], size
        assert (content.missing is None) == (size in {0, *ends, *(end + 1 for end in ends)}), size


def test_where_no_room_can_be_reserved_the_journal_does_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsupported(*arguments: object) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(os, "posix_fallocate", unsupported)
    content = killed(tmp_path)

    assert content == (tmp_path / "killed.jsonl").read_bytes()


# ------------------------------------------------------------------------------------------- a disk that refuses


def test_a_disk_that_refuses_is_said(tmp_path: Path) -> None:
    disk = FailingDisk()
    journal = Journal(tmp_path / "journal.jsonl", disk)
    disk.fail("journal", errno.EIO)

    with pytest.raises(OSError, match="Input/output error"):
        journal.write(ENTRIES[0])
    journal.close()
    journal.close()


@pytest.mark.parametrize("taken", [0, 1, 40, 10_000])
def test_what_the_disk_refused_is_missing_and_what_came_after_is_there(tmp_path: Path, taken: int) -> None:
    """However much of the refused line got into the file: a longer and a shorter one follow."""
    disk = FailingDisk()
    journal = Journal(tmp_path / "journal.jsonl", disk)
    journal.write(ENTRIES[0])
    disk.fail("journal", errno.ENOSPC, after=taken)
    with pytest.raises(OSError, match="No space left"):
        journal.write(Entry(time=1.0, kind="lost", text="x" * 20_000))
    disk.heal()
    journal.write(ENTRIES[1])
    journal.close()

    content = read_journal(tmp_path / "journal.jsonl")
    assert content.entries == ENTRIES[:2]
    assert content.missing == "journal.jsonl: entries 1 to 1 are missing before line 2"


def test_a_disk_that_takes_a_few_bytes_at_a_time_loses_nothing(tmp_path: Path) -> None:
    disk = FailingDisk(at_once=7)
    journal = Journal(tmp_path / "journal.jsonl", disk)
    for entry in ENTRIES:
        journal.write(entry)
    journal.close()

    assert read_journal(tmp_path / "journal.jsonl").entries == ENTRIES


# ---------------------------------------------------------------------------------------------- how long it lasts


def test_the_last_mark_of_a_run_that_goes_on_is_its_last_entry(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.write(ENTRIES[0])
    for time in (1.0, 2.0, 12.0, 3.0):
        journal.mark(time)
        content = read_journal(path)
        assert content.missing is None
        assert [(entry.time, entry.kind) for entry in content.entries] == [(0.0, "start"), (time, "running")]
    journal.close()


def test_an_entry_takes_the_place_of_a_mark(path: Path, tmp_path: Path) -> None:
    (tmp_path / "marked").mkdir()
    journal = Journal(tmp_path / "marked/journal.jsonl")
    for number, entry in enumerate(ENTRIES):
        journal.mark(1234567.891011 + number)  # longer than the last entry
        journal.write(entry)
        assert read_journal(journal.path).entries == ENTRIES[: number + 1]
        assert read_journal(journal.path).missing is None
    journal.mark(5.0)
    journal.close()
    assert journal.path.read_bytes() == path.read_bytes()


def test_a_mark_that_the_disk_refuses_harms_no_entry(tmp_path: Path) -> None:
    disk = FailingDisk()
    journal = Journal(tmp_path / "journal.jsonl", disk)
    journal.write(ENTRIES[0])
    disk.fail("journal", errno.EIO, after=10)
    with pytest.raises(OSError, match="error"):
        journal.mark(1.0)
    disk.heal()
    journal.write(ENTRIES[1])
    journal.close()
    assert read_journal(journal.path) == JournalContent(entries=ENTRIES[:2], missing=None)


def test_a_journal_is_locked_until_its_process_ends_it(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    assert not is_under_way(path)
    journal = Journal(path)
    assert is_under_way(path)
    journal.write(ENTRIES[0])
    assert read_journal(path).entries == ENTRIES[:1]
    assert is_under_way(path)
    journal.close()
    assert not is_under_way(path)
