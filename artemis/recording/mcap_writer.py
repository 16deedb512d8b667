"""Writes one run as one MCAP file: everything a replay needs, and everything Foxglove can show."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from mimetypes import guess_type
from pathlib import Path
from typing import Any

import msgspec

from artemis.build import kind_of_build, version
from artemis.clock import stopwatch
from artemis.devices.can_bus import Traffic
from artemis.errors import RecordingError
from artemis.families.family import Errors
from artemis.motion.poses import placed, seen_from
from artemis.plugins.guard import Problem
from artemis.plugins.observing import LOOK, Beside
from artemis.recording import schemas
from artemis.recording.disk import Disk, Trouble, trouble
from artemis.recording.event_log import EventLog
from artemis.recording.journal import Entry, Journal, Level
from artemis.recording.mcap_file import McapFile
from artemis.recording.provenance import Provenance, made_with
from artemis.recording.routes import ROUTES
from artemis.recording.schemas import encode, pack_frames, spatial_pose, tick_record
from artemis.scan import Scan
from artemis.values import Pose, Snapshot, Tick

CHUNK_SIZE = 256 * 1024
"""Bytes (before compression) that are written at once; a killed run loses less than this."""
FLUSH_PERIOD, FAST_FLUSH_PERIOD = 0.2, 0.4
"""What is older than this [s] is with the operating system: in real time, and on virtual time."""
POSE_PERIOD = 0.1
"""Poses and transforms for viewers come this often [s]; `/tick` holds those of every tick."""
QUEUE_TICKS = 500
"""Ticks that may wait for a slow disk, in real time."""
JOURNAL = "journal"

_Observed = tuple[Tick, bytes, Pose | None]


class Recorder:
    """Records a run. `threaded` (real time): a thread writes, and a tick waits for nothing; else complete at once.

    A disk that refuses never raises here once the run has begun: the recording ends where it is, the journal continues,
    and `troubles` says so.
    """

    def __init__(
        self,
        path: Path,
        provenance: Provenance,
        *,
        threaded: bool,
        journal: Journal | None = None,
        nodes: Mapping[str, int] | None = None,
        errors: Errors | None = None,
        scanners: Mapping[str, Pose] | None = None,
        disk: Disk | None = None,
    ) -> None:
        """Begin the file.

        Args:
            path: The file.
            provenance: What the run is made from.
            threaded: See above.
            journal: Where events are written, too; closed with the recorder.
            nodes: The drives' node ids by their names: whose frames a fault's entry shows.
            errors: What the drives' error codes mean, by their names.
            scanners: Where they sit on the robot, by their names: their scans are drawn there.
            disk: Makes the file.

        Raises:
            RecordingError: the file cannot be made.
        """
        self._path, self._journal = path, journal
        self._event_log = EventLog(nodes or {}, errors or {})
        self._scanners = {name: spatial_pose(place) for name, place in (scanners or {}).items()}
        self._scan_slots: dict[str, int] = {}
        self._start = _nanoseconds(provenance.start)
        self._begun = stopwatch()
        self._index = self._pose_slot = -1
        self._driven = 0.0
        self._flush_period = FLUSH_PERIOD if threaded else FAST_FLUSH_PERIOD
        self._next_flush = self._flush_period
        self._late, self._lost = _Gaps(), _Gaps()
        self._told_late = 0
        self._marked = 0
        self._data_trouble: Trouble | None = None
        self._journal_trouble: Trouble | None = None
        self.true_pose: Callable[[Tick], Pose | None] = lambda tick: None
        """Tells where the robot really is, in the frame `odom`, where somebody knows."""
        with ExitStack() as undo:
            undo.callback(journal.close if journal else lambda: None)
            try:
                self._file = (disk or Disk()).open(path, "w")
                undo.callback(self._file.close)
                self._writer = McapFile(self._file, f"artemis {version('artemis-robot')}", CHUNK_SIZE)
                self._channels = self._begin(provenance)
            except OSError as error:
                raise RecordingError(f"{path}: cannot begin a recording: {error.strerror}") from error
            undo.pop_all()
        self._beside = Beside(
            "recorder", self._record, threaded=threaded, bound=QUEUE_TICKS, failed=self._fail, look=LOOK
        )

    # ----------------------------------------------------------------------------------------------- for the run

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Record one tick, as `observe` does."""
        self.observe(tick, traffic, self.true_pose(tick), now)

    def observe(self, tick: Tick, frames: Traffic, true_pose: Pose | None = None, now: float = 0.0) -> None:
        """Record one tick, and tell the journal what is new in it.

        Args:
            tick: its values.
            frames: every frame of the tick in the order on the bus, each with "sent by us".
            true_pose: where the robot really is, in the frame of its pose; None where nobody knows.
            now: the time of the tick [s] by the clock of the frames.
        """
        packed = pack_frames(frames, now)
        entries = self._event_log.observe(tick, packed, now)
        self._driven = tick.snapshot.odometry.driven
        if (dropped := self._beside.put((tick, packed, true_pose))) is not None:
            self._late.add(dropped[0].snapshot.sensed.index)
        for entry in entries:
            self.note(entry)
        if (second := int(tick.snapshot.time)) != self._marked:
            self._marked = second
            self._beside.order(self._tell, Journal.mark, tick.snapshot.time)

    def note(self, entry: Entry) -> None:
        """Record something that no tick shows."""
        self._beside.order(self._write_entry, entry)

    def show_path(self, time: float, poses: Sequence[Pose], frame: str = "odom") -> None:
        """Record a path as it lies in a frame, for viewers, at run time `time` [s]."""
        self._beside.order(self._keep, self._write_path, time, tuple(poses), frame)

    @property
    def dropped(self) -> int:
        """Ticks that were not recorded because the disk was too slow, or failed."""
        return self._late.number + self._lost.number

    @property
    def first_gap(self) -> int | None:
        """Index of the first of them."""
        return min((gaps.first for gaps in (self._late, self._lost) if gaps.first is not None), default=None)

    def troubles(self) -> list[Trouble]:
        """What the disk does to the recording now, to be told at every tick while it lasts."""
        found = [trouble for trouble in (self._data_trouble, self._journal_trouble) if trouble]
        if self._late.number != self._told_late:
            self._told_late = self._late.number
            found.append(Trouble("DSK-03", f"{self._path.name}: from tick {self._late.first} on"))
        return found

    def take_problems(self) -> list[Problem]:
        """The same, as an observer says it; what is wrong with the journal is under its name."""
        return [(trouble.id, JOURNAL if trouble.journal else "", trouble.detail) for trouble in self.troubles()]

    def close(self, outcome: str = "") -> None:
        """Write what waits, how the run ended in a few words, and the index; harmless when repeated."""
        if self._file.closed:
            return
        self._beside.close()
        self._keep(self._writer.flush)
        for entry in self._last_entries(outcome):
            self.note(entry)
        self._keep(self._end, outcome)
        with suppress(OSError):  # everything was handed over when it was written
            self._file.close()
        if self._journal:
            self._journal.close()

    def _last_entries(self, outcome: str) -> list[Entry]:
        time, entries = self._event_log.time, self._event_log.end()
        if self.dropped:
            text = f"{self.dropped} ticks were not recorded, the first is {self.first_gap}"
            entries.append(Entry(time=time, kind="gap", text=text, level=Level.WARNING))
        return [*entries, Entry(time=time, kind="end", text=outcome, data={"driven_m": round(self._driven, 3)})]

    # ----------------------------------------------------------------------------------------------- the disk

    def _fail(self, error: BaseException) -> None:
        """The program fails in the thread: nothing is written any more, not even the journal, until the end."""
        self._end_recording(Trouble("DSK-05", f"{self._path.name}: writing it has failed: {error!r}", journal=True))

    def _record(self, observed: _Observed) -> None:
        tick = observed[0]
        self._index = tick.snapshot.sensed.index
        if self._data_trouble is None:
            self._keep(self._write_tick, *observed)
        else:
            self._lost.add(self._index)

    def _keep(self, action: Callable[..., None], *arguments: object) -> None:
        """Write to the recording, unless it ended when the disk refused; then what was not written yet is lost."""
        if self._data_trouble is None:
            try:
                action(*arguments)
            except OSError as error:
                self._end_recording(trouble(error, self._path))

    def _end_recording(self, why: Trouble) -> None:
        first = self._writer.first_waiting(self._channels["/tick"])
        first = self._index + 1 if first is None else first
        self._lost.add(first, self._index + 1 - first)
        self._data_trouble = why

    def _write_entry(self, entry: Entry) -> None:
        self._keep(self._write_log, entry)
        self._tell(Journal.write, entry)

    def _tell(self, action: Callable[[Journal, Any], None], what: object) -> None:
        """Have the journal write something."""
        if self._journal:
            try:
                action(self._journal, what)
            except OSError as error:
                self._journal_trouble = trouble(error, self._journal.path, journal=True)
            else:
                self._journal_trouble = None

    # ---------------------------------------------------------------------------------------- what is in the file

    def _begin(self, provenance: Provenance) -> dict[str, int]:
        """Write what the run is made from; returns the ids of the channels."""
        versions = {
            "start_ns": str(self._start),
            "start": provenance.start.isoformat(),
            "build": kind_of_build(),
            "platform": sys.platform,
            **made_with(),
        }
        self._writer.add_metadata("artemis", versions)
        if provenance.resume_point is not None:
            self._attach("resume_point.json", encode(provenance.resume_point))
        if provenance.routes:
            self._attach(ROUTES, provenance.routes)
        self._attach("mission.json", provenance.mission)
        self._attach("robot.json", provenance.robot)
        for name, content in provenance.files.items():
            self._attach(f"files/{name}", content)
        channels: dict[str, int] = {}
        ids: dict[str, int] = {}
        for topic, (name, kind) in schemas.CHANNELS.items():
            if name not in ids:
                ids[name] = self._writer.add_schema(name, "jsonschema", schemas.encoded_schema(kind))
            channels[topic] = self._writer.add_channel(topic, "json", ids[name])
        if self._scanners:
            schema = schemas.encoded_schema(schemas.LaserScan)
            id = self._writer.add_schema("foxglove.LaserScan", "jsonschema", schema)
            for topic in (schemas.SCANS + name for name in self._scanners):
                channels[topic] = self._writer.add_channel(topic, "json", id)
        return channels

    def _attach(self, name: str, content: bytes) -> None:
        media_type = guess_type(name)[0] or "application/octet-stream"
        self._writer.add_attachment(self._start, name, media_type, content)

    def _write_tick(self, tick: Tick, frames: bytes, true_pose: Pose | None) -> None:
        sensed = tick.snapshot.sensed
        index, at = sensed.index, self._start + round(sensed.time * 1e9)
        add, channels = self._writer.add_message, self._channels
        add(channels["/tick"], at, tick_record(tick, true_pose), index)
        if frames:
            add(channels["/frames"], at, encode(schemas.Frames(index, frames)), index)
        if (slot := int(sensed.time / POSE_PERIOD + 1e-6)) != self._pose_slot:
            self._pose_slot = slot
            self._write_poses(at, tick.snapshot, true_pose)
        for scan in sensed.scans:
            self._write_scan(scan)
        if sensed.time >= self._next_flush:
            self._next_flush = sensed.time + self._flush_period
            self._writer.flush()

    def _write_poses(self, at: int, snapshot: Snapshot, true_pose: Pose | None) -> None:
        """Where the robot is and the frames of that: `base_link` in `odom`, and this in `map` once there is one."""
        located, odom, time = snapshot.pose, snapshot.odometry.pose, _timestamp(at)
        frames = [("odom", "base_link", odom)]
        if located.frame != "odom":
            map_from_odom = placed(located.pose, seen_from(odom, Pose()))
            frames.insert(0, (located.frame, "odom", map_from_odom))
        transforms = [
            schemas.FrameTransform(time, parent, child, there.position, there.orientation)
            for parent, child, pose in frames
            for there in [spatial_pose(pose)]
        ]
        self._add("/pose/estimated", at, schemas.PoseInFrame(time, located.frame, spatial_pose(located.pose)))
        self._add("/tf", at, schemas.FrameTransforms(transforms))
        if true_pose is not None:
            self._add("/pose/true", at, schemas.PoseInFrame(time, located.frame, spatial_pose(true_pose)))

    def _write_scan(self, scan: Scan) -> None:
        """For viewers; `/tick` holds all of them."""
        place, slot = self._scanners.get(scan.source), int(scan.time / POSE_PERIOD + 1e-6)
        if place is not None and slot != self._scan_slots.get(scan.source):
            self._scan_slots[scan.source] = slot
            at = self._start + round(scan.time * 1e9)
            self._add(schemas.SCANS + scan.source, at, schemas.laser_scan(scan, place, _timestamp(at)))

    def _write_path(self, time: float, poses: Sequence[Pose], frame: str) -> None:
        at = self._start + round(time * 1e9)
        self._add("/path", at, schemas.PosesInFrame(_timestamp(at), frame, [spatial_pose(pose) for pose in poses]))

    def _write_log(self, entry: Entry) -> None:
        at = self._start + round(entry.time * 1e9)
        self._add("/log", at, schemas.Log(_timestamp(at), entry.level, entry.text, entry.kind))

    def _add(self, topic: str, at: int, message: msgspec.Struct) -> None:
        self._writer.add_message(self._channels[topic], at, encode(message))

    def _end(self, outcome: str) -> None:
        facts = {"outcome": outcome, "wall_s": f"{stopwatch() - self._begun:.3f}", "dropped": str(self.dropped)}
        self._writer.add_metadata("end", facts)
        self._writer.finish()


class _Gaps:
    """Ticks that are not in the recording. Written by one thread only."""

    def __init__(self) -> None:
        self.number = 0
        self.first: int | None = None

    def add(self, first: int, number: int = 1) -> None:
        self.number += number
        if self.first is None and number:
            self.first = first


def _nanoseconds(date: datetime) -> int:
    """Since 1970, exactly."""
    since = date - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


def _timestamp(at: int) -> schemas.Time:
    return schemas.Time(*divmod(at, 1_000_000_000))
