"""What is fuzzed, each with good inputs to start from."""

from __future__ import annotations

import asyncio
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from math import isfinite
from pathlib import Path
from random import Random
from zlib import crc32

from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, DataEnd, Footer
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from msgspec import structs

from artemis import clock
from artemis.devices import canopen
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import PdoLayout
from artemis.devices.drive import Drives
from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.sdo import SdoClient
from artemis.drive_schema import Drive
from artemis.errors import ConfigError, DeviceError, HidError, ProtocolError, RecordingError
from artemis.families import FAMILIES
from artemis.families.objects import ObjectType
from artemis.mission import load_mission
from artemis.recording.journal import Entry, Journal, read_journal
from artemis.recording.mcap_file import MAGIC
from artemis.recording.mcap_reader import Recording
from artemis.sim.axis import Axis
from artemis.sim.drive_node import simulated_drive
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

from .fuzzing import Target, mutate_bytes, mutate_text

TESTS = Path(__file__).parents[1]
MISSIONS = TESTS.parent / "missions"
GOOD = TESTS / "broken" / "good"
ROBOT = RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)
DRIVE = ROBOT.drives["steer-left"]
DRIVE_4, DRIVE_402 = (
    RobotFile.model_validate(load(MISSIONS / "robots" / f"artemis_{name}.yaml").data).drives["steer-left"]
    for name in ("epos4", "cia402")
)
NODE = DRIVE.node_id
MILLISECOND = 0.001


def targets(folder: Path) -> list[Target]:
    """All targets; they write into `folder`."""
    missions = [*MISSIONS.glob("*.yaml"), GOOD / "mission.yaml", *TESTS.glob("broken/syntax/*.yaml")]
    return [
        Target(name="decoders", attempt=decode, seeds=_frame_data(), mutate=mutate_bytes, steps=500),
        Target(name="drives", attempt=hear, seeds=_spoken(), mutate=mutate_bytes, steps=50_000),
        Target(name="sdo", attempt=transfer, seeds=_answers(), mutate=mutate_bytes, steps=100_000),
        Target(name="hid", attempt=describe, seeds=_descriptors(), mutate=mutate_bytes, steps=300_000),
        Target(name="sim_epos", attempt=obey, seeds=_orders(), mutate=mutate_bytes, steps=500_000),
        *(
            Target(
                name=name,
                attempt=partial(obey, drive=drive),
                seeds=_orders(),
                mutate=mutate_bytes,
                steps=1_000_000,
            )
            for name, drive in (("sim_epos4", DRIVE_4), ("sim_cia402", DRIVE_402))
        ),
        Target(
            name="recording",
            attempt=ReadRecording(folder),
            seeds=_recordings(folder),
            mutate=mutate_bytes,
            steps=50_000,
        ),
        Target(name="journal", attempt=ReadJournal(folder), seeds=_journals(folder), mutate=mutate_lines, steps=20_000),
        Target(
            name="mission",
            attempt=LoadMission(folder / "one", "mission.yaml"),
            seeds=[*_texts(missions), *_examples()],
            mutate=mutate_text,
            steps=500_000,
        ),
        Target(
            name="robot",
            attempt=LoadMission(folder / "two", "robots/artemis.yaml"),
            seeds=_texts([MISSIONS / "robots" / "artemis.yaml"]),
            mutate=mutate_text,
            steps=500_000,
        ),
        Target(
            name="path",
            attempt=LoadMission(folder / "three", "paths/line.csv"),
            seeds=_texts([*GOOD.glob("paths/*.csv"), MISSIONS / "paths" / "straight.csv"]),
            mutate=mutate_text,
            steps=500_000,
        ),
    ]


# ---------------------------------------------------------------------------------------------- frames

_DECODERS: tuple[Callable[[bytes], object], ...] = (
    canopen.decode_answer,
    canopen.nmt_from_heartbeat,
    canopen.emergency_from_data,
    *(
        PdoLayout([object_.type for object_ in pdo]).unpack
        for family in FAMILIES.values()
        for role in family.sent.values()
        for pdo in role
    ),
    *(type_.decode for type_ in ObjectType),
)


def decode(data: bytes) -> None:
    """Every decoder of CANopen."""
    for decoder in _DECODERS:
        with suppress(ProtocolError):
            decoder(data)


def _frame_data() -> list[bytes]:
    return [frame.data for stream in (*_spoken(), *_answers(), *_orders()) for _, frame in _frames(stream)]


def _frames(data: bytes) -> Iterator[tuple[int, Frame]]:
    """Any bytes as frames, each with milliseconds to wait before it."""
    while data:
        head, data = data[:4].ljust(4, b"\0"), data[4:]
        length = head[3] & 0x0F
        content, data = data[:length][:8], data[length:]
        yield head[0] % 32, Frame(int.from_bytes(head[1:3], "little") & 0x7FF, content, bool(head[3] & 0x80))


def _packed(frames: Sequence[tuple[int, bytes]], pause: int = 1) -> bytes:
    return b"".join(bytes((pause, *number.to_bytes(2, "little"), len(data))) + data for number, data in frames)


class _Bus:
    """Hands over what it is told to."""

    error_frames = 0

    def __init__(self) -> None:
        self.waiting: list[Frame] = []

    def send(self, frame: Frame) -> None:
        pass

    def receive(self) -> list[Frame]:
        frames, self.waiting = self.waiting, []
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        pass

    def close(self) -> None:
        pass


def hear(data: bytes) -> None:
    """Our side of the drives, between ticks: `on_status`, `on_details`, `on_emergency`, `on_heartbeat`."""
    bus = _Bus()
    drives, now = Drives(ROBOT, bus), 0.0
    for pause, frame in _frames(data):
        now += pause * MILLISECOND
        bus.waiting.append(structs.replace(frame, time=now))
        drives.wire.take_in()
        for feedback in drives.sense(now).drives:
            numbers = (feedback.position, feedback.velocity, feedback.current, *feedback.potentiometers)
            assert all(map(isfinite, numbers))
            assert feedback.age is None or feedback.age >= 0.0


def _spoken() -> list[bytes]:
    said: list[tuple[int, bytes]] = []
    for drive in ROBOT.drives.values():
        status, details = (PdoLayout([object_.type for object_ in pdo]) for pdo in drive.tables.sent[drive.role])
        values = [0] * (3 if drive.role == "traction" else 4)
        said += [
            (0x700 + drive.node_id, b"\x00"),
            (0x180 + drive.node_id, status.pack(0x0337, 1000)),
            (0x280 + drive.node_id, details.pack(*values)),
            (0x080 + drive.node_id, bytes.fromhex("3081110000000000")),
            (0x580 + drive.node_id, bytes.fromhex("4F00100005000000")),
            (0x180 + drive.node_id, status.pack(0x4123, -1000)),
            (0x700 + drive.node_id, b"\x05"),
        ]
    return [_packed(said)]


def transfer(data: bytes) -> None:
    """The SDO client, while a node answers whatever it likes: a transfer ends, well or with the node's failure."""
    clock.run(_transfers(data), simulated=True)


async def _transfers(data: bytes) -> None:
    loop = asyncio.get_running_loop()
    answers = _frames(data)

    def send(_: Frame) -> None:
        for pause, frame in islice(answers, 2):
            loop.call_later(pause * MILLISECOND, client.receive, frame)

    client = SdoClient("node", NODE, send)
    for index, content in ((0x1008, None), (0x6040, b"\x0f\0"), (0x2004, bytes(20)), (0x6041, None), (0x1008, None)):
        with suppress(DeviceError):
            await (client.read(index, 0) if content is None else client.write(index, 0, content))


def _answers() -> list[bytes]:
    texts = (
        "4308100045504F53 6040600000000000 6004200000000000 2000000000000000 3000000000000000 2000000000000000"
        " 4B41600040010000 4108100008000000 004142434445464700 1D48000000000000",
        "4108100008000000 0041424344454647 1D48000000000000 8040600000000206 8004200011000906 4241600040010000",
        "4008100000000000 0041424344454647 1041424344454647 1D48000000000000 8008100000000405 8001100000000905",
    )
    number = canopen.SDO_ANSWER + NODE
    return [_packed([(number, bytes.fromhex(answer)[:8]) for answer in text.split()]) for text in texts]


def describe(data: bytes) -> None:
    """Any bytes as a report descriptor, and then as each of its reports."""
    with suppress(HidError):
        found = parse_descriptor(data)
        for number in {field.report_id for field in found.fields}:
            with suppress(HidError):
                found.decode(bytes([number]) * found.has_report_ids + data)


def _descriptors() -> list[bytes]:
    devices = (load(path).data for path in sorted(TESTS.glob("data/hid/*.yaml")))
    return [bytes.fromhex(str(device["report_descriptor"])) for device in devices if isinstance(device, dict)]


def obey(data: bytes, drive: Drive = DRIVE) -> None:
    """A simulated drive, whatever it is told."""
    axis = Axis(drive)
    node, now = simulated_drive(drive, axis, name="fuzzed"), 0.0
    node.power_on(now)
    booted = round(node.boot_time / MILLISECOND) + 12
    for pause, frame in [(booted, Frame(0x080)), *_frames(data)]:
        for _ in range(pause):
            now += MILLISECOND
            axis.step(MILLISECOND)
            node.advance(now)
        node.receive(frame, now)
        assert all(len(sending[1].data) <= 8 for sending in node.outbox)
        node.outbox.clear()
        assert isfinite(axis.position)
        assert isfinite(axis.current)


def _orders() -> list[bytes]:
    request, nmt, control = canopen.SDO_REQUEST + NODE, 0x000, 0x300 + NODE
    written = ((0x6060, 0, "B", 3), (0x6060, 0, "B", 0xFF), (0x1017, 0, "H", 100), (0x6040, 0, "H", 0x0F))
    mapped = ((0x1A00, 0, "B", 0), (0x1A00, 1, "I", 0x60410010), (0x1A00, 2, "I", 0x60640020), (0x1A00, 0, "B", 2))
    guarded = ((0x1016, 1, "I", 0x7F00C8), (0x1800, 2, "B", 1), (0x1400, 2, "B", 255))
    moved = ((0x2062, 0, "i", 1000), (0x607A, 0, "i", 1000), (0x60C2, 1, "B", 20))
    writes = [
        canopen.encode_request(canopen.Expedited(index=index, subindex=sub, data=ObjectType(letter).encode(value)))
        for index, sub, letter, value in (*written, *mapped, *guarded, *moved)
    ]
    read = [
        canopen.encode_request(canopen.Upload(index=index, subindex=0)) for index in (0x1000, 0x1008, 0x6041, 0x1003)
    ]
    return [
        _packed([(request, data) for data in [*writes, *read]]),
        _packed(
            [(nmt, b"\x01\0"), *((control, bytes((word, 0))) for word in (6, 0x0F, 0x0B, 0, 0x80)), (0x080, b"")], 20
        ),
        _packed([(nmt, bytes((order, NODE))) for order in (1, 2, 0x80, 0x81, 0x82)], 31),
        _packed([(request, bytes.fromhex(t)) for t in ("2104200008000000", "0001020304050607", "1D08000000000000")]),
        _packed([(0x77F, b"\x05"), (0x200 + NODE, bytes.fromhex("0F0000010000")), (0x080, b"")], 10),
    ]


# ---------------------------------------------------------------------------------------------- recordings


class ReadRecording:
    """The reader of recordings."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "fuzzed.mcap"

    def __call__(self, data: bytes) -> None:
        self._path.write_bytes(data)
        with suppress(RecordingError):
            recording = Recording(self._path)
            for read in (recording.ticks_and_frames, recording.frames, recording.entries):
                with suppress(RecordingError):
                    list(read())
            for name in ("robot", "mission", "files", "resume_point"):
                with suppress(RecordingError):
                    getattr(recording, name)
            recording.places_robot()
            with suppress(RecordingError):
                recording.last_tick()


def _recordings(folder: Path) -> list[bytes]:
    """As written, and without compression and checksums: there a flipped byte reaches what they protect."""
    sys.path.append(str(TESTS / "unit"))
    import synthetic_run

    path = folder / "seed.mcap"
    synthetic_run.record(path, islice(synthetic_run.run(), 74, 78))
    return [path.read_bytes(), _bare(path)]


def _bare(path: Path) -> bytes:
    builder = RecordBuilder()
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                content, _ = get_chunk_data_stream(record)
                record = replace(
                    record, compression="", data=content.read(record.uncompressed_size), uncompressed_crc=0
                )
            elif isinstance(record, DataEnd):
                record = replace(record, data_section_crc=0)
            elif isinstance(record, Footer):
                record = replace(record, summary_crc=0)
            record.write(builder)
    records: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap leaves out the annotation
    return MAGIC + records + MAGIC


class ReadJournal:
    """The reader of journals."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "fuzzed.jsonl"

    def __call__(self, data: bytes) -> None:
        self._path.write_bytes(data)
        with suppress(RecordingError):
            read_journal(self._path)


def _journals(folder: Path) -> list[bytes]:
    journal = Journal(folder / "seed.jsonl")
    for kind, text in (("mode", "init -> ready"), ("fault", "DRV-25 steer-left"), ("note", "é")):
        journal.write(Entry(time=1.5, kind=kind, text=text, data={"id": 1, "values": [1.0, None]}))
    journal.close()
    return [(folder / "seed.jsonl").read_bytes()]


def mutate_lines(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """A change that the checksums of half of all journals do not tell."""
    data = (mutate_text if random.randrange(2) else mutate_bytes)(data, random, seeds)
    if random.randrange(2):
        return data
    parts = (line.rpartition(b',"crc32":') for line in data.split(b"\n"))
    return b"\n".join(b'%s,"crc32":%d}' % (content, crc32(content)) if content else rest for content, _, rest in parts)


# ---------------------------------------------------------------------------------------------- missions


class LoadMission:
    """The loader of missions, with one wrong file among good ones."""

    def __init__(self, folder: Path, file: str) -> None:
        shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
        shutil.copytree(GOOD, folder, dirs_exist_ok=True)
        self._mission, self._file = folder / "mission.yaml", folder / file

    def __call__(self, data: bytes) -> None:
        self._file.write_bytes(data)
        problems = ["none"]
        try:
            load_mission(self._mission)
        except ConfigError as error:
            problems = error.problems
        assert problems
        assert all(problem.isprintable() for problem in problems), problems


def _examples() -> list[bytes]:
    """The missions in the documentation, and parts of such."""
    pages = (page.read_text(encoding="utf-8") for page in sorted((TESTS.parent / "docs").glob("*.md")))
    return [block.encode() for page in pages for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)]


def _texts(paths: Iterable[Path]) -> list[bytes]:
    return [path.read_bytes() for path in sorted(paths)]
