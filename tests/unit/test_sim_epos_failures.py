"""What a simulated drive can be made to do wrong, and that it ends when it is ended."""

from __future__ import annotations

import pytest
from sim_epos_rig import Aborted, Rig

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Nmt
from artemis.sim.dictionary import AccessRefused
from artemis.sim.epos_failures import Speech, kind_of

START = 0x01
HOST = 127


def running() -> Rig:
    """Operational, with a PDO for each SYNC: statusword and position; the host's heartbeat is watched."""
    rig = Rig()
    rig.map(0x1A00, 0x60410010, 0x60640020)
    rig.write(0x1800, 2, "B", 1)
    rig.write(0x1017, 0, "H", 100)
    rig.write(0x1016, 1, "I", HOST << 16 | 200)
    rig.nmt(START)
    rig.heard.clear()
    return rig


def sync(rig: Rig, times: int = 1) -> list[tuple[int, int]]:
    """Statusword and position of each PDO that comes for so many SYNCs."""
    for _ in range(times):
        rig.run(0.02)
        rig.send(0x080)
    pdos = rig.take(0x180 + rig.id)
    return [(int.from_bytes(p[:2], "little"), int.from_bytes(p[2:], "little", signed=True)) for p in pdos]


def alive(rig: Rig, seconds: float) -> None:
    """Let time pass with the host's heartbeat."""
    for _ in range(round(seconds / 0.04)):
        rig.send(0x700 + HOST, b"\x05")
        rig.run(0.04)


# ---------------------------------------------------------------------------------------------- what it says


@pytest.mark.parametrize(
    ("identifier", "kind"),
    [
        (0x081, Speech.EMERGENCY),
        (0x181, Speech.PROCESS_DATA),
        (0x57F, Speech.PROCESS_DATA),
        (0x581, Speech.SDO),
        (0x701, Speech.HEARTBEAT),
    ],
)
def test_frames_are_of_four_kinds(identifier: int, kind: Speech) -> None:
    assert kind_of(Frame(identifier)) is kind


def test_so_many_feedback_frames_are_missing() -> None:
    rig = running()
    rig.node.failures.impede(Speech.PROCESS_DATA, count=3)
    assert len(sync(rig, 3)) == 0
    assert len(sync(rig, 2)) == 2


def test_muted_kinds_stay_mute_until_they_are_freed_and_others_speak() -> None:
    rig = running()
    free = rig.node.failures.impede(Speech.HEARTBEAT)
    rig.run(0.5)
    assert rig.take(0x700 + rig.id) == []
    assert len(sync(rig)) == 1
    free()
    rig.run(0.25)
    assert len(rig.take(0x700 + rig.id)) == 2


def test_sdo_answers_come_late_or_twice() -> None:
    rig = running()
    request = bytes.fromhex("40 00 10 00 00 00 00 00")
    undo = rig.node.failures.impede(Speech.SDO, copies=1, late=0.08)
    rig.heard.clear()
    rig.send(0x600 + rig.id, request)
    (late,) = rig.heard
    assert late[0] == pytest.approx(rig.now + 0.0803)
    undo()
    rig.node.failures.impede(Speech.SDO, copies=2, count=1)
    rig.heard.clear()
    rig.send(0x600 + rig.id, request)
    rig.send(0x600 + rig.id, request)
    assert len(rig.take(0x580 + rig.id)) == 3


def test_frames_that_change_content_are_muted_too() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.run(0.01)
    rig.heard.clear()
    rig.node.failures.impede(Speech.PROCESS_DATA)
    rig.control(0x0006)  # TPDO 1 is sent when the statusword changes
    assert rig.take(0x180 + rig.id) == []


def test_unheard_error_is_an_error_all_the_same() -> None:
    rig = running()
    rig.enable()
    rig.heard.clear()
    rig.node.emergency(0x2310, rig.now, heard=False)
    rig.run(0.01)
    assert rig.emergencies() == []
    assert rig.state() is DriveState.FAULT
    assert rig.read(0x1003, 1, "I") == 0x2310
    rig.control(0x0080)
    assert rig.emergencies() == [0]  # the next one is heard


def test_unheard_error_that_would_not_be_sent_swallows_no_later_one() -> None:
    rig = running()
    rig.node.emergency(0x8611, rig.now)
    rig.emergencies()
    rig.node.emergency(0x8611, rig.now, heard=False)  # active already: no new event
    rig.node.emergency(0x2310, rig.now)
    assert rig.emergencies() == [0x2310]


def test_drive_says_what_nothing_asked_for() -> None:
    rig = running()
    rig.node.say(0x080 + rig.id, b"\x10\x23", rig.now)
    assert rig.node.next_due <= rig.now
    assert rig.take(0x080 + rig.id) == [b"\x10\x23"]


# ---------------------------------------------------------------------------------------------- objects


def test_misreported_object_lies_in_pdos_and_over_sdo_until_told_not_to() -> None:
    rig = running()
    true = rig.node.failures.misreport(0x6041, 0, lambda word: word ^ 0x0041)
    assert rig.read(0x6041, 0, "H") == 0x0340 ^ 0x0041
    assert sync(rig) == [(0x0340 ^ 0x0041, 0)]
    true()
    assert rig.read(0x6041, 0, "H") == 0x0340
    assert sync(rig) == [(0x0340, 0)]


@pytest.mark.parametrize("bit", [0, 20, 31])
def test_misreported_position_is_cut_to_its_32_bits(bit: int) -> None:
    rig = running()
    rig.node.failures.misreport(0x6064, 0, lambda position: position ^ 1 << bit)
    ((_, position),) = sync(rig)
    assert position & 0xFFFFFFFF == 1 << bit


def test_misreporting_an_object_without_getter_leaves_its_value() -> None:
    rig = running()
    rig.write(0x6085, 0, "I", 7000)
    true = rig.node.failures.misreport(0x6085, 0, lambda value: value + 1)
    assert rig.read(0x6085, 0, "I") == 7001
    true()
    assert rig.read(0x6085, 0, "I") == 7000


def test_set_points_that_wait_for_a_sync_survive_a_lie() -> None:
    rig = Rig()
    rig.write(0x1403, 2, "B", 1)
    rig.nmt(START)
    rig.send(0x500 + rig.id, b"\x06\x00" + (300).to_bytes(4, "little"))
    rig.node.failures.misreport(0x6061, 0, lambda _: 1)
    rig.send(0x080)
    assert rig.read(0x60FF, 0, "i") == 300


def test_object_is_refused_with_any_code_so_often() -> None:
    rig = running()
    rig.node.failures.refuse_object(0x6085, 0, 0x08000021, count=2)
    assert rig.refusal(0x6085, 0, "I", 5000) == 0x08000021
    with pytest.raises(Aborted, match="0x08000021"):
        rig.read(0x6085, 0, "I")
    assert rig.refusal(0x6085, 0, "I", 5000) == 0
    accept = rig.node.failures.refuse_object(0x6085, 0, 0x06090030)
    assert [rig.refusal(0x6085, 0, "I", 5000) for _ in range(3)] == [0x06090030] * 3
    accept()
    assert rig.refusal(0x6085, 0, "I", 5000) == 0


def test_ignored_write_is_confirmed_and_not_kept() -> None:
    rig = running()
    rig.write(0x6085, 0, "I", 5000)
    keep = rig.node.failures.ignore_writes(0x6085, 0)
    rig.write(0x6085, 0, "I", 6000)
    assert rig.read(0x6085, 0, "I") == 5000
    keep()
    rig.write(0x6085, 0, "I", 6000)
    assert rig.read(0x6085, 0, "I") == 6000


def test_unknown_objects_cannot_fail() -> None:
    failures = Rig().node.failures
    for act in (failures.ignore_writes, lambda i, s: failures.refuse_object(i, s, 1)):
        with pytest.raises(AccessRefused):
            act(0x5FFF, 0)


# ---------------------------------------------------------------------------------------------- states


def test_refused_state_is_not_entered_and_later_is() -> None:
    rig = running()
    obey = rig.node.failures.refuse_states(DriveState.REFRESH)
    for word in (0x0006, 0x0007, 0x000F, 0x000F):
        rig.control(word)
    rig.run(0.05)
    assert rig.state() is DriveState.SWITCHED_ON
    obey()
    rig.control(0x000F)
    rig.run(0.05)
    assert rig.state() is DriveState.OPERATION_ENABLE


def test_refused_quick_stop_lets_it_run() -> None:
    rig = running()
    rig.enable()
    rig.node.failures.refuse_states(DriveState.QUICK_STOP_ACTIVE)
    rig.control(0x000B)
    assert rig.state() is DriveState.OPERATION_ENABLE


def test_refused_fault_reset() -> None:
    rig = running()
    rig.node.emergency(0x2310, rig.now)
    rig.run(0.01)
    rig.node.failures.refuse_states(DriveState.SWITCH_ON_DISABLED)
    rig.control(0x0080)
    assert rig.state() is DriveState.FAULT


@pytest.mark.parametrize("state", [DriveState.SWITCH_ON_DISABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT])
def test_forced_state_shows_in_the_statusword_and_sends_nothing(state: DriveState) -> None:
    rig = running()
    rig.enable()
    rig.heard.clear()
    rig.node.failures.force_state(state)
    assert rig.state() is state
    assert rig.emergencies() == []
    ((status, _),) = sync(rig)
    assert status & 0x006F == {"switch on disabled": 0x40, "quick stop active": 0x07, "fault": 0x08}[state.value]


def test_nmt_state_changes_by_itself() -> None:
    rig = running()
    rig.node.change_nmt(Nmt.PRE_OPERATIONAL, rig.now)
    assert sync(rig) == []
    rig.run(0.2)
    assert set(rig.take(0x700 + rig.id)) == {b"\x7f"}


def test_drive_that_ignores_heartbeats_misses_none() -> None:
    rig = running()
    alive(rig, 0.4)
    watch = rig.node.failures.ignore_heartbeats()
    rig.run(1.0)
    assert rig.emergencies() == []
    watch()
    alive(rig, 0.4)
    rig.run(0.3)
    assert rig.emergencies() == [0x8130]


def test_ignoring_outlasts_a_restart_and_a_new_setting() -> None:
    rig = running()
    rig.node.failures.ignore_heartbeats()
    rig.nmt(0x82)
    rig.run(0.1)
    rig.write(0x1016, 1, "I", HOST << 16 | 100)
    alive(rig, 0.2)
    rig.run(0.5)
    assert rig.emergencies() == []


def test_counter_goes_on_from_anywhere_and_wraps() -> None:
    rig = running()
    rig.node.failures.count_on_from((1 << 31) - 5)
    assert sync(rig)[0][1] == (1 << 31) - 5
    rig.axis.position += 10
    assert sync(rig)[0][1] == 5 - (1 << 31)
