"""Frames on the serial lines of EPOS drives, against the examples of the maker's guides."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.devices.serial_frames import (
    START,
    Epos4Splitter,
    SerialProtocol,
    content_of,
    epos1_body,
    epos1_data,
    epos1_length,
    epos4_frame,
    nmt_command,
    place_of_object,
    read_command,
    write_command,
)
from artemis.errors import ProtocolError

WORDS = st.binary(min_size=2, max_size=128).filter(lambda data: len(data) % 2 == 0)
OPCODES = st.integers(0, 255)


def crc_of_the_guide(words: list[int]) -> int:
    """CRC as the guides' program computes it: bit by bit over whole words, the last one zero."""
    crc = 0
    for word in words:
        for bit in range(15, -1, -1):
            carry = crc & 0x8000
            crc = (crc << 1 & 0xFFFF) | word >> bit & 1
            crc ^= 0x1021 if carry else 0
    return crc


def words_of(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "little") for at in range(0, len(data), 2)]


# ---------------------------------------------------------------------------------------------- the guides' examples


def test_read_of_the_first_generation_is_the_guides() -> None:
    """EPOS communication guide 2006, 6.2.4: object 0x2003:1 of node 2."""
    command = read_command(SerialProtocol.EPOS1, 2, 0x2003, 1)
    assert command.opcode == 0x10
    assert epos1_body(command.opcode, command.data) == bytes.fromhex("01 03 20 01 02 88 A8")


def test_answer_of_the_first_generation_is_understood() -> None:
    """The same example: firmware 0x2010; behind it a word that means nothing."""
    body = bytes.fromhex("03 00 00 00 00 10 20 10 62 10 26")
    assert epos1_length(body[0]) == len(body) - 1
    error, data = content_of(epos1_data(0x00, body))
    assert (error, data) == (0, bytes.fromhex("10 20 10 62"))
    assert epos1_body(0x00, bytes.fromhex("00 00 00 00 10 20 10 62")) == body


def test_read_of_an_epos4_is_the_guides() -> None:
    """EPOS4 communication guide rel8759, 2.2.9: object 0x30B0:0 of node 1."""
    command = read_command(SerialProtocol.EPOS4, 1, 0x30B0, 0)
    assert epos4_frame(command.opcode, command.data) == bytes.fromhex("90 02 60 02 01 B0 30 00 2E 62")


def test_answer_of_an_epos4_is_understood() -> None:
    """The same example: 36,865 counts, with a doubled byte."""
    frame = bytes.fromhex("90 02 00 04 00 00 00 00 01 90 90 00 00 9A 5C")
    opcode, data = fed(Epos4Splitter(), frame)
    assert opcode == 0x00
    assert content_of(data) == (0, (36865).to_bytes(4, "little"))
    assert epos4_frame(opcode, data) == frame


def fed(splitter: Epos4Splitter, data: bytes) -> tuple[int, bytes]:
    """The one frame that ends with the last byte."""
    assert [splitter.feed(byte) for byte in data[:-1]] == [None] * (len(data) - 1)
    frame = splitter.feed(data[-1])
    assert frame is not None
    return frame


# ---------------------------------------------------------------------------------------------- any frame


@given(opcode=OPCODES, data=WORDS)
def test_checksums_are_those_of_the_guides_program(opcode: int, data: bytes) -> None:
    body = epos1_body(opcode, data)
    assert int.from_bytes(body[-2:], "little") == crc_of_the_guide([opcode << 8 | body[0], *words_of(data), 0])
    assert crc_of_the_guide([opcode << 8 | body[0], *words_of(body[1:])]) == 0
    frame = epos4_frame(opcode, data)[2:].replace(b"\x90\x90", b"\x90")
    assert crc_of_the_guide(words_of(frame)) == 0


@given(opcode=OPCODES, data=WORDS, bit=st.integers(min_value=0))
def test_one_wrong_bit_is_always_seen(opcode: int, data: bytes, bit: int) -> None:
    body = epos1_body(opcode, data)
    assert epos1_data(opcode, body) == data
    bit = 8 + bit % (8 * len(body) - 8)  # the length says how much is read
    damaged = bytearray(body)
    damaged[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ProtocolError, match="wrong checksum"):
        epos1_data(opcode, bytes(damaged))


@given(frames=st.lists(st.tuples(OPCODES, WORDS), max_size=4), rubbish=st.binary(max_size=6))
def test_frames_of_an_epos4_are_found_behind_rubbish(frames: list[tuple[int, bytes]], rubbish: bytes) -> None:
    splitter, found = Epos4Splitter(), []
    rubbish = rubbish.replace(START, b"")
    for byte in rubbish.rstrip(b"\x90") + b"".join(epos4_frame(*frame) for frame in frames):
        if (frame := splitter.feed(byte)) is not None:
            found.append(frame)
    assert found == frames
    assert not splitter.half


def test_a_frame_in_which_another_begins_is_refused_and_the_other_taken() -> None:
    splitter, frame = Epos4Splitter(), epos4_frame(0, bytes(8))
    for byte in frame[:6] + frame[:1]:
        assert splitter.feed(byte) is None
    with pytest.raises(ProtocolError, match="another one begins"):
        splitter.feed(frame[1])
    assert fed(splitter, frame[2:]) == (0, bytes(8))


def test_a_start_byte_that_is_not_doubled_ends_a_frame() -> None:
    splitter = Epos4Splitter()
    for byte in epos4_frame(0, bytes(8))[:6] + b"\x90":
        splitter.feed(byte)
    with pytest.raises(ProtocolError, match="not doubled"):
        splitter.feed(0x07)
    assert not splitter.half


@pytest.mark.parametrize("protocol", SerialProtocol)
def test_a_command_says_which_object_of_which_node(protocol: SerialProtocol) -> None:
    for command in read_command(protocol, 3, 0x6041, 2), write_command(protocol, 3, 0x6041, 2, b"\x06\x00"):
        assert place_of_object(protocol, command.data) == (3, 0x6041, 2)
    assert write_command(protocol, 3, 0x6040, 0, b"\x06\x00").data[4:] == bytes((6, 0, 0, 0))
    assert nmt_command(protocol, 3, 0x81).data == bytes((3, 0, 0x81, 0))


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ProtocolError, match="5 bytes do not fit"):
        write_command(SerialProtocol.EPOS1, 1, 0x2004, 0, bytes(5))
    with pytest.raises(ProtocolError, match="node 256"):
        read_command(SerialProtocol.EPOS1, 256, 0x1000, 0)
    for wrong in (b"", b"\0", bytes(300)):
        with pytest.raises(ProtocolError):
            epos1_body(0x10, wrong)
    with pytest.raises(ProtocolError, match="error code needs 4"):
        content_of(b"\0\0")
