"""Codecs against frames from the EPOS manuals and CiA 301, byte for byte."""

from __future__ import annotations

import pytest
from sdo_server_side import decode_request, encode_answer

from artemis.devices import canopen
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import (
    Abort,
    Accepted,
    Answer,
    Emergency,
    Expedited,
    NextSegment,
    NmtCommand,
    PdoLayout,
    Request,
    SdoAbort,
    Segment,
    SegmentAccepted,
    Segmented,
    Upload,
)
from artemis.drive_states import Nmt
from artemis.errors import ProtocolError
from artemis.families.objects import ObjectType

REQUESTS: list[tuple[str, Request]] = [
    ("40 41 60 00 00 00 00 00", Upload(index=0x6041, subindex=0)),
    ("2B 40 60 00 0F 00 00 00", Expedited(index=0x6040, subindex=0, data=b"\x0f\x00")),
    ("2F 60 60 00 FD 00 00 00", Expedited(index=0x6060, subindex=0, data=b"\xfd")),
    ("27 00 20 01 01 02 03 00", Expedited(index=0x2000, subindex=1, data=b"\x01\x02\x03")),
    ("23 10 10 01 73 61 76 65", Expedited(index=0x1010, subindex=1, data=b"save")),
    ("22 40 60 00 0F 00 00 00", Expedited(index=0x6040, subindex=0, data=b"\x0f\x00\x00\x00", sized=False)),
    ("21 04 20 00 08 00 00 00", Segmented(index=0x2004, subindex=0, size=8)),
    ("20 04 20 00 00 00 00 00", Segmented(index=0x2004, subindex=0, size=None)),
    ("60 00 00 00 00 00 00 00", NextSegment(toggle=False)),
    ("70 00 00 00 00 00 00 00", NextSegment(toggle=True)),
    ("00 01 02 03 04 05 06 07", Segment(toggle=False, data=b"\x01\x02\x03\x04\x05\x06\x07", last=False)),
    ("1D 08 00 00 00 00 00 00", Segment(toggle=True, data=b"\x08", last=True)),
    ("80 41 60 00 00 00 04 05", Abort(index=0x6041, subindex=0, code=0x05040000)),
]
ANSWERS: list[tuple[str, Answer]] = [
    ("4B 41 60 00 40 01 00 00", Expedited(index=0x6041, subindex=0, data=b"\x40\x01")),
    ("4F 01 10 00 05 00 00 00", Expedited(index=0x1001, subindex=0, data=b"\x05")),
    ("43 08 10 00 45 50 4F 53", Expedited(index=0x1008, subindex=0, data=b"EPOS")),
    ("42 41 60 00 40 01 00 00", Expedited(index=0x6041, subindex=0, data=b"\x40\x01\x00\x00", sized=False)),
    ("41 04 20 00 08 00 00 00", Segmented(index=0x2004, subindex=0, size=8)),
    ("40 04 20 00 00 00 00 00", Segmented(index=0x2004, subindex=0, size=None)),
    ("00 01 02 03 04 05 06 07", Segment(toggle=False, data=b"\x01\x02\x03\x04\x05\x06\x07", last=False)),
    ("1D 08 00 00 00 00 00 00", Segment(toggle=True, data=b"\x08", last=True)),
    ("60 40 60 00 00 00 00 00", Accepted(index=0x6040, subindex=0)),
    ("20 00 00 00 00 00 00 00", SegmentAccepted(toggle=False)),
    ("30 00 00 00 00 00 00 00", SegmentAccepted(toggle=True)),
    ("80 00 30 00 00 00 02 06", Abort(index=0x3000, subindex=0, code=0x06020000)),
]


def test_identifiers_are_the_default_ones() -> None:
    """CiA 301 7.3.3."""
    assert (canopen.NMT, canopen.SYNC, canopen.EMERGENCY, canopen.HEARTBEAT) == (0x000, 0x080, 0x080, 0x700)
    assert canopen.TXPDO == (0x180, 0x280, 0x380, 0x480)
    assert canopen.RXPDO == (0x200, 0x300, 0x400, 0x500)
    assert (canopen.SDO_ANSWER, canopen.SDO_REQUEST) == (0x580, 0x600)


@pytest.mark.parametrize(("wire", "request_"), REQUESTS)
def test_sdo_request_is_these_bytes(wire: str, request_: Request) -> None:
    assert canopen.encode_request(request_) == bytes.fromhex(wire)
    assert decode_request(bytes.fromhex(wire)) == request_


@pytest.mark.parametrize(("wire", "answer"), ANSWERS)
def test_sdo_answer_is_these_bytes(wire: str, answer: Answer) -> None:
    assert encode_answer(answer) == bytes.fromhex(wire)
    assert canopen.decode_answer(bytes.fromhex(wire)) == answer


@pytest.mark.parametrize("specifier", [0xA0, 0xC0, 0xE0])
def test_unknown_command_specifier_is_refused(specifier: int) -> None:
    data = bytes((specifier, 0, 0, 0, 0, 0, 0, 0))
    with pytest.raises(ProtocolError, match="command specifier"):
        decode_request(data)
    with pytest.raises(ProtocolError, match="command specifier"):
        canopen.decode_answer(data)


@pytest.mark.parametrize(
    "request_",
    [
        Expedited(index=0x2000, subindex=0, data=b""),
        Expedited(index=0x2000, subindex=0, data=b"12345"),
        Expedited(index=0x2000, subindex=0, data=b"12", sized=False),
        Expedited(index=0x2000, subindex=0, data=b"123", sized=False),
        Segment(toggle=False, data=b"12345678", last=False),
        Segmented(index=0x2000, subindex=0, size=2**32),
        Upload(index=0x10000, subindex=0),
        Upload(index=0x1000, subindex=256),
        Abort(index=0x1000, subindex=0, code=-1),
        Abort(index=0x1000, subindex=0, code=2**32),
    ],
)
def test_request_that_does_not_fit_its_frame_is_refused(request_: Request) -> None:
    with pytest.raises(ProtocolError):
        canopen.encode_request(request_)


def test_data_that_does_not_fit_is_refused_by_its_length() -> None:
    with pytest.raises(ProtocolError, match="5 bytes do not fit an expedited transfer"):
        canopen.encode_request(Expedited(index=0x2000, subindex=0, data=b"12345"))


def test_bits_without_meaning_are_ignored() -> None:
    assert decode_request(b"\x6f" + bytes(7)) == NextSegment(toggle=False)
    assert canopen.decode_answer(b"\x2f" + bytes(7)) == SegmentAccepted(toggle=False)
    assert decode_request(b"\x5f" + bytes(7)) == Upload(index=0, subindex=0)
    assert canopen.decode_answer(b"\x7f" + bytes(7)) == Accepted(index=0, subindex=0)


@pytest.mark.parametrize("flag", [False, True])
def test_flags_are_truth_values(flag: bool) -> None:
    segment = decode_request(bytes((flag << 4 | flag,)) + bytes(7))
    assert isinstance(segment, Segment)
    assert segment.toggle is flag
    assert segment.last is flag
    assert decode_request(bytes((0x60 | flag << 4,)) + bytes(7)).toggle is flag  # type: ignore[union-attr]
    assert canopen.decode_answer(bytes((0x20 | flag << 4,)) + bytes(7)).toggle is flag  # type: ignore[union-attr]
    assert canopen.decode_answer(bytes((0x42 | flag,)) + bytes(7)).sized is flag  # type: ignore[union-attr]


def test_abort_names_device_object_and_reason() -> None:
    abort = SdoAbort(0x2010, 0, 0x06020000, device="steer-left")
    assert str(abort) == "steer-left: SDO abort 0x06020000 at 0x2010:0: object does not exist"
    assert (abort.index, abort.subindex, abort.code, abort.text) == (0x2010, 0, 0x06020000, "object does not exist")


def test_unknown_abort_code_is_still_shown() -> None:
    assert str(SdoAbort(0x2010, 3, 0x12345678)) == "SDO: SDO abort 0x12345678 at 0x2010:3: unknown code"


def test_nmt_commands_as_in_the_communication_guide() -> None:
    assert canopen.nmt_frame(NmtCommand.START, 2) == Frame(0x000, b"\x01\x02")
    assert canopen.nmt_frame(NmtCommand.RESET_NODE) == Frame(0x000, b"\x81\x00")
    assert {command.name: int(command) for command in NmtCommand} == {
        "START": 0x01,
        "STOP": 0x02,
        "ENTER_PRE_OPERATIONAL": 0x80,
        "RESET_NODE": 0x81,
        "RESET_COMMUNICATION": 0x82,
    }


@pytest.mark.parametrize(
    ("byte", "state"),
    [
        (0x00, Nmt.INITIALISING),
        (0x04, Nmt.STOPPED),
        (0x05, Nmt.OPERATIONAL),
        (0x7F, Nmt.PRE_OPERATIONAL),
        (0x85, Nmt.OPERATIONAL),
        (0xFF, Nmt.PRE_OPERATIONAL),
    ],
)
def test_heartbeat_tells_the_state_whatever_its_toggle(byte: int, state: Nmt) -> None:
    assert canopen.nmt_from_heartbeat(bytes((byte,))) is state


@pytest.mark.parametrize("data", [b"", b"\x01", b"\x05\x00"])
def test_wrong_heartbeat_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        canopen.nmt_from_heartbeat(data)


def test_host_heartbeat() -> None:
    assert canopen.heartbeat_frame(127, Nmt.OPERATIONAL) == Frame(0x77F, b"\x05")


def test_sync_is_empty() -> None:
    assert Frame(0x80) == canopen.SYNC_FRAME


def test_emergency_code_comes_low_byte_first() -> None:
    frame = Emergency(code=0x8611, register=0x20).frame(3)
    assert frame == Frame(0x83, bytes.fromhex("11 86 20 00 00 00 00 00"))
    assert canopen.emergency_from_data(frame.data) == Emergency(code=0x8611, register=0x20)


def test_emergency_of_wrong_length_is_refused() -> None:
    with pytest.raises(ProtocolError):
        canopen.emergency_from_data(bytes(7))
    with pytest.raises(ProtocolError):
        Emergency(code=0x8611, register=0x20, data=bytes(6)).frame(3)


def test_pdo_fields_are_little_endian_and_signed_by_type() -> None:
    layout = PdoLayout([ObjectType.U16, ObjectType.I32])
    assert layout.length == 6
    assert layout.pack(0x0140, -2) == bytes.fromhex("40 01 FE FF FF FF")
    assert layout.unpack(bytes.fromhex("40 01 FE FF FF FF")) == (0x0140, -2)


def test_pdo_longer_than_its_mapping_is_read_and_a_shorter_one_refused() -> None:
    layout = PdoLayout([ObjectType.U16, ObjectType.I8])
    assert layout.unpack(bytes.fromhex("40 01 FE 99")) == (0x0140, -2)
    with pytest.raises(ProtocolError, match="its mapping needs 3"):
        layout.unpack(b"\x40\x01")


@pytest.mark.parametrize("values", [(1,), (1, 2, 3), (0x10000, 0), (0, 128)])
def test_values_that_do_not_fit_the_pdo_are_refused(values: tuple[int, ...]) -> None:
    with pytest.raises(ProtocolError):
        PdoLayout([ObjectType.U16, ObjectType.I8]).pack(*values)


@pytest.mark.parametrize(
    ("types", "problem"),
    [
        ([ObjectType.I64, ObjectType.U8], "a PDO holds 8 bytes, these objects need 9"),
        ([ObjectType.U8, ObjectType.STR], "a string cannot be mapped into a PDO"),
    ],
)
def test_mapping_that_no_pdo_can_hold_is_refused(types: list[ObjectType], problem: str) -> None:
    with pytest.raises(ProtocolError, match=problem):
        PdoLayout(types)


@pytest.mark.parametrize(
    ("type_", "value", "wire"),
    [
        (ObjectType.U8, 255, "FF"),
        (ObjectType.I8, -3, "FD"),
        (ObjectType.U16, 0x0140, "40 01"),
        (ObjectType.I16, -2, "FE FF"),
        (ObjectType.U32, 0x65766173, "73 61 76 65"),
        (ObjectType.I32, -2147483648, "00 00 00 80"),
        (ObjectType.U64, 0x0102030405060708, "08 07 06 05 04 03 02 01"),
        (ObjectType.I64, -1, "FF FF FF FF FF FF FF FF"),
        (ObjectType.STR, "EPOS", "45 50 4F 53"),
    ],
)
def test_typed_value_on_the_wire(type_: ObjectType, value: int | str, wire: str) -> None:
    assert type_.encode(value) == bytes.fromhex(wire)
    assert type_.decode(bytes.fromhex(wire)) == value


@pytest.mark.parametrize(
    ("type_", "value"),
    [
        (ObjectType.U8, 256),
        (ObjectType.U8, -1),
        (ObjectType.I16, 32768),
        (ObjectType.I32, 2**31),
        (ObjectType.U64, 2**64),
        (ObjectType.U16, "1"),
        (ObjectType.STR, 1),
        (ObjectType.STR, "Ω"),
    ],
)
def test_value_outside_its_type_is_refused(type_: ObjectType, value: int | str) -> None:
    with pytest.raises(ProtocolError):
        type_.encode(value)


@pytest.mark.parametrize(
    ("type_", "data"), [(ObjectType.U16, b"\x01"), (ObjectType.U16, b"\x01\x02\x03\x04"), (ObjectType.STR, b"\xff")]
)
def test_bytes_that_are_not_of_the_type_are_refused(type_: ObjectType, data: bytes) -> None:
    with pytest.raises(ProtocolError):
        type_.decode(data)


def test_types_are_named_by_their_letter_and_only_strings_have_no_size() -> None:
    assert "".join(type_.value for type_ in ObjectType) == "BHIQbhiqs"
    assert [type_.size for type_ in ObjectType] == [1, 2, 4, 8, 1, 2, 4, 8, 0]


def test_string_loses_its_padding() -> None:
    assert ObjectType.STR.decode(b"EPOS\0\0") == "EPOS"


ABORT_CODES = """
    05030000 05040000 05040001 05040005 06010000 06010001 06010002 06020000 06040041 06040042 06040043 06040047 06060000
    06070010 06070012 06070013 06090011 06090030 06090031 06090032 06090036 08000000 08000020 08000021 08000022 0F00FFB9
    0F00FFBC 0F00FFBE 0F00FFBF 0F00FFC0
"""
"""Firmware specification, 12.3."""


def test_every_abort_code_of_the_firmware_specification_has_a_text_of_its_own() -> None:
    assert set(canopen.ABORT_TEXTS) == {int(code, 16) for code in ABORT_CODES.split()}
    assert all(canopen.ABORT_TEXTS.values())
    assert len(set(canopen.ABORT_TEXTS.values())) == 30


def test_abort_codes_that_have_names_say_what_they_mean() -> None:
    named = (
        canopen.TOGGLE_NOT_ALTERNATED,
        canopen.SDO_TIMEOUT,
        canopen.UNKNOWN_COMMAND,
        canopen.LENGTH_MISMATCH,
        canopen.GENERAL_ERROR,
    )
    assert [canopen.ABORT_TEXTS[code] for code in named] == [
        "toggle bit not alternated",
        "SDO protocol timed out",
        "unknown command specifier",
        "data type or length does not match",
        "general error",
    ]
