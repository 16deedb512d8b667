"""Codecs: what goes in comes out again, and no bytes make a decoder raise anything but ProtocolError."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sdo_server_side import decode_request, encode_answer

from artemis.devices import canopen
from artemis.devices.canopen import (
    Abort,
    Accepted,
    Answer,
    Emergency,
    Expedited,
    NextSegment,
    PdoLayout,
    Request,
    Segment,
    SegmentAccepted,
    Segmented,
    Upload,
)
from artemis.drive_states import Nmt
from artemis.errors import ProtocolError
from artemis.families.objects import ObjectType

indices = st.integers(0, 0xFFFF)
bytes_8 = st.integers(0, 0xFF)
words_32 = st.integers(0, 0xFFFFFFFF)
both_ways: st.SearchStrategy[Expedited | Segmented | Segment | Abort] = st.one_of(
    st.builds(Expedited, index=indices, subindex=bytes_8, data=st.binary(min_size=1, max_size=4)),
    st.builds(Expedited, index=indices, subindex=bytes_8, data=st.binary(min_size=4, max_size=4), sized=st.just(False)),
    st.builds(Segmented, index=indices, subindex=bytes_8, size=st.none() | words_32),
    st.builds(Segment, toggle=st.booleans(), data=st.binary(max_size=7), last=st.booleans()),
    st.builds(Abort, index=indices, subindex=bytes_8, code=words_32),
)
requests: st.SearchStrategy[Request] = st.one_of(
    both_ways,
    st.builds(Upload, index=indices, subindex=bytes_8),
    st.builds(NextSegment, toggle=st.booleans()),
)
answers: st.SearchStrategy[Answer] = st.one_of(
    both_ways,
    st.builds(Accepted, index=indices, subindex=bytes_8),
    st.builds(SegmentAccepted, toggle=st.booleans()),
)
numbers = [type_ for type_ in ObjectType if type_ is not ObjectType.STR]


def bounds(type_: ObjectType) -> tuple[int, int]:
    bits = 8 * type_.size
    return (0, 2**bits - 1) if type_.name.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


@given(requests)
def test_request_round_trips(request: Request) -> None:
    wire = canopen.encode_request(request)
    assert len(wire) == 8
    assert decode_request(wire) == request


@given(answers)
def test_answer_round_trips(answer: Answer) -> None:
    wire = encode_answer(answer)
    assert len(wire) == 8
    assert canopen.decode_answer(wire) == answer


@given(data=st.data(), type_=st.sampled_from(numbers))
def test_number_round_trips(data: st.DataObject, type_: ObjectType) -> None:
    value = data.draw(st.integers(*bounds(type_)))
    wire = type_.encode(value)
    assert len(wire) == type_.size
    assert type_.decode(wire) == value


@given(data=st.data(), type_=st.sampled_from(numbers))
def test_number_out_of_range_is_refused(data: st.DataObject, type_: ObjectType) -> None:
    low, high = bounds(type_)
    value = data.draw(st.integers(max_value=low - 1) | st.integers(min_value=high + 1))
    with pytest.raises(ProtocolError):
        type_.encode(value)


@given(st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E)))
def test_visible_string_round_trips(text: str) -> None:
    assert ObjectType.STR.decode(ObjectType.STR.encode(text)) == text


@given(st.integers(0, 0xFFFF), bytes_8, st.binary(min_size=5, max_size=5), st.integers(1, 127))
def test_emergency_round_trips(code: int, register: int, data: bytes, node_id: int) -> None:
    emergency = Emergency(code=code, register=register, data=data)
    frame = emergency.frame(node_id)
    assert frame.id == 0x80 + node_id
    assert canopen.emergency_from_data(frame.data) == emergency


@given(st.sampled_from(Nmt), st.integers(1, 127))
def test_heartbeat_round_trips(state: Nmt, node_id: int) -> None:
    frame = canopen.heartbeat_frame(node_id, state)
    assert frame.id == 0x700 + node_id
    assert canopen.nmt_from_heartbeat(frame.data) is state


@given(st.data())
def test_pdo_round_trips(data: st.DataObject) -> None:
    types = data.draw(st.lists(st.sampled_from(numbers), max_size=8).filter(lambda t: sum(x.size for x in t) <= 8))
    values = tuple(data.draw(st.integers(*bounds(type_))) for type_ in types)
    layout = PdoLayout(types)
    wire = layout.pack(*values)
    assert len(wire) == layout.length == sum(type_.size for type_ in types)
    assert layout.unpack(wire) == values


DECODERS: list[Callable[[bytes], object]] = [
    canopen.decode_answer,
    canopen.nmt_from_heartbeat,
    canopen.emergency_from_data,
    PdoLayout([ObjectType.U16, ObjectType.I32]).unpack,
    *(type_.decode for type_ in ObjectType),
]


@pytest.mark.parametrize("decode", DECODERS)
@given(data=st.binary(max_size=8) | st.binary(min_size=8, max_size=8) | st.binary(max_size=70))
@example(data=b"")
def test_no_bytes_make_a_decoder_raise_anything_but_protocol_errors(
    decode: Callable[[bytes], object], data: bytes
) -> None:
    with suppress(ProtocolError):
        decode(data)


@given(st.binary(min_size=8, max_size=8))
def test_decoded_request_means_the_same_when_sent_on(data: bytes) -> None:
    try:
        request = decode_request(data)
    except ProtocolError:
        return
    assert decode_request(canopen.encode_request(request)) == request


@given(st.binary(min_size=8, max_size=8))
def test_decoded_answer_means_the_same_when_sent_on(data: bytes) -> None:
    try:
        answer = canopen.decode_answer(data)
    except ProtocolError:
        return
    assert canopen.decode_answer(encode_answer(answer)) == answer
