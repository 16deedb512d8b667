"""Whatever bytes a device sends as its descriptor, or as a report: what comes out is known."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

from hypothesis import example, given
from hypothesis import strategies as st

from artemis.devices.hid.descriptor import MAX_DESCRIPTOR, MAX_FIELDS, MAX_REPORT, Descriptor, parse_descriptor
from artemis.errors import HidError

sys.path.append(str(Path(__file__).parents[1] / "unit"))
from hid_devices import DESCRIPTORS, JOYSTICK


def item(head: int, content: bytes) -> bytes:
    return bytes([head]) + content[: (0, 1, 2, 4)[head & 3]]


NUMBERS = st.sampled_from([0, 1, 2, 7, 8, 0x10, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF]) | st.integers(0, 255)
KNOWN = [0x04, 0x14, 0x24, 0x74, 0x84, 0x94, 0x08, 0x18, 0x28, 0x80, 0x80, 0x80, 0x90, 0xA0, 0xC0, 0xA4, 0xB4]
"""First bytes without a length: Usage Page, Logical Minimum and Maximum, Report Size, ID and Count, usages, main items,
Push, Pop."""
SEQUENCES = st.lists(
    st.builds(
        lambda head, size, number: item(head | size, number.to_bytes(4, "little")),
        st.sampled_from(KNOWN),
        st.integers(0, 3),
        NUMBERS,
    ),
    max_size=40,
).map(b"".join)


def check(found: Descriptor) -> None:
    """What every descriptor that is accepted promises."""
    assert len(found.fields) <= MAX_FIELDS
    assert len({field.name for field in found.fields}) == len(found.fields)
    ends: dict[int, int] = {}
    for field in found.fields:
        assert field.minimum <= field.maximum
        assert field.bits >= 1
        assert ends.get(field.report_id, 0) <= field.bit  # in order, and none over another
        ends[field.report_id] = field.bit + field.bits
        assert field.report_id == 0 or found.has_report_ids
    assert all(end <= 8 * MAX_REPORT for end in ends.values())


def attempt(data: bytes, report: bytes) -> None:
    """Lets only out what must not happen."""
    with suppress(HidError):
        found = parse_descriptor(data)
        check(found)
        values = found.decode(report)
        number = report[0] if found.has_report_ids else 0
        fields = [field for field in found.fields if field.report_id == number]
        assert list(values or {}) == [field.name for field in fields]
        for field in fields:
            assert values is not None
            low = -(1 << field.bits - 1) if field.minimum < 0 else 0
            assert low <= values[field.name] < low + (1 << field.bits)


@given(data=st.binary(max_size=200), report=st.binary(max_size=80))
@example(data=bytes(MAX_DESCRIPTOR + 1), report=b"")
def test_any_bytes_are_a_descriptor_or_refused(data: bytes, report: bytes) -> None:
    attempt(data, report)


@given(items=SEQUENCES, closed=st.booleans(), report=st.binary(max_size=300))
@example(items=bytes.fromhex("75 01 97 ff ff ff ff 81 02"), closed=True, report=b"")
def test_any_items_are_a_descriptor_or_refused(items: bytes, closed: bool, report: bytes) -> None:
    attempt(bytes.fromhex(JOYSTICK) + items + b"\xc0" * closed, report)


@given(name=st.sampled_from(sorted(DESCRIPTORS)), report=st.binary(max_size=80))
def test_any_report_of_a_real_device_is_decoded_or_refused(name: str, report: bytes) -> None:
    attempt(DESCRIPTORS[name], report)


@st.composite
def layouts(draw: st.DrawFn) -> list[tuple[int, int, bool]]:
    """Bits, a value that has room in them, whether it is signed."""
    chosen = []
    for bits in draw(st.lists(st.integers(2, 24), min_size=1, max_size=12)):
        signed = draw(st.booleans())
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        chosen.append((bits, draw(st.integers(low, high)), signed))
    return chosen


@given(layout=layouts(), numbered=st.booleans())
def test_what_was_packed_is_what_is_decoded(layout: list[tuple[int, int, bool]], numbered: bool) -> None:
    items, whole, place = b"\x85\x05" * numbered, 0, 0
    for bits, value, signed in layout:
        minimum, maximum = b"\x15" + bytes([0xFF if signed else 0]), b"\x25\x7f"
        items += b"\x09\x30" + minimum + maximum + bytes([0x75, bits, 0x95, 1, 0x81, 2])
        whole |= (value & (1 << bits) - 1) << place
        place += bits
    report = b"\x05" * numbered + whole.to_bytes((place + 7) // 8, "little")
    found = parse_descriptor(bytes.fromhex(JOYSTICK) + items + b"\xc0").decode(report)
    assert found is not None
    assert list(found.values()) == [value for _, value, _ in layout]
