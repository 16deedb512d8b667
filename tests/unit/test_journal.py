from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import synthetic_run

from artemis.errors import RecordingError
from artemis.recording.journal import Entry, Journal, Level, entries_between, read_journal
from artemis.values import Fault, JobKind, JobResult, Mode, OperatorInput, Request, Severity, Tick, Verdict

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


def test_a_full_disk_is_said() -> None:
    journal = Journal.__new__(Journal)
    journal._path, journal._sequence, journal._file = Path("journal.jsonl"), 0, open("/dev/full", "wb", buffering=0)
    with pytest.raises(RecordingError, match="cannot write: No space left on device; is the disk full"):
        journal.write(ENTRIES[0])
    journal.close()


# ------------------------------------------------------------------------------------------- entries from ticks


def tick(**sensed: object) -> Tick:
    base = next(synthetic_run.run()).tick
    return replace(base, snapshot=replace(base.snapshot, sensed=replace(base.snapshot.sensed, **sensed)))  # type: ignore[arg-type]


def described(previous: Tick | None, now: Tick) -> list[tuple[str, str, Level]]:
    return [(entry.kind, entry.text, entry.level) for entry in entries_between(previous, now)]


def test_a_tick_like_the_last_one_is_no_news() -> None:
    assert entries_between(tick(), tick(time=0.02)) == []


def test_the_first_tick_names_mode_and_phase() -> None:
    assert described(None, tick()) == [("mode", "init", Level.INFO), ("phase", "listen", Level.INFO)]


def test_a_change_to_fault_is_an_error() -> None:
    changed = replace(tick(), mode=Mode.FAULT)

    assert described(tick(), changed) == [("mode", "init -> fault", Level.ERROR)]
    assert entries_between(tick(), changed)[0].data == {"from": "init", "to": "fault"}


def with_faults(*faults: Fault) -> Tick:
    base = tick()
    return replace(base, snapshot=replace(base.snapshot, verdict=Verdict(faults=faults)))


def test_faults_are_told_when_they_come_and_when_they_go() -> None:
    mild = Fault(id="INP-02", severity=Severity.WARN, text="stick is old", device="stick")
    severe = Fault(id="BUS-01", severity=Severity.OFF, text="bus off")

    assert described(with_faults(mild), with_faults(severe, mild)) == [("fault", "BUS-01: bus off", Level.ERROR)]
    assert described(with_faults(), with_faults(mild)) == [("fault", "INP-02 stick: stick is old", Level.WARNING)]
    assert described(with_faults(severe, mild), with_faults(severe)) == [("cleared", "INP-02 stick", Level.INFO)]


def test_requests_are_told_with_their_source() -> None:
    asked = tick(requests=(Request.ARM,), inputs=(OperatorInput(source="stick", requests=(Request.QUICKSTOP,)),))

    assert described(tick(), asked) == [
        ("request", "arm", Level.INFO),
        ("request", "quick stop (by stick)", Level.INFO),
    ]


def test_a_failed_job_is_a_warning_with_its_detail() -> None:
    result = JobResult(id=7, kind=JobKind.CONFIGURE, drive="steer-left", ok=False, detail="no answer", values=(1, 2))
    (entry,) = entries_between(tick(), tick(results=(result,)))

    assert (entry.kind, entry.text) == ("result", "configure steer-left: failed, no answer")
    assert entry.level is Level.WARNING
    assert entry.data == {"id": 7, "job": "configure", "drive": "steer-left", "ok": False, "values": [1, 2]}


def test_emergencies_and_boots_of_a_drive_are_told() -> None:
    base = tick()
    drive = replace(base.snapshot.sensed.drives[0], emergencies=(0x8130, 0), boots=1)

    assert described(base, tick(drives=(drive,))) == [
        ("emergency", "traction-left: EMCY 0x8130", Level.WARNING),
        ("emergency", "traction-left: EMCY 0x0000", Level.INFO),
        ("boot-up", "traction-left", Level.INFO),
    ]
