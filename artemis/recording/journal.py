"""The journal of a run: what happened, one checked line each, readable after a cut at any byte."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec

from artemis.errors import RecordingError
from artemis.recording.disk import Disk, write_all

PREALLOCATED = 16 * 1024 * 1024
"""Bytes that are the journal's own from the start, however full the disk becomes."""


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
    """Writes `journal.jsonl`: every entry is with the operating system when `write` returns.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path, disk: Disk | None = None) -> None:
        """Start a new journal, locked until it ends, with room of its own where the file system can do these.

        Raises:
            RecordingError: the file exists already, or cannot be made.
        """
        self.path = path
        self._sequence = self._length = self._marked = 0
        try:
            self._file = (disk or Disk()).open(path, "x")
        except OSError as error:
            raise RecordingError(f"{path}: cannot begin a journal: {error.strerror}") from error
        with suppress(OSError):
            fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        if hasattr(os, "posix_fallocate"):
            with suppress(OSError):  # not every file system can; then the journal ends with the disk
                os.posix_fallocate(self._file.fileno(), 0, PREALLOCATED)

    def write(self, entry: Entry) -> None:
        """Append one entry. One that the disk refuses is lost: its number is missing, and the next may succeed.

        Raises:
            OSError: the disk refuses.
        """
        content = self._line(entry)
        self._sequence += 1
        self._put(content.ljust(self._marked, b"\0"))
        self._length, self._marked = self._length + len(content), 0

    def mark(self, time: float) -> None:
        """Say that the run goes on at run time `time` [s], in a last line that the next entry takes the place of.

        Raises:
            OSError: the disk refuses.
        """
        content = self._line(Entry(time=time, kind="running", text="")).ljust(self._marked, b"\0")
        self._marked = len(content)
        self._put(content)

    def _line(self, entry: Entry) -> bytes:
        line = _Line(self._sequence, round(entry.time, 6), entry.kind, entry.level, entry.text, entry.data)
        content = msgspec.json.encode(line)[:-1]
        return content + _CHECKSUM + b"%d}\n" % crc32(content)

    def _put(self, content: bytes) -> None:
        self._file.seek(self._length)  # behind the last whole line, whatever became of one that was refused
        write_all(self._file, content)

    def close(self) -> None:
        """End the journal, and give back the room it did not need; harmless when repeated."""
        if not self._file.closed:
            with suppress(OSError):  # a reader ignores what is behind the last line
                self._file.truncate(self._length)
            with suppress(OSError):  # every line was handed over when it was written
                self._file.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalContent:
    """What could be read of a journal; `missing` says what could not, and is None if all is there."""

    entries: tuple[Entry, ...]
    missing: str | None


def is_under_way(path: Path) -> bool:
    """Whether a process still writes this journal; False where the file system has no locks, as some of networks."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False


def read_journal(path: Path) -> JournalContent:
    """The journal up to its first damaged line. Entries that are missing in between are named.

    Raises:
        RecordingError: the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot read the journal: {error.strerror}") from error
    content = content.rstrip(b"\0")  # room that a killed run had not used yet
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
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def _entry(line: _Line) -> Entry:
    return Entry(time=line.time_s, kind=line.kind, text=line.text, level=line.level, data=line.data)
