from __future__ import annotations

import dataclasses
import json
import math
from datetime import timedelta
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import synthetic_run
from mcap.reader import make_reader
from msgspec.structs import replace

from artemis.devices.can_bus import Frame
from artemis.errors import RecordingError
from artemis.recording import mcap_writer
from artemis.recording.journal import Entry, Journal, read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.recording.schemas import CHANNELS, differences, encode, tick_record
from artemis.values import Pose


def first(count: int) -> list[synthetic_run.Observed]:
    return list(islice(synthetic_run.run(), count))


def messages(path: Path, topic: str) -> list[tuple[int, bytes]]:
    with path.open("rb") as stream:
        return [(m.log_time, m.data) for _, _, m in make_reader(stream).iter_messages(topics=[topic])]


def test_every_value_of_a_tick_comes_back_exactly(tmp_path: Path) -> None:
    observed = first(200)
    recording = Recording(synthetic_run.record(tmp_path / "recording.mcap", iter(observed)))

    ticks = list(recording.ticks())

    assert recording.missing is None
    assert [tick.snapshot.sensed for tick in ticks] == [each.tick.snapshot.sensed for each in observed]
    assert [encode(tick) for tick in ticks] == [tick_record(each.tick, each.true_pose) for each in observed]
    assert [tick.snapshot.odometry for tick in ticks] == [each.tick.snapshot.odometry for each in observed]
    assert [tick.wish.tracking for tick in ticks] == [each.tick.wish.tracking for each in observed]
    assert [tick.true_pose for tick in ticks] == [each.true_pose for each in observed]


def test_a_tick_made_again_is_compared_bit_for_bit(tmp_path: Path) -> None:
    tick = first(130)[-1].tick
    each = synthetic_run.Observed(tick=tick, frames=[], true_pose=Pose(x=1.0))
    (recorded,) = Recording(synthetic_run.record(tmp_path / "recording.mcap", iter([each]))).ticks()
    speed = math.nextafter(tick.set_points.speed, 1.0)
    changed = replace(tick, set_points=replace(tick.set_points, speed=speed, steering=0))

    assert differences(recorded, tick) == []
    assert differences(recorded, changed) == [
        f"set_points.speed: recorded {tick.set_points.speed!r}, now {speed!r}",
        f"set_points.steering: recorded {tick.set_points.steering!r}, now 0.0",
    ]


def test_frames_come_back_in_order(tmp_path: Path) -> None:
    observed = first(3)
    observed[1].frames[:] = [
        (True, Frame(0x702, b"", True, 0.0201)),
        (False, Frame(0x7FF, bytes(range(8)), False, 0.03)),
    ]
    recording = Recording(synthetic_run.record(tmp_path / "recording.mcap", iter(observed)))

    assert list(recording.frames()) == [(index, each.frames) for index, each in enumerate(observed)]


def test_a_tick_without_frames_writes_no_frames(tmp_path: Path) -> None:
    observed = first(2)
    observed[0].frames.clear()
    recording = Recording(synthetic_run.record(tmp_path / "recording.mcap", iter(observed)))

    assert [index for index, _ in recording.frames()] == [1]


def test_what_the_run_was_made_from_comes_back(tmp_path: Path) -> None:
    recording = Recording(synthetic_run.record(tmp_path / "recording.mcap", iter(first(2)), outcome="done, 2 ticks"))

    assert recording.robot == synthetic_run.robot()
    assert recording.mission == synthetic_run.MISSION
    assert recording.files == {"paths/circle.csv": synthetic_run.CIRCLE.encode()}
    assert recording.start == synthetic_run.START
    assert set(recording.versions) >= {"artemis", "python", "numpy"}
    assert recording.outcome == "done, 2 ticks"
    assert recording.wall_duration is not None


def test_equal_runs_give_equal_bytes(tmp_path: Path) -> None:
    paths = [synthetic_run.record(tmp_path / name, synthetic_run.run(fault_at=2.5)) for name in ("a.mcap", "b.mcap")]

    for topic in ("/tick", "/frames", "/log"):
        assert messages(paths[0], topic) == messages(paths[1], topic) != []


def test_log_time_is_the_wall_start_plus_run_time(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", iter(first(3)))

    start = int((synthetic_run.START - timedelta(microseconds=250_000)).timestamp()) * 10**9 + 250_000_000
    assert [time for time, _ in messages(path, "/tick")] == [start, start + 20_000_000, start + 40_000_000]


def test_what_happened_is_logged_and_journalled(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False, journal=journal)
    for each in first(101):
        recorder.observe(each.tick, each.frames)
    recorder.note(Entry(time=2.0, kind="note", text="a person came by"))
    recorder.close()

    logged = [(entry.time, entry.kind, entry.text) for entry in Recording(tmp_path).entries()]
    journalled = read_journal(tmp_path / "journal.jsonl")
    assert (0.4, "job", "configure traction-left") in logged
    assert (0.8, "result", "configure traction-left: done, 38 objects") in logged
    assert (1.5, "mode", "init -> ready") in logged
    assert logged[-2:] == [(2.0, "note", "a person came by"), (2.0, "end", "")]
    assert journalled.missing is None
    assert [(entry.time, entry.kind, entry.text) for entry in journalled.entries] == logged


def test_a_path_is_shown_in_the_frame_of_the_odometry(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False)
    recorder.show_path(0.5, [Pose(x=1.0, y=2.0, heading=math.pi)])
    recorder.close()

    ((_, data),) = messages(tmp_path / "recording.mcap", "/path")
    shown = json.loads(data)
    assert shown["frame_id"] == "odom"
    assert shown["timestamp"]["nsec"] == 750_000_000
    assert shown["poses"][0]["position"] == {"x": 1.0, "y": 2.0, "z": 0.0}
    assert shown["poses"][0]["orientation"]["z"] == pytest.approx(1.0)


def test_viewers_get_poses_ten_times_a_second(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", iter(first(100)))

    for topic in ("/pose/estimated", "/pose/true", "/tf"):
        assert len(messages(path, topic)) == 20


# ---------------------------------------------------------------------------------------------------- schemas


def fits(value: object, schema: dict[str, Any]) -> bool:
    """Whether a viewer that knows only plain schemas finds what the schema promises (optional values may be null)."""
    if value is None:
        return True
    if schema["type"] == "object":
        properties = schema["properties"]
        return (
            isinstance(value, dict)
            and set(value) <= set(properties)
            and all(fits(value[key], properties[key]) for key in value)
        )
    if schema["type"] == "array":
        return isinstance(value, list) and all(fits(each, schema["items"]) for each in value)
    kinds: dict[str, tuple[type, ...]] = {
        "string": (str,),
        "number": (int, float),
        "integer": (int,),
        "boolean": (bool,),
    }
    return isinstance(value, kinds[schema["type"]])


def test_every_message_fits_its_plain_schema(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False)
    for each in synthetic_run.run(fault_at=2.5):
        recorder.observe(each.tick, each.frames, each.true_pose)
    recorder.show_path(0.0, [Pose()])
    recorder.close()

    topics = set()
    with (tmp_path / "recording.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert schema.encoding == "jsonschema"
            assert fits(json.loads(message.data), json.loads(schema.data)), channel.topic
            topics.add(channel.topic)
    assert topics == set(CHANNELS)


# ------------------------------------------------------------------------------------------------- real time


def test_a_thread_records_the_same(tmp_path: Path) -> None:
    paths = [tmp_path / "direct.mcap", tmp_path / "threaded.mcap"]
    for path, threaded in zip(paths, (False, True), strict=True):
        synthetic_run.record(path, iter(first(120)), threaded=threaded)

    assert messages(paths[0], "/tick") == messages(paths[1], "/tick")
    assert messages(paths[0], "/tick") == messages(paths[1], "/tick")
    assert Recording(paths[1]).missing is None


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot begin a recording: No such file"):
        Recorder(tmp_path / "nowhere" / "recording.mcap", synthetic_run.provenance(), threaded=False)


# --------------------------------------------------------------------------------------------------- damage


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(mcap_writer, "CHUNK_SIZE", 12_000)
    return synthetic_run.record(tmp_path / "recording.mcap", iter(first(30)))


def borders(path: Path) -> set[int]:
    """Sizes of the file cut at, just before and just behind the ends of its chunks, and of the records behind them."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 3
    ends = [
        end
        for chunk in summary.chunk_indexes
        for length in (0, chunk.chunk_length, chunk.chunk_length + chunk.message_index_length)
        for end in [chunk.chunk_start_offset + length]
    ]
    return {end + offset for end in ends for offset in (-1, 0, 1)}


def test_a_cut_recording_is_read_as_far_as_it_is_whole(small: Path) -> None:
    whole = small.read_bytes()
    expected = list(Recording(small).ticks())
    cut = small.with_name("cut.mcap")
    seen: set[int] = set()
    begun = whole.index(b"files/paths") - 29  # the robot file ends where the next attachment begins
    for size in sorted({*range(0, len(whole), 37), *borders(small)}):
        cut.write_bytes(whole[:size])
        if size < begun:
            with pytest.raises(RecordingError, match="nothing of a run can be read"):
                Recording(cut)
            continue
        recording = Recording(cut)
        ticks = list(recording.ticks())
        assert ticks == expected[: len(ticks)]
        if recording.missing is None:  # only the index behind the data is lost
            assert len(ticks) == 30
        elif ticks:
            assert f"cut off; its last readable tick is {len(ticks) - 1}, at" in recording.missing
        seen.add(len(ticks))
    assert {0, 30} < seen


def test_a_recording_that_nobody_closed_is_read(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "recording.mcap", synthetic_run.provenance(), threaded=False)
    for each in first(90):
        recorder.observe(each.tick, each.frames)
    (tmp_path / "killed.mcap").write_bytes((tmp_path / "recording.mcap").read_bytes())
    recorder.close()

    recording = Recording(tmp_path / "killed.mcap")
    assert recording.outcome == ""
    assert recording.wall_duration is None
    assert recording.missing == "the file is cut off; its last readable tick is 81, at 1.62 s"


def test_a_flipped_bit_costs_the_chunk_that_it_is_in(small: Path) -> None:
    content = bytearray(small.read_bytes())
    expected = list(Recording(small).ticks())
    place = content.index(b"zstd", content.index(b"zstd") + 1) + 100  # in the second chunk
    content[place] ^= 0x10
    small.write_bytes(content)

    recording = Recording(small)
    ticks = list(recording.ticks())
    there = {tick.snapshot.sensed.index for tick in ticks}
    gap = sorted(set(range(30)) - there)
    assert 0 < gap[0] <= gap[-1] < 29
    assert ticks == [tick for tick in expected if tick.snapshot.sensed.index in there]
    assert (recording.number, recording.last_tick()) == (len(ticks), expected[-1])
    assert recording.missing is not None
    assert "damaged" in recording.missing
    assert f"; {len(gap)} ticks are missing, the first are {gap[0]} to {gap[-1]}" in recording.missing


def test_a_flipped_bit_in_a_file_of_the_mission_is_noticed(small: Path) -> None:
    content = bytearray(small.read_bytes())
    content[content.index(synthetic_run.CIRCLE.encode()) + 10] ^= 1
    small.write_bytes(content)

    missing = Recording(small).missing
    assert missing is not None
    assert "damaged" in missing


def test_a_damaged_description_is_said(tmp_path: Path) -> None:
    provenance = dataclasses.replace(synthetic_run.provenance(), robot=b'{"robot": "x"}', mission=b"[1]")
    Recorder(tmp_path / "recording.mcap", provenance, threaded=False).close()
    recording = Recording(tmp_path)

    with pytest.raises(RecordingError, match=r"robot\.json in it is damaged"):
        _ = recording.robot
    with pytest.raises(RecordingError, match=r"mission\.json in it is damaged"):
        _ = recording.mission


def test_values_that_this_version_does_not_know_are_said(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "tick_record", lambda *_: b'{"index":0,"mode":"dancing"}')
    synthetic_run.record(small, iter(first(2)))

    with pytest.raises(RecordingError, match=r"tick 0 is not understood .* written by artemis"):
        list(Recording(small).ticks())


@pytest.mark.parametrize(
    ("content", "problem"),
    [(b"", "cut off"), (b"\x89MCAP0\r\n", "cut off"), (b"hello, this is a text file", "not an MCAP file")],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes, problem: str) -> None:
    path = tmp_path / "recording.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=problem):
        Recording(path)


def test_a_missing_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording here"):
        Recording(tmp_path)
