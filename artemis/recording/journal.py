"""The journal of a run: what happened, one checked line each, readable after a cut at any byte."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec

from artemis.errors import RecordingError
from artemis.values import DriveFeedback, Fault, Job, JobResult, Mode, Severity, Tick


class Level(IntEnum):
    """How much an entry matters; the numbers are those of foxglove.Log."""

    INFO = 2
    WARNING = 3
    ERROR = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Something that happened at run time `time` [s]. `data` is JSON: the same for machines."""

    time: float
    kind: str
    text: str
    level: Level = Level.INFO
    data: dict[str, Any] = field(default_factory=dict)


# -------------------------------------------------------------------------------------------- entries from the ticks


def entries_between(previous: Tick | None, tick: Tick) -> list[Entry]:
    """What happened in `tick`: changes of mode, phase and faults, requests, jobs, their results, drives' messages."""
    sensed = tick.snapshot.sensed
    entries: list[Entry] = []
    if previous is None or tick.mode is not previous.mode:
        entries.append(_mode_entry(sensed.time, previous.mode if previous else None, tick.mode))
    if tick.wish.phase and (previous is None or tick.wish.phase != previous.wish.phase):
        entries.append(Entry(time=sensed.time, kind="phase", text=tick.wish.phase))
    faults_before = previous.snapshot.verdict.faults if previous else ()
    if tick.snapshot.verdict.faults != faults_before:
        entries += _fault_entries(sensed.time, faults_before, tick.snapshot.verdict.faults)
    for request in sensed.requests:
        entries.append(Entry(time=sensed.time, kind="request", text=request.value))
    for sample in sensed.inputs:
        for request in sample.requests:
            entries.append(Entry(time=sensed.time, kind="request", text=f"{request.value} (by {sample.source})"))
    for drive in sensed.drives:
        if drive.emergencies or drive.boots:
            entries += _drive_entries(sensed.time, drive)
    if sensed.results or tick.wish.jobs:
        entries += _job_entries(tick)
    return entries


def _mode_entry(time: float, before: Mode | None, mode: Mode) -> Entry:
    level = {Mode.FAULT: Level.ERROR, Mode.QUICKSTOP: Level.WARNING}.get(mode, Level.INFO)
    text = mode.value if before is None else f"{before.value} -> {mode.value}"
    data = {"from": before.value if before else None, "to": mode.value}
    return Entry(time=time, kind="mode", text=text, level=level, data=data)


def _fault_entries(time: float, before: tuple[Fault, ...], now: tuple[Fault, ...]) -> list[Entry]:
    old = {(fault.id, fault.device): fault for fault in before}
    new = {(fault.id, fault.device): fault for fault in now}
    entries = []
    for key, fault in new.items():
        if key not in old:
            level = Level.ERROR if fault.severity >= Severity.CONTROLLED_STOP else Level.WARNING
            data = {"id": fault.id, "device": fault.device, "severity": fault.severity.name}
            text = f"{_named(fault)}: {fault.text}"
            entries.append(Entry(time=time, kind="fault", text=text, level=level, data=data))
    for key, fault in old.items():
        if key not in new:
            data = {"id": fault.id, "device": fault.device}
            entries.append(Entry(time=time, kind="cleared", text=_named(fault), data=data))
    return entries


def _named(fault: Fault) -> str:
    return f"{fault.id} {fault.device}".rstrip()


def _drive_entries(time: float, drive: DriveFeedback) -> list[Entry]:
    entries = [
        Entry(
            time=time,
            kind="emergency",
            text=f"{drive.name}: EMCY 0x{code:04X}",
            level=Level.WARNING if code else Level.INFO,  # code 0 says that the error is gone
            data={"drive": drive.name, "code": code},
        )
        for code in drive.emergencies
    ]
    if drive.boots:
        entries.append(Entry(time=time, kind="boot-up", text=drive.name, data={"drive": drive.name}))
    return entries


def _job_entries(tick: Tick) -> list[Entry]:
    time = tick.snapshot.time
    entries = []
    for result in tick.snapshot.sensed.results:
        outcome = "done" if result.ok else "failed"
        text = f"{result.kind.value} {result.drive}: {outcome}" + (f", {result.detail}" if result.detail else "")
        level = Level.INFO if result.ok else Level.WARNING
        data = {**_order(result), "ok": result.ok, "values": list(result.values)}
        entries.append(Entry(time=time, kind="result", text=text, level=level, data=data))
    for job in tick.wish.jobs:
        data = {**_order(job), "value": job.value}
        entries.append(Entry(time=time, kind="job", text=f"{job.kind.value} {job.drive}", data=data))
    return entries


def _order(job: Job | JobResult) -> dict[str, Any]:
    return {"id": job.id, "job": job.kind.value, "drive": job.drive}


# ---------------------------------------------------------------------------------------------------------- the file


class _Line(msgspec.Struct, frozen=True):
    """One line of the file, but for `,"crc32":N}` at its end: the checksum (zlib) of the bytes before."""

    sequence: int
    time_s: float
    kind: str
    level: Level
    text: str
    data: dict[str, Any]


_CHECKSUM = b',"crc32":'


class Journal:
    """Writes `journal.jsonl`: every entry is with the operating system when `write` returns."""

    def __init__(self, path: Path) -> None:
        """Start a new journal.

        Raises:
            RecordingError: the file exists already, or cannot be made.
        """
        self._path = path
        self._sequence = 0
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise RecordingError(f"{path}: cannot begin a journal: {error.strerror}") from error

    def write(self, entry: Entry) -> None:
        """Append one entry.

        Raises:
            RecordingError: the file cannot be written (disk full?).
        """
        line = _Line(self._sequence, entry.time, entry.kind, entry.level, entry.text, entry.data)
        content = msgspec.json.encode(line)[:-1]
        try:
            self._file.write(content + _CHECKSUM + b"%d}\n" % crc32(content))
        except OSError as error:
            raise RecordingError(f"{self._path}: cannot write: {error.strerror}; is the disk full?") from error
        self._sequence += 1

    def close(self) -> None:
        """End the journal; harmless when repeated."""
        self._file.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalContent:
    """What could be read of a journal; `missing` says what could not, and is None if all is there."""

    entries: tuple[Entry, ...]
    missing: str | None


def read_journal(path: Path) -> JournalContent:
    """The journal up to its first damaged line. Entries that are missing in between are named.

    Raises:
        RecordingError: the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot read the journal: {error.strerror}") from error
    entries: list[Entry] = []
    missing: list[str] = []
    expected = offset = 0
    for number, raw in enumerate(content.split(b"\n"), start=1):
        line = _checked(raw) if offset < len(content) else None
        if line is None:
            break
        if line.sequence != expected:
            missing.append(f"entries {expected} to {line.sequence - 1} are missing before line {number}")
        expected = line.sequence + 1
        offset += len(raw) + 1
        entries.append(_entry(line))
    if offset < len(content):
        missing.append(f"line {len(entries) + 1} is damaged: {len(content) - offset} bytes from there on are lost")
    return JournalContent(entries=tuple(entries), missing=f"{path.name}: {'; '.join(missing)}" if missing else None)


def _checked(raw: bytes) -> _Line | None:
    """The line if it is whole."""
    content, found, checksum = raw.rpartition(_CHECKSUM)
    if not found or checksum != b"%d}" % crc32(content):
        return None
    try:
        return msgspec.json.decode(content + b"}", type=_Line)
    except msgspec.DecodeError:
        return None


def _entry(line: _Line) -> Entry:
    return Entry(time=line.time_s, kind=line.kind, text=line.text, level=line.level, data=line.data)
