from __future__ import annotations

import math

import pytest
from sim_epos_rig import STEERING, TRACTION, Rig

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Nmt
from artemis.sim.epos_settings import SimSettings

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82


def silent(rig: Rig) -> bool:
    """Nobody answers SDO requests."""
    rig.send(0x600 + rig.id, bytes.fromhex("40 41 60 00 00 00 00 00"))
    return not rig.take(0x580 + rig.id)


def test_a_node_boots_up_into_pre_operational() -> None:
    rig = Rig(boot=False, settings=SimSettings(boot_time_s=0.05))
    assert rig.node.next_due == 0.05
    rig.run(0.049)
    assert rig.heard == []
    assert silent(rig)
    rig.run(0.002)
    ((time, frame),) = rig.heard
    assert time == pytest.approx(0.05, abs=0.001)
    assert frame == Frame(0x702, b"\0")
    assert rig.node.nmt is Nmt.PRE_OPERATIONAL
    assert rig.status == 0x0140


def test_a_node_without_power_is_unresponsive_and_mute() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 10)
    rig.enable()
    rig.heard.clear()
    rig.node.power_off()
    rig.run(0.1)
    assert silent(rig)
    assert rig.heard == []
    assert rig.node.next_due == math.inf


def test_whatever_happens_to_a_node_without_power_starts_no_timer() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 10)
    rig.node.power_off()
    rig.node.emergency(0x8130, rig.now)
    rig.node.poke(0x1017, 0, 20)
    rig.node.say(0x702, b"\x05", rig.now)
    assert rig.node.next_due == math.inf


def test_bit_9_of_the_statusword_is_the_operational_state() -> None:
    rig = Rig()
    rig.nmt(START, rig.id)
    assert rig.status & 0x0200
    rig.nmt(PRE_OPERATIONAL, rig.id)
    assert not rig.status & 0x0200


@pytest.mark.parametrize(("address", "obeyed"), [(0, True), (2, True), (3, False)])
def test_commands_are_for_one_node_or_for_all(address: int, obeyed: bool) -> None:
    rig = Rig()
    rig.nmt(START, address)
    assert (rig.node.nmt is Nmt.OPERATIONAL) is obeyed


def test_a_stopped_node_answers_no_sdo_and_sends_no_emergency_but_beats() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 10)
    rig.nmt(STOP)
    rig.run(0.002)
    rig.heard.clear()
    assert silent(rig)
    rig.node.emergency(0x1000, rig.now)
    rig.run(0.02)
    assert rig.emergencies() == []
    assert rig.take(0x702) == [b"\x04", b"\x04"]
    assert rig.state() is DriveState.FAULT


def test_the_power_state_machine_runs_in_pre_operational_too() -> None:
    rig = Rig()
    rig.enable()
    assert rig.node.nmt is Nmt.PRE_OPERATIONAL


def test_reset_node_is_like_a_power_cycle_with_the_stored_parameters() -> None:
    rig = Rig(STEERING)
    rig.write(0x6065, 0, "I", 5555)
    rig.write(0x1010, 1, "I", 0x65766173)
    rig.write(0x6065, 0, "I", 7777)
    rig.write(0x6083, 0, "I", 333)
    rig.enable(mode=-2)
    rig.write(0x206B, 0, "i", 2000)
    rig.run(0.3)
    rig.control(0x0000)
    rig.run(0.1)
    assert rig.node.read(0x6064) != 0
    rig.nmt(RESET_NODE)
    assert silent(rig)
    rig.run(0.06)
    assert rig.take(0x703) == [b"\0"]
    assert rig.status == 0x0140
    assert rig.read(0x6065, 0, "I") == 5555
    assert rig.read(0x6083, 0, "I") == 10000
    assert rig.read(0x6064, 0, "i") == 0
    assert rig.read(0x206B, 0, "i") == 0
    assert rig.read(0x6060, 0, "b") == 1


def test_a_power_cycle_starts_the_counter_at_0_and_leaves_the_shaft_where_it_is() -> None:
    rig = Rig()
    rig.axis.position = 1234.0
    rig.node.power_on(rig.now)
    rig.run(0.06)
    assert rig.axis.position == 1234.0
    assert rig.read(0x6064, 0, "i") == 0
    assert rig.read(0x2020, 0, "H") == 0


def test_unsaved_parameters_are_lost_with_the_power() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 100)
    rig.node.power_on(rig.now)
    rig.run(0.06)
    assert rig.read(0x1017, 0, "H") == 0


def test_reset_communication_keeps_the_drive_running_and_reloads_the_pdos() -> None:
    rig = Rig()
    rig.enable()
    rig.write(0x1800, 2, "B", 1)
    rig.write(0x6085, 0, "I", 777)
    rig.nmt(RESET_COMMUNICATION)
    rig.run(0.06)
    assert rig.take(0x702) == [b"\0"]
    assert rig.node.nmt is Nmt.PRE_OPERATIONAL
    assert rig.read(0x1800, 2, "B") == 255
    assert rig.read(0x6085, 0, "I") == 777
    assert rig.state() is DriveState.OPERATION_ENABLE


def test_restore_brings_the_factory_back_only_while_disabled() -> None:
    rig = Rig()
    rig.write(0x6065, 0, "I", 9999)
    rig.enable()
    assert rig.refusal(0x1011, 1, "I", 0x64616F6C) == 0x08000022
    rig.control(0)
    rig.write(0x1011, 1, "I", 0x64616F6C)
    assert rig.read(0x6065, 0, "I") == 2000
    assert rig.read(0x1011, 1, "I") == 1


@pytest.mark.parametrize("restart", ["reset node", "power"])
def test_restored_defaults_hold_after_the_restart_that_makes_them_valid(restart: str) -> None:
    rig = Rig()
    rig.write(0x6065, 0, "I", 9999)
    rig.write(0x200C, 1, "I", 42)
    rig.write(0x1010, 1, "I", 0x65766173)
    rig.write(0x1011, 1, "I", 0x64616F6C)
    if restart == "power":
        rig.node.power_on(rig.now)
    else:
        rig.nmt(RESET_NODE)
    rig.run(0.06)
    assert (rig.read(0x6065, 0, "I"), rig.read(0x200C, 1, "I")) == (2000, 0)


def test_restored_identifiers_wait_for_store_and_restart() -> None:
    rig = Rig()
    rig.write(0x1400, 1, "I", 0x333)
    rig.write(0x1010, 1, "I", 0x65766173)
    rig.write(0x1011, 5, "I", 0x64616F6C)
    assert rig.read(0x1400, 1, "I") == 0x202
    rig.nmt(START)
    rig.send(0x333, b"\x06\0")
    assert rig.state() is DriveState.READY
    rig.write(0x1010, 1, "I", 0x65766173)
    rig.nmt(RESET_NODE)
    rig.run(0.06)
    rig.nmt(START)
    rig.send(0x333, b"\x06\0")
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
    rig.send(0x202, b"\x06\0")
    assert rig.state() is DriveState.READY


@pytest.mark.parametrize(("index", "sub"), [(0x1010, 1), (0x1011, 1), (0x1011, 5)])
def test_a_wrong_signature_is_refused(index: int, sub: int) -> None:
    assert Rig().refusal(index, sub, "I", 1) == 0x08000020


def test_a_reset_forgets_the_watch_of_before() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 60)
    rig.write(0x100C, 0, "H", 60)
    rig.write(0x100D, 0, "B", 1)
    rig.send(0x77F, b"\x05")
    rig.send(0x702, rtr=True)
    rig.run(0.03)
    rig.nmt(RESET_NODE)
    rig.run(0.2)
    assert rig.emergencies() == []
    assert rig.status == 0x0140


def test_a_node_that_initialises_has_no_errors() -> None:
    rig = Rig(boot=False)
    rig.node.emergency(0x1000, 0.0)
    rig.axis.supply_voltage = 0.0
    rig.run(0.01)
    rig.axis.supply_voltage = 24.0
    rig.run(0.05)
    assert rig.emergencies() == []
    assert rig.status == 0x0140


# ---------------------------------------------------------------------------------------------- heartbeats, guarding


def test_heartbeats_start_at_once_and_tell_the_state() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 50)
    rig.run(0.101)
    rig.nmt(START)
    rig.run(0.05)
    assert [(round(time, 3), frame.data) for time, frame in rig.heard if frame.id == 0x702] == [
        (0.061, b"\x7f"),
        (0.11, b"\x7f"),
        (0.16, b"\x7f"),
        (0.21, b"\x05"),
    ]


def test_the_consumer_waits_for_the_first_heartbeat() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.run(1.0)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize("sub", [1, 2])
def test_silence_of_a_producer_is_an_error(sub: int) -> None:
    rig = Rig()
    rig.write(0x1016, sub, "I", 127 << 16 | 200)
    for _ in range(5):
        rig.send(0x77F, b"\x05")
        rig.run(0.15)
    rig.send(0x77F, b"\x05")
    rig.run(0.199)
    assert rig.emergencies() == []
    rig.run(0.003)
    assert rig.emergencies() == [0x8130]
    rig.run(0.5)
    assert rig.emergencies() == []
    assert rig.state() is DriveState.FAULT


def test_a_moving_drive_ramps_down_when_the_host_falls_silent() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.write(0x6085, 0, "I", 5000)
    rig.send(0x77F, b"\x05")
    rig.enable()
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(0x000F)
    rig.run(0.185)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)
    rig.run(0.1)
    assert rig.state() is DriveState.FAULT_REACTION_ENABLED
    assert 400.0 < rig.axis.velocity < 700.0
    rig.run(0.2)
    assert rig.state() is DriveState.FAULT
    assert abs(rig.axis.velocity) < 50.0


def test_after_a_time_out_watching_begins_with_the_next_heartbeat() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.send(0x77F, b"\x05")
    rig.run(0.3)
    rig.control(0x0080)
    assert rig.status == 0x0140
    rig.run(1.0)
    assert rig.status == 0x0140
    rig.emergencies()
    rig.send(0x77F, b"\x05")
    rig.run(0.3)
    assert rig.emergencies() == [0x8130]


def test_an_entry_that_is_switched_off_watches_nobody() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.send(0x77F, b"\x05")
    rig.write(0x1016, 1, "I", 0)
    rig.run(0.5)
    assert rig.status == 0x0140


def test_writing_the_same_entry_again_does_not_stop_the_watch() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.send(0x77F, b"\x05")
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.run(0.3)
    assert rig.emergencies() == [0x8130]


@pytest.mark.parametrize("value", [1 << 24 | 127 << 16 | 200, 128 << 16 | 200, 200])
def test_an_impossible_consumer_entry_is_refused(value: int) -> None:
    assert Rig().refusal(0x1016, 1, "I", value) == 0x06090030


def test_one_producer_cannot_be_watched_twice() -> None:
    rig = Rig()
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    assert rig.refusal(0x1016, 2, "I", 127 << 16 | 500) == 0x06040043


def test_guarding_answers_with_the_state_and_a_toggle() -> None:
    rig = Rig()
    for command in (0, 0, START, START, STOP):
        rig.nmt(command)
        rig.send(0x702, rtr=True)
    assert rig.take(0x702) == [b"\x7f", b"\xff", b"\x05", b"\x85", b"\x04"]


def test_a_heartbeat_replaces_guarding() -> None:
    rig = Rig()
    rig.write(0x1017, 0, "H", 1000)
    rig.run(0.002)
    rig.heard.clear()
    rig.send(0x702, rtr=True)
    assert rig.heard == []


def test_life_guarding_misses_the_master_after_guard_time_times_factor() -> None:
    rig = Rig()
    rig.write(0x100C, 0, "H", 100)
    rig.write(0x100D, 0, "B", 3)
    rig.run(1.0)
    assert rig.emergencies() == []
    rig.send(0x702, rtr=True)
    rig.run(0.298)
    assert rig.emergencies() == []
    rig.run(0.004)
    assert rig.emergencies() == [0x8130]


def test_the_next_timer_is_known() -> None:
    rig = Rig(TRACTION)
    assert rig.node.next_due == math.inf
    rig.write(0x1016, 1, "I", 127 << 16 | 200)
    rig.send(0x77F, b"\x05")
    assert rig.node.next_due == pytest.approx(rig.now + 0.2)
    rig.write(0x1017, 0, "H", 100)
    rig.run(0.001)
    assert rig.node.next_due == pytest.approx(rig.now + 0.1, abs=0.0011)


def test_foreign_frames_do_nothing() -> None:
    rig = Rig()
    rig.nmt(START)
    rig.heard.clear()
    for identifier in (0x081, 0x181, 0x281, 0x203, 0x303, 0x583, 0x603, 0x701, 0x77F, 0x7FF):
        rig.send(identifier, bytes(8))
    assert rig.heard == []
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


def test_a_short_or_remote_nmt_frame_is_ignored() -> None:
    rig = Rig()
    rig.send(0x000, b"\x01")
    rig.send(0x000, rtr=True)
    assert rig.node.nmt is Nmt.PRE_OPERATIONAL
