"""The objects of an EPOS4 as its users know them, written down apart from the simulated drive: what a client expects.

Source: the maker's EDS of the EPOS4, firmware 0x0170, but for what only its own tools use; 0x6076 is written by nobody,
and COB-IDs are those of a drive from the factory. One row: index, sub-indices (hexadecimal), type, access (`P`:
mappable; `rww`: into received PDOs), defaults ("-": none).
"""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

TYPES = {
    "u8": (datatypes.UNSIGNED8, 1),
    "u16": (datatypes.UNSIGNED16, 2),
    "u32": (datatypes.UNSIGNED32, 4),
    "u64": (datatypes.UNSIGNED64, 8),
    "i8": (datatypes.INTEGER8, 1),
    "i16": (datatypes.INTEGER16, 2),
    "i32": (datatypes.INTEGER32, 4),
    "str": (datatypes.VISIBLE_STRING, 0),
}
"""Type of the package, and bytes; 0: any."""
PLACES = 12
"""Of a PDO mapping."""

TABLE = """
1000 0 u32 ro -
1001 0 u8 ro -
1003 0 u8 rw 0
1003 1-5 u32 ro -
1005 0 u32 const 128
1008 0 str ro -
1010 0 u8 ro 1
1010 1 u32 rw 1
1011 0 u8 ro 4
1011 1 u32 rw 1
1011 4 u32 rw 1
1014 0 u32 ro node+0x80
1016 0 u8 ro 2
1016 1-2 u32 rw 0
1017 0 u16 rw 0
1018 0 u8 ro 4
1018 1-4 u32 ro -
1029 0 u8 ro 1
1029 1 u8 rw 0
1200 1-2 u32 ro node+0x600 node+0x580
2000 0 u8 rw 1
2001 0 u8 rw 0
2002 0 u8 rw 5
2005 0 u16 rw 500
2006 0 u16 rw 500
200A 0 u8 ro -
2010 0 u8 ro -
2100 1 u64 ro -
210C 1-4 u32 rw 0
2200 1 u16 ro -
2201 1-2 u32 rw 8000 58000
3000 1-4 u32 rw 0x100001 0x10111 49 0
3000 5-6 u32 ro -
3001 1-2 u32 rwwP 5000 15000
3001 3 u8 rw 1
3001 4 u16 rw 40
3001 5 u32 rw 0
3002 1 u32 rw 0
3002 2 u16 rw 0
3003 1-4 u32 rw 1 1 100000 0
3010 1 u32 rw 500
3010 2 u16 rw 1
3010 4 i32 roP -
3011 1 u16 rw 1
3011 2 u32 rw 0x80004
3011 3 i32 roP -
3012 1 u16 rw 2000
3012 2 u32 rw 3072
3012 3 u16 rw 1
3012 5 u16 rw 30
3012 6 u16 roP -
3012 7 u32 ro -
3012 8 u16 rw 200
3012 9 u32 ro -
3012 A-B u32 rw 0 12
3012 C u16 roP -
3012 D u64 ro -
301A 1 u16 rw 0
301A 2 u16 ro -
3020 1 u32 rw 500
3020 2 u16 rw 1
3020 4 i32 roP -
30A0 1-2 u32 rwwP 1171880 3906250
30A1 1-5 u32 rwwP 1500000 780000 16000 0 0
30A1 9 u32 rwwP 0xfa040300
30A2 1-4 u32 rwwP 20000 500000 0 0
30A2 5 u16 rw 600
30A3 1-5 u32 rwwP 400 100000 33 10 1000
30AE 1-2 u32 rwwP 10000 100000
30AE 3 u16 rwwP 12500
30AE 10-14 u32 rwwP 1000
30AE 20-23 u32 rwwP 20000 500000 0 0
30AE 30-34 u32 rwwP 400 100000 33 10 1000
30AE 40 u16 rwwP 0
30B0 0 i32 rwwP 0
30B1 0 i32 rw 0
30B2 0 u16 rwwP 500
30D0 0 i32 roP -
30D1 1-2 i32 roP -
30D2 1 i16 roP -
30D3 1 i32 roP -
30E0 1 u32 rw 30
30E0 2-3 u16 rw 2 1000
3141 1 u16 roP -
3141 2 u16 rw 0
3142 1-8 u8 rw 0 1 2 19 255 255 255 255
3150 1 u16 roP -
3150 2 u16 rw 0
3151 1-3 u8 rw 16 17 255
3158 1-2 u16 rw 10
3158 3 u8 ro -
3160 1-2 i16 roP -
3161 1-2 u8 rw 0 1
3162 1-2 i16 roP -
3163 1 i16 rw 0
3163 2 u16 rw 10000
3163 3 i16 rw 0
3163 4 u16 rw 10000
3170 1-4 i32 rw 0
3171 1-4 i32 rw 0
3180 1-2 i16 roP -
3181 1-2 u8 rw 0 1
3182 1-2 i32 rwwP 0
3200 1-2 u16 roP -
3201 1 i16 ro -
3201 4 u16 rw 1050
3202 1 u8 ro -
3203 1 u16 roP -
6007 0 i16 rw 3
603F 0 u16 roP -
6040 0 u16 rwwP 0
6041 0 u16 roP -
605A 0 i16 rw 6
605B 0 i16 rw 0
605C 0 i16 rw 1
605E 0 i16 rw 2
6060 0 i8 rwwP 1
6061 0 i8 roP -
6062 0 i32 roP -
6064 0 i32 roP -
6065 0 u32 rwwP 2000
6066 0 u16 rwwP 0
6067 0 u32 rwwP 4294967295
6068 0 u16 rwwP 0
606B 0 i32 roP -
606C 0 i32 roP -
6071 0 i16 rwwP 0
6076 0 u32 ro 0
6077 0 i16 roP -
607A 0 i32 rwwP 0
607B 1-2 i32 rwwP 0
607D 1-2 i32 rwwP 0
607F 0 u32 rwwP 50000
6080 0 u32 rwwP 50000
6081 0 u32 rwwP 1000
6083 0 u32 rwwP 10000
6084 0 u32 rwwP 10000
6085 0 u32 rwwP 10000
6086 0 i16 rwwP 0
6098 0 i8 rwwP 7
6099 1-2 u32 rwwP 100 10
609A 0 u32 rwwP 1000
60A8 0 u32 rw 0xb50000
60A9 0 u32 rw 0xb44700
60AA 0 u32 rw 0xc00300
60B0 0 i32 rwwP 0
60B1 0 i32 rwwP 0
60B2 0 i16 rwwP 0
60B8 0 u16 rwwP 0
60B9 0 u16 roP -
60BA 0 i32 roP -
60BB 0 i32 roP -
60C2 1 u8 rwwP 0
60C2 2 i8 rwwP -3
60C5 0 u32 rwwP 4294967295
60D0 1 i16 ro -
60D5 0 u16 roP -
60D6 0 u16 roP -
60E3 1-F i8 ro -
60E4 1-3 i32 roP -
60E5 1-3 i32 roP -
60E5 9-B i32 roP -
60F4 0 i32 roP -
60FD 0 u32 roP -
60FE 1 u32 rwwP 0
60FF 0 i32 rwwP 0
6402 0 u16 rw 10
6502 0 u32 roP -"""
PDO_TABLE = """
{rx_parameters} 1 u32 rw node+0x{rx_id:X}
{rx_parameters} 2 u8 rw 255
{tx_parameters} 1 u32 rw node+0x{tx_id:X}
{tx_parameters} 2 u8 rw 255
{tx_parameters} 3 u16 rw 10
"""
MAPPINGS = {
    0x1600: ((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x607A0020), (0x60400010, 0x60FF0020)),
    0x1A00: ((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010, 0x606C0020)),
}


class Known(NamedTuple):
    """One object."""

    at: int
    """Index."""
    sub: int
    type: str
    access: str
    default: int | None

    @property
    def size(self) -> int:
        """Bytes; 0: any."""
        return TYPES[self.type][1]

    @property
    def mapping(self) -> int:
        """Its entry in a PDO mapping."""
        return self.at << 16 | self.sub << 8 | 8 * self.size


def known(node_id: int) -> Iterator[Known]:
    """Every object."""
    tables = [TABLE]
    for number in range(4):
        invalid = 0x80000000 if number else 0
        tables.append(
            PDO_TABLE.format(
                rx_parameters=f"{0x1400 + number:X}",
                rx_id=0x200 + 0x100 * number,
                tx_parameters=f"{0x1800 + number:X}",
                tx_id=0x40000180 + 0x100 * number | invalid,
            )
        )
    for line in "".join(tables).split("\n"):
        if line:
            yield from _objects(line, node_id)
    for base, defaults in MAPPINGS.items():
        for number, mapped in enumerate(defaults):
            yield Known(base + number, 0, "u8", "rw", len(mapped))
            places = mapped + (0,) * (PLACES - len(mapped))
            yield from (Known(base + number, sub + 1, "u32", "rw", place) for sub, place in enumerate(places))


def _objects(line: str, node_id: int) -> Iterator[Known]:
    index, subs, kind, access, *defaults = line.split()
    first, _, last = subs.partition("-")
    for number, sub in enumerate(range(int(first, 16), int(last or first, 16) + 1)):
        text = defaults[number % len(defaults)]
        base, _, added = text.rpartition("+")
        default = None if text == "-" else int(added, 0) + (node_id if base else 0)
        yield Known(int(index, 16), sub, kind, access, default)


def described4(node_id: int = 1) -> canopen.ObjectDictionary:
    """The same for a client of the `canopen` package."""
    made = canopen.ObjectDictionary()
    records: dict[int, list[Known]] = {}
    for entry in known(node_id):
        records.setdefault(entry.at, []).append(entry)
    for index, entries in records.items():
        if [entry.sub for entry in entries] == [0]:
            made.add_object(_variable(entries[0]))
            continue
        record = ODRecord(f"record {index:04X}", index)
        if entries[0].sub:
            record.add_member(_variable(Known(index, 0, "u8", "ro", None)))
        for entry in entries:
            record.add_member(_variable(entry))
        made.add_object(record)
    return made


def _variable(entry: Known) -> ODVariable:
    made = ODVariable(f"object {entry.at:04X}:{entry.sub:X}", entry.at, entry.sub)
    made.data_type = TYPES[entry.type][0]
    made.access_type = entry.access.removesuffix("P").replace("rww", "rw")
    made.default = entry.default
    return made
