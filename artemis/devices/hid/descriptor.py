"""Report descriptors: which bits of an input report mean what (USB HID 1.11, chapters 5, 6.2.2 and 8)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from artemis.errors import HidError

MAX_DESCRIPTOR = 4096
"""Bytes; the kernel's limit, too (Linux, hid.h: HID_MAX_DESCRIPTOR_SIZE)."""
MAX_REPORT = 4096
"""Bytes of a report without its ID."""
MAX_FIELDS = 8192
"""Of all reports together."""

JOYSTICK, GAMEPAD, MULTI_AXIS, SIMULATION_PAGE = 0x10004, 0x10005, 0x10008, 0x2
"""Usages of collections that somebody drives with (HID usage tables 1.5, chapters 4 and 5)."""

_PAGE, _MINIMUM, _MAXIMUM, _SIZE, _ID, _COUNT, _PUSH, _POP = 0, 1, 2, 7, 8, 9, 10, 11
_PHYSICAL_MINIMUM, _PHYSICAL_MAXIMUM, _EXPONENT, _UNIT = 3, 4, 5, 6
_DEGREES = 0x14
"""Unit "English rotation" (HID 1.11, 6.2.2.7)."""
_USAGE, _USAGE_MINIMUM, _USAGE_MAXIMUM, _DELIMITER = 0, 1, 2, 10
_LOCALS = frozenset({_USAGE, _USAGE_MINIMUM, _USAGE_MAXIMUM, 3, 4, 5, 7, 8, 9, _DELIMITER})
_PADDING, _INPUT, _OUTPUT, _COLLECTION, _FEATURE, _END_COLLECTION = 0, 8, 9, 10, 11, 12
_MAIN, _GLOBAL, _LOCAL = 0, 1, 2
_LONG_ITEM = 0xFE
_CONSTANT, _VARIABLE, _RELATIVE, _NULL_STATE = 0x01, 0x02, 0x04, 0x40
_BUTTONS = 0x9

_NAMES = {
    **{
        0x10030 + place: name
        for place, name in enumerate("x y z rx ry rz slider dial wheel hat".split())  # generic desktop page
    },
    0x200BA: "rudder",
    0x200BB: "throttle",
    0x200C4: "accelerator",
    0x200C5: "brake",
    0x200C6: "clutch",
    0x200C7: "shifter",
    0x200C8: "steering",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One variable of an input report."""

    name: str
    """As `x`, `rz`, `hat`, `brake`, `button.1`, else `usage.<page>.<id>` in four hexadecimal digits each. Another of
    the same usage in a descriptor: `z.2`."""
    report_id: int
    """0: the device uses none."""
    usage: int
    """Page << 16 | id; 0: it has none."""
    bit: int
    """Of the first, counted behind the report's ID."""
    bits: int
    minimum: int
    """Logical; values may lie outside."""
    maximum: int
    null_state: bool
    """A value outside the logical range says "nothing", as that of a released hat switch."""
    relative: bool
    step: float | None = None
    """Of a hat switch: degrees from a value to the next, clockwise, the lowest is up; None: not known, or no hat."""


class Descriptor:
    """What a device's input reports contain. Arrays (the keys of keyboards) and padding are left out."""

    def __init__(self, fields: tuple[Field, ...], lengths: dict[int, int], has_report_ids: bool, usage: int) -> None:
        """`lengths` are the bytes of each input report behind its ID, by ID (0: the device uses none)."""
        self.fields = fields
        self.has_report_ids = has_report_ids
        self.application = usage
        """Usage of the first top-level collection."""
        self._reports: dict[int, tuple[int, list[tuple[str, int, int, int]]]] = {}
        for field in fields:
            _, parts = self._reports.setdefault(field.report_id, (lengths[field.report_id], []))
            sign = 1 << field.bits - 1 if field.minimum < 0 else 0
            parts.append((field.name, field.bit, (1 << field.bits) - 1, sign))

    def decode(self, report: bytes) -> dict[str, int] | None:
        """Value of each field by its name; None for a report that is unknown or has no fields.

        `report` is as the device sent it, first its ID if it uses any. What is longer than declared is fine.

        Raises:
            HidError: it is shorter than declared.
        """
        number = 0
        if self.has_report_ids:
            if not report:
                raise HidError("report without a byte: its ID is missing")
            number, report = report[0], report[1:]
        if number not in self._reports:
            return None
        length, parts = self._reports[number]
        if len(report) < length:
            raise HidError(f"report {number} ends at byte {len(report)} of {length}")
        whole = int.from_bytes(report, "little")
        return {name: ((whole >> bit & mask) ^ sign) - sign for name, bit, mask, sign in parts}


@lru_cache(maxsize=16)  # one with thousands of bytes for its vendor takes longer than a tick
def parse_descriptor(data: bytes) -> Descriptor:
    """Read a report descriptor. Time and memory are bounded, whatever it says.

    Raises:
        HidError: it breaks the rules or exceeds the limits above; tells the byte.
    """
    if len(data) > MAX_DESCRIPTOR:
        raise HidError(f"report descriptor of {len(data)} bytes: {MAX_DESCRIPTOR} are the most")
    reading = _Reading()
    for offset, kind, tag, content in _items(data):
        try:
            reading.take(kind, tag, content)
        except HidError as error:
            raise HidError(f"report descriptor, byte {offset}: {error}") from None
    if reading.depth or reading.application is None:
        what = "a collection is not closed" if reading.depth else "it has no collection"
        raise HidError(f"report descriptor, byte {len(data)}: {what}")
    lengths = {number: (bits + 7) // 8 for number, bits in reading.bits.items()}
    return Descriptor(tuple(reading.fields), lengths, reading.has_report_ids, reading.application)


def is_control(usage: int) -> bool:
    """Whether a collection of this usage is something to drive with: joystick, gamepad, wheel, multi-axis."""
    return usage in (JOYSTICK, GAMEPAD, MULTI_AXIS) or usage >> 16 == SIMULATION_PAGE


def _items(data: bytes) -> Iterator[tuple[int, int, int, bytes]]:
    """Offset, kind, tag and content of each short item; long items, of which none is defined, are skipped."""
    offset = 0
    while offset < len(data):
        head, begin = data[offset], offset + 1
        if head == _LONG_ITEM:
            end = begin + 2 + (data[begin] if begin < len(data) else 0)
        else:
            end = begin + (0, 1, 2, 4)[head & 3]
        if end > len(data):
            raise HidError(f"report descriptor, byte {offset}: the item is cut off")
        if head != _LONG_ITEM:
            yield offset, head >> 2 & 3, head >> 4, data[begin:end]
        offset = end


class _Reading:
    """The state of a parser: what global and local items have said so far, and the fields found."""

    def __init__(self) -> None:
        self.fields: list[Field] = []
        self.bits: dict[int, int] = {}
        self.has_report_ids = False
        self.application: int | None = None
        self.depth = 0
        self._globals: dict[int, bytes] = {}
        self._pushed: list[dict[int, bytes]] = []
        self._usages: list[tuple[int, int, bool]] = []  # first, last, whether they named their page themselves
        self._first: bytes | None = None
        self._names: Counter[str] = Counter()

    def take(self, kind: int, tag: int, content: bytes) -> None:
        """Read an item."""
        if kind == _MAIN:
            self._main(tag, content)
            self._usages, self._first = [], None
        elif kind == _GLOBAL and tag <= _POP:
            self._global(tag, content)
        elif kind == _LOCAL and tag in _LOCALS:
            self._local(tag, content)
        else:
            raise HidError(f"unknown item (kind {kind}, tag {tag})")

    def _main(self, tag: int, content: bytes) -> None:
        if tag == _COLLECTION:
            if self.application is None:
                self.application = self._complete(1)[0]
            self.depth += 1
        elif not self.depth:
            if tag != _PADDING or content:  # some descriptors end in zeros
                raise HidError("it stands outside of every collection")
        elif tag == _END_COLLECTION:
            self.depth -= 1
        elif tag == _INPUT:
            self._input(_unsigned(content))
        elif tag not in (_OUTPUT, _FEATURE):
            raise HidError(f"unknown main item (tag {tag})")

    def _global(self, tag: int, content: bytes) -> None:
        if tag == _PUSH:
            self._pushed.append(self._globals.copy())
            return
        if tag == _POP:
            if not self._pushed:
                raise HidError("Pop without Push")
            self._globals = self._pushed.pop()
            return
        value = _unsigned(content)
        if tag == _ID:
            self.has_report_ids = True
            if not 1 <= value <= 255:
                raise HidError(f"report ID {value}: it is 1 to 255")
        if tag == _PAGE and value > 0xFFFF:
            raise HidError(f"usage page 0x{value:X} has more than 16 bits")
        self._globals[tag] = content

    def _local(self, tag: int, content: bytes) -> None:
        if tag == _DELIMITER:
            raise HidError("sets of alternative usages (Delimiter) are not supported")
        if tag == _USAGE_MINIMUM:
            self._first = content
        elif tag in (_USAGE, _USAGE_MAXIMUM):
            first = content if tag == _USAGE else self._first
            if first is None:
                raise HidError("Usage Maximum without Usage Minimum")
            page = self._value(_PAGE) << 16
            begin, end = (_unsigned(usage) | (0 if len(usage) == 4 else page) for usage in (first, content))
            if end < begin:
                raise HidError(f"usages from 0x{begin:X} to 0x{end:X}")
            self._usages.append((begin, end, 4 in (len(first), len(content))))
            self._first = None

    def _input(self, flags: int) -> None:
        size, count, number = (self._value(tag) for tag in (_SIZE, _COUNT, _ID))
        begin = self.bits.get(number, 0)
        end = begin + size * count
        if end > 8 * MAX_REPORT:
            raise HidError(f"report {number} gets {end} bits long; {8 * MAX_REPORT} are the most")
        self.bits[number] = end
        if flags & _CONSTANT or not flags & _VARIABLE or begin == end:
            return
        if len(self.fields) + count > MAX_FIELDS:
            raise HidError(f"more than {MAX_FIELDS} fields")
        minimum, maximum = (_signed(self._globals.get(tag, b"")) for tag in (_MINIMUM, _MAXIMUM))
        if maximum < minimum:  # many write the largest value of a byte, 255, as 0xFF, which is -1
            maximum = self._value(_MAXIMUM)
        if maximum < minimum:
            raise HidError(f"logical range from {minimum} to {maximum}")
        for place, usage in enumerate(self._complete(count)):
            name = self._name(usage)
            self.fields.append(
                Field(
                    name=name,
                    report_id=number,
                    usage=usage,
                    bit=begin + place * size,
                    bits=size,
                    minimum=minimum,
                    maximum=maximum,
                    null_state=bool(flags & _NULL_STATE),
                    relative=bool(flags & _RELATIVE),
                    step=self._hat_step(maximum - minimum) if name.startswith("hat") else None,
                )
            )

    def _hat_step(self, steps: int) -> float | None:
        """Of a hat switch with so many steps: eight or four directions, or as many as its physical range says."""
        if steps in (3, 7):
            return 360.0 / (steps + 1)
        low, high = (_signed(self._globals.get(tag, b"")) for tag in (_PHYSICAL_MINIMUM, _PHYSICAL_MAXIMUM))
        plain = self._value(_UNIT) == _DEGREES and self._value(_EXPONENT) == 0
        return (high - low) / steps if plain and low == 0 < high <= 360 and steps else None

    def _value(self, tag: int) -> int:
        return _unsigned(self._globals.get(tag, b""))

    def _complete(self, count: int) -> list[int]:
        """Usages of `count` fields; the last one repeats.

        A page that was named behind the usages counts for all since the last that took it (as Linux reads it).
        """
        page = self._value(_PAGE)
        for place, (first, last, complete) in reversed(list(enumerate(self._usages))):
            if not complete and first >> 16 == page:
                break
            if not complete:
                self._usages[place] = page << 16 | first & 0xFFFF, page << 16 | last & 0xFFFF, False
        found: list[int] = []
        for first, last, _ in self._usages:
            found += range(first, min(last + 1, first + count - len(found)))
        return found + [found[-1] if found else 0] * (count - len(found))

    def _name(self, usage: int) -> str:
        page, id = divmod(usage, 1 << 16)
        name = _NAMES.get(usage) or (f"button.{id}" if page == _BUTTONS else f"usage.{page:04x}.{id:04x}")
        self._names[name] += 1
        number = self._names[name]
        return name if number == 1 else f"{name}.{number}"


def _unsigned(content: bytes) -> int:
    return int.from_bytes(content, "little")


def _signed(content: bytes) -> int:
    return int.from_bytes(content, "little", signed=True)
