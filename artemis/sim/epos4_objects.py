"""The objects of the EPOS4, firmware 0x0170 (its EDS: types, access, defaults, ranges, what is mappable).

What only the maker's own tools use is left out: program download, data recorder, auto-tuning, internal objects. Rows
are those of `dictionary.row`. Objects marked `dis` refuse to change while the power stage is enabled; the
communication guide names the abort code, public tables the objects.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from artemis.sim.dictionary import AbortCode, AbortRules, ObjectEntry, Type, row, with_counts
from artemis.sim.epos_objects import OFF, pdo_rows

BOOL, I8, I16, I32, U8, U16, U32 = Type.BOOL, Type.I8, Type.I16, Type.I32, Type.U8, Type.U16, Type.U32

ABORTS = AbortRules(
    too_high=AbortCode.RANGE, too_low=AbortCode.RANGE, too_long=AbortCode.WRONG_LENGTH, cuts_bytes=False
)
"""The communication guide lists one code for each."""
MODES = frozenset({1, 3, 6, 8, 9, 10})
HOMING_METHODS = (37, 34, 33, 27, 23, 18, 17, 11, 7, 2, 1, -1, -2, -3, -4)
VELOCITY_UNITS = frozenset((prefix & 0xFF) << 24 | 0x00B44700 for prefix in range(-6, 1))
"""Values of 0x60A9: revolutions per minute, times a power of ten from -6 to 0."""
BIT_RATES = frozenset({0, 1, 2, 3, 4, 6, 7, 9})
INPUT_USES = frozenset({0, 1, 2, *range(16, 29), 255})
OUTPUT_USES = frozenset({0, 16, 17, 18, 24, 25, 255})
ANALOG_USES = frozenset({0, 1, 8, 9, 255})
VOLATILE = frozenset({0x1003, 0x1010, 0x1011, 0x6040, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60FE, 0x60FF})
"""Indices of writable objects that 0x1010 does not keep: commands, set-points and signatures."""

ANALOG_SPAN_MV, ANALOG_STEPS = 20000, 4096
"""The analog inputs take -10 to +10 V in 12 bit (hardware reference)."""


def millivolts(voltage: float) -> int:
    """A voltage [V] as the converter of an analog input sees it [mV]."""
    steps = round(voltage * 1000.0 * ANALOG_STEPS / ANALOG_SPAN_MV)
    half = ANALOG_STEPS // 2
    return round(max(-half, min(half - 1, steps)) * ANALOG_SPAN_MV / ANALOG_STEPS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardware4:
    """Current limits [mA] that a controller accepts."""

    nominal_current: int
    output_current: int


HARDWARE = {
    0x6050: Hardware4(nominal_current=1500, output_current=4500),  # Module and Compact 24/1.5
    0x6150: Hardware4(nominal_current=5000, output_current=15000),  # Module and Compact 50/5
    0x6350: Hardware4(nominal_current=5000, output_current=15000),  # 50/5
    0x6450: Hardware4(nominal_current=15000, output_current=30000),  # 70/15
    0x6551: Hardware4(nominal_current=8000, output_current=30000),  # Module and Compact 50/8
    0x6552: Hardware4(nominal_current=15000, output_current=30000),  # Module and Compact 50/15
}
"""By hardware version. Of the 50/5 as its EDS says; of the others by their names, and peaks from the catalogue."""


@cache
def objects4(node_id: int, hardware_version: int, firmware: int, serial_number: int) -> tuple[ObjectEntry, ...]:
    """All objects of one drive as it leaves the factory.

    Args:
        node_id: As set by the DIP switches.
        hardware_version: High word of object 0x1018:2; decides the current limits (unknown ones get those of the 50/5).
        firmware: High word of object 0x1018:3.
        serial_number: Object 0x2100:1.
    """
    hardware = HARDWARE.get(hardware_version, HARDWARE[0x6150])
    rows = _communication(node_id) + _identity(node_id, hardware_version, firmware, serial_number)
    rows += pdo_rows(node_id, 4, "rw", frozenset({1, 255}), places=12, inhibit=10)
    rows += _motor(hardware) + _sensors() + _loops() + _periphery(hardware)
    return with_counts(rows + _device_control() + _modes())


def _communication(node_id: int) -> list[ObjectEntry]:
    return [
        row(0x1000, 0, U32, "ro", 0x00020192),
        row(0x1001, 0, U8, "ro"),
        row(0x1003, 0, U8, "rw", 0, 0, 5),
        *(row(0x1003, sub, U32, "ro") for sub in range(1, 6)),
        row(0x1005, 0, U32, "const", 0x80),
        row(0x1010, 1, U32, "rw", 1),
        row(0x1011, 1, U32, "rw dis", 1),
        row(0x1011, 4, U32, "rw dis", 1),
        row(0x1014, 0, U32, "ro", 0x80 + node_id),
        row(0x1016, 1, U32, "rw"),
        row(0x1016, 2, U32, "rw"),
        row(0x1017, 0, U16, "rw"),
        row(0x1029, 1, U8, "rw", 0, 0, 1),
        row(0x1200, 1, U32, "ro", 0x600 + node_id),
        row(0x1200, 2, U32, "ro", 0x580 + node_id),
    ]


def _identity(node_id: int, hardware_version: int, firmware: int, serial_number: int) -> list[ObjectEntry]:
    return [
        ObjectEntry(index=0x1008, sub=0, type=Type.STRING, access="const", default=b"EPOS4"),
        row(0x1018, 1, U32, "ro", 0x000000FB),
        row(0x1018, 2, U32, "ro", hardware_version << 16),
        row(0x1018, 3, U32, "ro", firmware << 16),
        row(0x1018, 4, U32, "ro", serial_number % 10**8),
        row(0x1F56, 1, U32, "ro", firmware << 16),
        row(0x1F57, 1, U32, "ro"),
        row(0x2000, 0, U8, "rw", node_id, 1, 255),
        row(0x2001, 0, U8, "rw", 0, choices=BIT_RATES),
        row(0x2002, 0, U8, "rw", 5, 0, 5),
        row(0x2005, 0, U16, "rw", 500, 50),
        row(0x2006, 0, U16, "rw", 500, 50),
        row(0x200A, 0, U8, "ro"),
        row(0x2010, 0, U8, "ro"),
        row(0x2100, 1, Type.U64, "ro", serial_number),
        *(row(0x210C, sub, U32, "rw") for sub in range(1, 5)),
    ]


def _motor(hardware: Hardware4) -> list[ObjectEntry]:
    nominal, output = hardware.nominal_current, hardware.output_current
    return [
        row(0x2200, 1, U16, "ro"),
        row(0x2200, 2, BOOL, "ro"),
        row(0x2201, 1, U32, "rw", 8000, 8000, 55500),
        row(0x2201, 2, U32, "rw", 58000),
        row(0x3000, 1, U32, "rw dis", 0x00100001),
        row(0x3000, 2, U32, "rw dis", 0x00010111),
        row(0x3000, 3, U32, "rw dis", 0x31),
        row(0x3000, 4, U32, "rw dis", 0, 0, 1),
        row(0x3000, 5, U32, "ro"),
        row(0x3000, 6, U32, "ro"),
        row(0x3001, 1, U32, "rw R T", nominal, 0, nominal),
        row(0x3001, 2, U32, "rw R T", output, 0, output),
        row(0x3001, 3, U8, "rw dis", 1, 1),
        row(0x3001, 4, U16, "rw", 40, 1, 10000),
        row(0x3001, 5, U32, "rw", 0, 0, 10_000_000),
        row(0x3002, 1, U32, "rw"),
        row(0x3002, 2, U16, "rw"),
        row(0x3003, 1, U32, "rw dis", 1, 1),
        row(0x3003, 2, U32, "rw dis", 1, 1),
        row(0x3003, 3, U32, "rw dis", 100000, 1, 100000),
        row(0x3003, 4, U32, "rw dis", 0, 0, 1),
        row(0x6402, 0, U16, "rw dis", 10, choices=frozenset({1, 10, 11})),
    ]


def _sensors() -> list[ObjectEntry]:
    encoders = []
    for index in (0x3010, 0x3020):
        encoders += [
            row(index, 1, U32, "rw dis", 500, 16, 2_500_000),
            row(index, 2, U16, "rw dis", 0x0001),
            row(index, 4, I32, "ro T"),
        ]
    return [
        *encoders,
        row(0x3011, 1, U16, "rw dis", 0x0001),
        row(0x3011, 2, U32, "rw dis", 0x00080004),
        row(0x3011, 3, I32, "ro T"),
        row(0x3012, 1, U16, "rw dis", 2000, 400, 2000),
        row(0x3012, 2, U32, "rw dis", 0x00000C00),
        row(0x3012, 3, U16, "rw dis", 0x0001),
        row(0x3012, 5, U16, "rw dis", 30, 0, 50),
        row(0x3012, 6, U16, "ro T"),
        row(0x3012, 7, U32, "ro"),
        row(0x3012, 8, U16, "rw dis", 200, 0, 10000),
        row(0x3012, 9, U32, "ro"),
        row(0x3012, 0xA, U32, "rw dis"),
        row(0x3012, 0xB, U32, "rw dis", 0x0000000C),
        row(0x3012, 0xC, U16, "ro T"),
        row(0x3012, 0xD, Type.U64, "ro"),
        row(0x301A, 1, U16, "rw dis"),
        row(0x301A, 2, U16, "ro"),
    ]


def _loops() -> list[ObjectEntry]:
    gains: dict[int, dict[int, int]] = {
        0x30A0: {1: 1171880, 2: 3906250},
        0x30A1: {1: 1500000, 2: 780000, 3: 16000, 4: 0, 5: 0},
        0x30A2: {1: 20000, 2: 500000, 3: 0, 4: 0},
        0x30A3: {1: 400, 2: 100000, 3: 33, 4: 10, 5: 1000},
    }
    dual: dict[int, int] = {
        **{0x1: 10000, 0x2: 100000, **dict.fromkeys(range(0x10, 0x15), 1000)},
        **{0x20: 20000, 0x21: 500000, 0x22: 0, 0x23: 0},
        **{0x30: 400, 0x31: 100000, 0x32: 33, 0x33: 10, 0x34: 1000},
    }
    milli, micro = 0xFD040300, 0xFA040300
    return [
        *(row(index, sub, U32, "rw R T", gain) for index, loop in gains.items() for sub, gain in loop.items()),
        row(0x30A1, 9, U32, "rw R T", micro, choices=frozenset({micro, milli})),
        row(0x30A2, 5, U16, "rw", 600, 1, 10000),
        *(row(0x30AE, sub, U32, "rw R T", gain, 0, 10**9 if sub < 0x20 else None) for sub, gain in dual.items()),
        row(0x30AE, 3, U16, "rw R T", 12500, 5000, 20000),
        row(0x30AE, 0x40, U16, "rw R T", 0, 0, 3),
    ]


def _periphery(hardware: Hardware4) -> list[ObjectEntry]:
    peak = hardware.output_current
    uses, outputs = (0, 1, 2, 19, 255, 255, 255, 255), (16, 17, 255)
    return [
        row(0x30B0, 0, I32, "rw R T"),
        row(0x30B1, 0, I32, "rw"),
        row(0x30B2, 0, U16, "rw R T", 500, 0, peak),
        row(0x30D0, 0, I32, "ro T"),
        row(0x30D1, 1, I32, "ro T"),
        row(0x30D1, 2, I32, "ro T"),
        row(0x30D2, 1, I16, "ro T"),
        row(0x30D3, 1, I32, "ro T"),
        row(0x30E0, 1, U32, "rw", 30),
        row(0x30E0, 2, U16, "rw", 2),
        row(0x30E0, 3, U16, "rw", 1000),
        row(0x3141, 1, U16, "ro T"),
        row(0x3141, 2, U16, "rw"),
        *(row(0x3142, number + 1, U8, "rw", use, choices=INPUT_USES) for number, use in enumerate(uses)),
        row(0x3150, 1, U16, "ro T"),
        row(0x3150, 2, U16, "rw"),
        *(row(0x3151, number + 1, U8, "rw", use, choices=OUTPUT_USES) for number, use in enumerate(outputs)),
        row(0x3158, 1, U16, "rw", 10, 0, 5000),
        row(0x3158, 2, U16, "rw", 10, 0, 5000),
        row(0x3158, 3, U8, "ro"),
        *(row(index, sub, I16, "ro T") for index in (0x3160, 0x3162) for sub in (1, 2)),
        *(row(0x3161, sub, U8, "rw", sub - 1, choices=ANALOG_USES) for sub in (1, 2)),
        *(row(0x3163, sub, I16, "rw") for sub in (1, 3)),
        *(row(0x3163, sub, U16, "rw", 10000, 5000, 20000) for sub in (2, 4)),
        *(row(0x3170, sub, I32, "rw", 0, -10000, 10000) for sub in (1, 3)),
        *(row(0x3170, sub, I32, "rw", 0, -peak, peak) for sub in (2, 4)),
        *(row(0x3171, sub, I32, "rw", 0, -10000, 10000) for sub in (1, 3)),
        *(row(0x3171, sub, I32, "rw") for sub in (2, 4)),
        *(row(0x3180, sub, I16, "ro T") for sub in (1, 2)),
        *(row(0x3181, sub, U8, "rw", sub - 1) for sub in (1, 2)),
        *(row(0x3182, sub, I32, "rw R T", 0, -4000, 4000) for sub in (1, 2)),
        *(row(0x3200, sub, U16, "ro T") for sub in (1, 2)),
        row(0x3201, 1, I16, "ro"),
        row(0x3201, 4, U16, "rw", 1050, 0, 1050),
        row(0x3202, 1, U8, "ro"),
        row(0x3203, 1, U16, "ro T"),
    ]


def _device_control() -> list[ObjectEntry]:
    return [
        row(0x6007, 0, I16, "rw", 3, choices=frozenset({2, 3})),
        row(0x603F, 0, U16, "ro T"),
        row(0x6040, 0, U16, "rw R T"),
        row(0x6041, 0, U16, "ro T"),
        row(0x605A, 0, I16, "rw", 6, choices=frozenset({6})),
        row(0x605B, 0, I16, "rw", 0, 0, 1),
        row(0x605C, 0, I16, "rw", 1, 0, 1),
        row(0x605E, 0, I16, "rw", 2, 0, 2),
        row(0x6060, 0, I8, "rw R T", 1, choices=MODES),
        row(0x6061, 0, I8, "ro T", 1),
        row(0x6502, 0, U32, "ro T", 0x3A5),
    ]


def _modes() -> list[ObjectEntry]:
    return [
        row(0x6062, 0, I32, "ro T"),
        row(0x6064, 0, I32, "ro T"),
        row(0x6065, 0, U32, "rw R T", 2000),
        row(0x6066, 0, U16, "rw R T", 0, 0, 0),
        row(0x6067, 0, U32, "rw R T", OFF),
        row(0x6068, 0, U16, "rw R T"),
        row(0x606B, 0, I32, "ro T"),
        row(0x606C, 0, I32, "ro T"),
        row(0x6071, 0, I16, "rw R T"),
        row(0x6076, 0, U32, "ro"),
        row(0x6077, 0, I16, "ro T"),
        row(0x607A, 0, I32, "rw R T"),
        *(row(0x607B, sub, I32, "rw R T", 0, 0, 0) for sub in (1, 2)),
        *(row(0x607D, sub, I32, "rw R T") for sub in (1, 2)),
        row(0x607F, 0, U32, "rw R T", 50000),
        row(0x6080, 0, U32, "rw R T", 50000),
        row(0x6081, 0, U32, "rw R T", 1000),
        *(row(index, 0, U32, "rw R T", 10000, 1) for index in (0x6083, 0x6084, 0x6085)),
        row(0x6086, 0, I16, "rw R T", 0, 0, 0),
        row(0x6098, 0, I8, "rw R T", 7, choices=frozenset(HOMING_METHODS)),
        row(0x6099, 1, U32, "rw R T", 100),
        row(0x6099, 2, U32, "rw R T", 10),
        row(0x609A, 0, U32, "rw R T", 1000, 1),
        row(0x60A8, 0, U32, "rw", 0x00B50000, 0x00B50000, 0x00B50000),
        row(0x60A9, 0, U32, "rw dis", 0x00B44700, choices=VELOCITY_UNITS),
        row(0x60AA, 0, U32, "rw", 0x00C00300, 0x00C00300, 0x00C00300),
        row(0x60B0, 0, I32, "rw R T"),
        row(0x60B1, 0, I32, "rw R T"),
        row(0x60B2, 0, I16, "rw R T"),
        row(0x60B8, 0, U16, "rw R T"),
        row(0x60B9, 0, U16, "ro T"),
        *(row(index, 0, I32, "ro T") for index in (0x60BA, 0x60BB)),
        row(0x60C2, 1, U8, "rw R T", 0, 0, 100),
        row(0x60C2, 2, I8, "rw R T", -3, -3, -3),
        row(0x60C5, 0, U32, "rw R T", OFF, 1),
        row(0x60D0, 1, I16, "ro"),
        *(row(index, 0, U16, "ro T") for index in (0x60D5, 0x60D6)),
        *(row(0x60E3, number + 1, I8, "ro", method) for number, method in enumerate(HOMING_METHODS)),
        *(row(0x60E4, sub, I32, "ro T") for sub in (1, 2, 3)),
        *(row(0x60E5, sub, I32, "ro T") for sub in (1, 2, 3, 9, 0xA, 0xB)),
        row(0x60F4, 0, I32, "ro T"),
        row(0x60FD, 0, U32, "ro T"),
        row(0x60FE, 1, U32, "rw R T"),
        row(0x60FF, 0, I32, "rw R T"),
    ]
