"""The objects of the first-generation EPOS (EPOS firmware specification, April 2010, chapter 14; EDS of the 24/1).

One row an object: index, sub-index, type, "access and marks" (`dictionary.row`), default, lowest and highest value.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from artemis.sim.dictionary import ObjectEntry, Type, row, with_counts

I8, I16, I32, U8, U16, U32 = Type.I8, Type.I16, Type.I32, Type.U8, Type.U16, Type.U32

LOWEST, HIGHEST = -(1 << 31), (1 << 31) - 1
OFF = 0xFFFFFFFF
"""Switches 0x6065 and 0x6067 off."""
MODES = frozenset({6, 3, 1, -1, -2, -3, -4, -5, -6})
HOMING_METHODS = frozenset({0, 1, 2, 7, 11, 17, 18, 23, 27, 33, 34, 35, -1, -2, -3, -4})
RPDO_DEFAULTS = ((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x607A0020), (0x60400010, 0x60FF0020))
TPDO_DEFAULTS = ((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010, 0x606C0020))
TPDO_COB_IDS = (0x40000180, 0xC0000280, 0xC0000380, 0xC0000480)
INVALID = 1 << 31
"""Of a COB-ID: the PDO is off."""
VOLATILE = frozenset({0x1003, 0x1010, 0x1011, 0x2030, 0x2062, 0x206B, 0x6040, 0x607A, 0x60FF})
"""Indices of writable objects that 0x1010 does not keep: commands, set-points and signatures."""

ANALOG_STEP_MV, ANALOG_STEPS = 4.88, 1023
"""The analog inputs have 10 bit (firmware specification, 10.1)."""
_STEPS_PER_VOLT = 1000.0 / ANALOG_STEP_MV
_MILLIVOLTS = [round(step * ANALOG_STEP_MV) for step in range(ANALOG_STEPS + 1)]


def millivolts(voltage: float) -> int:
    """A voltage [V] as object 0x207C shows it [mV]: 0 to 5 V in 1024 steps."""
    steps = round(voltage * _STEPS_PER_VOLT)
    return _MILLIVOLTS[steps] if 0 <= steps <= ANALOG_STEPS else _MILLIVOLTS[0 if steps < 0 else ANALOG_STEPS]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardware:
    """Current limits [mA] and winding time constant [100 ms] that a controller accepts."""

    continuous_current: int
    output_current: int
    thermal_time: int


HARDWARE = {
    0x6010: Hardware(continuous_current=1000, output_current=2000, thermal_time=1440),  # EPOS 24/1
    0x6210: Hardware(continuous_current=5000, output_current=10000, thermal_time=5400),  # EPOS 24/5
}


@cache
def objects(node_id: int, hardware_version: int, firmware: int, serial_number: int) -> tuple[ObjectEntry, ...]:
    """All objects of one drive as it leaves the factory.

    Args:
        node_id: As set by the DIP switches.
        hardware_version: Object 0x2003:2; decides the current limits (unknown ones get those of the 24/5).
        firmware: Object 0x2003:1.
        serial_number: Object 0x2004.
    """
    hardware = HARDWARE.get(hardware_version & 0xFFF0, HARDWARE[0x6210])
    rows = _communication(node_id) + _identity(node_id, hardware_version, firmware, serial_number)
    rows += (
        pdo_rows(node_id, 4, "rw cfg", frozenset({1, 253, 255}), places=8) + _setup() + _profile() + _motor(hardware)
    )
    return with_counts(rows)


def _communication(node_id: int) -> list[ObjectEntry]:
    return [
        row(0x1000, 0, U32, "ro", 0x00020192),
        row(0x1001, 0, U8, "ro"),
        row(0x1003, 0, U8, "rw", 0, 0, 5),
        *(row(0x1003, sub, U32, "ro") for sub in range(1, 6)),
        row(0x1005, 0, U32, "rw", 0x80, 0x01, 0x7FF),
        row(0x100C, 0, U16, "rw cfg"),
        row(0x100D, 0, U8, "rw cfg"),
        row(0x1010, 1, U32, "rw", 1),
        row(0x1011, 1, U32, "rw dis", 1),
        *(row(0x1011, sub, U32, "ro") for sub in range(2, 5)),
        row(0x1011, 5, U32, "rw", 1),
        row(0x1014, 0, U32, "ro", 0x80 + node_id),
        row(0x1016, 1, U32, "rw cfg"),
        row(0x1016, 2, U32, "rw cfg"),
        row(0x1017, 0, U16, "rw cfg"),
        row(0x1020, 1, U32, "rw"),
        row(0x1020, 2, U32, "rw"),
        row(0x1200, 1, U32, "ro", 0x600 + node_id),
        row(0x1200, 2, U32, "ro", 0x580 + node_id),
    ]


def _identity(node_id: int, hardware_version: int, firmware: int, serial_number: int) -> list[ObjectEntry]:
    last_digits = int(f"{serial_number % 10**8:d}", 16)  # the last 8 decimal digits, written as hexadecimal ones
    return [
        ObjectEntry(index=0x1008, sub=0, type=Type.STRING, access="const", default=b"EPOS"),
        row(0x1018, 1, U32, "ro", 0x000000FB),
        row(0x1018, 2, U32, "ro", hardware_version << 16),
        row(0x1018, 3, U32, "ro", firmware << 16),
        row(0x1018, 4, U32, "ro", last_digits),
        row(0x2000, 0, U8, "rw", node_id, 1, 127),
        row(0x2001, 0, U16, "rw", 0, 0, 6),
        row(0x2002, 0, U16, "rw", 3, 0, 5),
        row(0x2003, 1, U16, "ro", firmware),
        row(0x2003, 2, U16, "ro", hardware_version),
        *(row(0x2003, sub, U16, "ro") for sub in (3, 4, 5)),
        row(0x2004, 0, Type.U64, "const", serial_number),
        row(0x2005, 0, U16, "rw", 500),
    ]


def pdo_rows(
    node_id: int, count: int, marks: str, types: frozenset[int], places: int, inhibit: int = 0
) -> list[ObjectEntry]:
    """Parameters and mappings of PDOs, each way so many.

    The first four have identifiers and mappings by default (CiA 301, 7.3.3), the others are off and empty.

    Args:
        node_id: Of the drive.
        count: How many each way.
        marks: As of `dictionary.row`.
        types: Transmission types that are allowed for those that the drive sends.
        places: Objects in a PDO, at most.
        inhibit: Factory value of 0x1800:3 [0.1 ms].
    """
    rows = []
    for number in range(count):
        default = number < len(TPDO_COB_IDS)
        received: tuple[int, ...] = RPDO_DEFAULTS[number] if default else ()
        sent: tuple[int, ...] = TPDO_DEFAULTS[number] if default else ()
        rows += [
            row(0x1400 + number, 1, U32, marks, 0x200 + 0x100 * number + node_id if default else INVALID),
            row(0x1400 + number, 2, U8, marks, 255, choices=frozenset({1, 255})),
            row(0x1800 + number, 1, U32, marks, TPDO_COB_IDS[number] + node_id if default else INVALID),
            row(0x1800 + number, 2, U8, marks, 255, choices=types),
            row(0x1800 + number, 3, U16, marks, inhibit),
        ]
        for base, mapping in ((0x1600, received), (0x1A00, sent)):
            rows.append(row(base + number, 0, U8, marks, len(mapping), 0, places))
            objects_in = mapping + (0,) * (places - len(mapping))
            rows += [row(base + number, sub + 1, U32, marks, each) for sub, each in enumerate(objects_in)]
    return rows


def _setup() -> list[ObjectEntry]:
    return [
        row(0x2008, 0, U16, "rw cfg dis"),
        *(row(0x200C, sub, U32, "rw cfg") for sub in range(1, 5)),
        row(0x2020, 0, U16, "ro T"),
        row(0x2021, 0, U16, "ro T"),
        row(0x2022, 0, U16, "ro T"),
        row(0x2027, 0, I16, "ro T"),
        row(0x2028, 0, I32, "ro T"),
        row(0x2030, 0, I16, "rw R T"),
        row(0x2062, 0, I32, "rw R T"),
        row(0x206B, 0, I32, "rw R T"),
        *(row(0x2070, sub + 1, U16, "rw cfg", use, 0, 15) for sub, use in enumerate((15, 14, 13, 2, 1, 0))),
        row(0x2071, 1, U16, "ro T"),
        row(0x2071, 2, U16, "rw cfg", 0xE007),
        row(0x2071, 3, U16, "rw cfg"),
        row(0x2071, 4, U16, "rw cfg", 0x0008),
        row(0x2074, 1, I32, "ro T"),  # the position marker: no digital input is wired, so nothing is ever captured
        row(0x2074, 2, U8, "rw cfg", 0, 0, 2),
        row(0x2074, 3, U8, "rw cfg", 0, 0, 3),
        row(0x2074, 4, U16, "rw T"),
        *(row(0x2074, sub, I32, "ro T") for sub in (5, 6)),
        row(0x2078, 1, U16, "rw R T"),
        row(0x2078, 2, U16, "rw cfg"),
        row(0x2078, 3, U16, "rw cfg"),
        *(row(0x2079, sub + 1, U16, "rw cfg", use, 0, 15) for sub, use in enumerate((15, 14, 13, 12))),
        row(0x207C, 1, I16, "ro T"),
        row(0x207C, 2, I16, "ro T"),
        row(0x2080, 0, U16, "rw cfg R T", 500),
        row(0x2081, 0, I32, "rw R T"),
        row(0x20F4, 0, I16, "ro T"),
        row(0x2210, 1, U16, "rw cfg dis", 500, 16, 7500),
        row(0x2210, 2, U16, "rw cfg dis", 1, 1, 3),
        row(0x2210, 3, U16, "rw"),
        row(0x2210, 4, U16, "rw cfg dis", 0, 0, 3),
    ]


def _profile() -> list[ObjectEntry]:
    indices = ((0x6089, I8, 0), (0x608A, U8, 0xAC), (0x608B, I8, 0), (0x608C, U8, 0xA4), (0x608D, I8, 0))
    return [
        row(0x6040, 0, U16, "rw R T"),
        row(0x6041, 0, U16, "ro T"),
        row(0x6060, 0, I8, "rw R T", 1, choices=MODES),
        row(0x6061, 0, I8, "ro T", 1),
        row(0x6062, 0, I32, "ro T"),
        row(0x6064, 0, I32, "ro T"),
        row(0x6065, 0, U32, "rw cfg R T", 2000),
        row(0x6067, 0, U32, "rw cfg", OFF),
        row(0x6068, 0, U16, "rw cfg"),
        row(0x6069, 0, I32, "ro T"),
        row(0x606B, 0, I32, "ro T"),
        row(0x606C, 0, I32, "ro T"),
        row(0x6078, 0, I16, "ro T"),
        row(0x607A, 0, I32, "rw R T"),
        row(0x607C, 0, I32, "rw cfg R T"),
        row(0x607D, 1, I32, "rw cfg", LOWEST),
        row(0x607D, 2, I32, "rw cfg", HIGHEST),
        row(0x607F, 0, U32, "rw cfg", 25000, 1, 25000),
        row(0x6081, 0, U32, "rw R T", 1000, 1, 25000),
        row(0x6083, 0, U32, "rw R T", 10000, 1),
        row(0x6084, 0, U32, "rw R T", 10000, 1),
        row(0x6085, 0, U32, "rw R T", 10000, 1),
        row(0x6086, 0, I16, "rw cfg R T", 0, 0, 1),
        *(row(index, 0, kind, "rw dis", fixed, choices=frozenset({fixed})) for index, kind, fixed in indices),
        row(0x608E, 0, U8, "rw dis", 0xA4, choices=frozenset({0xA4})),
        row(0x6098, 0, I8, "rw cfg R T", 7, choices=HOMING_METHODS),
        row(0x6099, 1, U32, "rw cfg R T", 100),
        row(0x6099, 2, U32, "rw cfg R T", 10),
        row(0x609A, 0, U32, "rw cfg R T", 1000),
        row(0x60FF, 0, I32, "rw R T"),
        row(0x6502, 0, U32, "const", 0x003F0025),
    ]


def _motor(hardware: Hardware) -> list[ObjectEntry]:
    continuous, output = hardware.continuous_current, hardware.output_current
    gains = ((0x60F6, (400, 120)), (0x60F9, (400, 120)), (0x60FB, (150, 10, 200)))
    return [
        *(
            row(index, sub + 1, I16, "rw cfg R T", gain, 0, 32767)
            for index, loop in gains
            for sub, gain in enumerate(loop)
        ),
        row(0x60FB, 4, U16, "rw cfg R T"),
        row(0x60FB, 5, U16, "rw cfg R T"),
        row(0x6402, 0, U16, "rw cfg dis", 10, choices=frozenset({1, 10, 11})),
        row(0x6410, 1, U16, "rw cfg R T", continuous, 0, continuous),
        row(0x6410, 2, U16, "rw cfg R T", output, 0, output),
        row(0x6410, 3, U8, "rw cfg dis", 1, 1, 255),
        row(0x6410, 4, U16, "rw cfg R T", 30000, 1, 65535),
        row(0x6410, 5, U16, "rw cfg", 40, 1, hardware.thermal_time),
    ]
