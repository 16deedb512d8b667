"""Writes one run as one MCAP file: everything a replay needs, and everything Foxglove can show."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from mimetypes import guess_type
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import msgspec
import numpy as np

from artemis.clock import stopwatch
from artemis.devices.can_bus import Frame
from artemis.errors import RecordingError
from artemis.recording import schemas
from artemis.recording.journal import Entry, Journal, Level, entries_between
from artemis.recording.mcap_file import McapFile
from artemis.recording.schemas import encode, pack_frames, sensed_record, spatial_pose, tick_record
from artemis.values import Pose, Tick

CHUNK_SIZE = 256 * 1024
"""Bytes (before compression) that are written at once; a killed run loses less than this."""
FLUSH_PERIOD = 1.0
"""In real time, what is older than this [s] is with the operating system."""
POSE_PERIOD = 0.1
"""Poses and transforms for viewers come this often [s]; `/tick` holds those of every tick."""
QUEUE_TICKS = 500
"""Ticks that may wait for a slow disk, in real time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What a run is made from."""

    start: datetime
    """Date and time on the wall at run time 0, with time zone."""
    mission: bytes
    """The resolved mission, JSON."""
    robot: bytes
    """The resolved robot, JSON."""
    files: Mapping[str, bytes]
    """Contents of every file that the mission names, by the name there."""


class Recorder:
    """Records a run. `threaded` (real time): a thread writes, and a tick waits for nothing; else complete at once.

    Attributes:
        dropped: ticks that were not recorded because the disk was too slow, or failed.
        first_gap: index of the first of them.
    """

    def __init__(self, path: Path, provenance: Provenance, *, threaded: bool, journal: Journal | None = None) -> None:
        """Begin the file; what happens is also written to `journal`, which is closed with the recorder.

        Raises:
            RecordingError: the file cannot be made.
        """
        self.dropped = 0
        self.first_gap: int | None = None
        self._path = path
        self._journal = journal
        self._start = _nanoseconds(provenance.start)
        self._begun = stopwatch()
        self._problem: str | None = None
        self._previous: Tick | None = None
        self._pose_slot = -1
        self._next_flush = FLUSH_PERIOD
        self._threaded = threaded
        self._orders: SimpleQueue[tuple[Callable[..., None], tuple[Any, ...]] | None] = SimpleQueue()
        self._thread = Thread(target=self._work, name="recorder", daemon=True) if threaded else None
        try:
            self._file = path.open("wb")
            self._writer = McapFile(self._file, f"artemis {version('artemis-robot')}", CHUNK_SIZE)
            self._channels = self._begin(provenance)
            self._file.flush()
        except OSError as error:
            raise RecordingError(f"{path}: cannot begin a recording: {error.strerror}") from error
        if self._thread:
            self._thread.start()

    # ----------------------------------------------------------------------------------------------- for the run

    def observe(
        self, tick: Tick, frames: Sequence[tuple[bool, Frame]], true_pose: Pose | None = None, late_s: float = 0.0
    ) -> None:
        """Record one tick.

        Args:
            tick: its values.
            frames: every frame of the tick in the order on the bus, each with "sent by us".
            true_pose: where the robot really is, in the frame `odom`; None where nobody knows.
            late_s: how late the tick began.

        Raises:
            RecordingError: the file cannot be written (not when threaded: then `close` says so).
        """
        if self._thread is None:
            self._do(self._write_tick, (tick, frames, true_pose, late_s))
        elif self._orders.qsize() < QUEUE_TICKS and self._problem is None:
            self._orders.put((self._write_tick, (tick, tuple(frames), true_pose, late_s)))
        else:
            self.dropped += 1
            if self.first_gap is None:
                self.first_gap = tick.snapshot.sensed.index

    def note(self, entry: Entry) -> None:
        """Record something that no tick shows.

        Raises:
            RecordingError: as `observe`.
        """
        self._order(self._write_entry, entry)

    def show_path(self, time: float, poses: Sequence[Pose]) -> None:
        """Record a path as it lies in the frame `odom`, for viewers, at run time `time` [s].

        Raises:
            RecordingError: as `observe`.
        """
        self._order(self._write_path, time, tuple(poses))

    def close(self, outcome: str = "") -> None:
        """Write what waits, how the run ended in a few words, and the index; harmless when repeated.

        Raises:
            RecordingError: something could not be written, now or earlier.
        """
        if self._file.closed:
            return
        if self._thread:
            self._orders.put(None)
            self._thread.join()
            self._thread = None
        try:
            self._do(self._end, (outcome,))
        finally:
            self._file.close()
            if self._journal:
                self._journal.close()

    def _order(self, action: Callable[..., None], *arguments: object) -> None:
        if self._thread is None:
            self._do(action, arguments)
        else:
            self._orders.put((action, arguments))

    def _do(self, action: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        if self._problem is not None:
            raise RecordingError(self._problem)
        try:
            action(*arguments)
        except OSError as error:
            self._problem = f"{self._path}: cannot write: {error.strerror}; is the disk full?"
            raise RecordingError(self._problem) from error

    def _work(self) -> None:
        """The thread: do what is ordered until told to end, or until the disk fails."""
        while (order := self._orders.get()) is not None:
            try:
                self._do(*order)
            except RecordingError as error:
                self._problem = str(error)

    # ---------------------------------------------------------------------------------------- what is in the file

    def _begin(self, provenance: Provenance) -> dict[str, int]:
        """Write what the run is made from; returns the ids of the channels."""
        versions = {
            "start_ns": str(self._start),
            "start": provenance.start.isoformat(),
            "artemis": version("artemis-robot"),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "platform": sys.platform,
        }
        self._writer.add_metadata("artemis", versions)
        self._attach("mission.json", provenance.mission)
        self._attach("robot.json", provenance.robot)
        for name, content in provenance.files.items():
            self._attach(f"files/{name}", content)
        channels: dict[str, int] = {}
        ids: dict[str, int] = {}
        for topic, (name, kind) in schemas.CHANNELS.items():
            if name not in ids:
                schema = msgspec.json.encode(schemas.json_schema(kind))
                ids[name] = self._writer.add_schema(name, "jsonschema", schema)
            channels[topic] = self._writer.add_channel(topic, "json", ids[name])
        return channels

    def _attach(self, name: str, content: bytes) -> None:
        media_type = guess_type(name)[0] or "application/octet-stream"
        self._writer.add_attachment(self._start, name, media_type, content)

    def _write_tick(
        self, tick: Tick, frames: Sequence[tuple[bool, Frame]], true_pose: Pose | None, late_s: float
    ) -> None:
        sensed = tick.snapshot.sensed
        index, at = sensed.index, self._start + round(sensed.time * 1e9)
        add, channels = self._writer.add_message, self._channels
        add(channels["/sensed"], at, sensed_record(sensed), index)
        add(channels["/tick"], at, tick_record(tick, true_pose, late_s), index)
        if frames:
            add(channels["/frames"], at, encode(schemas.Frames(index, pack_frames(frames))), index)
        if (slot := int(sensed.time / POSE_PERIOD + 1e-6)) != self._pose_slot:
            self._pose_slot = slot
            self._write_poses(at, tick.snapshot.odometry.pose, true_pose)
        for entry in entries_between(self._previous, tick):
            self._write_entry(entry)
        self._previous = tick
        if self._threaded and sensed.time >= self._next_flush:
            self._next_flush = sensed.time + FLUSH_PERIOD
            self._writer.flush()

    def _write_poses(self, at: int, estimated: Pose, true_pose: Pose | None) -> None:
        pose = spatial_pose(estimated)
        transform = schemas.FrameTransform(_timestamp(at), "odom", "base_link", pose.position, pose.orientation)
        self._add("/pose/estimated", at, schemas.PoseInFrame(_timestamp(at), "odom", pose))
        self._add("/tf", at, schemas.FrameTransforms([transform]))
        if true_pose is not None:
            self._add("/pose/true", at, schemas.PoseInFrame(_timestamp(at), "odom", spatial_pose(true_pose)))

    def _write_path(self, time: float, poses: Sequence[Pose]) -> None:
        at = self._start + round(time * 1e9)
        self._add("/path", at, schemas.PosesInFrame(_timestamp(at), "odom", [spatial_pose(pose) for pose in poses]))

    def _write_entry(self, entry: Entry) -> None:
        at = self._start + round(entry.time * 1e9)
        self._add("/log", at, schemas.Log(_timestamp(at), entry.level, entry.text, entry.kind))
        if self._journal:
            self._journal.write(entry)

    def _add(self, topic: str, at: int, message: msgspec.Struct) -> None:
        self._writer.add_message(self._channels[topic], at, encode(message))

    def _end(self, outcome: str) -> None:
        if self.dropped and self._previous:
            text = f"{self.dropped} ticks were not recorded, the first is {self.first_gap}"
            self._write_entry(Entry(time=self._previous.snapshot.time, kind="gap", text=text, level=Level.WARNING))
        facts = {"outcome": outcome, "wall_s": f"{stopwatch() - self._begun:.3f}", "dropped": str(self.dropped)}
        self._writer.add_metadata("end", facts)
        self._writer.finish()
        self._file.flush()


def _nanoseconds(date: datetime) -> int:
    """Since 1970, exactly."""
    since = date - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


def _timestamp(at: int) -> schemas.Time:
    return schemas.Time(*divmod(at, 1_000_000_000))
