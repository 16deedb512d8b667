from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path
from zlib import crc32

import pytest
import synthetic_run
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, DataEnd, Footer, MessageIndex
from mcap.stream_reader import StreamReader

from artemis.recording import mcap_records
from artemis.recording.mcap_file import MAGIC, McapFile
from artemis.recording.mcap_reader import Recording


def written() -> bytes:
    """Two topics, 30 messages of about 130 bytes in chunks of 1000, an attachment and metadata."""
    stream = BytesIO()
    file = McapFile(stream, "test", 1000)
    schema = file.add_schema("Number", "jsonschema", b"{}")
    channels = [file.add_channel(topic, "json", schema) for topic in ("/even", "/odd")]
    file.add_attachment(5, "notes.txt", "text/plain", b"hello")
    for number in range(30):
        file.add_message(channels[number % 2], 1000 + number, b"%d" % number * 50, number)
    file.add_metadata("end", {"outcome": "done"})
    file.finish()
    return stream.getvalue()


def test_another_reader_finds_everything_through_the_summary() -> None:
    reader = SeekingReader(BytesIO(written()), validate_crcs=True)
    summary = reader.get_summary()

    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 30
    assert summary.statistics.channel_message_counts == {1: 15, 2: 15}
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (1000, 1029)
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 2
    assert [(a.name, a.data, a.log_time) for a in reader.iter_attachments()] == [("notes.txt", b"hello", 5)]
    assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [("end", {"outcome": "done"})]


def test_topics_and_times_select_messages() -> None:
    reader = SeekingReader(BytesIO(written()), validate_crcs=True)

    found = [message for _, _, message in reader.iter_messages(topics=["/odd"], starting_at=1010, ending_before=1021)]

    assert [(m.log_time, m.publish_time, m.sequence) for m in found] == [(t, t, t - 1000) for t in range(1011, 1021, 2)]
    assert found[0].data == b"11" * 50


def test_indexes_point_at_messages_of_their_channel() -> None:
    content = written()
    summary = SeekingReader(BytesIO(content)).get_summary()
    assert summary is not None
    for chunk in summary.chunk_indexes:
        stream = BytesIO(content)
        stream.seek(chunk.chunk_start_offset)
        assert stream.read(1)[0] == Opcode.CHUNK
        for channel, offset in chunk.message_index_offsets.items():
            stream.seek(offset)
            assert stream.read(1)[0] == Opcode.MESSAGE_INDEX
            stream.read(8)
            index = MessageIndex.read(ReadDataStream(stream))
            assert index.channel_id == channel
            assert all(chunk.message_start_time <= time <= chunk.message_end_time for time, _ in index.records)


def test_checksums_cover_data_and_summary() -> None:
    content = written()
    records = list(StreamReader(BytesIO(content), emit_chunks=True, validate_crcs=True).records)
    (end,) = [record for record in records if isinstance(record, DataEnd)]
    footer = records[-1]
    assert isinstance(footer, Footer)
    data_end = footer.summary_start - 13
    assert end.data_section_crc == crc32(content[:data_end])
    assert footer.summary_crc == crc32(content[footer.summary_start : -12])
    assert content[footer.summary_offset_start] == Opcode.SUMMARY_OFFSET


def test_a_file_without_messages_is_whole() -> None:
    stream = BytesIO()
    file = McapFile(stream, "test", 1000)
    file.flush()
    file.finish()

    summary = SeekingReader(BytesIO(stream.getvalue()), validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 0


@pytest.mark.parametrize("said_by", ["the chunk", "zstd"])
def test_a_chunk_that_claims_more_than_any_recorder_writes_takes_no_memory(
    said_by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A chunk of 100 kB that says it holds 4 GiB, or does."""
    recording = synthetic_run.record(tmp_path / "recording.mcap", islice(synthetic_run.run(), 300))
    monkeypatch.setattr(mcap_records, "MOST_IN_CHUNK", 1 << 20)
    assert Recording(recording).missing is None
    size = 4 << 30 if said_by == "the chunk" else 1
    much = zstandard.ZstdCompressor().compress(bytes(2 << 20 if said_by == "zstd" else 10))
    content = bytearray(recording.read_bytes())
    offset, _ = [place for place in places(content) if place[1] == Opcode.CHUNK][-1]
    built = RecordBuilder()
    Chunk("zstd", much, 0, 0, 0, size).write(built)
    content[offset:] = built.end()  # type: ignore[no-untyped-call]
    recording.write_bytes(content)

    damaged = Recording(recording)

    assert damaged.missing is not None
    assert "a chunk claims " in damaged.missing


def places(content: bytes | bytearray) -> Iterator[tuple[int, int]]:
    """Offset and opcode of each record."""
    offset = len(MAGIC)
    while offset < len(content) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", content, offset)
        yield offset, opcode
        offset += 9 + length


def test_a_damaged_length_takes_no_more_memory_than_the_file_is_long(tmp_path: Path) -> None:
    recording = synthetic_run.record(tmp_path / "recording.mcap", islice(synthetic_run.run(), 300))
    content = bytearray(recording.read_bytes())
    offset = next(offset for offset, opcode in places(content) if opcode == Opcode.CHUNK)
    struct.pack_into("<Q", content, offset + 9 + 8 + 8 + 8 + 4 + 4 + len("zstd"), 1 << 40)
    recording.write_bytes(content)
    tracemalloc.start()
    damaged = Recording(recording)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert damaged.missing is not None
    assert peak < 50_000_000
