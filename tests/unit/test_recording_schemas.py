from __future__ import annotations

import math
import sys
from typing import Any, get_args, get_origin, get_type_hints

import pytest
import synthetic_run
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct
from msgspec.structs import fields, replace

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Nmt
from artemis.recording.schemas import (
    CHANNELS,
    TickRecord,
    json_schema,
    pack_frames,
    tick_from_record,
    tick_record,
    unpack_frames,
)
from artemis.scan import Scan
from artemis.values import DriveFeedback, Fault, OperatorInput, Request, Sensed, Severity, Tick

floats = st.floats(allow_nan=False)  # nan is equal to nothing: it has its own test
ages = st.none() | floats
drives = st.builds(
    DriveFeedback,
    name=st.text(st.characters(codec="utf-8")),
    state=st.sampled_from(DriveState),
    statusword=st.integers(0, 0xFFFF),
    position=floats,
    velocity=floats,
    current=floats,
    potentiometers=st.tuples(floats, floats),
    age=ages,
    nmt=st.none() | st.sampled_from(Nmt),
    heartbeat_age=ages,
    emergencies=st.lists(st.integers(0, 0xFFFF)).map(tuple),
)
inputs = st.builds(
    OperatorInput,
    source=st.sampled_from(["stick", "null"]),
    speed=floats,
    steering=floats,
    requests=st.lists(st.sampled_from(Request)).map(tuple),
    age=ages,
    axes=st.lists(floats).map(tuple),
    buttons=st.lists(st.booleans()).map(tuple),
)
scans = st.builds(
    Scan,
    source=st.just("null"),
    time=floats,
    start_angle=floats,
    increment=floats,
    ranges=st.binary(max_size=9),
    intensities=st.binary(max_size=9),
)
faults = st.builds(Fault, id=st.just("DRV-25"), severity=st.sampled_from(Severity), text=st.text("null é"))
sensed_values = st.builds(
    Sensed,
    index=st.integers(0, 2**31),
    time=floats,
    drives=st.lists(drives, max_size=4).map(tuple),
    inputs=st.lists(inputs, max_size=2).map(tuple),
    faults=st.lists(faults, max_size=2).map(tuple),
    scans=st.lists(scans, max_size=2).map(tuple),
)


def recorded(sensed: Sensed) -> Sensed:
    """What a recording makes of it."""
    tick = next(synthetic_run.run()).tick
    record = tick_record(replace(tick, snapshot=replace(tick.snapshot, sensed=sensed)))
    return tick_from_record(record).snapshot.sensed


@pytest.mark.slow
@given(sensed_values)
def test_sensed_values_survive_exactly(sensed: Sensed) -> None:
    assert recorded(sensed) == sensed


def test_what_has_its_default_is_left_out_and_made_again() -> None:
    tick = next(synthetic_run.run()).tick
    record = tick_record(tick)

    assert b'"scans"' not in record
    assert tick_from_record(record).snapshot == tick.snapshot


def test_no_none_is_written() -> None:
    def check(kind: Any) -> None:  # noqa: ANN401 (any type annotation)
        if get_origin(kind) is not None:
            for part in get_args(kind):
                check(part)
        elif kind is not Ellipsis and issubclass(kind, Struct):
            hints = get_type_hints(kind)
            optional = {name for name, hint in hints.items() if type(None) in get_args(hint)}
            assert optional == {field.name for field in fields(kind) if field.default is None}, kind
            assert kind.__struct_config__.omit_defaults or not optional, kind
            for hint in hints.values():
                check(hint)

    check(TickRecord)


def test_nan_survives() -> None:
    sample = OperatorInput(source="stick", speed=math.nan, steering=-math.inf, age=None, axes=(math.nan, 1.0))
    back = recorded(Sensed(index=1, time=0.02, inputs=(sample,))).inputs[0]

    assert math.isnan(back.speed)
    assert back.steering == -math.inf
    assert math.isnan(back.axes[0])
    assert back.axes[1] == 1.0
    assert back.age is None


@pytest.mark.parametrize("text", ["float:nan", "text:float:nan", "text:", "null", '{"goal":null,"a":"\\\\"}'])
@pytest.mark.parametrize("speed", [0.5, math.inf])
def test_a_text_that_reads_like_a_number_stays_text(text: str, speed: float) -> None:
    sensed = Sensed(
        index=1,
        time=0.02,
        inputs=(OperatorInput(source=text, speed=speed, steering=0.0),),
        faults=(Fault(id="DRV-25", severity=Severity.WARN, text=text),),
    )
    assert recorded(sensed) == sensed


def test_a_text_with_null_is_written_as_fast_as_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.recording.schemas._spelled", None)
    fault = Fault(id="DRV-25", severity=Severity.WARN, text='{"goal":null,"said":"\\"null\\""}')
    sensed = Sensed(index=1, time=0.02, faults=(fault,))
    assert recorded(sensed) == sensed


def test_a_tick_with_nan_survives() -> None:
    tick = next(synthetic_run.run()).tick
    back = tick_from_record(tick_record(replace(tick, set_points=replace(tick.set_points, speed=math.nan))))

    assert math.isnan(back.set_points.speed)
    assert back.set_points.steering == tick.set_points.steering


def test_ticks_that_differ_in_the_last_bit_have_different_records() -> None:
    tick = next(synthetic_run.run()).tick
    speed = math.nextafter(tick.set_points.speed, 1.0)

    assert tick_record(replace(tick, set_points=replace(tick.set_points, speed=speed))) != tick_record(tick)


@given(
    st.lists(
        st.tuples(
            st.booleans(),
            st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8), st.booleans(), floats),
        )
    )
)
def test_frames_survive_packing(frames: list[tuple[bool, Frame]]) -> None:
    packed = pack_frames(frames, 7.5)

    assert unpack_frames(packed) == [(sent, replace(frame, time=frame.time or 7.5)) for sent, frame in frames]


@pytest.mark.parametrize("topic", CHANNELS)
def test_schemas_are_plain(topic: str) -> None:
    def check(schema: dict[str, object]) -> None:
        assert schema["type"] in {"object", "array", "string", "number", "integer", "boolean"}
        assert not {"$ref", "anyOf", "oneOf"} & set(schema)
        properties = schema.get("properties", {})
        assert isinstance(properties, dict)
        for part in (*properties.values(), *([schema["items"]] if "items" in schema else [])):
            assert isinstance(part, dict)
            check(part)

    schema = json_schema(CHANNELS[topic][1])
    assert schema["type"] == "object"
    check(schema)


def test_foxglove_finds_its_time_by_the_title() -> None:
    timestamp = json_schema(CHANNELS["/log"][1])["properties"]["timestamp"]

    assert timestamp["title"] == "time"
    assert set(timestamp["properties"]) == {"sec", "nsec"}


# ----------------------------------------------------------------------------------------------------------- its cost


@pytest.mark.skipif(sys.getprofile() is not None, reason="somebody else counts calls")
def test_recording_a_scan_costs_no_call_and_a_third_more_bytes_than_it_has() -> None:
    def calls(tick: Tick) -> int:
        number = 0

        def count(*event: object) -> None:
            nonlocal number
            number += event[1] == "call"

        sys.setprofile(count)
        try:
            tick_record(tick)
        finally:
            sys.setprofile(None)
        return number

    tick = next(synthetic_run.run()).tick
    scan = Scan(source="front", time=0.0, start_angle=0.0, increment=0.004, ranges=bytes(range(2)) * 1081)
    snapshot = replace(tick.snapshot, sensed=replace(tick.snapshot.sensed, scans=(scan,)))
    with_one = replace(tick, snapshot=snapshot)
    assert calls(with_one) == calls(tick)
    assert len(tick_record(with_one)) - len(tick_record(tick)) < 2 * 1081 * 4 / 3 + 150
