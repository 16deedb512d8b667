"""Our reader of report descriptors against hid-tools: on the descriptors of real devices, and on changed ones."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.errors import HidError

sys.path.append(str(Path(__file__).parents[1] / "unit"))
from hid_devices import DESCRIPTORS

hid = pytest.importorskip("hidtools.hid")


class Variable(NamedTuple):
    """One field. hid-tools does not extend the sign of a maximum, so that is compared by its lowest bits."""

    report_id: int
    usage: int
    bit: int
    bits: int
    minimum: int
    maximum: int
    null_state: bool
    relative: bool


def ours(described: Descriptor) -> list[Variable]:
    return sorted(
        Variable(f.report_id, f.usage, f.bit, f.bits, f.minimum, f.maximum, f.null_state, f.relative)
        for f in described.fields
    )


def their_fields(described: Any) -> Iterator[tuple[int, int, Any]]:  # noqa: ANN401
    """Report ID, first bit behind it, and the field, of each variable that is not constant."""
    for number, report in described.input_reports.items():
        for field in report:
            if not field.is_const and not field.is_array and field.size:
                yield max(number, 0), field.start - 8 * (number >= 0), field


def theirs(described: Any) -> list[Variable]:  # noqa: ANN401
    return sorted(
        Variable(number, f.usage, bit, f.size, f.logical_min, f.logical_max, f.is_null, bool(f.type & 4))
        for number, bit, f in their_fields(described)
    )


@pytest.mark.parametrize("name", DESCRIPTORS)
def test_fields_are_those_of_hid_tools(name: str) -> None:
    assert ours(parse_descriptor(DESCRIPTORS[name])) == theirs(hid.ReportDescriptor.from_bytes(DESCRIPTORS[name]))


@pytest.mark.parametrize("name", DESCRIPTORS)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_any_report_has_the_values_that_hid_tools_reads(name: str, data: st.DataObject) -> None:
    found, other = parse_descriptor(DESCRIPTORS[name]), hid.ReportDescriptor.from_bytes(DESCRIPTORS[name])
    number = data.draw(st.sampled_from(sorted({field.report_id for field in found.fields})))
    report = other.input_reports[number if found.has_report_ids else -1]
    size = (report.bitsize + 7) // 8
    content = data.draw(st.binary(min_size=size, max_size=size + 3))
    if found.has_report_ids:
        content = bytes([number]) + content[1:]
    values = found.decode(content)
    assert values is not None
    fields = [field for field in found.fields if field.report_id == number]
    expected = {bit: f.get_values(content)[0] for id, bit, f in their_fields(other) if id == number}
    assert {field.bit: values[field.name] for field in fields} == expected


# ---------------------------------------------------------------------------------------------- changed descriptors

EDITS = st.lists(st.tuples(st.integers(0, 300), st.integers(0, 2), st.integers(0, 255)), min_size=1, max_size=3)
"""Where, what (replace, insert, delete), and the byte."""
SHORT = sorted(name for name, data in DESCRIPTORS.items() if len(data) < 300)


def changed(data: bytes, edits: list[tuple[int, int, int]]) -> bytes:
    for place, act, byte in edits:
        place %= len(data)
        data = data[:place] + (bytes([byte]) if act < 2 else b"") + data[place + (act != 1) :]
    return data


def has_one_meaning(described: Any) -> bool:  # noqa: ANN401
    """Whether hid-tools looks at all of it. Of usages beside a range it takes the range alone, of several ranges the
    last, of none it makes one field instead of several; it keeps usages at the end of a collection, and Report ID out
    of Push and Pop.
    """
    usages, begins, ends, pushed = 0, 0, 0, False
    for item in described.rdesc_items:
        usages += item.item == "Usage"
        begins += item.item == "Usage Minimum"
        ends += item.item == "Usage Maximum"
        pushed = pushed or item.item == "Push"
        if item.item == "Report ID" and pushed:
            return False
        if item.item == "Input" and item.value & 3 == 2 and (bool(usages), begins, ends) not in ((1, 0, 0), (0, 1, 1)):
            return False
        if item.item == "End Collection" and (usages or begins or ends):
            return False
        if item.item in ("Input", "Output", "Feature", "Collection", "End Collection"):
            usages = begins = ends = 0
    return True


@given(name=st.sampled_from(SHORT), edits=EDITS)
def test_whoever_accepts_a_changed_descriptor_reads_the_same(name: str, edits: list[tuple[int, int, int]]) -> None:
    data = changed(DESCRIPTORS[name], edits)
    try:
        found = parse_descriptor(data)
        other = hid.ReportDescriptor.from_bytes(data)
    except (HidError, hid.ParseError, KeyError, IndexError, ValueError, AssertionError):
        return
    if has_one_meaning(other):
        # hid-tools reads every maximum without its sign
        mine, peers = (
            [each._replace(maximum=each.maximum & 0xFF) for each in read] for read in (ours(found), theirs(other))
        )
        assert mine == peers
