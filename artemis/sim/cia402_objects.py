"""The objects of a drive of the profile CiA 402: what the profile gives it, and what the robot file says of it.

Sources: CiA 301, 7.5 (communication); CiA 402 (types, meaning). Rows are those of `dictionary.row`. Defaults that the
profile leaves open are such that a host which writes nothing gets nothing to move. An option code that the robot file
does not name is not there.
"""

from __future__ import annotations

from functools import cache

from artemis.drive_schema import Drive
from artemis.families.cia402 import Cia402, ObjectWords
from artemis.families.objects import ObjectType
from artemis.sim.cia402_power import (
    ABORT_CODES,
    ABORT_CONNECTION,
    FAULT_CODES,
    FAULT_REACTION,
    QUICK_STOP,
    QUICK_STOP_CODES,
)
from artemis.sim.dictionary import AbortCode, AbortRules, ObjectEntry, Type, row, with_counts
from artemis.sim.epos_objects import pdo_rows

I8, I16, I32, U8, U16, U32 = Type.I8, Type.I16, Type.I32, Type.U8, Type.U16, Type.U32

RULES = AbortRules(too_long=AbortCode.TOO_LONG, cuts_bytes=False)
MODES = frozenset({3, 8, 9})
"""Profile velocity, cyclic synchronous position and velocity: those that artemis drives with."""
SUPPORTED_MODES = 1 << 2 | 1 << 7 | 1 << 8
"""Object 0x6502: a bit for each of them, from 1 on."""
VOLATILE = frozenset({0x1003, 0x1010, 0x1011, 0x6040, 0x607A, 0x60B0, 0x60B1, 0x60FF})
"""Indices of writable objects that 0x1010 does not keep: commands, set-points and signatures."""
FACTORY_RAMP, FACTORY_SPEED = 10000.0, 3000.0
"""Accelerations [rpm/s] and highest profile velocity [rpm] as from the factory; assumptions."""


@cache
def objects402(drive: Drive, words: Cia402) -> tuple[ObjectEntry, ...]:
    """All objects of one drive as it leaves the factory; `words` are its own.

    Objects that the robot file names and the profile has already are the profile's, but for their type.
    """
    rows = [
        *_communication(drive, words),
        *pdo_rows(drive.node_id, words.pdos, "rw", frozenset({1, 253, 255}), places=8),
        *_device_control(words),
        *_modes(words),
    ]
    measured: list[ObjectWords] = [*(words.analog_inputs or ())]
    measured += [each for each in (words.current, words.absolute_encoder) if each is not None]
    asked = [each for each in (words.supply, words.temperature, words.sto) if each is not None]
    known = {(entry.index, entry.sub): entry for entry in rows}
    for marks, named in (("ro T", measured), ("ro", asked), ("rw", words.settings)):
        for each in named:
            known.setdefault((each.index, each.subindex), row(each.index, each.subindex, _type(each), marks))
    return with_counts(list(known.values()))


def _type(words: ObjectWords) -> Type:
    kinds = {
        ObjectType.U8: U8,
        ObjectType.U16: U16,
        ObjectType.U32: U32,
        ObjectType.I8: I8,
        ObjectType.I16: I16,
        ObjectType.I32: I32,
    }
    return kinds[words.object.type]


def _communication(drive: Drive, words: Cia402) -> list[ObjectEntry]:
    node_id = drive.node_id
    serial = node_id if drive.serial_number is None else drive.serial_number & 0xFFFFFFFF
    return [
        row(0x1000, 0, U32, "const", 0x00020192),
        row(0x1001, 0, U8, "ro"),
        row(0x1003, 0, U8, "rw", 0, 0, 5),
        *(row(0x1003, sub, U32, "ro") for sub in range(1, 6)),
        row(0x1005, 0, U32, "const", 0x80),
        ObjectEntry(index=0x1008, sub=0, type=Type.STRING, access="const", default=b"CiA 402 drive"),
        row(0x1010, 1, U32, "rw", 1),
        row(0x1011, 1, U32, "rw dis", 1),
        row(0x1014, 0, U32, "const", 0x80 + node_id),
        row(0x1016, 1, U32, "rw"),
        row(0x1016, 2, U32, "rw"),
        row(0x1017, 0, U16, "rw"),
        row(0x1018, 1, U32, "const", words.vendor_id),
        row(0x1018, 2, U32, "const", drive.hardware_version),
        row(0x1018, 3, U32, "const", drive.oldest_firmware),
        row(0x1018, 4, U32, "const", serial),
        row(0x1029, 1, U8, "rw", 0, 0, 2),
        row(0x1200, 1, U32, "const", 0x600 + node_id),
        row(0x1200, 2, U32, "const", 0x580 + node_id),
    ]


def _device_control(words: Cia402) -> list[ObjectEntry]:
    codes = words.option_codes
    options = (
        (ABORT_CONNECTION, codes.abort_connection, 0, ABORT_CODES),
        (QUICK_STOP, codes.quick_stop, 2, QUICK_STOP_CODES),
        (FAULT_REACTION, codes.fault_reaction, 2, FAULT_CODES),
    )
    return [
        row(0x6040, 0, U16, "rw R T"),
        row(0x6041, 0, U16, "ro T"),
        row(0x6060, 0, I8, "rw R T", min(MODES), choices=MODES),
        row(0x6061, 0, I8, "ro T"),
        row(0x6502, 0, U32, "const", SUPPORTED_MODES),
        *(
            row(index, 0, I16, "rw", default, choices=all_)
            for index, code, default, all_ in options
            if code is not None
        ),
    ]


def _modes(words: Cia402) -> list[ObjectEntry]:
    ramp = max(1, round(FACTORY_RAMP * words.acceleration_units_per_rpm_s))
    rows = [
        *(row(index, 0, I32, "ro T") for index in (0x6062, 0x6064, 0x606B, 0x606C, 0x60F4)),
        row(0x6065, 0, U32, "rw R T", 0xFFFFFFFF if 0x6065 in words.absent else 2000),
        row(0x6067, 0, U32, "rw R T", 0xFFFFFFFF),
        row(0x607A, 0, I32, "rw R T"),
        *(row(0x607D, sub, I32, "rw R T") for sub in (1, 2)),
        row(0x607E, 0, U8, "rw R T"),
        row(0x607F, 0, U32, "rw R T", round(FACTORY_SPEED * words.velocity_units_per_rpm)),
        *(row(index, 0, U32, "rw R T", ramp, 1) for index in (0x6083, 0x6084, 0x6085)),
        row(0x60B0, 0, I32, "rw R T"),
        row(0x60B1, 0, I32, "rw R T"),
        row(0x60FD, 0, U32, "ro T"),
        row(0x60FF, 0, I32, "rw R T"),
    ]
    if words.interpolation_period:
        rows += [row(0x60C2, 1, U8, "rw R T", 1), row(0x60C2, 2, I8, "rw R T", -3, -6, 0)]
    return rows
