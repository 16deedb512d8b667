"""The object dictionary of a simulated EPOS: what may be read and written, when, and by what it is refused.

Checks come in the order object, sub-index, access, length, range, device state, and then the object's own.
The objects themselves stand in `epos_objects.py`, `epos4_objects.py` and `cia402_objects.py`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

from artemis.errors import ArtemisError


class AbortCode(IntEnum):
    """SDO abort codes (EPOS firmware specification 2010, 12.3; CiA 301 7.2.4.3.17)."""

    TOGGLE_BIT = 0x05030000
    COMMAND_SPECIFIER = 0x05040001
    UNSUPPORTED_ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_TOO_LONG = 0x06040042
    INCOMPATIBLE = 0x06040043
    WRONG_LENGTH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    RANGE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    CANNOT_STORE = 0x08000020
    DEVICE_STATE = 0x08000022
    NMT_STATE = 0x0F00FFC0


class AccessRefused(ArtemisError):
    """A request that the dictionary refuses; the SDO server turns it into an abort frame."""

    def __init__(self, code: int) -> None:
        self.code = code
        name = f" ({AbortCode(code).name})" if code in list(AbortCode) else ""
        super().__init__(f"refused with SDO abort 0x{code:08X}{name}")


@dataclass(frozen=True, slots=True, kw_only=True)
class AbortRules:
    """By which code a generation of drives refuses a number out of range, and one of the wrong length."""

    too_high: int = AbortCode.TOO_HIGH
    too_low: int = AbortCode.TOO_LOW
    too_long: int = AbortCode.TOO_LONG
    cuts_bytes: bool = True
    """Data that is too long for an object of one byte is cut, not refused."""


@dataclass(slots=True, kw_only=True)
class Refusal:
    """A failure: requests for an object are aborted with this code, so many more times (None: always)."""

    code: int
    left: int | None


class Type(IntEnum):
    """Data types, with the index CiA 301 gives them."""

    BOOL = 0x01
    I8 = 0x02
    I16 = 0x03
    I32 = 0x04
    U8 = 0x05
    U16 = 0x06
    U32 = 0x07
    STRING = 0x09
    U64 = 0x1B


FORMATS = {
    Type.BOOL: "B",
    Type.I8: "b",
    Type.I16: "h",
    Type.I32: "i",
    Type.U8: "B",
    Type.U16: "H",
    Type.U32: "I",
    Type.U64: "Q",
}
"""Code of each number type in the `struct` module."""
SIZES = {kind: struct.calcsize("<" + code) for kind, code in FORMATS.items()}
SIGNED = {Type.I8, Type.I16, Type.I32}


def key_of(index: int, sub: int) -> int:
    """Index and sub-index as one number, the way a PDO mapping holds them: index * 256 + sub."""
    return index << 8 | sub


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectEntry:
    """One object."""

    index: int
    sub: int
    type: Type
    access: str
    """"ro", "rw", "wo" or "const", as seen over SDO."""
    default: int | bytes = 0
    minimum: int = 0
    maximum: int = 0
    choices: frozenset[int] | None = None
    """The only values allowed, where they are not a range."""
    receive: bool = False
    """May be mapped into a PDO that the drive receives."""
    transmit: bool = False
    disabled_only: bool = False
    """Writable only while the power stage is disabled."""
    configuration: bool = False
    """A change clears object 0x1020."""

    @property
    def key(self) -> int:
        """Index and sub-index as one number."""
        return key_of(self.index, self.sub)

    @property
    def size(self) -> int | None:
        """Length in bytes; None for a string."""
        return SIZES.get(self.type)


def row(
    index: int,
    sub: int,
    kind: Type,
    marks: str,
    default: int = 0,
    low: int | None = None,
    high: int | None = None,
    choices: frozenset[int] | None = None,
) -> ObjectEntry:
    """One object of a table. `marks`: its access, then of `cfg`, `dis`, `R` and `T` those that hold.

    Args:
        index: Index.
        sub: Sub-index.
        kind: Data type.
        marks: `cfg` a configuration parameter, `dis` writable only while the power stage is disabled, `R` and `T`
            mappable into received and transmitted PDOs.
        default: Value from the factory.
        low: Lowest value; None: of the type.
        high: Highest value; None: of the type.
        choices: The only values allowed, where they are not a range.
    """
    bits = 8 * SIZES[kind]
    lowest, highest = (-(1 << bits - 1), (1 << bits - 1) - 1) if kind in SIGNED else (0, (1 << bits) - 1)
    access, *rest = marks.split()
    return ObjectEntry(
        index=index,
        sub=sub,
        type=kind,
        access=access,
        default=default,
        minimum=lowest if low is None else low,
        maximum=highest if high is None else high,
        choices=choices,
        receive="R" in rest,
        transmit="T" in rest,
        disabled_only="dis" in rest,
        configuration="cfg" in rest,
    )


def with_counts(rows: list[ObjectEntry]) -> tuple[ObjectEntry, ...]:
    """All rows, and for each object with sub-indices its sub-index 0, the highest of them, where no row has it."""
    counts: dict[int, int] = {}
    for entry in rows:
        counts[entry.index] = max(counts.get(entry.index, 0), entry.sub)
    described = {entry.index for entry in rows if entry.sub == 0}
    return (*rows, *(row(i, 0, Type.U8, "const", n) for i, n in counts.items() if n > 0 and i not in described))


class Dictionary:
    """Values and rules of all objects of one drive.

    Live objects have a `getter`; `checks` may refuse a value with `AccessRefused`, `written` is told of one that was
    taken.
    """

    def __init__(
        self, entries: Sequence[ObjectEntry], power_off: Callable[[], bool], rules: AbortRules | None = None
    ) -> None:
        self.entries = {entry.key: entry for entry in entries}
        self.values: dict[int, int] = {}
        """Stored numbers by `key_of`; what a live object holds is behind its getter."""
        self._strings: dict[int, bytes] = {}
        for key, entry in self.entries.items():
            if isinstance(entry.default, bytes):
                self._strings[key] = entry.default
            else:
                self.values[key] = entry.default
        self.getters: dict[int, Callable[[], int]] = {}
        self.checks: dict[int, Callable[[int], None]] = {}
        self.written: dict[int, Callable[[int], None]] = {}
        self.refusals: dict[int, Refusal] = {}
        self.ignored: set[int] = set()
        """Failure: writes over SDO are taken and not kept."""
        self._indices = {entry.index for entry in entries}
        self._power_off = power_off
        self._rules = AbortRules() if rules is None else rules

    def find(self, index: int, sub: int) -> ObjectEntry:
        """The object at this place.

        Raises:
            Abort: there is none.
        """
        entry = self.entries.get(key_of(index, sub))
        if entry is None:
            raise AccessRefused(AbortCode.NO_SUBINDEX if index in self._indices else AbortCode.NO_OBJECT)
        return entry

    def number(self, index: int, sub: int = 0) -> int:
        """Present value of an object that is known to exist and to be a number."""
        key = key_of(index, sub)
        getter = self.getters.get(key)
        return self.values[key] if getter is None else getter()

    def read(self, index: int, sub: int = 0) -> int | bytes:
        """Present value, whatever the access.

        Raises:
            Abort: no such object.
        """
        string = self._strings.get(self.find(index, sub).key)
        return self.number(index, sub) if string is None else string

    def poke(self, index: int, sub: int, value: int) -> None:
        """Put a number in place, past access, range and state; whoever listens to the object is told.

        Raises:
            Abort: no such object.
        """
        self._store(self.find(index, sub), value)

    def upload(self, index: int, sub: int) -> bytes:
        """An object as a client reads it over SDO, little endian.

        Raises:
            Abort: no such object, or write-only.
        """
        entry = self.find(index, sub)
        if entry.access == "wo":
            raise AccessRefused(AbortCode.WRITE_ONLY)
        self._refuse(entry.key)
        value = self.read(index, sub)
        return value if isinstance(value, bytes) else struct.pack("<" + FORMATS[entry.type], value)

    def download(self, index: int, sub: int, data: bytes, *, length_told: bool = True) -> None:
        """Write an object as a client does over SDO; an EPOS of 2023h or later cuts what is too long for a byte.

        Args:
            index: Index.
            sub: Sub-index.
            data: The value, little endian; four bytes of unknown use when the length was not told.
            length_told: The client said how many bytes it means.

        Raises:
            Abort: refused.
        """
        entry = self.find(index, sub)
        if entry.access in ("ro", "const"):
            raise AccessRefused(AbortCode.READ_ONLY)
        self._refuse(entry.key)
        size = SIZES[entry.type]
        if not length_told or (size == 1 and self._rules.cuts_bytes):
            data = data[:size]
        if len(data) != size:
            raise AccessRefused(self._rules.too_long if len(data) > size else AbortCode.TOO_SHORT)
        value = int.from_bytes(data, "little", signed=entry.type in SIGNED)
        self._judge_range(entry, value)
        if entry.disabled_only and not self._power_off():
            raise AccessRefused(AbortCode.DEVICE_STATE)
        check = self.checks.get(entry.key)
        if check is not None:
            check(value)
        if entry.key in self.ignored:
            return
        if entry.configuration and value != self.values[entry.key]:
            self.values[key_of(0x1020, 1)] = self.values[key_of(0x1020, 2)] = 0
        self._store(entry, value)

    def getter(self, key: int) -> Callable[[], int]:
        """A function that reads this object: found once, called for every PDO."""
        getter = self.getters.get(key)
        if getter is not None:
            return getter
        return partial(self.values.__getitem__, key)

    def setter(self, key: int) -> Callable[[int], None]:
        """A function that writes this object from a PDO: a value out of range is dropped, there is nobody to tell."""
        entry, values, written = self.entries[key], self.values, self.written.get(key)
        minimum, maximum, choices = entry.minimum, entry.maximum, entry.choices

        def write(value: int) -> None:
            if minimum <= value <= maximum and (choices is None or value in choices):
                values[key] = value
                if written is not None:
                    written(value)

        return write

    def _refuse(self, key: int) -> None:
        refusal = self.refusals.get(key)
        if refusal is None:
            return
        if refusal.left is not None:
            refusal.left -= 1
            if refusal.left <= 0:
                del self.refusals[key]
        raise AccessRefused(refusal.code)

    def _judge_range(self, entry: ObjectEntry, value: int) -> None:
        if value > entry.maximum:
            raise AccessRefused(self._rules.too_high)
        if value < entry.minimum:
            raise AccessRefused(self._rules.too_low)
        if entry.choices is not None and value not in entry.choices:
            raise AccessRefused(AbortCode.RANGE)

    def _store(self, entry: ObjectEntry, value: int) -> None:
        self.values[entry.key] = value
        written = self.written.get(entry.key)
        if written is not None:
            written(value)
