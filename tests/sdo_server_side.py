"""The other end of an SDO transfer, for tests: requests as a node reads them, answers as it writes them."""

from __future__ import annotations

import struct

from artemis.devices.canopen import (
    Abort,
    Accepted,
    Answer,
    Expedited,
    NextSegment,
    Request,
    Segment,
    SegmentAccepted,
    Segmented,
    Upload,
)
from artemis.errors import ProtocolError

_OBJECT = struct.Struct("<BHB4s")
_NUMBER = struct.Struct("<BHBI")


def decode_request(data: bytes) -> Request:
    """What a client asks for (CiA 301 7.2.4.3). Raises ProtocolError where it asks for nothing that is known."""
    if len(data) != 8:
        raise ProtocolError(f"{len(data)} bytes")
    command, index, subindex, rest = _OBJECT.unpack(data)
    toggle, number = bool(command & 0x10), int.from_bytes(rest, "little")
    match command >> 5:
        case 0:
            return Segment(toggle=toggle, data=data[1 : 8 - (command >> 1 & 7)], last=bool(command & 1))
        case 1 if command & 2:
            sized = bool(command & 1)
            return Expedited(
                index=index, subindex=subindex, data=rest[: 4 - (command >> 2 & 3)] if sized else rest, sized=sized
            )
        case 1:
            return Segmented(index=index, subindex=subindex, size=number if command & 1 else None)
        case 2:
            return Upload(index=index, subindex=subindex)
        case 3:
            return NextSegment(toggle=toggle)
        case 4:
            return Abort(index=index, subindex=subindex, code=number)
    raise ProtocolError(f"unknown SDO command specifier in [{data.hex(' ')}]")


def encode_answer(answer: Answer) -> bytes:
    """The eight bytes from server to client."""
    match answer:
        case Segment(toggle=toggle, data=data, last=last):
            return bytes((toggle << 4 | (7 - len(data)) << 1 | last,)) + data.ljust(7, b"\0")
        case SegmentAccepted(toggle=toggle):
            return bytes((0x20 | toggle << 4,)) + bytes(7)
        case Expedited(data=data, sized=sized):
            return _OBJECT.pack(0x42 | (4 - len(data)) << 2 | sized, answer.index, answer.subindex, data)
        case Segmented(size=size):
            return _NUMBER.pack(0x40 if size is None else 0x41, answer.index, answer.subindex, size or 0)
        case Accepted():
            return _NUMBER.pack(0x60, answer.index, answer.subindex, 0)
        case Abort(code=code):
            return _NUMBER.pack(0x80, answer.index, answer.subindex, code)
