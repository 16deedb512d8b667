from __future__ import annotations

import pytest

from artemis.sim.dictionary import SIZES, AbortCode, AccessRefused, Dictionary, ObjectEntry, Type, key_of
from artemis.sim.epos_objects import objects


def factory(hardware: int = 0x6210, *, power_off: bool = True) -> Dictionary:
    return Dictionary(objects(5, hardware, 0x2033, 87654321), lambda: power_off)


def refusal(dictionary: Dictionary, index: int, sub: int, data: bytes) -> int:
    with pytest.raises(AccessRefused) as caught:
        dictionary.download(index, sub, data)
    return caught.value.code


@pytest.mark.parametrize("hardware", [0x6010, 0x6210, 0x9990])
def test_every_default_is_within_its_own_range(hardware: int) -> None:
    for entry in objects(5, hardware, 0x2033, 1):
        if isinstance(entry.default, int):
            assert entry.minimum <= entry.default <= entry.maximum, hex(entry.index)
            assert entry.choices is None or entry.default in entry.choices, hex(entry.index)


def test_no_object_stands_twice_and_each_record_tells_its_length() -> None:
    entries = objects(5, 0x6210, 0x2033, 1)
    keys = [entry.key for entry in entries]
    assert len(keys) == len(set(keys))
    assert {entry.index for entry in entries} == {entry.index for entry in entries if entry.sub == 0}


@pytest.mark.parametrize(
    ("index", "sub", "value"),
    [
        (0x1000, 0, 0x00020192),
        (0x1008, 0, b"EPOS"),
        (0x1014, 0, 0x85),
        (0x1016, 0, 2),
        (0x1018, 0, 4),
        (0x1018, 1, 0xFB),
        (0x1018, 2, 0x62100000),
        (0x1018, 3, 0x20330000),
        (0x1018, 4, 0x87654321),
        (0x1200, 1, 0x605),
        (0x1400, 1, 0x205),
        (0x1403, 1, 0x505),
        (0x1800, 1, 0x40000185),
        (0x1801, 1, 0xC0000285),
        (0x1803, 1, 0xC0000485),
        (0x1602, 0, 2),
        (0x1602, 2, 0x607A0020),
        (0x1A03, 2, 0x606C0020),
        (0x2003, 1, 0x2033),
        (0x2004, 0, 87654321),
        (0x6065, 0, 2000),
        (0x607D, 1, -(2**31)),
        (0x6502, 0, 0x003F0025),
    ],
)
def test_factory_values(index: int, sub: int, value: int | bytes) -> None:
    assert factory().read(index, sub) == value


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        (0x3000, 0, b"\0", AbortCode.NO_OBJECT),
        (0x1018, 5, b"\0\0\0\0", AbortCode.NO_SUBINDEX),
        (0x6041, 0, b"\0\0", AbortCode.READ_ONLY),
        (0x1008, 0, b"ABCD", AbortCode.READ_ONLY),
        (0x6041, 0, b"\0\0\0", AbortCode.READ_ONLY),  # access is judged before length
        (0x6081, 0, b"\0\0", AbortCode.TOO_SHORT),
        (0x2008, 0, b"\0\0\0\0", AbortCode.TOO_LONG),
        (0x6081, 0, b"\0\0\0\0", AbortCode.TOO_LOW),
        (0x607F, 0, (25001).to_bytes(4, "little"), AbortCode.TOO_HIGH),
        (0x60F6, 1, b"\xff\xff", AbortCode.TOO_LOW),
        (0x6060, 0, b"\x05", AbortCode.RANGE),
        (0x6089, 0, b"\x01", AbortCode.RANGE),
        (0x1800, 2, b"\x02", AbortCode.RANGE),
    ],
)
def test_a_bad_write_is_refused_with_its_own_code(index: int, sub: int, data: bytes, code: AbortCode) -> None:
    assert refusal(factory(), index, sub, data) is code


def test_current_limits_depend_on_the_hardware() -> None:
    too_much = (5000).to_bytes(2, "little")
    assert refusal(factory(0x6010), 0x6410, 1, too_much) is AbortCode.TOO_HIGH
    dictionary = factory(0x6210)
    dictionary.download(0x6410, 1, too_much)
    assert dictionary.read(0x6410, 1) == 5000


def test_motor_objects_need_a_disabled_power_stage() -> None:
    assert refusal(factory(power_off=False), 0x6402, 0, b"\x0b\0") is AbortCode.DEVICE_STATE
    dictionary = factory()
    dictionary.download(0x6402, 0, b"\x0b\0")
    assert dictionary.read(0x6402) == 11


def test_range_is_judged_before_the_device_state() -> None:
    assert refusal(factory(power_off=False), 0x6402, 0, b"\x07\0") is AbortCode.RANGE


def test_a_byte_object_takes_data_that_is_too_long() -> None:
    dictionary = factory()
    dictionary.download(0x6060, 0, b"\xfd\0\0\0")
    assert dictionary.read(0x6060) == -3


def test_data_of_untold_length_is_cut() -> None:
    dictionary = factory()
    dictionary.download(0x6040, 0, b"\x0f\0\0\0", length_told=False)
    assert dictionary.read(0x6040) == 15


def test_a_changed_parameter_invalidates_the_verified_configuration_and_a_set_point_does_not() -> None:
    dictionary = factory()
    dictionary.poke(0x1020, 1, 9000)
    dictionary.poke(0x1020, 2, 77)
    dictionary.download(0x60FF, 0, b"\1\0\0\0")
    dictionary.download(0x6065, 0, (2000).to_bytes(4, "little"))  # as it was
    assert (dictionary.read(0x1020, 1), dictionary.read(0x1020, 2)) == (9000, 77)
    dictionary.download(0x6065, 0, (3000).to_bytes(4, "little"))
    assert (dictionary.read(0x1020, 1), dictionary.read(0x1020, 2)) == (0, 0)


def test_process_data_out_of_range_is_dropped() -> None:
    dictionary = factory()
    told: list[int] = []
    dictionary.written[key_of(0x6081, 0)] = told.append
    write = dictionary.setter(key_of(0x6081, 0))
    write(0)
    write(500)
    write(30000)
    assert dictionary.read(0x6081) == 500
    assert told == [500]


def test_a_live_object_is_read_through_its_getter() -> None:
    dictionary = factory()
    dictionary.getters[key_of(0x6064, 0)] = lambda: -5
    assert dictionary.upload(0x6064, 0) == b"\xfb\xff\xff\xff"
    assert dictionary.getter(key_of(0x6064, 0))() == -5
    assert dictionary.getter(key_of(0x6065, 0))() == 2000


def test_a_write_only_object_cannot_be_read() -> None:
    entry = ObjectEntry(index=0x2FFF, sub=0, type=Type.U8, access="wo", maximum=255)
    dictionary = Dictionary([entry], lambda: True)
    with pytest.raises(AccessRefused, match="WRITE_ONLY"):
        dictionary.upload(0x2FFF, 0)


def test_an_object_uploads_as_many_bytes_as_its_type_has() -> None:
    dictionary = factory()
    for entry in dictionary.entries.values():
        assert len(dictionary.upload(entry.index, entry.sub)) == SIZES.get(entry.type, 4)
