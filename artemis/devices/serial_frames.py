"""Frames of the serial lines of EPOS drives: RS232 of the first generation, USB and RS232 of an EPOS4. Pure functions.

Sources: EPOS communication guide 2006, chapters 6 and 8; EPOS4 communication guide rel8759 (2019), chapter 2.
Multi-byte fields are little endian. A command names the node it is for: the drive on the line, or one behind it on CAN.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from enum import Enum, IntEnum

from artemis.errors import ProtocolError

READY, REFUSED = b"O", b"F"
"""Hand-shake of the first generation: go on; or no: not ready, or the frame was damaged (6.2.2)."""
ANSWER = 0x00
"""Operation code of every answer."""
START = b"\x90\x02"
"""DLE and STX, before a frame of an EPOS4 (2.2.4); within it each DLE is sent twice."""
DLE = START[:1]
MOST_WORDS = 0x90
"""No frame has more words of data: 64 of the first generation (6.3), 143 of an EPOS4 (2.2.1)."""


class SerialProtocol(Enum):
    """How a drive speaks on its serial line."""

    EPOS1 = "epos1"
    EPOS4 = "epos4"


class SerialService(IntEnum):
    """What a host may want; the numbers are the operation codes of the first generation (6.3)."""

    READ = 0x10
    WRITE = 0x11
    NMT = 0x0E
    SEND_CAN = 0x20


OPCODES = {
    SerialProtocol.EPOS1: {service: service.value for service in SerialService},
    SerialProtocol.EPOS4: {SerialService.READ: 0x60, SerialService.WRITE: 0x68, SerialService.NMT: 0x70},
}
"""Operation codes; an EPOS4 sends no CAN frames of the host's (2.1)."""

_OBJECT = {SerialProtocol.EPOS1: struct.Struct("<HBB"), SerialProtocol.EPOS4: struct.Struct("<BHB")}
_NMT = struct.Struct("<HH")
_ERROR = struct.Struct("<I")
ERROR_SIZE = _ERROR.size
"""Every answer begins with an error code of so many bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialCommand:
    """What is asked of a drive: an operation code with its data, a whole number of words."""

    opcode: int
    data: bytes
    answered: bool = True
    """The first generation confirms some commands by its hand-shake alone."""


def read_command(protocol: SerialProtocol, node_id: int, index: int, subindex: int) -> SerialCommand:
    """Read an object of at most four bytes. Raises ProtocolError for a number that does not fit its field."""
    place = _place(protocol, node_id, index, subindex)
    return SerialCommand(opcode=OPCODES[protocol][SerialService.READ], data=place)


def write_command(protocol: SerialProtocol, node_id: int, index: int, subindex: int, data: bytes) -> SerialCommand:
    """Write an object of at most four bytes, which is filled up with zeros. Raises as `read_command` does."""
    if not 1 <= len(data) <= 4:
        raise ProtocolError(f"{len(data)} bytes do not fit a write over a serial line, which takes 1 to 4", "serial")
    place = _place(protocol, node_id, index, subindex)
    return SerialCommand(opcode=OPCODES[protocol][SerialService.WRITE], data=place + data.ljust(4, b"\0"))


def nmt_command(protocol: SerialProtocol, node_id: int, nmt: int) -> SerialCommand:
    """Order a node, or all of them (0), into another NMT state."""
    data = _NMT.pack(node_id, nmt)
    return SerialCommand(
        opcode=OPCODES[protocol][SerialService.NMT], data=data, answered=protocol is SerialProtocol.EPOS4
    )


def _place(protocol: SerialProtocol, node_id: int, index: int, subindex: int) -> bytes:
    try:
        if protocol is SerialProtocol.EPOS1:
            return _OBJECT[protocol].pack(index, subindex, node_id)
        return _OBJECT[protocol].pack(node_id, index, subindex)
    except struct.error as error:
        raise ProtocolError(f"node {node_id}, object 0x{index:X}:{subindex}: {error}", "serial") from None


def place_of_object(protocol: SerialProtocol, data: bytes) -> tuple[int, int, int]:
    """Node, index and sub-index that the data of a read or a write begins with."""
    first, second, third = _OBJECT[protocol].unpack_from(data)
    return (third, first, second) if protocol is SerialProtocol.EPOS1 else (first, second, third)


def content_of(answer: bytes) -> tuple[int, bytes]:
    """Error code (0: none; else an abort code of CANopen) and the rest of an answer's data."""
    if len(answer) < _ERROR.size:
        raise ProtocolError(f"an answer of {len(answer)} bytes, an error code needs 4", "serial")
    return _ERROR.unpack_from(answer)[0], answer[_ERROR.size :]


def checksum(head: tuple[int, int], data: bytes) -> int:
    """CRC-CCITT of a frame: polynomial 0x1021, start 0, of each word the high byte first (6.2.3; EPOS4: 2.2.3).

    `head` is the first word, high byte first. The zero word that the guides append is in the algorithm here.
    """
    swapped = bytearray(len(data))
    swapped[0::2], swapped[1::2] = data[1::2], data[0::2]
    return crc_hqx(bytes(head) + swapped, 0)


# --------------------------------------------------------------------------------------------- the first generation


def epos1_body(opcode: int, data: bytes) -> bytes:
    """What follows the operation code: number of words less one, data, checksum (6.2.1)."""
    words = _words(data)
    if not 1 <= words:
        raise ProtocolError("a frame needs a word of data", "serial")
    crc = checksum((opcode, words - 1), data)
    return bytes((words - 1,)) + data + crc.to_bytes(2, "little")


def epos1_length(first: int) -> int:
    """Bytes that follow the first one of such a body: data and checksum."""
    return 2 * (first + 1) + 2


def epos1_data(opcode: int, body: bytes) -> bytes:
    """Data of a whole body. Raises ProtocolError: its checksum is wrong."""
    data, crc = body[1:-2], int.from_bytes(body[-2:], "little")
    if checksum((opcode, body[0]), data) != crc:
        raise ProtocolError(f"wrong checksum in [{bytes((opcode,)).hex()} {body.hex(' ')}]", "serial")
    return data


# ---------------------------------------------------------------------------------------------------------- EPOS4


def epos4_frame(opcode: int, data: bytes) -> bytes:
    """A whole frame of an EPOS4: start, operation code, number of words, data, checksum (2.2.1)."""
    words = _words(data)
    crc = checksum((words, opcode), data)
    return START + (bytes((opcode, words)) + data + crc.to_bytes(2, "little")).replace(DLE, DLE * 2)


class Epos4Splitter:
    """Finds frames in the bytes of an EPOS4's line."""

    def __init__(self) -> None:
        self.stray = 0
        """Bytes that were in no frame."""
        self._frame: bytearray | None = None
        self._doubled = False

    @property
    def half(self) -> bool:
        """Whether a frame has begun and not ended."""
        return self._frame is not None or self._doubled

    def reset(self) -> None:
        """Forget a frame that has begun."""
        self._frame, self._doubled = None, False

    def feed(self, byte: int) -> tuple[int, bytes] | None:
        """Take the next byte; operation code and data, when a frame ends with it.

        Raises:
            ProtocolError: its checksum is wrong, or another frame begins in it.
        """
        if self._doubled and byte == START[1]:
            broken, self._frame, self._doubled = self._frame is not None, bytearray(), False
            if broken:
                raise ProtocolError("a frame that another one begins in", "serial")
            return None
        if self._doubled and self._frame is None:
            self.stray, self._doubled = self.stray + 1, byte == DLE[0]
            return None
        if self._doubled and byte != DLE[0]:
            self.reset()
            raise ProtocolError("a frame with a start byte that is not doubled", "serial")
        if self._doubled:
            self._doubled = False
        elif byte == DLE[0]:
            self._doubled = True
            return None
        if self._frame is None:
            self.stray += 1
            return None
        self._frame.append(byte)
        return self._ended()

    def _ended(self) -> tuple[int, bytes] | None:
        frame = self._frame
        if frame is None or len(frame) < 2 or len(frame) < 2 * frame[1] + 4:
            return None
        self.reset()
        opcode, words, data = frame[0], frame[1], bytes(frame[2:-2])
        if checksum((words, opcode), data) != int.from_bytes(frame[-2:], "little"):
            raise ProtocolError(f"wrong checksum in [{frame.hex(' ')}]", "serial")
        return opcode, data


def _words(data: bytes) -> int:
    if len(data) % 2 or len(data) > 2 * MOST_WORDS:
        raise ProtocolError(f"{len(data)} bytes are no whole number of words, or too many", "serial")
    return len(data) // 2
