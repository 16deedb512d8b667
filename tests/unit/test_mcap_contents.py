"""A recording is opened by its checksum and its indexes; where these do not suffice, all of it is looked through."""

from __future__ import annotations

import struct
from itertools import islice
from pathlib import Path

import pytest
import synthetic_run
from mcap.opcode import Opcode
from mcap.reader import make_reader

from artemis.recording import mcap_contents, mcap_reader
from artemis.recording.mcap_file import MAGIC, McapFile
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_records import content_of

NUMBER = 200


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in about ten chunks."""
    path = tmp_path_factory.mktemp("whole") / "recording.mcap"
    return synthetic_run.record(path, islice(synthetic_run.run(), NUMBER))


@pytest.fixture
def unpacked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The sizes of chunks that were unpacked."""
    sizes: list[int] = []

    def counting(*arguments: object, check: bool) -> bytes:
        content = content_of(*arguments, check=check)  # type: ignore[arg-type]
        sizes.append(len(content))
        return content

    monkeypatch.setattr(mcap_contents, "content_of", counting)
    monkeypatch.setattr(mcap_reader, "content_of", counting)
    return sizes


def written_again(recording: Path, path: Path, *, without: range = range(0), log_last: bool = False) -> Recording:
    """The same in chunks of other sizes, without some ticks; `log_last`: nothing is logged before the last tick."""
    with recording.open("rb") as source, path.open("wb", buffering=0) as file:
        reader, again, channels = make_reader(source), McapFile(file, "test", 20_000), dict[str, int]()
        for metadata in reader.iter_metadata():
            again.add_metadata(metadata.name, metadata.metadata)
        for attachment in reader.iter_attachments():
            again.add_attachment(attachment.log_time, attachment.name, attachment.media_type, attachment.data)
        found = list(reader.iter_messages(log_time_order=False))
        for schema, channel, message in sorted(found, key=lambda each: log_last and each[1].topic == "/log"):
            if channel.topic == "/tick" and message.sequence in without:
                continue
            assert schema is not None
            if channel.topic not in channels:
                kind = again.add_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = again.add_channel(channel.topic, channel.message_encoding, kind)
            again.add_message(channels[channel.topic], message.log_time, message.data, message.sequence)
        again.finish()
    return Recording(path)


def test_of_a_whole_recording_the_chunks_of_the_first_and_the_last_ticks_are_unpacked(
    whole: Path, unpacked: list[int]
) -> None:
    recording = Recording(whole)

    assert len(unpacked) == 2
    assert (recording.number, recording.missing) == (NUMBER, None)
    assert recording.duration == pytest.approx((NUMBER - 1) / 50)
    assert len(list(recording.ticks())) == NUMBER
    assert len(unpacked) > 6


def test_the_last_tick_is_read_from_the_end(whole: Path, unpacked: list[int]) -> None:
    last = Recording(whole).last_tick()

    assert last is not None
    assert last.snapshot.sensed.index == NUMBER - 1
    assert len(unpacked) <= 4  # what follows the last ticks is in a chunk of its own


@pytest.mark.parametrize(("begin", "end"), [(1, 3), (90, 120), (NUMBER - 3, NUMBER - 1)])
def test_ticks_that_are_missing_in_a_whole_file_are_counted(whole: Path, tmp_path: Path, begin: int, end: int) -> None:
    recording = written_again(whole, tmp_path / "gap.mcap", without=range(begin, end))

    assert recording.number == NUMBER - (end - begin)
    assert recording.missing == f"{end - begin} ticks were not recorded, the first are {begin} to {end - 1}"


def test_a_topic_that_comes_late_is_found(whole: Path, tmp_path: Path) -> None:
    entries = list(Recording(whole).entries())

    recording = written_again(whole, tmp_path / "late.mcap", log_last=True)

    assert list(recording.entries()) == entries != []
    assert (recording.number, recording.missing) == (NUMBER, None)


def test_a_file_without_a_checksum_is_looked_through(whole: Path, tmp_path: Path, unpacked: list[int]) -> None:
    path, content = tmp_path / "unsaid.mcap", bytearray(whole.read_bytes())
    (summary,) = struct.unpack_from("<Q", content, len(content) - len(MAGIC) - 20)
    end = summary - 13  # of the data: kind, length and checksum
    assert content[end] == Opcode.DATA_END
    content[end + 9 : end + 13] = bytes(4)
    path.write_bytes(content)

    recording = Recording(path)

    assert len(unpacked) > 6
    assert (recording.number, recording.missing) == (NUMBER, None)
    content[content.index(b"zstd", end // 2) + 100] ^= 1
    path.write_bytes(content)
    damaged = Recording(path).missing
    assert damaged is not None
    assert "damaged" in damaged
