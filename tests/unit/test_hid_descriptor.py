"""Report descriptors: of real devices, and each rule by itself."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from hid_devices import DESCRIPTORS, DEVICES, JOYSTICK, STICK, joystick

from artemis.devices.hid.descriptor import (
    MAX_DESCRIPTOR,
    MAX_FIELDS,
    MAX_REPORT,
    Descriptor,
    is_control,
    parse_descriptor,
)
from artemis.errors import HidError

USAGES = {"Joystick": 0x10004, "Game Pad": 0x10005}
NAMES = {"Hat switch": "hat", "System Main Menu": "usage.0001.0085"}
SAMPLES = [(name, number) for name, device in DEVICES.items() for number in range(len(device["sample_reports"]))]


def rows(device: dict[str, Any]) -> Iterator[tuple[int, int, int, int, int, int, bool]]:
    """Report ID, usage, bit, bits, minimum, maximum, null state of each field that the data names."""
    for row in device["fields"]:
        code = str(row["usage_code"]) if row["usage_code"] is not None else "0"
        first, _, last = code.partition("..")
        usage = int(first, 0)
        for place in range(row.get("count", 1)):
            bit = row["bit"] + place * row["bits"]
            null = row.get("null_state", False)
            yield row["report_id"], usage + (place if last else 0), bit, row["bits"], row["min"], row["max"], null


@pytest.mark.parametrize("name", DEVICES)
def test_every_field_of_a_real_device_is_found(name: str) -> None:
    found = parse_descriptor(DESCRIPTORS[name])
    fields = [(f.report_id, f.usage, f.bit, f.bits, f.minimum, f.maximum, f.null_state) for f in found.fields]
    assert fields == list(rows(DEVICES[name]))
    assert found.has_report_ids == DEVICES[name]["has_report_ids"]
    assert found.application == USAGES[DEVICES[name]["application"]]
    assert is_control(found.application)
    assert len({field.name for field in found.fields}) == len(fields)


@pytest.mark.parametrize(("name", "number"), SAMPLES)
def test_reports_of_real_devices_say_what_was_seen(name: str, number: int) -> None:
    found, sample = parse_descriptor(DESCRIPTORS[name]), DEVICES[name]["sample_reports"][number]
    values = found.decode(bytes.fromhex(sample["report"]))
    assert values is not None
    for label, value in sample["decoded"].items():
        field = NAMES.get(label.rstrip("'"), label.rstrip("'").lower())
        assert values[field + f".{1 + label.count(chr(39))}" * ("'" in label)] == value
    pressed = {int(field.split(".")[1]) for field, value in values.items() if field.startswith("button.") and value}
    assert pressed == set(sample.get("buttons", ()))


@pytest.mark.parametrize("name", DEVICES)
def test_reports_have_the_lengths_that_the_device_sends(name: str) -> None:
    found = parse_descriptor(DESCRIPTORS[name])
    with_fields = {field.report_id for field in found.fields}
    for row in DEVICES[name]["input_reports"]:
        number, length = row["report_id"], row["bytes_after_id"]
        head = bytes([number]) if found.has_report_ids else b""
        values = found.decode(head + bytes(length))
        assert (values is None) == (number not in with_fields)
        if values is not None:
            assert found.decode(head + bytes(length) + b"\xff\xff") == values
            with pytest.raises(HidError, match=f"report {number} ends at byte {length - 1} of {length}"):
                found.decode(head + bytes(length - 1))


# ---------------------------------------------------------------------------------------------- single rules


def shape(found: Descriptor) -> list[tuple[str, int, int]]:
    return [(field.name, field.bit, field.bits) for field in found.fields]


def test_push_saves_and_pop_brings_back_all_that_is_global() -> None:
    inside = "a4 15 81 25 7f 75 10 95 02 05 02 09 c4 09 c5 81 02 b4"
    found = joystick(f"15 00 25 ff 75 08 95 01 09 30 81 02 {inside} 09 31 81 02")
    assert shape(found) == [("x", 0, 8), ("accelerator", 8, 16), ("brake", 24, 16), ("y", 40, 8)]
    assert [(field.minimum, field.maximum) for field in found.fields] == [(0, 255), (-127, 127), (-127, 127), (0, 255)]


def test_usages_take_their_page_or_the_one_that_follows_them() -> None:
    assert shape(joystick("09 c4 05 02 75 08 95 01 25 7f 81 02")) == [("accelerator", 0, 8)]
    assert shape(joystick("0b 30 00 01 00 05 02 75 08 95 01 25 7f 81 02")) == [("x", 0, 8)]
    both = joystick("09 30 0b 31 00 01 00 05 02 09 c4 75 08 95 03 25 7f 81 02")
    assert shape(both) == [("x", 0, 8), ("y", 8, 8), ("accelerator", 16, 8)]
    assert shape(joystick("05 02 0b 30 00 01 00 75 08 95 01 25 7f 81 02")) == [("x", 0, 8)]
    assert shape(joystick("19 30 2b 31 00 01 00 05 02 75 08 95 02 25 7f 81 02")) == [("x", 0, 8), ("y", 8, 8)]
    assert shape(joystick("1b 30 00 01 00 29 31 05 02 75 08 95 02 25 7f 81 02")) == [("x", 0, 8), ("y", 8, 8)]


def test_a_page_behind_the_usages_counts_for_those_that_no_page_has_taken_since() -> None:
    two = "05 02 75 08 95 02 25 7f 81 02"
    assert shape(joystick(f"19 c4 29 c5 {two}")) == [("accelerator", 0, 8), ("brake", 8, 8)]
    assert shape(joystick(f"09 c5 09 c4 {two}")) == [("brake", 0, 8), ("accelerator", 8, 8)]
    assert shape(joystick(f"09 c4 0b c5 00 02 00 {two}")) == [("accelerator", 0, 8), ("brake", 8, 8)]


def test_a_usage_and_a_range_go_one_after_the_other() -> None:
    assert shape(joystick("09 33 19 30 29 39 75 08 95 03 25 7f 81 02")) == [("rx", 0, 8), ("x", 8, 8), ("y", 16, 8)]


def test_a_usage_range_names_one_field_after_the_other() -> None:
    found = joystick("05 09 19 03 29 06 25 01 75 01 95 04 81 02 95 04 81 01")
    assert shape(found) == [(f"button.{3 + place}", place, 1) for place in range(4)]
    assert found.decode(b"\xfa") == {"button.3": 0, "button.4": 1, "button.5": 0, "button.6": 1}


def test_the_last_usage_repeats_and_each_field_has_a_name_of_its_own() -> None:
    found = joystick("09 30 09 32 75 04 95 04 25 0f 81 02 09 32 95 01 81 02 06 00 ff 09 21 95 03 81 02")
    names = ["x", "z", "z.2", "z.3", "z.4", "usage.ff00.0021", "usage.ff00.0021.2", "usage.ff00.0021.3"]
    assert [field.name for field in found.fields] == names
    assert found.decode(bytes.fromhex("21435765")) == dict(zip(names, (1, 2, 3, 4, 7, 5, 5, 6), strict=True))


def test_fields_without_a_usage_are_there_all_the_same() -> None:
    assert [field.name for field in joystick("75 08 95 02 25 7f 81 02").fields] == [
        "usage.0000.0000",
        "usage.0000.0000.2",
    ]


def test_fields_lie_across_bytes() -> None:
    found = joystick("09 30 09 31 09 35 16 00 00 26 ff 03 75 0a 95 03 81 02 75 02 95 01 81 01")
    report = (0x3AB | 0x155 << 10 | 0x2CD << 20).to_bytes(4, "little")
    assert found.decode(report) == {"x": 0x3AB, "y": 0x155, "rz": 0x2CD}


def test_a_negative_minimum_makes_values_signed() -> None:
    found = joystick("09 30 15 81 25 7f 75 08 95 01 81 02 09 31 16 00 f8 26 ff 07 75 0c 95 01 81 02 75 04 81 01")
    assert [(field.minimum, field.maximum) for field in found.fields] == [(-127, 127), (-2048, 2047)]
    assert found.decode(b"\xff\x00\x08") == {"x": -1, "y": -2048}
    assert found.decode(b"\x80\xff\x07") == {"x": -128, "y": 2047}  # -128 lies outside the range, and stays
    assert joystick("09 30 15 ff 25 01 75 04 95 02 81 02").decode(b"\xf1") == {"x": 1, "x.2": -1}


@pytest.mark.parametrize(
    ("items", "wanted"),
    [
        ("15 00 25 ff", (0, 255)),
        ("15 00 26 ff ff", (0, 65535)),
        ("15 00 26 ff 00", (0, 255)),
        ("25 ff", (0, 255)),
        ("15 01 25 08", (1, 8)),
        ("15 80 25 ff", (-128, -1)),
        ("15 ff 25 80", (-1, 128)),
        ("15 ff 25 ff", (-1, -1)),
        ("14 24", (0, 0)),
    ],
)
def test_a_maximum_below_the_minimum_is_read_without_its_sign(items: str, wanted: tuple[int, int]) -> None:
    (field,) = joystick(f"{items} 09 30 75 10 95 01 81 02").fields
    assert (field.minimum, field.maximum) == wanted


def test_a_hat_at_rest_leaves_its_range() -> None:
    found = joystick("09 39 15 01 25 08 75 04 95 01 81 42 81 01")
    (hat,) = found.fields
    assert (hat.name, hat.minimum, hat.maximum, hat.null_state, hat.relative) == ("hat", 1, 8, True, False)
    assert found.decode(b"\xf0") == {"hat": 0}


def test_relative_fields_say_so() -> None:
    (wheel,) = joystick("09 38 15 81 25 7f 75 08 95 01 81 06").fields
    assert (wheel.name, wheel.relative, wheel.null_state) == ("wheel", True, False)


def test_constants_and_arrays_take_their_place_but_are_no_fields() -> None:
    found = joystick("25 01 75 08 95 01 09 30 81 03 05 07 19 00 29 65 95 02 81 00 05 01 09 31 95 01 81 02")
    assert shape(found) == [("y", 24, 8)]


def test_what_goes_to_the_device_is_no_input_and_takes_its_usages_along() -> None:
    assert shape(joystick("75 08 95 01 25 7f 09 30 91 02 09 31 b1 02 09 32 81 02")) == [("z", 0, 8)]


def test_a_report_fills_whole_bytes() -> None:
    nine = joystick("05 09 19 01 29 09 25 01 75 01 95 09 81 02")
    assert nine.decode(b"\x00\x01") == {**{f"button.{number}": 0 for number in range(1, 9)}, "button.9": 1}
    with pytest.raises(HidError, match="report 0 ends at byte 1 of 2"):
        nine.decode(b"\x00")


def test_reports_are_told_apart_by_their_ids() -> None:
    found = joystick("75 08 95 01 25 7f 85 01 09 30 81 02 85 02 09 31 81 02 85 01 09 32 81 02 85 03 81 01")
    assert found.decode(b"\x01\x05\x06") == {"x": 5, "z": 6}
    assert found.decode(b"\x02\x07") == {"y": 7}
    assert found.decode(b"\x03\x07") is None
    assert found.decode(b"\x09") is None
    with pytest.raises(HidError, match="its ID is missing"):
        found.decode(b"")


def test_a_device_without_input_fields_has_no_reports() -> None:
    found = joystick("75 08 95 01 91 02")
    assert found.fields == ()
    assert found.decode(b"") is None
    assert found.decode(b"\x01\x02") is None


def test_zeros_may_follow_the_last_collection_and_long_items_mean_nothing() -> None:
    plain = parse_descriptor(STICK).fields
    assert parse_descriptor(STICK + bytes(5)).fields == plain
    assert parse_descriptor(bytes.fromhex("fe 02 77 01 02") + STICK).fields == plain


def test_the_first_top_level_collection_tells_what_the_device_is() -> None:
    keyboard = bytes.fromhex("05 01 09 06 a1 01 c0")
    assert parse_descriptor(keyboard + STICK).application == 0x10006
    assert parse_descriptor(STICK + keyboard).application == 0x10004
    assert parse_descriptor(bytes.fromhex("a1 01 c0")).application == 0
    assert [usage for usage in (0x10002, 0x10006, 0x10008, 0x20001, 0xC0001, 0) if is_control(usage)] == [
        0x10008,
        0x20001,
    ]


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ("", "byte 0: it has no collection"),
        ("05", "byte 0: the item is cut off"),
        (f"{JOYSTICK} 27 01 02 03", "byte 6: the item is cut off"),
        ("fe", "byte 0: the item is cut off"),
        ("fe 02 00 01", "byte 0: the item is cut off"),
        (JOYSTICK, "byte 6: a collection is not closed"),
        (f"{JOYSTICK} c0 c0", "byte 7: it stands outside of every collection"),
        ("75 08 95 01 81 02", "byte 4: it stands outside of every collection"),
        (f"{JOYSTICK} c0 01 00", "byte 7: it stands outside of every collection"),
        ("29 01", "byte 0: Usage Maximum without Usage Minimum"),
        (f"{JOYSTICK} 00 c0", r"byte 6: unknown main item \(tag 0\)"),
        (f"{JOYSTICK} d0 c0", r"byte 6: unknown main item \(tag 13\)"),
        (f"{JOYSTICK} c4 c0", r"byte 6: unknown item \(kind 1, tag 12\)"),
        (f"{JOYSTICK} 68 c0", r"byte 6: unknown item \(kind 2, tag 6\)"),
        (f"{JOYSTICK} 0c c0", r"byte 6: unknown item \(kind 3, tag 0\)"),
        (f"{JOYSTICK} a9 01 c0", r"byte 6: sets of alternative usages \(Delimiter\) are not supported"),
        (f"{JOYSTICK} b4 c0", "byte 6: Pop without Push"),
        (f"{JOYSTICK} 85 00 c0", "byte 6: report ID 0: it is 1 to 255"),
        (f"{JOYSTICK} 86 00 01 c0", "byte 6: report ID 256"),
        (f"{JOYSTICK} 07 00 00 01 00 c0", "byte 6: usage page 0x10000 has more than 16 bits"),
        (f"{JOYSTICK} 29 01 c0", "byte 6: Usage Maximum without Usage Minimum"),
        (f"{JOYSTICK} 19 01 29 02 29 03 c0", "byte 10: Usage Maximum without Usage Minimum"),
        (f"{JOYSTICK} 19 05 29 04 75 01 95 01 81 02 c0", "byte 8: usages from 0x10005 to 0x10004"),
        (f"{JOYSTICK} 15 05 25 04 75 01 95 01 81 02 c0", "byte 14: logical range from 5 to 4"),
    ],
)
def test_what_breaks_the_rules_is_refused_with_its_place(data: str, problem: str) -> None:
    with pytest.raises(HidError, match=f"^report descriptor, {problem}"):
        parse_descriptor(bytes.fromhex(data))


@pytest.mark.parametrize(
    ("items", "problem"),
    [
        ("75 01 97 ff ff ff ff 81 02", "gets 4294967295 bits long; 32768 are the most"),
        ("77 ff ff ff ff 97 ff ff ff ff 81 03", "bits long"),
        ("75 01 96 00 80 81 02", f"more than {MAX_FIELDS} fields"),
        ("75 01 96 00 20 81 02 85 02 09 30 95 01 81 02", f"more than {MAX_FIELDS} fields"),
        ("75 08 96 00 10 81 03 75 01 95 01 81 03", "report 0 gets 32769 bits long"),
        ("75 08 96 00 08 81 03 81 03 81 03", f"report 0 gets {8 * (MAX_REPORT + 2048)} bits long"),
    ],
)
def test_what_would_need_too_much_memory_is_refused(items: str, problem: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(HidError, match=problem):
            joystick(items)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_the_limits_themselves_are_allowed() -> None:
    assert len(joystick("75 01 96 00 20 25 01 09 30 81 02").fields) == MAX_FIELDS
    assert joystick("75 08 96 00 10 81 03 05 09 85 02 09 01 95 01 25 01 81 02").decode(b"\x02\x01") == {"button.1": 1}
    assert joystick("85 ff 06 ff ff 09 01 75 08 95 01 25 7f 81 02").decode(b"\xff\x07") == {"usage.ffff.0001": 7}
    assert parse_descriptor(STICK + bytes(MAX_DESCRIPTOR - len(STICK))).has_report_ids is False


def test_words_and_units_say_nothing_of_fields() -> None:
    words = "39 01 49 01 59 01 79 01 89 01 99 01"  # designators and strings
    units = "35 00 46 3b 01 55 0e 65 14"
    assert shape(joystick(f"09 30 {words} {units} 75 08 95 01 25 7f 81 02")) == [("x", 0, 8)]


def test_large_numbers_that_mean_nothing_cost_nothing() -> None:
    huge = "1b 00 00 01 00 2b ff ff ff ff"  # all usages of all pages
    assert shape(joystick(f"{huge} 75 08 95 02 25 7f 81 02")) == [("usage.0001.0000", 0, 8), ("usage.0001.0001", 8, 8)]
    assert joystick(f"{huge} 75 00 97 ff ff ff ff 81 02").fields == ()
    with pytest.raises(HidError, match="report descriptor of 4097 bytes: 4096 are the most"):
        parse_descriptor(bytes(4097))


def test_axes_and_pedals_have_the_names_of_the_usage_tables() -> None:
    desktop = joystick("19 30 29 39 75 08 95 0a 25 7f 81 02")
    assert [field.name for field in desktop.fields] == "x y z rx ry rz slider dial wheel hat".split()
    pedals = joystick("05 02 09 ba 09 bb 19 c4 29 c8 75 08 95 07 25 7f 81 02")
    assert [
        field.name for field in pedals.fields
    ] == "rudder throttle accelerator brake clutch shifter steering".split()


def test_the_names_of_all_devices_are_those_of_the_usage_tables() -> None:
    names = Counter(field.name for data in DESCRIPTORS.values() for field in parse_descriptor(data).fields)
    plain = {name for name in names if not name.startswith(("button.", "usage.")) and "." not in name}
    assert plain == {"x", "y", "z", "rx", "ry", "rz", "slider", "hat", "brake", "accelerator"}
    assert {"z.2", "button.1", "usage.000c.0224", "usage.ff00.0021"} <= names.keys()
