"""One drive's process data, against bytes computed by hand."""

from __future__ import annotations

import math
import struct

import pytest
from core_builders import ROBOT, FakeBus
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import Frame
from artemis.devices.epos import EposDrive
from artemis.devices.epos_objects import UNREADABLE
from artemis.devices.epos_state import Controlword
from artemis.drive_states import DriveState, Nmt
from artemis.errors import ProtocolError

COUNTS_PER_METRE = 4700.0
"""47 counts per centimetre."""
COUNTS_PER_DEGREE = 2000 * 946 / 360
"""Encoder counts of a motor turn, gear, degrees."""
ON = Controlword.ENABLE_OPERATION


def epos(name: str) -> EposDrive:
    return EposDrive(name, ROBOT, BusGateway(ROBOT, FakeBus()))


def status(counts: int, word: int = 0x0337, time: float = 0.0) -> Frame:
    return Frame(0x181, struct.pack("<Hi", word, counts), time=time)


def positions(name: str, *counts: int) -> list[float]:
    drive = epos(name)
    found = []
    for number, value in enumerate(counts):
        drive.on_status(status(value, time=0.02 * number))
        found.append(drive.feedback(0.02 * number).position)
    return found


# ---------------------------------------------------------------------------------------------- set-points out


@pytest.mark.parametrize(
    ("name", "value", "identifier", "data"),
    [
        # 0.4 m/s x 4700 counts/m x 60 s / 72 counts = 1566.67 rpm -> 1567 = 0x061F; mirrored: -1567 = 0xFFFFF9E1
        ("traction-left", 0.4, 0x201, "0f 00 1f 06 00 00"),
        ("traction-left", -0.4, 0x201, "0f 00 e1 f9 ff ff"),
        ("traction-right", 0.4, 0x202, "0f 00 e1 f9 ff ff"),
        ("traction-right", 0.0, 0x202, "0f 00 00 00 00 00"),
        # 10 degrees x 2000 x 946 / 360 = 52555.56 counts -> 52556 = 0xCD4C; mirrored: -52556 = 0xFFFF32B4
        ("steer-left", math.radians(10.0), 0x203, "0f 00 4c cd 00 00"),
        ("steer-right", math.radians(10.0), 0x204, "0f 00 b4 32 ff ff"),
        ("steer-right", math.radians(-10.0), 0x204, "0f 00 4c cd 00 00"),
    ],
)
def test_set_point_frame_has_controlword_and_target_in_drive_units(
    name: str, value: float, identifier: int, data: str
) -> None:
    assert epos(name).set_point_frame(ON, value) == Frame(identifier, bytes.fromhex(data))


@pytest.mark.parametrize(("name", "identifier"), [("traction-left", 0x301), ("steer-right", 0x304)])
def test_stop_frame_is_the_controlword_alone_at_its_own_identifier(name: str, identifier: int) -> None:
    assert epos(name).stop_frame() == Frame(identifier, bytes.fromhex("0b 00"))


def test_frames_remember_the_controlword_for_the_next_edge() -> None:
    drive = epos("traction-left")
    drive.set_point_frame(0x80, 0.0)
    assert drive.last_controlword == 0x80
    drive.stop_frame()
    assert drive.last_controlword == Controlword.QUICK_STOP


# ---------------------------------------------------------------------------------------------- feedback in


def test_drive_that_was_never_heard_is_unknown_without_age() -> None:
    feedback = epos("steer-left").feedback(5.0)
    assert (feedback.state, feedback.age, feedback.nmt, feedback.heartbeat_age) == (
        DriveState.UNKNOWN,
        None,
        None,
        None,
    )


def test_status_frame_bytes_are_statusword_and_position() -> None:
    drive = epos("traction-left")
    drive.on_status(Frame(0x181, bytes.fromhex("37 03 00 00 00 00"), time=1.0))
    drive.on_status(Frame(0x181, bytes.fromhex("17 03 5e 00 00 00"), time=1.02))  # 0x5E = 94 counts
    feedback = drive.feedback(1.02)
    assert (feedback.statusword, feedback.state) == (0x0317, DriveState.QUICK_STOP_ACTIVE)
    assert drive.state is DriveState.QUICK_STOP_ACTIVE
    assert feedback.position == pytest.approx(0.02)


def test_details_of_a_traction_drive_are_velocity_current_and_mode() -> None:
    for name, sign in (("traction-left", 1), ("traction-right", -1)):
        drive = epos(name)
        drive.on_details(Frame(0x281, bytes.fromhex("1f 06 00 00 0c fe 03")))  # 1567 rpm, 0xFE0C = -500 mA, mode 3
        feedback = drive.feedback(0.0)
        assert feedback.velocity == pytest.approx(sign * 1567 * 72 / 60 / COUNTS_PER_METRE)
        assert (feedback.current, feedback.mode) == (-0.5, 3)
        assert feedback.potentiometers == (0.0, 0.0)


def test_details_of_a_steering_drive_are_both_potentiometers_current_and_mode() -> None:
    drive = epos("steer-left")
    drive.on_details(Frame(0x283, bytes.fromhex("ce 09 b0 09 fa 00 ff")))  # 2510 mV, 2480 mV, 250 mA, mode -1
    feedback = drive.feedback(0.0)
    assert feedback.potentiometers == (2.51, 2.48)
    assert (feedback.current, feedback.mode) == (0.25, -1)


def test_first_position_is_the_origin_wherever_the_counter_stands() -> None:
    assert positions("traction-left", 123456, 123456 + 470) == pytest.approx([0.0, 0.1])


@pytest.mark.parametrize(
    ("name", "counts"),
    [("traction-left", 94), ("traction-right", -94), ("steer-left", 5256), ("steer-right", -5256)],
)
def test_forward_and_left_are_positive_whatever_way_the_motor_turns(name: str, counts: int) -> None:
    expected = 0.02 if name.startswith("traction") else math.radians(1.0)
    assert positions(name, 0, counts)[-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("start", "step"), [(0x7FFFFFFF - 100, 470), (-0x80000000 + 100, -470)])
def test_counter_may_wrap_either_way(start: int, step: int) -> None:
    wrapped = (start + step + 0x80000000) % 0x100000000 - 0x80000000
    assert abs(wrapped - start) > 0x7FFFFFFF, "it does wrap"
    assert positions("traction-left", start, wrapped)[-1] == pytest.approx(step / COUNTS_PER_METRE)


@given(start=st.integers(0x7FFFF000, 0x80000FFF), steps=st.lists(st.integers(-680, 680), max_size=20))
def test_position_is_the_sum_of_all_steps_however_often_the_counter_wraps(start: int, steps: list[int]) -> None:
    counts = [(start + 0x80000000) % 0x100000000 - 0x80000000]
    for step in steps:
        counts.append((counts[-1] + step + 0x80000000) % 0x100000000 - 0x80000000)
    assert positions("traction-left", *counts)[-1] == pytest.approx(sum(steps) / COUNTS_PER_METRE, rel=1e-6, abs=1e-3)


def test_steering_velocity_is_the_change_of_angle_over_time() -> None:
    drive = epos("steer-right")
    drive.on_status(status(0, time=0.0))
    drive.on_status(status(-round(COUNTS_PER_DEGREE), time=0.02))
    assert drive.feedback(0.02).velocity == pytest.approx(math.radians(50.0), rel=1e-3)


def test_age_is_that_of_the_older_frame_and_needs_both() -> None:
    drive = epos("steer-left")
    drive.on_status(status(0, time=1.0))
    assert drive.feedback(1.0).age is None
    drive.on_details(Frame(0x283, bytes(7), time=1.5))
    assert drive.feedback(1.6).age == pytest.approx(0.6)
    drive.on_status(status(0, time=2.0))
    assert drive.feedback(2.1).age == pytest.approx(0.6)


def test_heartbeat_tells_nmt_state_and_age() -> None:
    drive = epos("steer-left")
    drive.on_heartbeat(Frame(0x703, b"\x05", time=1.0))
    feedback = drive.feedback(1.25)
    assert (feedback.nmt, feedback.heartbeat_age, feedback.boots) == (Nmt.OPERATIONAL, 0.25, 0)


def test_emergencies_and_boot_ups_are_given_out_once() -> None:
    drive = epos("steer-left")
    drive.on_emergency(Frame(0x083, bytes.fromhex("10 23 02 00 00 00 00 00")))
    drive.on_emergency(Frame(0x083, bytes.fromhex("00 00 00 00 00 00 00 00")))
    for time in (0.0, 0.05, 0.1, 0.5):  # some repeat it while they initialise
        drive.on_heartbeat(Frame(0x703, b"\x00", time=time))
    first, second = drive.feedback(0.0), drive.feedback(0.0)
    assert (first.emergencies, first.boots) == ((0x2310, 0x0000), 2)
    assert (second.emergencies, second.boots) == ((), 0)


def test_unreadable_emergency_is_marked() -> None:
    drive = epos("steer-left")
    for length in (0, 2, 7):
        drive.on_emergency(Frame(0x083, bytes(length)))
    assert drive.feedback(0.0).emergencies == (UNREADABLE,) * 3


# ---------------------------------------------------------------------------------------------- what cannot be

LARGEST = int(1.5 * 3190 / 60 * 72 * (0.02 + 0.1))
"""Counts that a traction motor at 1.5 times its highest speed, 3190 rpm, turns in a tick and the bus' jitter: 689."""


def test_position_that_no_motion_reaches_is_dropped_and_counted() -> None:
    drive = epos("traction-left")
    drive.on_details(Frame(0x281, bytes(7)))
    drive.on_status(status(0))
    drive.on_status(status(LARGEST, time=0.02))
    assert drive.feedback(0.02).jumps == 0
    for number in (1, 2):
        drive.on_status(status(LARGEST + 100_000, word=0x0317, time=0.02 + 0.02 * number))
        feedback = drive.feedback(0.02 + 0.02 * number)
        assert (feedback.jumps, feedback.frames) == (number, 1)
        assert feedback.position == pytest.approx(LARGEST / COUNTS_PER_METRE)
        assert feedback.state is DriveState.QUICK_STOP_ACTIVE, "the statusword is believed"
    drive.on_status(status(LARGEST + 1, time=0.08))
    feedback = drive.feedback(0.08)
    assert (feedback.jumps, feedback.age) == (0, 0.08)
    assert feedback.position == pytest.approx((LARGEST + 1) / COUNTS_PER_METRE)


@pytest.mark.parametrize("sign", [1, -1])
def test_largest_step_depends_on_the_time_since_the_last(sign: int) -> None:
    for elapsed, longest in ((0.02, LARGEST), (0.1, LARGEST * 0.2 / 0.12)):
        for counts, jumps in ((int(longest) - 1, 0), (int(longest) + 2, 1)):
            drive = epos("traction-right")
            drive.on_status(status(0))
            drive.on_status(status(sign * counts, time=elapsed))
            assert drive.feedback(elapsed).jumps == jumps


def test_age_of_dropped_positions_grows() -> None:
    drive = epos("traction-left")
    drive.on_details(Frame(0x281, bytes(7), time=0.1))
    drive.on_status(status(0))
    drive.on_status(status(100_000, time=0.1))
    assert drive.feedback(0.1).age == pytest.approx(0.1)


def test_frame_older_than_the_last_is_dropped_and_counted() -> None:
    drive = epos("traction-left")
    drive.on_status(status(0, time=1.0))
    drive.on_status(status(40, word=0x0317, time=0.999))
    feedback = drive.feedback(1.0)
    assert (feedback.disordered, feedback.frames, feedback.position) == (1, 1, 0.0)
    assert feedback.state is DriveState.OPERATION_ENABLE
    assert drive.feedback(1.0).disordered == 0, "told once"
    drive.on_status(status(47, time=1.0))
    assert drive.feedback(1.0).position == pytest.approx(0.01), "at the same time is not older"


def test_details_older_than_the_last_are_dropped_and_counted() -> None:
    drive = epos("steer-left")
    drive.on_status(status(0, time=1.0))
    drive.on_details(Frame(0x283, bytes.fromhex("ce 09 b0 09 fa 00 ff"), time=1.0))
    drive.on_details(Frame(0x283, bytes(7), time=0.999))
    feedback = drive.feedback(1.0)
    assert (feedback.disordered, feedback.potentiometers, feedback.age) == (1, (2.51, 2.48), 0.0)
    drive.on_details(Frame(0x283, bytes(7), time=1.0))
    assert drive.feedback(1.0).potentiometers == (0.0, 0.0), "at the same time is not older"
    drive.restart()
    drive.on_details(Frame(0x283, bytes(7), time=0.5))
    assert drive.feedback(1.0).disordered == 0


def test_answers_nobody_waits_for_are_told_once() -> None:
    drive = epos("steer-left")
    drive.sdo.receive(Frame(0x583, bytes(8)))
    drive.sdo.receive(Frame(0x583, bytes(8)))
    assert [drive.feedback(0.0).stray for _ in range(2)] == [2, 0]


# ---------------------------------------------------------------------------------------------- references


def test_rebased_drive_counts_from_the_angle_it_was_told() -> None:
    drive = epos("steer-right")
    drive.on_status(status(777))
    drive.rebase(math.radians(30.0), 777)
    assert drive.feedback(0.0).position == pytest.approx(math.radians(30.0))
    drive.on_status(status(777 - 5256, time=0.02))
    assert drive.feedback(0.02).position == pytest.approx(math.radians(31.0), rel=1e-4)


def test_set_point_at_the_measured_angle_is_the_measured_count() -> None:
    drive = epos("steer-left")
    drive.on_status(status(-12345))
    drive.rebase(math.radians(-20.0), -12345)
    drive.on_status(status(-7089, time=0.02))  # 5256 counts further
    frame = drive.set_point_frame(ON, drive.feedback(0.02).position)
    assert struct.unpack("<Hi", frame.data) == (0x0F, -7089)


def test_set_point_beyond_the_end_of_the_counter_wraps_as_the_counter_does() -> None:
    drive = epos("steer-left")
    drive.on_status(status(0x7FFFFFFF))
    drive.rebase(0.0, 0x7FFFFFFF)
    frame = drive.set_point_frame(ON, math.radians(10.0))
    assert struct.unpack("<Hi", frame.data)[1] == -0x80000000 + 52555


@pytest.mark.parametrize(("counts", "distance"), [(9494, 0.02), (9541, 0.03), (0, 0.02), (-47, 0.01)])
def test_restarted_drive_has_counted_on_or_from_zero(counts: int, distance: float) -> None:
    drive = epos("traction-left")
    drive.on_status(status(9400))
    drive.on_details(Frame(0x281, bytes(7)))
    drive.on_status(status(9494, time=0.02))
    drive.restart()
    assert drive.feedback(0.02).age is None, "not heard since"
    drive.on_status(status(counts, time=0.04))
    assert drive.feedback(0.04).position == pytest.approx(distance)
    drive.on_status(status(counts + 94, time=0.06))
    assert drive.feedback(0.06).position == pytest.approx(distance + 0.02)


def test_way_of_a_restarted_drive_is_no_jump() -> None:
    drive = epos("traction-left")
    drive.on_status(status(100_000))
    drive.restart()
    drive.on_status(status(9400, time=0.02))
    assert drive.feedback(0.02).jumps == 0
    assert drive.feedback(0.02).position == pytest.approx(2.0)


# ---------------------------------------------------------------------------------------------- garbage


@pytest.mark.parametrize("length", range(6))
def test_short_status_frame_is_refused_and_changes_nothing(length: int) -> None:
    drive = epos("traction-left")
    drive.on_status(status(4700, time=1.0))
    drive.on_details(Frame(0x281, bytes(7), time=1.0))
    before = drive.feedback(1.0)
    with pytest.raises(ProtocolError):
        drive.on_status(Frame(0x181, bytes(length), time=2.0))
    assert drive.feedback(1.0) == replace(before, frames=0)


@pytest.mark.parametrize("name", ["traction-left", "steer-left"])
def test_short_details_frame_is_refused_and_changes_nothing(name: str) -> None:
    drive = epos(name)
    before = drive.feedback(1.0)
    with pytest.raises(ProtocolError):
        drive.on_details(Frame(0x281, bytes(6), time=2.0))
    assert drive.feedback(1.0) == before


@pytest.mark.parametrize("data", [b"", b"\x42", b"\x05\x05"])
def test_senseless_heartbeat_is_refused_and_changes_nothing(data: bytes) -> None:
    drive = epos("steer-left")
    drive.on_heartbeat(Frame(0x703, b"\x05", time=1.0))
    with pytest.raises(ProtocolError):
        drive.on_heartbeat(Frame(0x703, data, time=2.0))
    feedback = drive.feedback(3.0)
    assert (feedback.nmt, feedback.heartbeat_age) == (Nmt.OPERATIONAL, 2.0)
