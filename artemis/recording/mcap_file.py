"""An MCAP file as it is written: chunks with their indexes, then the summary (MCAP specification, mcap.dev/spec).

The records are the mcap package's. Its writer is not used: it cannot be told to write what waits, by which a killed run
loses a fraction of a second only, nor say which messages wait when the disk refuses; and it needs 2 to 3 us more for a
message, of which a tick has three, and 0.9 kB of memory for every chunk of a run.
"""

from __future__ import annotations

import struct
from zlib import compressobj, crc32, decompress

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from artemis.recording.disk import Writable, write_all

MAGIC = b"\x89MCAP0\r\n"
COMPRESSION_LEVEL = 1
"""Of zstd: half the time of its default, and for records of ticks no larger."""
_MESSAGE = struct.Struct("<BQHIQQ")
"""A message but for its data: kind and length of the record, channel, sequence, log time, publishing time."""
_MESSAGE_FIELDS = _MESSAGE.size - 9
"""Bytes between the length of a message's record and its data."""


class McapFile:
    """Writes records in order; the caller opens and closes the file."""

    def __init__(self, file: Writable, library: str, chunk_size: int) -> None:
        """Begin: `library` says who writes; a chunk is written when it is longer than `chunk_size` bytes.

        Raises:
            OSError: as every method here, if the file cannot be written.
        """
        self._file = file
        self._chunk_size = chunk_size
        self._offset = self._crc = 0
        self._schemas: list[McapRecord] = []
        self._channels: list[McapRecord] = []
        self._indexer, self._indexes, self._chunks = compressobj(1), bytearray(), 0
        """Indexes of the chunks, packed, since a run of hours has ten thousands; and how many."""
        self._attachments: list[McapRecord] = []
        self._metadata: list[McapRecord] = []
        self._chunk = bytearray()
        self._places: dict[int, list[int]] = {}  # of the chunk's messages, by channel: log time, offset, ...
        self._counts: dict[int, int] = {}
        self._earliest, self._latest = 0, 0
        self._compress = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL).compress
        self._write(MAGIC)
        self._write(_bytes(Header("", library)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe messages; returns the schema's id."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk += _bytes(schema)
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema_id: int) -> int:
        """Announce messages of one topic; returns the channel's id."""
        number = len(self._channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding=encoding, metadata={}, schema_id=schema_id)
        self._channels.append(channel)
        self._chunk += _bytes(channel)
        return number

    def add_message(self, channel_id: int, time: int, data: bytes, sequence: int = 0) -> None:
        """Append a message, logged and published at `time` [ns since 1970]."""
        chunk = self._chunk
        place = self._places.get(channel_id)
        if place is None:
            place = self._places[channel_id] = []
        place += (time, len(chunk))
        chunk += _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_FIELDS + len(data), channel_id, sequence, time, time)
        chunk += data
        if len(chunk) > self._chunk_size:
            self._end_chunk()

    def add_attachment(self, time: int, name: str, media_type: str, data: bytes) -> None:
        """Put a file of its own into the file, made and logged at `time` [ns since 1970]."""
        record = _bytes(Attachment(create_time=time, log_time=time, name=name, media_type=media_type, data=data))
        index = AttachmentIndex(
            offset=self._write(record),
            length=len(record),
            log_time=time,
            create_time=time,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._attachments.append(index)

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        """Put names and values into the file."""
        record = _bytes(Metadata(name, content))
        self._metadata.append(MetadataIndex(offset=self._write(record), length=len(record), name=name))

    def first_waiting(self, channel_id: int) -> int | None:
        """Sequence number of a channel's first message that is not in the file yet; None: all are."""
        place = self._places.get(channel_id)
        return None if place is None else int(_MESSAGE.unpack_from(self._chunk, place[1])[3])

    def flush(self) -> None:
        """Write everything, including the chunk that is not full yet."""
        self._end_chunk()

    def finish(self) -> None:
        """Write the last chunk, the summary and the end of the file."""
        self._end_chunk()
        self._write(_bytes(DataEnd(self._crc)))
        start = self._offset
        groups = [
            (Opcode.SCHEMA, b"".join(map(_bytes, self._schemas))),
            (Opcode.CHANNEL, b"".join(map(_bytes, self._channels))),
            (Opcode.STATISTICS, _bytes(self._statistics())),
            (Opcode.CHUNK_INDEX, decompress(self._indexes + self._indexer.flush())),
            (Opcode.ATTACHMENT_INDEX, b"".join(map(_bytes, self._attachments))),
            (Opcode.METADATA_INDEX, b"".join(map(_bytes, self._metadata))),
        ]
        summary, offsets = b"", b""
        for opcode, group in groups:
            offsets += _bytes(SummaryOffset(opcode, start + len(summary), len(group))) if group else b""
            summary += group
        footer = Footer(summary_start=start, summary_offset_start=start + len(summary), summary_crc=0)
        checked = summary + offsets + _bytes(footer)[:-4]  # all but the checksum itself
        self._write(checked + struct.pack("<I", crc32(checked)))
        self._write(MAGIC)

    def _end_chunk(self) -> None:
        """Write the messages collected, compressed, and behind them where each channel's are."""
        if not self._places:
            return
        times = [time for place in self._places.values() for time in place[::2]]
        chunk = Chunk(
            compression="zstd",
            data=self._compress(self._chunk),
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=crc32(self._chunk),
            uncompressed_size=len(self._chunk),
        )
        offset = self._write(_bytes(chunk))
        after = self._offset
        index = {number: self._write(_message_index(number, place)) for number, place in self._places.items()}
        record = ChunkIndex(
            chunk_start_offset=offset,
            chunk_length=after - offset,
            message_index_offsets=index,
            message_index_length=self._offset - after,
            message_start_time=chunk.message_start_time,
            message_end_time=chunk.message_end_time,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            uncompressed_size=chunk.uncompressed_size,
        )
        self._indexes += self._indexer.compress(_bytes(record))
        self._chunks += 1
        self._count(chunk)
        self._chunk.clear()
        self._places.clear()

    def _count(self, chunk: Chunk) -> None:
        self._earliest = min(self._earliest, chunk.message_start_time) if self._counts else chunk.message_start_time
        self._latest = max(self._latest, chunk.message_end_time)
        for number, place in self._places.items():
            self._counts[number] = self._counts.get(number, 0) + len(place) // 2

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_start_time=self._earliest,
            message_end_time=self._latest,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> int:
        """Append to the file; returns where."""
        offset = self._offset
        write_all(self._file, data)
        self._offset += len(data)
        self._crc = crc32(data, self._crc)
        return offset


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap leaves out the annotation
    return content


def _message_index(channel_id: int, place: list[int]) -> bytes:
    """The record that says where the messages of a channel are in their chunk: log time, offset, ..."""
    content = struct.pack(f"<HI{len(place)}Q", channel_id, 8 * len(place), *place)
    return struct.pack("<BQ", Opcode.MESSAGE_INDEX, len(content)) + content
