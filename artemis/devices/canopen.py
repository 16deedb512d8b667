"""CANopen on the wire: identifiers, and codecs for every frame that a drive and its host exchange. Pure functions.

Sources: CiA 301 (chapter 7), EPOS firmware specification 2010 (chapters 11, 12, 14), EPOS communication guide 2006
(chapter 7). Every multi-byte field is little endian. "Tx" and "Rx" are from the drive's side. SDO has both sides here:
requests go from client to server, answers back. A decoder returns a value or raises `ProtocolError`, nothing else; an
encoder raises it for a value that does not fit its field.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from artemis.devices.can_bus import Frame
from artemis.drive_states import Nmt
from artemis.errors import ProtocolError
from artemis.families.objects import ObjectType, does_not_fit, packed

NMT = 0x000
SYNC = 0x080
EMERGENCY = 0x080  # this and the following: plus node id (default COB-IDs, CiA 301 7.3.3)
TXPDO = (0x180, 0x280, 0x380, 0x480)  # drive to host, PDO 1 to 4
RXPDO = (0x200, 0x300, 0x400, 0x500)  # host to drive
SDO_ANSWER = 0x580  # server to client
SDO_REQUEST = 0x600  # client to server
HEARTBEAT = 0x700  # also boot-up and node guarding

SYNC_FRAME = Frame(SYNC)


class NmtCommand(IntEnum):
    """NMT services of the host (CiA 301 7.2.8)."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


_NMT_STATES = {state.value: state for state in Nmt}


def nmt_frame(command: NmtCommand, node_id: int = 0) -> Frame:
    """Order a node, or all of them (0), into another NMT state. Not confirmed by the node."""
    return Frame(NMT, bytes((command, node_id)))


def heartbeat_frame(node_id: int, state: Nmt) -> Frame:
    """Heartbeat of a node (or of the host); the state INITIALISING makes it a boot-up frame."""
    return Frame(HEARTBEAT + node_id, bytes((state.value,)))


def nmt_from_heartbeat(data: bytes) -> Nmt:
    """State in a heartbeat, guarding answer (its toggle, bit 7, is ignored) or boot-up frame (INITIALISING)."""
    state = _NMT_STATES.get(data[0] & 0x7F) if len(data) == 1 else None
    if state is None:
        raise ProtocolError(f"heartbeat with unknown content [{data.hex(' ')}]")
    return state


ONE_BOOT = 0.15
"""No drive boots again so soon [s]; some nodes repeat the boot-up as their heartbeat while they initialise."""


def is_boot_up(before: Nmt | None, now: Nmt | None, elapsed: float) -> bool:
    """Whether a heartbeat of state `now` is the boot-up (CiA 301, 7.2.8.3.3), `elapsed` [s] after one of `before`."""
    return now is Nmt.INITIALISING and not (before is now and elapsed < ONE_BOOT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Emergency:
    """An emergency object: error code (0 = all errors gone), error register 0x1001, five bytes of the maker's own."""

    code: int
    register: int
    data: bytes = bytes(5)

    def frame(self, node_id: int) -> Frame:
        """The frame of this emergency as node `node_id` sends it."""
        if len(self.data) != 5:
            raise ProtocolError(f"EMCY carries 5 bytes of the maker's own, not {len(self.data)}")
        return Frame(EMERGENCY + node_id, packed(_EMERGENCY, self.code, self.register, self.data))


_EMERGENCY = struct.Struct("<HB5s")


def emergency_from_data(data: bytes) -> Emergency:
    """Decode an emergency frame's data."""
    if len(data) != 8:
        raise ProtocolError(f"EMCY of {len(data)} bytes instead of 8")
    code, register, rest = _EMERGENCY.unpack(data)
    return Emergency(code=code, register=register, data=rest)


class PdoLayout:
    """The fields of one PDO, compiled once; packing and unpacking happen in every tick."""

    def __init__(self, types: Sequence[ObjectType]) -> None:
        """Lay out the numbers in mapping order; a PDO holds eight bytes at most."""
        if ObjectType.STR in types:
            raise ProtocolError("a string cannot be mapped into a PDO")
        self._layout = struct.Struct("<" + "".join(type_.value for type_ in types))
        self.length = self._layout.size  # bytes
        if self.length > 8:
            raise ProtocolError(f"a PDO holds 8 bytes, these objects need {self.length}")

    def pack(self, *values: int) -> bytes:
        """Data of a PDO with these values, one for each field."""
        try:
            return self._layout.pack(*values)
        except struct.error as error:
            raise does_not_fit(values, error) from None

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Values of a received PDO; surplus bytes are ignored (CiA 301 7.2.2)."""
        try:
            return self._layout.unpack_from(data)
        except struct.error:
            raise ProtocolError(f"PDO of {len(data)} bytes, its mapping needs {self.length}") from None


TOGGLE_NOT_ALTERNATED = 0x05030000
SDO_TIMEOUT = 0x05040000
UNKNOWN_COMMAND = 0x05040001
LENGTH_MISMATCH = 0x06070010
GENERAL_ERROR = 0x08000000

ABORT_TEXTS = {
    0x05030000: "toggle bit not alternated",
    0x05040000: "SDO protocol timed out",
    0x05040001: "unknown command specifier",
    0x05040005: "out of memory",
    0x06010000: "unsupported access",
    0x06010001: "object is write only",
    0x06010002: "object is read only",
    0x06020000: "object does not exist",
    0x06040041: "object cannot be mapped into a PDO",
    0x06040042: "mapped objects exceed the length of a PDO",
    0x06040043: "parameters are incompatible",
    0x06040047: "incompatible inside the device",
    0x06060000: "hardware error",
    0x06070010: "data type or length does not match",
    0x06070012: "data is too long",
    0x06070013: "data is too short",
    0x06090011: "sub-index does not exist",
    0x06090030: "value out of range",
    0x06090031: "value too high",
    0x06090032: "value too low",
    0x06090036: "maximum is less than minimum",
    0x08000000: "general error",
    0x08000020: "data cannot be stored",
    0x08000021: "refused because of local control",
    0x08000022: "refused in this device state",
    0x0F00FFB9: "wrong CAN or node id",
    0x0F00FFBC: "device is not in service mode",
    0x0F00FFBE: "wrong password",
    0x0F00FFBF: "serial command is illegal",
    0x0F00FFC0: "wrong NMT state",
}
"""Texts of SDO abort codes (EPOS firmware specification 2010, 12.3; CiA 301 table 22)."""


class SdoAbort(ProtocolError):
    """A node refused a transfer, or we gave it up because the answers broke the protocol."""

    def __init__(self, index: int, subindex: int, code: int, device: str = "SDO") -> None:
        self.index = index
        self.subindex = subindex
        self.code = code
        self.text = ABORT_TEXTS.get(code, "unknown code")
        super().__init__(f"SDO abort 0x{code:08X} at 0x{index:04X}:{subindex}: {self.text}", device=device)


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """Request: read an object."""

    index: int
    subindex: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Expedited:
    """Request: write these one to four bytes. Answer: the object holds them. Not `sized`: perhaps fewer than four."""

    index: int
    subindex: int
    data: bytes
    sized: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Segmented:
    """Request: a write in segments begins. Answer: a read in segments begins. `size` in bytes; None: not told."""

    index: int
    subindex: int
    size: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """Up to seven bytes: of a write as request, of a read as answer. The first has the toggle False."""

    toggle: bool
    data: bytes
    last: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class NextSegment:
    """Request: send the next segment of a read."""

    toggle: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """Answer: written (expedited), or ready for segments."""

    index: int
    subindex: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentAccepted:
    """Answer: the segment arrived."""

    toggle: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Abort:
    """Either side gives the transfer up; never answered."""

    index: int
    subindex: int
    code: int


Request = Upload | Expedited | Segmented | Segment | NextSegment | Abort
Answer = Expedited | Segmented | Segment | Accepted | SegmentAccepted | Abort

# First byte of an SDO frame (CiA 301 7.2.4.3): bits 7-5 command; begin of a transfer: 3-2 unused bytes of four,
# 1 expedited, 0 sized; segments: 4 toggle, 3-1 unused bytes of seven, 0 last.
_BEGIN = struct.Struct("<BHB4s")
_SEGMENT = struct.Struct("<B7s")


def encode_request(request: Request) -> bytes:
    """The eight bytes from client to server. Raises ProtocolError when a field is out of range or data too long."""
    match request:
        case Segment(toggle=toggle, data=data, last=last):
            if len(data) > 7:
                raise ProtocolError(f"{len(data)} bytes do not fit a segment")
            return _SEGMENT.pack(toggle << 4 | (7 - len(data)) << 1 | last, data)
        case NextSegment(toggle=toggle):
            return _SEGMENT.pack(0x60 | toggle << 4, b"")
        case Expedited(data=rest, sized=sized):
            if not (1 if sized else 4) <= len(rest) <= 4:
                raise ProtocolError(f"{len(rest)} bytes do not fit an expedited transfer")
            command = 0x20 | (4 - len(rest)) << 2 | 0x02 | sized
        case Segmented(size=size):
            command, rest = (0x20, b"") if size is None else (0x21, ObjectType.U32.encode(size))
        case Abort(code=code):
            command, rest = 0x80, ObjectType.U32.encode(code)
        case _:  # Upload
            command, rest = 0x40, b""
    return packed(_BEGIN, command, request.index, request.subindex, rest)


def decode_answer(data: bytes) -> Answer:
    """What a server answers. Block transfers are not supported: ProtocolError."""
    if len(data) != 8:
        raise ProtocolError(f"SDO frame of {len(data)} bytes instead of 8")
    command, index, subindex, rest = _BEGIN.unpack(data)
    toggle, sized = bool(command & 0x10), bool(command & 0x01)
    match command >> 5:
        case 0:
            return Segment(toggle=toggle, data=data[1 : 8 - (command >> 1 & 0x07)], last=sized)
        case 1:
            return SegmentAccepted(toggle=toggle)
        case 2 if command & 0x02:
            content = rest[: 4 - (command >> 2 & 0x03)] if sized else rest
            return Expedited(index=index, subindex=subindex, data=content, sized=sized)
        case 2:
            size = int.from_bytes(rest, "little") if sized else None
            return Segmented(index=index, subindex=subindex, size=size)
        case 3:
            return Accepted(index=index, subindex=subindex)
        case 4:
            return Abort(index=index, subindex=subindex, code=int.from_bytes(rest, "little"))
    raise ProtocolError(f"unknown SDO command specifier in [{data.hex(' ')}]")
