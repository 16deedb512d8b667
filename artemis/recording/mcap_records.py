"""The records of an MCAP file, one by one, checked. No damaged file takes more memory than it is long."""

from __future__ import annotations

import os
import struct
from collections.abc import Container, Iterator
from io import BufferedReader, BytesIO, FileIO
from typing import NamedTuple, TypeVar
from zlib import crc32

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Metadata

from artemis.recording.mcap_file import MAGIC

_RECORD = struct.Struct("<BQ")
"""Kind and length of a record (MCAP specification, "Records")."""
_MESSAGE = struct.Struct("<BQHIQ8x")
"""A message but for its data: kind and length of the record, channel, sequence, log time; publishing it is the same."""
SHORTEST_MESSAGE = _MESSAGE.size - _RECORD.size
"""Bytes of one without data."""
MOST_IN_CHUNK = 64 * 1024 * 1024
"""A chunk that claims to hold more bytes is damaged: the recorder ends one with the message that passes 256 KiB."""
_Record = TypeVar("_Record", Attachment, Channel, Chunk, DataEnd, Metadata)


class Message(NamedTuple):
    """What a message holds, by the number of its channel, logged at `time_ns` [ns since 1970]."""

    channel: int
    sequence: int
    time_ns: int
    data: bytes


class BoundedFile(BufferedReader):
    """A file that takes no more memory than it is long, whatever length a damaged record claims."""

    def __init__(self, raw: FileIO) -> None:
        super().__init__(raw)
        self._length = os.fstat(raw.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """As any file."""
        return super().read(self._length if size is None else min(size, self._length))


def whole_records(stream: BufferedReader) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each record up to the end of the data, which is checked.

    The package's own reader takes each record apart: a third of the time that a report of a long run needs.

    Raises:
        InvalidMagic: the file does not begin as MCAP does.
        EndOfFile: it ends within a record.
        ValueError: the checksum of all data is wrong.
    """
    begin = stream.read(len(MAGIC))
    if len(begin) < len(MAGIC):
        raise EndOfFile
    if begin != MAGIC:
        raise InvalidMagic(begin)
    checksum = crc32(begin)
    while True:
        head = stream.read(_RECORD.size)
        if len(head) < _RECORD.size:
            raise EndOfFile
        opcode, length = _RECORD.unpack(head)
        content = stream.read(length)
        if len(content) < length:
            raise EndOfFile
        if opcode == Opcode.DATA_END and read_record(DataEnd, content).data_section_crc not in (0, checksum):
            raise ValueError("the checksum of its data is wrong")
        checksum = crc32(content, crc32(head, checksum))
        yield opcode, content


def read_record(kind: type[_Record], content: bytes) -> _Record:
    """A record of a kind.

    Raises:
        ValueError: it is shorter than it claims to be.
    """
    try:
        record: _Record = kind.read(ReadDataStream(BytesIO(content)))
    except (EndOfFile, struct.error) as error:
        raise ValueError(f"a record of {len(content)} bytes is shorter than what is in it") from error
    return record


def content_of(chunk: Chunk, unpacker: zstandard.ZstdDecompressor, *, check: bool) -> bytes:
    """The records of a chunk, decompressed, and checked if asked for.

    Raises:
        ValueError: it claims to be larger than any that was ever written, is compressed otherwise, or damaged.
    """
    content, claimed = chunk.data, chunk.uncompressed_size
    if chunk.compression == "zstd":
        size = zstandard.get_frame_parameters(content).content_size
        claimed = claimed if size == zstandard.CONTENTSIZE_UNKNOWN else max(claimed, size)
    elif chunk.compression:
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}; expected zstd")
    if claimed > MOST_IN_CHUNK:
        raise ValueError(f"a chunk claims {claimed} bytes, more than {MOST_IN_CHUNK} that it may hold")
    if chunk.compression:
        content = unpacker.decompress(content, max_output_size=claimed)
    if check and chunk.uncompressed_crc not in (0, crc32(content)):
        raise ValueError("the checksum of a chunk is wrong")
    return content


def records_in(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, start and end of each record in a chunk."""
    offset = 0
    while offset < len(content):
        opcode, length = _RECORD.unpack_from(content, offset)
        offset += _RECORD.size
        if offset + length > len(content):
            raise ValueError("a record is longer than its chunk")
        yield opcode, offset, offset + length
        offset += length


def messages_in(content: bytes, channels: Container[int]) -> Iterator[Message]:
    """The messages of some channels in a chunk: two to four for each tick of a run, and each passed over at once."""
    offset, last = 0, len(content) - _MESSAGE.size
    while offset <= last:
        opcode, length, channel, sequence, time = _MESSAGE.unpack_from(content, offset)
        begin, offset = offset, offset + _RECORD.size + length
        if opcode == Opcode.MESSAGE and channel in channels:
            yield Message(channel, sequence, time, content[begin + _MESSAGE.size : offset])
