"""What a recording's messages hold: their types, their JSON, and the JSON schemas made from the types.

Foxglove opens a JSON channel only if its schema is plain (objects, arrays, numbers, strings, booleans; no references,
no unions), so the schemas are derived here. Names of fields are shown there: an optional field counts as its type.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from enum import Enum
from functools import cache
from math import cos, isfinite, sin
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec.structs import asdict

from artemis import values
from artemis.devices.can_bus import Frame, Traffic
from artemis.scan import Scan

# ------------------------------------------------------------------------------------------------- records of artemis


class TickRecord(values.Tick, frozen=True, kw_only=True, gc=False):
    """A whole tick (topic `/tick`): what was sensed, all that was made of it, and where the robot really was.

    A field that is not there has its default.
    """

    true_pose: values.Pose | None = None
    """In the frame of the snapshot's pose; only where someone knows it (simulation, ground truth)."""


class Frames(msgspec.Struct, frozen=True):
    """All frames of one tick (topic `/frames`), packed by `pack_frames`."""

    tick: int
    data: bytes


# ------------------------------------------------------------------- Foxglove's types (docs.foxglove.dev, "Schemas")


class Time(msgspec.Struct, frozen=True):
    """A point in time since 1970: whole seconds, and the nanoseconds beyond."""

    sec: int
    nsec: int


class Vector(msgspec.Struct, frozen=True):
    """Metres."""

    x: float
    y: float
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True):
    """A rotation; of a robot on the floor only `z` and `w` differ from 0."""

    z: float
    w: float
    x: float = 0.0
    y: float = 0.0


class SpatialPose(msgspec.Struct, frozen=True):
    """A pose in space."""

    position: Vector
    orientation: Quaternion


class PoseInFrame(msgspec.Struct, frozen=True):
    """One pose."""

    timestamp: Time
    frame_id: str
    pose: SpatialPose


class PosesInFrame(msgspec.Struct, frozen=True):
    """Many poses: a path."""

    timestamp: Time
    frame_id: str
    poses: list[SpatialPose]


class FrameTransform(msgspec.Struct, frozen=True):
    """Where a child frame lies in its parent."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector
    rotation: Quaternion


class FrameTransforms(msgspec.Struct, frozen=True):
    """Some of them."""

    transforms: list[FrameTransform]


class LaserScan(msgspec.Struct, frozen=True):
    """A scan, seen from a place in a frame; a range of 0: no return."""

    timestamp: Time
    frame_id: str
    pose: SpatialPose
    start_angle: float
    end_angle: float
    ranges: list[float]
    intensities: list[float]


class Log(msgspec.Struct, frozen=True):
    """One line of the log; `name` is the kind of the entry. Levels: 2 info, 3 warning, 4 error."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


CHANNELS: dict[str, tuple[str, type]] = {
    "/tick": ("artemis.Tick", TickRecord),
    "/frames": ("artemis.Frames", Frames),
    "/pose/estimated": ("foxglove.PoseInFrame", PoseInFrame),
    "/pose/true": ("foxglove.PoseInFrame", PoseInFrame),
    "/tf": ("foxglove.FrameTransforms", FrameTransforms),
    "/path": ("foxglove.PosesInFrame", PosesInFrame),
    "/log": ("foxglove.Log", Log),
}
"""Name of the schema and type of the messages, by topic."""
SCANS = "/scan/"
"""Topics of single scanners begin so; they are `foxglove.LaserScan`."""


@cache
def encoded_schema(kind: Any) -> bytes:  # noqa: ANN401 (any type annotation)
    """Its JSON schema as JSON."""
    return msgspec.json.encode(json_schema(kind))


def json_schema(kind: Any) -> dict[str, Any]:  # noqa: ANN401 (any type annotation)
    """JSON schema of a type annotation, without references and unions: `X | None` is described as X."""
    if get_origin(kind) is UnionType:
        kind = next(part for part in get_args(kind) if part is not type(None))
    if get_origin(kind) in (tuple, list):
        return {"type": "array", "items": json_schema(get_args(kind)[0])}
    if issubclass(kind, Enum):
        kind = type(next(iter(kind)).value)
    plain = {bool: "boolean", int: "integer", float: "number", str: "string"}
    if kind in plain:
        return {"type": plain[kind]}
    if kind is bytes:
        return {"type": "string", "contentEncoding": "base64"}
    properties = {name: json_schema(hint) for name, hint in get_type_hints(kind).items()}
    # Foxglove takes an object for a time by its title
    return {"type": "object", "title": "time" if kind is Time else kind.__name__, "properties": properties}


# --------------------------------------------------------------------------------------------------- JSON, both ways

_ENCODER = msgspec.json.Encoder()
encode = _ENCODER.encode
_TICK = msgspec.json.Decoder(TickRecord)
_NON_FINITE = {"float:nan": float("nan"), "float:inf": float("inf"), "float:-inf": float("-inf")}
_TEXT = "text:"
_STRING = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"')
"""Of JSON."""


def tick_record(tick: values.Tick, true_pose: values.Pose | None = None) -> bytes:
    """JSON of a tick, but for defaults. Floats survive exactly, also those that JSON lacks (nan, inf)."""
    return _exact(tick if true_pose is None else TickRecord(**asdict(tick), true_pose=true_pose))


def tick_from_record(record: bytes) -> TickRecord:
    """Inverse of `tick_record`.

    Raises:
        msgspec.ValidationError: the JSON is something else.
    """
    try:
        return _TICK.decode(record)
    except msgspec.ValidationError:
        return msgspec.convert(_respelled(msgspec.json.decode(record)), TickRecord)


def differences(recorded: TickRecord, tick: values.Tick) -> list[str]:
    """Where a tick, made again from the recorded sensed values, differs from the record: empty if bit for bit equal.

    Each line names the field and both values: `set_points.speed: recorded 0.4, now 0.41`.
    """
    record, again = _exact(recorded), tick_record(tick, recorded.true_pose)
    if again == record:
        return []
    now = tick_from_record(again)  # a round trip makes floats of integers in float fields, as those recorded were
    return list(_differing("", recorded, now))


def _differing(name: str, recorded: Any, now: Any) -> Iterator[str]:  # noqa: ANN401 (any part of a record)
    if isinstance(recorded, msgspec.Struct) and type(recorded) is type(now):
        for key in recorded.__struct_fields__:
            yield from _differing(f"{name}.{key}".lstrip("."), getattr(recorded, key), getattr(now, key))
    elif repr(recorded) != repr(now):
        yield f"{name}: recorded {msgspec.to_builtins(recorded)!r}, now {msgspec.to_builtins(now)!r}"


def _exact(record: values.Tick) -> bytes:
    """JSON of a record. No None is in it, but msgspec writes nan and inf as null: then they are spelled out."""
    written = encode(record)
    if b"null" in written and b"null" in _STRING.sub(b"", written):
        return encode(_spelled(msgspec.to_builtins(record)))
    return written


def _spelled(value: Any) -> Any:  # noqa: ANN401 (any JSON)
    """Non-finite floats as strings in nested dicts and sequences; a string that looks like one is marked."""
    match value:
        case dict():
            return {key: _spelled(part) for key, part in value.items()}
        case list() | tuple():
            return [_spelled(part) for part in value]
        case float() if not isfinite(value):
            return f"float:{value}"
        case str() if value in _NON_FINITE or value.startswith(_TEXT):
            return _TEXT + value
    return value


def _respelled(value: Any) -> Any:  # noqa: ANN401 (any JSON)
    """Inverse of `_spelled`."""
    match value:
        case dict():
            return {key: _respelled(part) for key, part in value.items()}
        case list():
            return [_respelled(part) for part in value]
        case str():
            return _NON_FINITE.get(value, value.removeprefix(_TEXT))
    return value


# ----------------------------------------------------------------------------------------------------------- frames

FRAME_RECORD = np.dtype([("time", "<f8"), ("flags", "u1"), ("id", "<u2"), ("length", "u1"), ("data", "u1", (8,))])
"""One packed frame, 20 bytes: time on the bus [s, the loop's clock], flags (1 sent by us, 2 remote frame), identifier,
number of data bytes, data padded with zeros."""
_FRAME = struct.Struct("<dBHB8s")


def pack_frames(frames: Traffic, now: float) -> bytes:
    """Frames, each with "sent by us", as consecutive `FRAME_RECORD`s; one without a time was sent by `now` [s]."""
    pack = _FRAME.pack
    return b"".join(
        [
            pack(frame.time or now, sent | frame.rtr << 1, frame.id, len(frame.data), frame.data)
            for sent, frame in frames
        ]
    )


def unpack_frames(data: bytes) -> list[tuple[bool, Frame]]:
    """Inverse of `pack_frames`."""
    return [
        (bool(flags & 1), Frame(identifier, content[:length], bool(flags & 2), time))
        for time, flags, identifier, length, content in _FRAME.iter_unpack(data)
    ]


# ------------------------------------------------------------------------------------------------------------- poses


def laser_scan(scan: Scan, place: SpatialPose, timestamp: Time) -> LaserScan:
    """A scan as Foxglove draws it, from a scanner at `place` on the robot."""
    ranges, strengths = scan.millimetres, scan.strengths
    end = scan.start_angle + scan.increment * (len(ranges) - 1)
    metres = (ranges * 1e-3).round(3).tolist()
    return LaserScan(timestamp, "base_link", place, scan.start_angle, end, metres, strengths.astype(float).tolist())


def spatial_pose(pose: values.Pose) -> SpatialPose:
    """A pose on the floor as Foxglove draws it."""
    return SpatialPose(Vector(pose.x, pose.y), Quaternion(z=sin(pose.heading / 2), w=cos(pose.heading / 2)))
