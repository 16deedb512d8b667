"""Which frames may leave in which mode: every mode against every kind of frame."""

from __future__ import annotations

from pathlib import Path

import pytest
from core_builders import NAMES, ROBOT
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from artemis.devices.allow_list import MARGIN, MOST, AllowList
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import Abort, Expedited, NextSegment, Segment, Segmented, Upload, encode_request
from artemis.values import Mode
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

RPM = 4700 * 60 / 72
"""Motor rpm per m/s of a driven wheel."""
TOP = 1.02 * 0.72
"""Highest target of a wheel [m/s]: the robot file's limit and two percent."""
ON, OFF, STOP, RESET, SHUTDOWN = 0x0F, 0x00, 0x0B, 0x80, 0x06
DRIVING = {Mode.TELEOP, Mode.FOLLOW, Mode.ACT}
SERVICE = {Mode.INIT, Mode.QUICKSTOP, Mode.FAULT, Mode.END}
QUIET = {Mode.READY, Mode.TELEOP, Mode.FOLLOW, Mode.ACT}
FALLING = (Mode.READY, Mode.CALIBRATE, Mode.QUICKSTOP)


def allow(mode: Mode) -> AllowList:
    listed = AllowList(ROBOT)
    listed.begin(mode)
    return listed


def set_point(node: int, value: int, word: int = ON) -> Frame:
    return Frame(0x200 + node, word.to_bytes(2, "little") + value.to_bytes(4, "little", signed=True))


def speed(metres: float, node: int = 1, word: int = ON) -> Frame:
    return set_point(node, round(metres * RPM), word)


def sdo(request: Upload | Expedited | Segmented | Segment | NextSegment | Abort, node: int = 3) -> Frame:
    return Frame(0x600 + node, encode_request(request))


def write(index: int, value: int, size: int = 4, node: int = 3) -> Frame:
    return sdo(Expedited(index=index, subindex=0, data=value.to_bytes(size, "little", signed=True)), node)


def may(mode: Mode, frame: Frame) -> bool:
    return allow(mode).problem(frame) is None


# ---------------------------------------------------------------------------------------------- mode by kind of frame

NEVER: set[Mode] = set()
ALWAYS = set(Mode)
KINDS: dict[str, tuple[Frame, set[Mode]]] = {
    "SYNC": (Frame(0x080), ALWAYS),
    "SYNC with a counter": (Frame(0x080, b"\x01"), NEVER),
    "heartbeat": (Frame(0x77F, b"\x05"), ALWAYS),
    "heartbeat of another state": (Frame(0x77F, b"\x7f"), NEVER),
    "empty heartbeat": (Frame(0x77F), NEVER),
    "heartbeat of a drive": (Frame(0x701, b"\x05"), NEVER),
    "NMT Stop": (Frame(0x000, b"\x02\x03"), NEVER),
    "NMT Stop of all": (Frame(0x000, b"\x02\x00"), NEVER),
    "NMT Start": (Frame(0x000, b"\x01\x03"), SERVICE),
    "NMT Pre-Operational": (Frame(0x000, b"\x80\x01"), SERVICE),
    "NMT Reset Node": (Frame(0x000, b"\x81\x04"), SERVICE),
    "NMT Reset Communication of all": (Frame(0x000, b"\x82\x00"), SERVICE),
    "NMT to a stranger": (Frame(0x000, b"\x01\x05"), NEVER),
    "NMT to ourselves": (Frame(0x000, b"\x81\x7f"), NEVER),
    "NMT command that is none": (Frame(0x000, b"\x03\x01"), NEVER),
    "short NMT command": (Frame(0x000, b"\x01"), NEVER),
    "long NMT command": (Frame(0x000, b"\x01\x01\x00"), NEVER),
    "empty NMT command": (Frame(0x000), NEVER),
    "quick stop": (Frame(0x301, b"\x0b\x00"), ALWAYS),
    "quick stop of steering": (Frame(0x304, b"\x0b\x00"), ALWAYS),
    "enable at once": (Frame(0x301, b"\x0f\x00"), NEVER),
    "disable at once": (Frame(0x301, b"\x00\x00"), NEVER),
    "quick stop with surplus": (Frame(0x301, b"\x0b\x00\x00"), NEVER),
    "quick stop of a stranger": (Frame(0x305, b"\x0b\x00"), NEVER),
    "enabled, no speed": (speed(0.0), ALWAYS - {Mode.FAULT, Mode.END}),
    "shut down, no speed": (speed(0.0, word=SHUTDOWN), ALWAYS - {Mode.FAULT, Mode.END}),
    "off, no speed": (speed(0.0, word=OFF), ALWAYS),
    "quick stop, no speed": (speed(0.0, word=STOP), ALWAYS),
    "fault reset, no speed": (speed(0.0, word=RESET), ALWAYS),
    "slow": (speed(0.01), DRIVING),
    "slow backwards": (speed(-0.01, 2), DRIVING),
    "slow though off": (speed(0.01, word=OFF), DRIVING),
    "as fast as may be": (speed(TOP), DRIVING),
    "too fast": (speed(TOP + 0.001), NEVER),
    "too fast backwards": (speed(-TOP - 0.001), NEVER),
    "steering angle": (set_point(3, 50_000), ALWAYS),
    "short set-point": (Frame(0x201, b"\x0f\x00\x00\x00\x00"), NEVER),
    "long set-point": (Frame(0x203, bytes(7)), NEVER),
    "set-point of a stranger": (set_point(5, 0), NEVER),
    "third RxPDO": (Frame(0x401, bytes(6)), NEVER),
    "fourth RxPDO": (Frame(0x501, bytes(6)), NEVER),
    "SDO read": (sdo(Upload(index=0x6041, subindex=0)), ALWAYS - QUIET),
    "SDO next segment": (sdo(NextSegment(toggle=True)), ALWAYS - QUIET),
    "SDO segment": (sdo(Segment(toggle=False, data=b"1234567", last=True)), ALWAYS - QUIET),
    "SDO abort": (sdo(Abort(index=0x60FF, subindex=0, code=0x05040000)), ALWAYS - QUIET),
    "SDO write": (write(0x6085, 5000), ALWAYS - QUIET),
    "SDO write in segments": (sdo(Segmented(index=0x1008, subindex=0, size=9)), ALWAYS - QUIET),
    "SDO target 0": (write(0x60FF, 0, node=1), ALWAYS - QUIET),
    "SDO target 1": (write(0x60FF, 1, node=1), NEVER),
    "SDO target -1": (write(0x60FF, -1, node=1), NEVER),
    "SDO target 0x01000000": (write(0x60FF, 0x01000000, node=1), NEVER),
    "SDO target in segments": (sdo(Segmented(index=0x60FF, subindex=0, size=4)), NEVER),
    "SDO disable": (write(0x6040, OFF, 2), ALWAYS - QUIET),
    "SDO quick stop": (write(0x6040, STOP, 2), ALWAYS - QUIET),
    "SDO fault reset": (write(0x6040, RESET, 2), ALWAYS - QUIET),
    "SDO shutdown": (write(0x6040, SHUTDOWN, 2), NEVER),
    "SDO enable": (write(0x6040, ON, 2), NEVER),
    "SDO controlword in segments": (sdo(Segmented(index=0x6040, subindex=0, size=2)), NEVER),
    "short SDO": (Frame(0x603, bytes(7)), NEVER),
    "SDO of a stranger": (Frame(0x605, bytes(8)), NEVER),
    "SDO answer": (Frame(0x583, bytes(8)), NEVER),
    "emergency": (Frame(0x083, bytes(8)), NEVER),
    "feedback": (Frame(0x181, bytes(6)), NEVER),
    "time stamp": (Frame(0x100, bytes(6)), NEVER),
    "LSS": (Frame(0x7E5, bytes(8)), NEVER),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", Mode)
def test_frame_leaves_exactly_in_the_modes_of_its_kind(mode: Mode, kind: str) -> None:
    frame, modes = KINDS[kind]
    assert may(mode, frame) is (mode in modes)


@pytest.mark.parametrize("kind", KINDS)
def test_remote_frames_never_leave(kind: str) -> None:
    frame, _ = KINDS[kind]
    for mode in Mode:
        assert not may(mode, replace(frame, rtr=True))


@given(identifier=st.integers(0, 0x7FF), data=st.binary(max_size=8), mode=st.sampled_from(Mode))
def test_only_our_own_identifiers_leave(identifier: int, data: bytes, mode: Mode) -> None:
    ours = {0x000, 0x080, 0x77F, *(base + node for base in (0x200, 0x300, 0x600) for node in (1, 2, 3, 4))}
    listed = allow(mode)
    assert (identifier in listed.ours) is (identifier in ours)
    if identifier not in ours:
        assert listed.problem(Frame(identifier, data)) is not None


@given(data=st.binary(min_size=2, max_size=2), mode=st.sampled_from(Mode))
def test_nmt_stop_never_leaves(data: bytes, mode: Mode) -> None:
    allowed = may(mode, Frame(0x000, data))
    assert not (allowed and data[0] == 0x02)


@given(data=st.binary(min_size=8, max_size=8), mode=st.sampled_from(Mode), node=st.integers(1, 4))
def test_no_sdo_enables_a_drive_or_sets_a_speed(data: bytes, mode: Mode, node: int) -> None:
    index = int.from_bytes(data[1:3], "little")
    download = data[0] >> 5 == 1
    if may(mode, Frame(0x600 + node, data)) and download:
        assert not (index == 0x60FF and any(data[4:]))
        assert not (index == 0x6040 and data[4] not in (OFF, STOP, RESET))


def test_problem_tells_frame_mode_and_reason() -> None:
    assert allow(Mode.FOLLOW).problem(Frame(0x000, b"\x02\x03")) == (
        "0x000 [02 03] in follow: NMT Stop also stops the drive's messages: never"
    )
    assert allow(Mode.FAULT).problem(speed(0.5, word=OFF)) == (
        "0x201 [00 00 a6 07 00 00] in fault: target of 0.50 m/s, at most 0.00"
    )
    assert allow(Mode.INIT).problem(Frame(0x123)) == "0x123 [] in init: is not a frame of artemis"


# ---------------------------------------------------------------------------------------------- targets that fall


def ask(listed: AllowList, mode: Mode, *speeds: float) -> list[bool]:
    """In a tick each, target speeds of the left wheel; whether each left."""
    left = []
    for metres in speeds:
        listed.begin(mode)
        left.append(listed.problem(speed(metres)) is None)
    return left


@pytest.mark.parametrize("mode", FALLING)
def test_targets_only_fall_once_the_robot_no_longer_drives(mode: Mode) -> None:
    listed = allow(Mode.FOLLOW)
    assert ask(listed, Mode.FOLLOW, 0.5) == [True]
    assert ask(listed, mode, 0.5 + MARGIN + 0.01) == [False]
    assert ask(listed, mode, 0.5, 0.48, 0.3, 0.3 + MARGIN, 0.3, 0.0) == [True] * 6
    assert ask(listed, mode, 0.01) == [False], "not again after it stood"
    assert ask(listed, Mode.FOLLOW, 0.5) == [True]


@pytest.mark.parametrize("mode", FALLING)
def test_ceiling_follows_what_was_asked_down_but_never_up(mode: Mode) -> None:
    listed = allow(Mode.TELEOP)
    ask(listed, Mode.TELEOP, 0.3)
    for metres in (0.34, 0.38, 0.42, 0.46):  # each within the margin of the one before
        (left,) = ask(listed, mode, metres)
        assert left is (metres < 0.3 + MARGIN)


def test_what_was_held_back_does_not_raise_the_ceiling() -> None:
    listed = allow(Mode.TELEOP)
    ask(listed, Mode.TELEOP, 0.2)
    assert ask(listed, Mode.QUICKSTOP, 0.7, 0.7, 0.2) == [False, False, True]


def test_ceiling_is_that_of_the_faster_wheel() -> None:
    listed = allow(Mode.TELEOP)
    listed.problem(speed(0.2, 1))
    listed.problem(speed(-0.4, 2))
    listed.begin(Mode.QUICKSTOP)
    assert listed.problem(speed(0.4, 1)) is None
    assert listed.problem(speed(-0.5, 2)) is not None


@pytest.mark.parametrize("mode", FALLING)
def test_target_may_pass_the_ceiling_by_the_rounding_to_whole_rpm(mode: Mode) -> None:
    for rpm, left in ((1, True), (2, False)):
        listed = allow(Mode.TELEOP)
        ask(listed, Mode.TELEOP, 0.2)
        listed.begin(mode)
        ceiling = round(0.2 * RPM) / RPM + MARGIN
        assert (listed.problem(set_point(1, int(ceiling * RPM) + rpm)) is None) is left


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in DRIVING])
def test_without_having_driven_no_target_leaves(mode: Mode) -> None:
    for rpm in (1, -1):
        assert not may(mode, set_point(1, rpm))


@pytest.mark.parametrize("mode", [Mode.INIT, Mode.FAULT, Mode.END])
def test_targets_are_zero_at_once_where_nothing_may_move(mode: Mode) -> None:
    listed = allow(Mode.FOLLOW)
    ask(listed, Mode.FOLLOW, 0.5)
    listed.begin(mode)
    assert listed.problem(set_point(1, 1, OFF)) is not None
    assert listed.problem(set_point(1, 0, OFF)) is None
    assert ask(listed, Mode.QUICKSTOP, 0.1) == [False], "and a milder mode gives nothing back"


# ---------------------------------------------------------------------------------------------- how often


@pytest.mark.parametrize(
    "frame", [Frame(0x080), Frame(0x77F, b"\x05"), Frame(0x302, b"\x0b\x00"), speed(0.0), set_point(4, 7)], ids=str
)
def test_frame_leaves_at_most_twice_in_a_tick(frame: Frame) -> None:
    listed = allow(Mode.TELEOP)
    assert MOST == 2
    assert [listed.problem(frame) is None for _ in range(4)] == [True, True, False, False]
    assert "was sent 3 times in one tick" in str(allow_thrice(frame))
    listed.begin(Mode.TELEOP)
    assert listed.problem(frame) is None


def allow_thrice(frame: Frame) -> str | None:
    listed = allow(Mode.TELEOP)
    return [listed.problem(frame) for _ in range(3)][-1]


@pytest.mark.parametrize("frame", [Frame(0x000, b"\x80\x01"), sdo(Upload(index=0x1000, subindex=0))], ids=str)
def test_jobs_send_as_often_as_they_need(frame: Frame) -> None:
    listed = allow(Mode.INIT)
    assert {listed.problem(frame) for _ in range(50)} == {None}


def test_every_drive_has_its_own_count() -> None:
    listed = allow(Mode.TELEOP)
    for _ in range(2):
        for node, _ in enumerate(NAMES, 1):
            assert listed.problem(set_point(node, 0)) is None


def test_new_list_is_that_of_a_run_that_begins() -> None:
    listed = AllowList(ROBOT)
    assert listed.problem(Frame(0x000, b"\x80\x01")) is None
    assert listed.problem(speed(0.1)) is not None


# ---------------------------------------------------------------------------------------------- the supply voltage

ON_EPOS4 = RobotFile.model_validate(load(Path(__file__).parents[2] / "missions/robots/artemis_epos4.yaml").data)
SUPPLY, FENCE = Upload(index=0x2200, subindex=1), Upload(index=0x1000, subindex=7)


@pytest.mark.parametrize("mode", sorted(QUIET, key=str))
@pytest.mark.parametrize("request_", [SUPPLY, FENCE, Abort(index=0x2200, subindex=1, code=0x05040000)])
def test_the_supply_voltage_is_read_while_the_robot_moves_of_the_drive_that_measures_it(
    mode: Mode, request_: Upload | Abort
) -> None:
    listed = AllowList(ON_EPOS4)
    listed.begin(mode)
    assert listed.problem(sdo(request_, 1)) is None
    if request_ is not FENCE:
        assert listed.problem(sdo(request_, 2)) is not None
    assert not may(mode, sdo(request_, 1)), "no drive of this robot measures it"


TEMPERATURE = Upload(index=0x3201, subindex=1)


@pytest.mark.parametrize("mode", sorted(QUIET, key=str))
@pytest.mark.parametrize("request_", [TEMPERATURE, FENCE, Abort(index=0x3201, subindex=1, code=0x05040000)])
def test_temperatures_are_read_while_the_robot_moves_of_drives_that_measure_theirs(
    mode: Mode, request_: Upload | Abort
) -> None:
    listed = AllowList(ON_EPOS4)
    listed.begin(mode)
    for node in (1, 2, 3, 4):
        assert listed.problem(sdo(request_, node)) is None
        assert not may(mode, sdo(request_, node)), "no drive of this robot measures its own"


@pytest.mark.parametrize("mode", sorted(QUIET, key=str))
@pytest.mark.parametrize(
    "request_",
    [
        Upload(index=0x3201, subindex=4),
        Upload(index=0x2200, subindex=0),
        Expedited(index=0x3201, subindex=1, data=bytes(2)),
        Upload(index=0x6041, subindex=0),
        Expedited(index=0x2200, subindex=1, data=bytes(2)),
        Segmented(index=0x2200, subindex=1, size=9),
        NextSegment(toggle=False),
    ],
)
def test_nothing_else_passes_by_sdo_while_the_robot_moves(
    mode: Mode, request_: Upload | Expedited | Segmented | NextSegment
) -> None:
    listed = AllowList(ON_EPOS4)
    listed.begin(mode)
    assert listed.problem(sdo(request_, 1)) is not None
