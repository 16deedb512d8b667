"""What is in the file of a recording, whole or damaged: found in a walk through its records."""

from __future__ import annotations

import struct
from array import array
from io import BufferedReader

import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Metadata

from artemis.recording.mcap_records import (
    SHORTEST_MESSAGE,
    content_of,
    messages_in,
    read_record,
    records_in,
    whole_records,
)

DAMAGE = (McapError, ValueError, struct.error, zstandard.ZstdError, RuntimeError, MemoryError, OverflowError)
"""What a damaged file makes the mcap package raise (checksums: ValueError; absurd lengths: the last two)."""
TICKS = "/tick"
_INDEX, _PLACE = struct.Struct("<HI"), 16
"""Channel and length at the beginning of a message index; bytes in it for each message (MCAP specification)."""


class FileContents:
    """What a walk through a file finds.

    Attributes:
        metadata, attachments: by their names.
        chunks: where in the file the content of each begins.
        topics: by the numbers of their channels.
        number: of ticks.
        lost: ticks between the first and the last that are not there.
        first_gap: sequence numbers of those that are missing first; None: none are.
        first, last: sequence numbers of these two; -1: there is none.
        first_ns, last_ns: their log times.
        sure: the checksum of the file is right, and by its indexes every tick from the first to the last is there.
    """

    def __init__(self) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.chunks = array("Q")
        self.topics: dict[int, str] = {}
        self.number = self.lost = 0
        self.first_gap: range | None = None
        self.first = self.last = -1
        self.first_ns = self.last_ns = 0
        self.sure = False
        self._chunk = self._newest = b""
        """The last one, and the last with ticks."""
        self._indexed = 0
        """Ticks by the indexes."""
        self._unpacker = zstandard.ZstdDecompressor()

    def walk(self, stream: BufferedReader, *, thorough: bool) -> str | None:
        """Collect everything whole, also behind a damaged chunk; returns what is wrong with the rest.

        `thorough`: all chunks are unpacked, checked and looked through. Else only those of the first and of the last
        ticks, in a fifth of the time; the ticks between are counted by the indexes, which is enough if it is `sure`.
        """
        damage = None
        try:
            for opcode, content in whole_records(stream):
                if opcode == Opcode.DATA_END:
                    if not thorough and read_record(DataEnd, content).data_section_crc and self._newest:
                        self._end_by_indexes()
                    return damage
                try:
                    self._see(opcode, content, stream.tell() - len(content), thorough)
                except DAMAGE as error:
                    damage = damage or f"the file is damaged ({error})"
                    if not thorough:
                        return damage
        except InvalidMagic:
            return "not an MCAP file"
        except EndOfFile:
            return damage or "the file is cut off"
        except DAMAGE as error:
            return damage or f"the file is damaged ({error})"
        return damage or "the file is cut off"

    def _see(self, opcode: int, content: bytes, place: int, thorough: bool) -> None:
        if opcode == Opcode.METADATA:
            metadata = read_record(Metadata, content)
            self.metadata[metadata.name] = metadata.metadata
        elif opcode == Opcode.ATTACHMENT:
            attachment = read_record(Attachment, content)
            self.attachments[attachment.name] = attachment.data
        elif opcode == Opcode.CHUNK:
            self._chunk = content
            if thorough or self.number == 0:
                self._look_through(content)
            self.chunks.append(place)
        elif opcode == Opcode.MESSAGE_INDEX and not thorough:
            channel, length = _INDEX.unpack_from(content)
            if channel not in self.topics:
                self._look_through(self._chunk)
            if self.topics.get(channel) == TICKS:
                self._newest, self._indexed = self._chunk, self._indexed + length // _PLACE

    def _end_by_indexes(self) -> None:
        self._look_through(self._newest)
        self.number, self.lost, self.first_gap = self._indexed, 0, None
        self.sure = self.number == self.last - self.first + 1

    def _look_through(self, chunk: bytes) -> None:
        """Learn topics, and which ticks are there."""
        content = content_of(read_record(Chunk, chunk), self._unpacker, check=True)
        for opcode, start, end in records_in(content):
            if opcode == Opcode.MESSAGE and end - start < SHORTEST_MESSAGE:
                raise ValueError(f"a message of {end - start} bytes")
            if opcode == Opcode.CHANNEL:
                channel = read_record(Channel, content[start:end])
                self.topics[channel.id] = channel.topic
        for _, sequence, time_ns, _ in messages_in(content, self.channels(TICKS)):
            if self.number == 0:
                self.first, self.first_ns = sequence, time_ns
            elif sequence > self.last + 1:
                self.lost += sequence - self.last - 1
                self.first_gap = self.first_gap or range(self.last + 1, sequence)
            self.number += 1
            self.last, self.last_ns = sequence, time_ns

    def channels(self, *topics: str) -> set[int]:
        """The numbers of these."""
        return {number for number, topic in self.topics.items() if topic in topics}


def contents_of(stream: BufferedReader) -> tuple[FileContents, str | None]:
    """What is whole in a file, and what is wrong with the rest. All of it is unpacked only where that is needed."""
    found = FileContents()
    if found.walk(stream, thorough=False) is None and found.sure:
        return found, None
    stream.seek(0)
    found = FileContents()
    return found, found.walk(stream, thorough=True)
