"""Objects of a drive: data types, addresses, and those that CANopen and CiA 402 give every drive. Pure."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from artemis.errors import ProtocolError


def packed(layout: struct.Struct, *values: int | bytes) -> bytes:
    """The values in their fields; raises ProtocolError when one does not fit."""
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise does_not_fit(values, error) from None


def does_not_fit(values: tuple[int | bytes, ...], error: struct.error) -> ProtocolError:
    """What to raise when `struct` refuses values."""
    return ProtocolError(f"{values} does not fit its fields: {error}")


class ObjectType(Enum):
    """Data types of objects (CiA 301 7.1). The value is the letter of `struct`."""

    U8 = "B"
    U16 = "H"
    U32 = "I"
    U64 = "Q"
    I8 = "b"
    I16 = "h"
    I32 = "i"
    I64 = "q"
    STR = "s"
    """Visible string: ASCII, any length."""

    def __init__(self, letter: str) -> None:
        self._layout = struct.Struct("<" + letter)
        self.size = 0 if letter == "s" else self._layout.size  # bytes on the wire; 0: not fixed

    def encode(self, value: int | str) -> bytes:
        """Bytes on the wire."""
        if self is not ObjectType.STR:
            return packed(self._layout, value)  # type: ignore[arg-type]  # a str is refused by struct itself
        if not isinstance(value, str) or not value.isascii():
            raise ProtocolError(f"{value!r} is not a visible string")
        return value.encode("ascii")

    def decode(self, data: bytes) -> int | str:
        """The value; a string loses the zero bytes that pad it."""
        if self is ObjectType.STR:
            if not data.isascii():
                raise ProtocolError(f"[{data.hex(' ')}] is not a visible string")
            return data.decode("ascii").rstrip("\0")
        if len(data) != self.size:
            raise ProtocolError(f"{self.name} of {len(data)} bytes instead of {self.size}: [{data.hex(' ')}]")
        value: int = self._layout.unpack(data)[0]
        return value


U8, U16, U32, I8, I16, I32 = (
    ObjectType.U8,
    ObjectType.U16,
    ObjectType.U32,
    ObjectType.I8,
    ObjectType.I16,
    ObjectType.I32,
)


@dataclass(frozen=True, slots=True)
class Object:
    """One entry of the object dictionary."""

    index: int
    subindex: int
    type: ObjectType

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex}"

    @property
    def mapping(self) -> int:
        """Its PDO mapping entry."""
        return self.index << 16 | self.subindex << 8 | self.type.size * 8


class Setting(NamedTuple):
    """A value that an object must have."""

    object: Object
    value: int
    mask: int = -1
    """Bits of it that count; the others stay as the drive has them."""

    def over(self, present: int) -> int:
        """What the object must have, where it has `present`."""
        return present & ~self.mask | self.value & self.mask


# CiA 301, chapter 7.5
DEVICE_TYPE = Object(0x1000, 0, U32)
ERROR_COUNT = Object(0x1003, 0, U8)
STORE = Object(0x1010, 1, U32)
CONSUMER_HEARTBEAT, OTHER_CONSUMER_HEARTBEAT = Object(0x1016, 1, U32), Object(0x1016, 2, U32)
PRODUCER_HEARTBEAT = Object(0x1017, 0, U16)
VENDOR, PRODUCT, REVISION, SERIAL_NUMBER = (Object(0x1018, number, U32) for number in range(1, 5))
COMMUNICATION_ERROR = Object(0x1029, 1, U8)

# CiA 402
ABORT_CONNECTION = Object(0x6007, 0, I16)
CONTROLWORD = Object(0x6040, 0, U16)
STATUSWORD = Object(0x6041, 0, U16)
QUICK_STOP_OPTION = Object(0x605A, 0, I16)
FAULT_REACTION = Object(0x605E, 0, I16)
MODE = Object(0x6060, 0, I8)
MODE_DISPLAY = Object(0x6061, 0, I8)
POSITION = Object(0x6064, 0, I32)
FOLLOWING_ERROR = Object(0x6065, 0, U32)
VELOCITY = Object(0x606C, 0, I32)
TARGET_POSITION = Object(0x607A, 0, I32)
POSITION_LIMITS = Object(0x607D, 1, I32), Object(0x607D, 2, I32)
POLARITY = Object(0x607E, 0, U8)
"""Bits 7 and 6: positions and velocities count the other way, set-points and what is shown."""
TOP_PROFILE_VELOCITY = Object(0x607F, 0, U32)
TOP_MOTOR_SPEED = Object(0x6080, 0, U32)
ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION = (Object(index, 0, U32) for index in (0x6083, 0x6084, 0x6085))
PROFILE_TYPE = Object(0x6086, 0, I16)
OFFSETS = Object(0x60B0, 0, I32), Object(0x60B1, 0, I32), Object(0x60B2, 0, I16)
"""Of position, velocity and torque: added to each set-point of the cyclic modes."""
INTERPOLATION_TIME, INTERPOLATION_EXPONENT = Object(0x60C2, 1, U8), Object(0x60C2, 2, I8)
DIGITAL_INPUTS = Object(0x60FD, 0, U32)
TARGET_VELOCITY = Object(0x60FF, 0, I32)
MOTOR_TYPE = Object(0x6402, 0, U16)

SAVE = 0x65766173
"""Signature that `STORE` wants: the letters "save" (CiA 301 7.5.2.13)."""
LIMIT_OFF = (-0x80000000, 0x7FFFFFFF)
"""Values of 0x607D that switch the position limits off (EPOS firmware specification 2010, 14.74)."""
LOST_HEARTBEAT = 0x8130
"""Error code of a drive that misses our heartbeat (CiA 301)."""
