"""Reads a recording back, whole or damaged: as far as it is whole, and says what is missing."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Metadata
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from numpy.typing import NDArray
from pydantic import ValidationError

from artemis.devices.can_bus import Frame
from artemis.errors import RecordingError
from artemis.recording import schemas
from artemis.recording.journal import Entry, JournalContent, Level, read_journal
from artemis.recording.provenance import Resumption
from artemis.recording.schemas import TickRecord
from artemis.values import Pose
from artemis.vehicle import Robot

_RECORD = struct.Struct("<BQ")
"""Kind and length of a record (MCAP specification, "Records")."""
_MESSAGE = struct.Struct("<HIQ8x")
"""Channel, sequence and log time at the beginning of a message; the publishing time is the same."""
_DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError, RuntimeError, MemoryError, OverflowError)
"""What a damaged file makes the mcap package raise (checksums: ValueError; absurd lengths: the last two)."""
_NOT_UNDERSTOOD = (msgspec.DecodeError, ValueError, RecursionError)
"""What bytes raise that are not the JSON that they should be (not UTF-8, an unknown value: ValueError)."""
_PLACED = b'"reset_pose":true'
"""In the record of the tick in which the odometry gets its origin."""


class _Message(NamedTuple):
    topic: str
    sequence: int
    time_ns: int
    data: bytes


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
    """

    def __init__(self, path: Path) -> None:
        """Open and check the whole file.

        Raises:
            RecordingError: it cannot be read, is no recording of artemis, or ends before the run begins.
        """
        self.path = path / "recording.mcap" if path.is_dir() else path
        self.attachments: dict[str, bytes] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        self._chunks: list[Chunk] = []
        self._topics: dict[int, str] = {}
        damage = self._scan()
        if "artemis" not in self._metadata or "robot.json" not in self.attachments:
            raise RecordingError(f"{self.path}: {damage or 'not written by artemis'}; nothing of a run can be read")
        self.versions = self._metadata["artemis"]
        end = self._metadata.get("end", {})
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

    # ----------------------------------------------------------------------------------------------------- content

    @cached_property
    def robot(self) -> Robot:
        """The robot that drove.

        Raises:
            RecordingError: its description is damaged.
        """
        try:
            return Robot.model_validate_json(self.attachments["robot.json"])
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
    def files(self) -> dict[str, bytes]:
        """The mission's files, by the names there."""
        prefix = "files/"
        return {name[len(prefix) :]: data for name, data in self.attachments.items() if name.startswith(prefix)}

    def ticks(self) -> Iterator[TickRecord]:
        """Every tick that is there, in order.

        Raises:
            RecordingError: a tick holds other values than this version of artemis knows.
        """
        yield from map(self._decoded, self._messages("/tick"))

    def last_tick(self) -> TickRecord | None:
        """The last of them; None: there is none.

        Raises:
            RecordingError: as `ticks`.
        """
        last = deque(self._messages("/tick"), maxlen=1)
        return self._decoded(last[0]) if last else None

    def places_robot(self) -> bool:
        """Whether the odometry got its origin in this run: before, its poses mean nothing."""
        return any(_PLACED in message.data for message in self._messages("/tick"))

    @cached_property
    def resumption(self) -> Resumption | None:
        """The run that this one goes on with.

        Raises:
            RecordingError: its description is damaged.
        """
        record = self.attachments.get("resumption.json")
        try:
            return msgspec.json.decode(record, type=Resumption) if record is not None else None
        except _NOT_UNDERSTOOD as error:
            raise RecordingError(f"{self.path}: resumption.json in it is damaged: {error}") from error

    def frame_arrays(self) -> Iterator[tuple[int, NDArray[np.void]]]:
        """The index of each tick with frames, and these as an array of dtype `schemas.FRAME_RECORD`.

        Raises:
            RecordingError: as `ticks` does.
        """
        for message in self._messages("/frames"):
            with self._understanding(message):
                packed = msgspec.json.decode(message.data, type=schemas.Frames)
                array = schemas.frame_array(packed.data)
            yield packed.tick, array

    def frames(self) -> Iterator[tuple[int, list[tuple[bool, Frame]]]]:
        """The index of each tick with frames, and these, each with "sent by us". Raises as `ticks` does."""
        for index, array in self.frame_arrays():
            yield index, schemas.unpack_frames(array.tobytes())

    def entries(self) -> Iterator[Entry]:
        """What happened: the log (the journal holds the same, with data for machines). Raises as `ticks` does."""
        for message in self._messages("/log"):
            with self._understanding(message):
                line = msgspec.json.decode(message.data, type=schemas.Log)
                level = Level(line.level)
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

    def events(self) -> tuple[Entry, ...]:
        """What happened, with data: the journal. Where that is lost, or less whole than the recording: the log."""
        journal = self.journal
        if journal is None or (journal.missing and not self.missing):
            return tuple(self.entries())
        return journal.entries

    def true_poses(self) -> Iterator[tuple[float, Pose]]:
        """Run time [s] and true pose (frame `odom`) of every tick that has one. Raises as `ticks` does."""
        for tick in self.ticks():
            if tick.true_pose is not None:
                yield tick.snapshot.time, tick.true_pose

    def _decoded(self, message: _Message) -> TickRecord:
        with self._understanding(message):
            return schemas.tick_from_record(message.data)

    @contextmanager
    def _understanding(self, message: _Message) -> Iterator[None]:
        """Turns what decoding a message raises into a RecordingError."""
        try:
            yield
        except _NOT_UNDERSTOOD as error:
            what = f"{message.topic.removeprefix('/')} {message.sequence}"
            version = self.versions.get("artemis", "?")
            problem = f"{what} is not understood ({error}); it was written by artemis {version}"
            raise RecordingError(f"{self.path}: {problem}") from error

    # --------------------------------------------------------------------------------------------------- the file

    def _scan(self) -> str | None:
        """Collect everything whole; returns what is wrong with the rest."""
        try:
            with self.path.open("rb") as stream:
                size = self.path.stat().st_size
                reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
                return self._collect(reader)
        except FileNotFoundError:
            raise RecordingError(f"{self.path}: no recording here; name a run folder or an MCAP file") from None
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot read: {error.strerror}") from error

    def _collect(self, reader: StreamReader) -> str | None:
        try:
            for record in reader.records:
                if isinstance(record, Metadata):
                    self._metadata[record.name] = record.metadata
                elif isinstance(record, Attachment):
                    self.attachments[record.name] = record.data
                elif isinstance(record, Chunk):
                    self._learn_topics(_content(record))
                    self._chunks.append(record)
                elif isinstance(record, DataEnd):
                    return None
        except InvalidMagic:
            return "not an MCAP file"
        except (EndOfFile, RecordLengthLimitExceeded, struct.error):
            return "the file is cut off"
        except _DAMAGE as error:
            return f"the file is damaged ({error})"
        return "the file is cut off"

    def _learn_topics(self, content: bytes) -> None:
        for opcode, start, end in _records(content):
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(content[start:end])))
                self._topics[channel.id] = channel.topic
            elif opcode == Opcode.MESSAGE and end - start < _MESSAGE.size:
                raise ValueError(f"a message of {end - start} bytes")

    def _messages(self, *topics: str) -> Iterator[_Message]:
        """All messages of some topics, in the order written."""
        wanted = {number: topic for number, topic in self._topics.items() if topic in topics}
        for chunk in self._chunks:
            content = _content(chunk)
            for opcode, start, end in _records(content):
                if opcode == Opcode.MESSAGE:
                    number, sequence, time_ns = _MESSAGE.unpack_from(content, start)
                    if number in wanted:
                        yield _Message(wanted[number], sequence, time_ns, content[start + _MESSAGE.size : end])

    def _missing(self, damage: str | None) -> str | None:
        """Words for ticks that the recorder had to drop, and for the damage of the file."""
        lost = 0
        first = ""
        last: _Message | None = None
        for message in self._messages("/tick"):
            if last and message.sequence > last.sequence + 1:
                lost += message.sequence - last.sequence - 1
                first = first or f"{last.sequence + 1} to {message.sequence - 1}"
            last = message
        place = f"tick {last.sequence} at {(last.time_ns - self._start) / 1e9:.2f} s" if last else "no tick"
        parts = [f"{lost} ticks were not recorded, the first are {first}"] if lost else []
        parts += [f"{damage}; the last whole one is {place}"] if damage else []
        return "; ".join(parts) or None


def _content(chunk: Chunk) -> bytes:
    """The records of a chunk, decompressed and checked."""
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(length)


def _records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, start and end of each record in a chunk."""
    offset = 0
    while offset < len(content):
        opcode, length = _RECORD.unpack_from(content, offset)
        offset += _RECORD.size
        if offset + length > len(content):
            raise ValueError("a record is longer than its chunk")
        yield opcode, offset, offset + length
        offset += length
