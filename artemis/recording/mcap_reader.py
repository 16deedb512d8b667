"""Reads a recording back, whole or damaged: as far as it is whole, and says what is missing.

Never more of it is in memory than one chunk and the files that the mission names, however long the run was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import cached_property
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk
from pydantic import ValidationError

from artemis.devices.can_bus import Frame
from artemis.errors import RecordingError
from artemis.motion.route import Route
from artemis.recording import schemas
from artemis.recording.journal import Entry, JournalContent, Level, read_journal
from artemis.recording.mcap_contents import DAMAGE, TICKS, contents_of
from artemis.recording.mcap_records import BoundedFile, Message, content_of, messages_in
from artemis.recording.provenance import ResumePoint
from artemis.recording.routes import ROUTES, unpacked_routes
from artemis.recording.schemas import TickRecord
from artemis.vehicle import RobotFile

_NOT_UNDERSTOOD = (msgspec.DecodeError, ValueError, RecursionError)
"""What bytes raise that are not the JSON that they should be (not UTF-8, an unknown value: ValueError)."""
_FRAMES, _LOG = msgspec.json.Decoder(schemas.Frames), msgspec.json.Decoder(schemas.Log)
_Content = TypeVar("_Content")
_NO_JOURNAL = "journal.jsonl is missing, empty, damaged or of another run: events are read from the recording's log"
_PLACED = b'"reset_pose":true'
"""In the record of the tick in which the odometry gets its origin."""


class Recording:
    """A run folder, or its `recording.mcap`.

    Attributes:
        path: the file.
        missing: what could not be read or was not recorded, in words; None if the recording is whole.
        versions: of artemis, python and numpy.
        start: date and time on the wall at run time 0.
        attachments: `mission.json` and `robot.json` (resolved), and the mission's files as `files/...`.
        outcome: how the run ended, in a few words; empty if nobody said.
        wall_duration: how long the run took on the wall [s]; None if it was cut off.
        number: of ticks.
        number_before_gap: of ticks before the first that is missing between others; None: none is.
        duration: run time from the first to the last tick [s].
    """

    def __init__(self, path: Path) -> None:
        """Open and check the whole file.

        Raises:
            RecordingError: it cannot be read, is no recording of artemis, or ends before the run begins.
        """
        self._in_folder = path.is_dir()
        self.path = path / "recording.mcap" if self._in_folder else path
        with self._opened() as stream:
            self._found, damage = contents_of(stream)
        self.attachments, metadata = self._found.attachments, self._found.metadata
        if "artemis" not in metadata or "robot.json" not in self.attachments:
            raise RecordingError(f"{self.path}: {damage or 'not written by artemis'}; nothing of a run can be read")
        self.versions = metadata["artemis"]
        end = metadata.get("end", {})
        self.outcome = end.get("outcome", "")
        try:
            self._start = int(self.versions["start_ns"])
            if self._start >> 64:
                raise ValueError("start_ns does not fit 64 bits")
            self.start = datetime.fromisoformat(self.versions["start"])
            self.wall_duration = float(end["wall_s"]) if "wall_s" in end else None
        except (KeyError, ValueError) as error:
            raise RecordingError(f"{self.path}: {damage or 'damaged'}; its times cannot be read: {error!r}") from error
        self.missing = self._missing(damage)
        self.number, gap = self._found.number, self._found.first_gap
        self.number_before_gap = gap.start - self._found.first if gap else None
        self.duration = (self._found.last_ns - self._found.first_ns) / 1e9

    # ----------------------------------------------------------------------------------------------------- content

    @cached_property
    def robot(self) -> RobotFile:
        """The robot that drove.

        Raises:
            RecordingError: its description is damaged.
        """
        try:
            return RobotFile.model_validate_json(self.attachments["robot.json"])
        except ValidationError as error:
            raise RecordingError(f"{self.path}: robot.json in it is damaged: {error}") from error

    @cached_property
    def mission(self) -> dict[str, Any]:
        """The resolved mission.

        Raises:
            RecordingError: it is damaged.
        """
        try:
            return msgspec.json.decode(self.attachments.get("mission.json", b""), type=dict[str, Any])
        except _NOT_UNDERSTOOD as error:
            raise RecordingError(f"{self.path}: mission.json in it is damaged: {error}") from error

    @property
    def routes(self) -> dict[int, Route]:
        """The routes that the run drove, by the number of their step; none in recordings of earlier versions.

        Raises:
            RecordingError: they are damaged.
        """
        try:
            return unpacked_routes(self.attachments[ROUTES]) if ROUTES in self.attachments else {}
        except ValueError as error:
            raise RecordingError(f"{self.path}: {ROUTES} in it is damaged: {error}") from error

    @property
    def files(self) -> dict[str, bytes]:
        """The mission's files, by the names there."""
        prefix = "files/"
        return {name[len(prefix) :]: data for name, data in self.attachments.items() if name.startswith(prefix)}

    def ticks(self) -> Iterator[TickRecord]:
        """Every tick that is there, in order.

        Raises:
            RecordingError: a tick holds other values than this version of artemis knows, or the file is gone.
        """
        yield from map(self._decoded, self._messages(TICKS))

    def chosen_ticks(self, chosen: Callable[[float, bytes], bool]) -> Iterator[TickRecord]:
        """Those that `chosen` wants, by their run time [s] and their JSON; only they are decoded. Raises as `ticks`."""
        for message in self._messages(TICKS):
            if chosen((message.time_ns - self._start) / 1e9, message.data):
                yield self._decoded(message)

    def ticks_and_frames(self) -> Iterator[TickRecord | schemas.Frames]:
        """The ticks and, each after its tick, packed frames; all in one pass. Raises as `ticks` does."""
        ticks = self._found.channels(TICKS)
        for message in self._messages(TICKS, "/frames"):
            yield self._decoded(message) if message.channel in ticks else self._understood(message, _frames_from)

    def last_tick(self) -> TickRecord | None:
        """The last of them; None: there is none.

        Raises:
            RecordingError: as `ticks`.
        """
        for content in self._contents(reversed(self._found.chunks)):
            if ticks := list(messages_in(content, self._found.channels(TICKS))):
                return self._decoded(ticks[-1])
        return None

    def places_robot(self) -> bool:
        """Whether the odometry got its origin in this run: before, its poses mean nothing."""
        return any(_PLACED in message.data for message in self._messages(TICKS))

    @cached_property
    def resume_point(self) -> ResumePoint | None:
        """The run that this one resumes.

        Raises:
            RecordingError: its description is damaged.
        """
        record = self.attachments.get("resume_point.json")
        try:
            return msgspec.json.decode(record, type=ResumePoint) if record is not None else None
        except _NOT_UNDERSTOOD as error:
            raise RecordingError(f"{self.path}: resume_point.json in it is damaged: {error}") from error

    def frames(self) -> Iterator[tuple[int, list[tuple[bool, Frame]]]]:
        """The index of each tick with frames, and these, each with "sent by us". Raises as `ticks` does."""
        for message in self._messages("/frames"):
            packed = self._understood(message, _frames_from)
            yield packed.tick, schemas.unpack_frames(packed.data)

    def entries(self) -> Iterator[Entry]:
        """What happened: the log (the journal holds the same, with data for machines). Raises as `ticks` does."""
        for message in self._messages("/log"):
            line, level = self._understood(message, _line_from)
            time = (message.time_ns - self._start) / 1e9
            yield Entry(time=time, kind=line.name, text=line.message, level=level)

    @cached_property
    def journal(self) -> JournalContent | None:
        """The journal beside it; None where there is none that begins like this run."""
        try:
            content = read_journal(self.path.parent / "journal.jsonl")
        except RecordingError:
            return None
        begun = content.entries[0].data.get("date") if content.entries else None
        return content if begun == self.versions["start"] else None

    @property
    def incomplete(self) -> str | None:
        """What is missing of the recording and, in a run folder, of its journal; None: nothing."""
        parts = self.missing, self.journal.missing if self.journal else _NO_JOURNAL if self._in_folder else None
        return "; ".join(filter(None, parts)) or None

    def events(self) -> tuple[Entry, ...]:
        """What happened, with data: the journal. Where that is lost, or less whole than the recording: the log."""
        journal = self.journal
        if journal is None or (journal.missing and not self.missing):
            return tuple(self.entries())
        return journal.entries

    def _decoded(self, message: Message) -> TickRecord:
        return self._understood(message, schemas.tick_from_record)

    def _understood(self, message: Message, read: Callable[[bytes], _Content]) -> _Content:
        """What `read` makes of a message; what that raises becomes a RecordingError."""
        try:
            return read(message.data)
        except _NOT_UNDERSTOOD as error:
            what = f"{self._found.topics[message.channel].removeprefix('/')} {message.sequence}"
            version = self.versions.get("artemis", "?")
            problem = f"{what} is not understood ({error}); it was written by artemis {version}"
            raise RecordingError(f"{self.path}: {problem}") from error

    # --------------------------------------------------------------------------------------------------- the file

    @contextmanager
    def _opened(self) -> Iterator[BufferedReader]:
        try:
            with BoundedFile(FileIO(self.path)) as stream:
                yield stream
        except FileNotFoundError:
            raise RecordingError(f"{self.path}: no recording here; name a run folder or an MCAP file") from None
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot read: {error.strerror}") from error

    def _messages(self, *topics: str) -> Iterator[Message]:
        """All messages of some topics, in the order written."""
        channels = self._found.channels(*topics)
        for content in self._contents(self._found.chunks):
            yield from messages_in(content, channels)

    def _contents(self, chunks: Iterable[int]) -> Iterator[bytes]:
        """These chunks, read again."""
        unpacker = zstandard.ZstdDecompressor()
        with self._opened() as stream:
            for place in chunks:
                stream.seek(place)
                try:
                    content = content_of(Chunk.read(ReadDataStream(stream)), unpacker, check=False)
                except DAMAGE as error:
                    raise RecordingError(f"{self.path}: changed while it was read: {error}") from error
                yield content

    def _missing(self, damage: str | None) -> str | None:
        """Words for ticks that the recorder had to drop, and for the damage of the file."""
        ticks = self._found
        time = (ticks.last_ns - self._start) / 1e9
        place = f"its last readable tick is {ticks.last}, at {time:.2f} s" if ticks.number else "no tick can be read"
        lost = "are missing" if damage else "were not recorded"
        parts = [f"{damage}; {place}"] if damage else []
        if gap := ticks.first_gap:
            parts.append(f"{ticks.lost} ticks {lost}, the first are {gap[0]} to {gap[-1]}")
        return "; ".join(parts) or None


def _line_from(record: bytes) -> tuple[schemas.Log, Level]:
    line = _LOG.decode(record)
    return line, Level(line.level)


def _frames_from(record: bytes) -> schemas.Frames:
    packed = _FRAMES.decode(record)
    if len(packed.data) % schemas.FRAME_RECORD.itemsize:
        raise ValueError(f"{len(packed.data)} bytes of frames")
    return packed
