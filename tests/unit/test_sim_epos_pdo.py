from __future__ import annotations

import struct

import pytest
from sim_epos_rig import STEERING, Rig

from artemis.drive_states import DriveState

START, STOP, PRE_OPERATIONAL = 0x01, 0x02, 0x80
STATUSWORD, POSITION, CONTROLWORD, TARGET = 0x60410010, 0x60640020, 0x60400010, 0x60FF0020


def test_by_default_only_the_statusword_is_sent_and_on_every_change() -> None:
    rig = Rig()
    rig.nmt(START)
    assert rig.take(0x182) == [b"\x40\x03"]
    rig.run(0.1)
    assert rig.take(0x182) == []
    rig.control(0x0006)
    rig.control(0x000F)
    rig.run(0.02)
    assert [data.hex() for data in rig.take(0x182)] == ["2103", "2343", "3343", "3707"]


def test_nothing_is_sent_or_taken_outside_operational() -> None:
    rig = Rig()
    rig.write(0x1800, 2, "B", 1)
    rig.send(0x80)
    rig.send(0x202, b"\x06\0")
    rig.send(0x182, rtr=True)
    assert rig.take(0x182) == []
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
    rig.nmt(START)
    rig.send(0x202, b"\x06\0")
    assert rig.state() is DriveState.READY
    rig.nmt(STOP)
    rig.send(0x202, b"\x00\0")
    assert rig.state() is DriveState.READY


def test_the_default_receive_pdos_carry_mode_and_targets() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.send(0x302, struct.pack("<Hb", 6, -2))
    assert rig.node.read(0x6061) == -2
    rig.send(0x402, struct.pack("<Hi", 6, -70000))
    assert rig.node.read(0x607A) == -70000
    rig.send(0x502, struct.pack("<Hi", 7, 1500))
    assert rig.node.read(0x60FF) == 1500
    assert rig.state() is DriveState.SWITCHED_ON


def test_a_controlword_starts_the_target_that_came_with_it() -> None:
    rig = Rig()
    rig.enable()
    rig.nmt(START)
    rig.send(0x502, struct.pack("<Hi", 15, 1500))
    assert rig.axis.target == 1500.0


def test_synchronous_set_points_take_effect_at_the_sync_and_the_newest_counts() -> None:
    rig = Rig()
    rig.write(0x1403, 2, "B", 1)
    rig.enable()
    rig.nmt(START)
    rig.send(0x502, struct.pack("<Hi", 15, 1500))
    rig.send(0x502, struct.pack("<Hi", 15, 900))
    assert rig.node.read(0x60FF) == 0
    rig.send(0x80)
    assert rig.axis.target == 900.0
    rig.node.poke(0x60FF, 0, 1)
    rig.send(0x80)
    assert rig.node.read(0x60FF) == 1


def test_at_a_sync_all_set_points_are_written_before_any_controlword() -> None:
    rig = Rig()
    rig.write(0x1400, 2, "B", 1)
    rig.map(0x1601, TARGET)
    rig.write(0x1401, 2, "B", 1)
    rig.enable()
    rig.nmt(START)
    rig.send(0x202, b"\x0f\0")
    rig.send(0x302, struct.pack("<i", 700))
    rig.send(0x80)
    assert rig.axis.target == 700.0


def test_set_points_that_wait_are_forgotten_outside_operational() -> None:
    rig = Rig()
    rig.write(0x1403, 2, "B", 1)
    rig.nmt(START)
    rig.send(0x502, struct.pack("<Hi", 6, 1500))
    rig.nmt(PRE_OPERATIONAL)
    rig.nmt(START)
    rig.send(0x80)
    assert rig.node.read(0x60FF) == 0


def test_synchronous_data_is_sampled_after_the_sync() -> None:
    rig = Rig(STEERING)
    rig.write(0x1800, 2, "B", 1)
    rig.map(0x1A00, STATUSWORD, POSITION)
    rig.write(0x1400, 2, "B", 1)
    rig.nmt(START)
    assert rig.take(0x183) == []
    rig.axis.position = -5.0
    rig.send(0x203, b"\x06\0")
    rig.send(0x80)
    assert rig.take(0x183) == [struct.pack("<Hi", 0x0321, -5)]
    rig.run(0.1)
    assert rig.take(0x183) == []


def test_a_pdo_on_request_answers_remote_frames_only() -> None:
    rig = Rig()
    rig.write(0x1800, 1, "I", 0x182)
    rig.write(0x1800, 2, "B", 253)
    rig.nmt(START)
    rig.control(0x0006)
    rig.send(0x80)
    assert rig.take(0x182) == []
    rig.send(0x182, rtr=True)
    assert rig.take(0x182) == [b"\x21\x03"]


def test_bit_30_forbids_remote_requests() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.take(0x182)
    rig.send(0x182, rtr=True)
    assert rig.take(0x182) == []


def test_bit_31_switches_a_pdo_off() -> None:
    rig = Rig()
    rig.write(0x1800, 1, "I", 0xC0000182)
    rig.write(0x1400, 1, "I", 0x80000202)
    rig.nmt(START)
    rig.send(0x202, b"\x06\0")
    assert rig.take(0x182) == []
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


def test_another_identifier_acts_at_once() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.write(0x1400, 1, "I", 0x300)
    rig.send(0x202, b"\x06\0")
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
    rig.send(0x300, b"\x06\0")
    assert rig.state() is DriveState.READY


@pytest.mark.parametrize("cob_id", [0x180, 0x580, 0, 0x20000202, 0x1202])
def test_an_identifier_outside_the_allowed_ones_is_refused(cob_id: int) -> None:
    assert Rig().refusal(0x1400, 1, "I", cob_id) == 0x06090030


def test_an_invalid_pdo_may_have_no_identifier() -> None:
    assert Rig().refusal(0x1800, 1, "I", 0x80000000) == 0


def test_the_inhibit_time_spaces_changes_and_the_last_one_still_comes() -> None:
    rig = Rig()
    rig.write(0x1800, 3, "H", 200)  # 20 ms
    rig.nmt(START)
    start = rig.now
    rig.control(0x0006)
    rig.control(0x0007)
    assert rig.node.next_due == pytest.approx(start + 0.02)
    rig.run(0.03)
    times = [round(time - start, 3) for time, frame in rig.heard if frame.id == 0x182]
    assert times == [0.0, pytest.approx(0.02, abs=0.0011)]
    assert rig.take(0x182)[-1] == b"\x23\x03"


def test_a_moving_position_is_sent_on_change() -> None:
    rig = Rig(STEERING)
    rig.map(0x1A01, POSITION)
    rig.write(0x1801, 1, "I", 0x40000283)
    rig.nmt(START)
    assert rig.take(0x283) == [struct.pack("<i", 0)]
    rig.axis.position = 7.0
    rig.run(0.001)
    assert rig.take(0x283) == [struct.pack("<i", 7)]


def test_entering_operational_again_sends_event_driven_data_again() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.nmt(PRE_OPERATIONAL)
    rig.nmt(START)
    assert rig.take(0x182) == [b"\x40\x03", b"\x40\x03"]


def test_a_short_frame_is_an_error_and_changes_nothing() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.send(0x502, b"\x06\0\x01")
    assert rig.emergencies() == [0x8210]
    assert rig.node.read(0x60FF) == 0
    rig.run(0.01)
    assert rig.status & 0x417F == 0x0108


def test_a_frame_longer_than_the_mapping_is_taken() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.send(0x202, b"\x06\0\xff\xff")
    assert rig.state() is DriveState.READY


def test_remote_frames_for_received_pdos_and_sync_do_nothing() -> None:
    rig = Rig()
    rig.write(0x1800, 2, "B", 1)
    rig.nmt(START)
    rig.send(0x202, rtr=True)
    rig.send(0x80, rtr=True)
    assert rig.heard == []


def test_the_sync_identifier_can_be_changed() -> None:
    rig = Rig()
    rig.write(0x1800, 2, "B", 1)
    rig.nmt(START)
    rig.write(0x1005, 0, "I", 0x90)
    rig.send(0x80)
    assert rig.take(0x182) == []
    rig.send(0x90)
    assert len(rig.take(0x182)) == 1


# ---------------------------------------------------------------------------------------------- rules of mappings


def test_a_mapping_changes_in_pre_operational_only() -> None:
    rig = Rig()
    rig.nmt(START)
    assert rig.refusal(0x1A00, 0, "B", 0) == 0x0F00FFC0
    assert rig.refusal(0x1A00, 1, "I", POSITION) == 0x0F00FFC0
    rig.nmt(PRE_OPERATIONAL)
    assert rig.refusal(0x1A00, 0, "B", 0) == 0


def test_a_place_changes_only_while_the_mapping_is_switched_off() -> None:
    rig = Rig()
    assert rig.refusal(0x1A00, 1, "I", POSITION) == 0x06010000
    rig.write(0x1A00, 0, "B", 0)
    assert rig.refusal(0x1A00, 1, "I", POSITION) == 0


@pytest.mark.parametrize(
    ("index", "mapped"),
    [
        (0x1A00, 0x30000020),  # no such object
        (0x1A00, 0x60830010),  # wrong length
        (0x1A00, 0x60670020),  # cannot be mapped
        (0x1600, 0x60640020),  # can be sent, not received
        (0x1600, 0x10080020),  # a string
    ],
)
def test_what_cannot_be_mapped_is_refused(index: int, mapped: int) -> None:
    rig = Rig()
    rig.write(index, 0, "B", 0)
    assert rig.refusal(index, 1, "I", mapped) == 0x06040041


def test_a_pdo_carries_eight_bytes_at_most() -> None:
    rig = Rig()
    rig.write(0x1A00, 0, "B", 0)
    for place, mapped in enumerate((POSITION, 0x606C0020, STATUSWORD)):
        rig.write(0x1A00, place + 1, "I", mapped)
    assert rig.refusal(0x1A00, 0, "B", 3) == 0x06040042
    assert rig.refusal(0x1A00, 0, "B", 2) == 0
    assert rig.refusal(0x1A00, 0, "B", 9) == 0x06090031


def test_an_empty_place_cannot_be_counted() -> None:
    rig = Rig()
    rig.write(0x1A00, 0, "B", 0)
    assert rig.refusal(0x1A00, 0, "B", 2) == 0x06040041


def test_a_mapping_of_nothing_switches_the_pdo_off() -> None:
    rig = Rig()
    rig.map(0x1A00)
    rig.map(0x1600)
    rig.nmt(START)
    rig.send(0x202, b"\x06\0")
    assert rig.heard == []
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


def test_every_mappable_object_can_be_sent() -> None:
    rig = Rig()
    rig.write(0x1800, 2, "B", 1)
    entries = [entry for entry in rig.node._dictionary.entries.values() if entry.transmit]
    assert len(entries) > 40
    for entry in entries:
        assert entry.size is not None
        rig.map(0x1A00, entry.key << 8 | 8 * entry.size)
        rig.nmt(START)
        rig.send(0x80)
        (data,) = rig.take(0x182)
        assert data == rig.node._dictionary.upload(entry.index, entry.sub)
        rig.nmt(PRE_OPERATIONAL)
