"""Inputs, outputs, supply, temperature and memory of a simulated EPOS4."""

from __future__ import annotations

import pytest
from sim_epos_rig import STEERING_4, TRACTION_4, Rig

SAVE, LOAD = 0x65766173, 0x64616F6C


@pytest.mark.parametrize(
    ("voltage", "shown"),
    [(0.0, 0), (2.5, 2500), (-2.5, -2500), (5.002, 5000), (5.003, 5005), (12.0, 9995), (-12.0, -10000)],
)
def test_analog_inputs_have_12_bit_over_20_volts(voltage: float, shown: int) -> None:
    rig = Rig(TRACTION_4)
    rig.axis.analog = (voltage, 0.0)
    assert rig.read(0x3160, 1, "h") == shown
    assert rig.read(0x3162, 1, "h") == shown


def test_analog_inputs_are_adjusted() -> None:
    rig = Rig(TRACTION_4)
    rig.axis.analog = (0.0, 2.0)
    raw = rig.read(0x3160, 2, "h")
    rig.write(0x3163, 3, "h", -100)
    rig.write(0x3163, 4, "H", 20000)
    assert rig.read(0x3160, 2, "h") == 2 * (raw - 100)
    rig.write(0x3161, 2, "B", 255)
    assert rig.read(0x3162, 2, "h") == 0, "nobody's"


def test_the_supply_is_measured_in_tenths_of_a_volt_and_watched() -> None:
    rig = Rig(TRACTION_4)
    rig.axis.supply_voltage = 23.46
    assert rig.read(0x2200, 1, "H") == 235
    rig.enable(3)
    rig.axis.supply_voltage = 7.9
    rig.run(0.01)
    assert rig.emergencies() == [0x3220]
    rig.control(0x80)
    assert rig.status & 0x6F == 0x08, "the cause remains"
    rig.axis.supply_voltage = 24.0
    rig.control(0)
    rig.control(0x80)
    assert rig.status & 0x6F == 0x40
    rig.write(0x2201, 1, "I", 25000)
    rig.run(0.01)
    assert rig.emergencies() == [0x0000, 0x3220]


def test_supply_limits_that_were_not_stored_are_gone_after_a_restart() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x2201, 1, "I", 25000)
    rig.nmt(0x81)
    rig.run(0.25)
    rig.heard.clear()
    rig.run(0.1)
    assert rig.emergencies() == []


def test_the_power_stage_warms_with_its_current_and_switches_off_when_it_is_too_hot() -> None:
    rig = Rig(TRACTION_4)
    assert rig.read(0x3201, 1, "h") == 250
    rig.enable(3)
    rig.axis.load_current = 4000.0
    rig.run(5.0)
    assert 265 < rig.read(0x3201, 1, "h") < 285, "4 of 5 A for 5 s of 60"
    rig.epos4.periphery.ambient = 103.0
    rig.run(0.01)
    assert rig.emergencies() == [0x4210]
    rig.control(0x80)
    assert rig.status & 0x6F == 0x08, "it is still hot"
    rig.epos4.periphery.ambient = 40.0
    rig.control(0)
    rig.control(0x80)
    assert rig.status & 0x6F == 0x40


def test_the_limit_of_the_motor_current_is_shown() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x3001, 1, "I", 1000)
    rig.write(0x3001, 4, "H", 10)
    rig.enable(3)
    rig.axis.load_current = 2000.0
    rig.run(0.4)
    level = rig.read(0x3200, 1, "H")
    assert 50 < level <= 200
    rig.run(3.0)
    assert rig.read(0x3200, 1, "H") >= 99
    assert rig.status & 0x0800


def test_outputs_show_what_was_asked_of_them() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x60FE, 1, "I", 1 << 17)
    assert rig.read(0x3150, 1, "H") == 0b010
    rig.write(0x3150, 2, "H", 0b011)
    assert rig.read(0x3150, 1, "H") == 0b001


# ---------------------------------------------------------------------------------------------- memory


def test_what_is_stored_outlasts_a_reset() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x6085, 0, "I", 1234)
    rig.write(0x210C, 1, "I", 77)
    assert rig.refusal(0x1010, 1, "I", 1) == 0x08000020
    rig.write(0x1010, 1, "I", SAVE)
    rig.write(0x6085, 0, "I", 5)
    rig.node.power_off()
    rig.node.power_on(rig.now)
    rig.run(0.25)
    assert (rig.read(0x6085, 0, "I"), rig.read(0x210C, 1, "I")) == (1234, 77)


def test_restored_defaults_act_after_a_reset_and_erase_motor_data_and_gains() -> None:
    rig = Rig(TRACTION_4)
    for index, sub, value in ((0x3001, 5, 70500), (0x30A0, 1, 5), (0x30A2, 2, 6)):
        rig.write(index, sub, "I", value)
    rig.write(0x1010, 1, "I", SAVE)
    rig.nmt(1)
    assert rig.refusal(0x1011, 1, "I", LOAD) == 0x0F00FFC0
    rig.nmt(0x80)
    rig.enable(3)
    assert rig.refusal(0x1011, 1, "I", LOAD) == 0x08000022
    rig.control(0)
    rig.write(0x1011, 1, "I", LOAD)
    assert rig.read(0x3001, 5, "I") == 70500, "not before the reset"
    assert rig.read(0x1011, 1, "I") == 1
    rig.nmt(0x81)
    rig.run(0.25)
    assert (rig.read(0x3001, 5, "I"), rig.read(0x6076, 0, "I")) == (0, 0)
    assert (rig.read(0x30A0, 1, "I"), rig.read(0x30A2, 2, "I")) == (1171880, 500000)


def test_a_communication_reset_loads_the_objects_of_communication_again() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x1017, 0, "H", 100)
    rig.write(0x1029, 1, "B", 1)
    rig.write(0x6085, 0, "I", 1234)
    rig.nmt(0x82)
    rig.run(0.25)
    assert (rig.read(0x1017, 0, "H"), rig.read(0x1029, 1, "B")) == (0, 0)
    assert rig.read(0x6085, 0, "I") == 1234


def test_stored_identifiers_stay_when_the_node_id_changes() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x1010, 1, "I", SAVE)
    moved = TRACTION_4.model_copy(update={"node_id": 9})
    assert rig.read(0x1400, 1, "I") == 0x202
    assert Rig(moved).read(0x1400, 1, "I") == 0x209


def test_it_knows_no_node_guarding() -> None:
    rig = Rig(TRACTION_4)
    rig.send(0x702, rtr=True)
    assert rig.take(0x702) == []


@pytest.mark.parametrize(("behaviour", "operational"), [(0, False), (1, True)])
def test_the_nmt_state_after_a_lost_heartbeat_is_a_setting(behaviour: int, operational: bool) -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x1029, 1, "B", behaviour)
    rig.write(0x1016, 1, "I", 127 << 16 | 50)
    rig.nmt(1)
    rig.send(0x77F, b"\x05")
    rig.run(0.1)
    assert rig.emergencies() == [0x8130]
    assert bool(rig.status & 0x0200) == operational


def test_a_pdo_that_is_too_short_is_an_error() -> None:
    rig = Rig(TRACTION_4)
    rig.nmt(1)
    rig.send(0x502, b"\x06\0\0")
    assert rig.emergencies() == [0x8210]


def test_all_received_pdos_are_valid_from_the_factory() -> None:
    rig = Rig(TRACTION_4)
    rig.nmt(1)
    for identifier, data in ((0x202, b"\x06\0"), (0x302, b"\x06\0\x03"), (0x502, b"\x0f\0\xe8\x03\0\0")):
        rig.send(identifier, data)
    rig.run(0.5)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01), "target and controlword of one frame"


def test_an_ssi_encoder_shows_the_bits_that_are_clocked_in() -> None:
    rig = Rig(STEERING_4)
    rig.axis.encoder = 0x1ABCD, 17
    assert rig.read(0x60E4, 2, "i") == 0, "no such sensor from the factory"
    rig.write(0x3000, 1, "I", 0x301)
    assert rig.read(0x60E4, 2, "i") == 0x1ABCD >> 5, "12 bits from the factory"
    rig.write(0x3012, 0xB, "I", 17)
    assert rig.read(0x60E4, 2, "i") == rig.read(0x3012, 9, "I") == 0x1ABCD
    rig.write(0x3012, 0xB, "I", 18)
    assert rig.read(0x60E4, 2, "i") == 0x1ABCD << 1
    rig.heard.clear()
    rig.run(0.01)
    assert rig.emergencies() == []


def test_an_ssi_encoder_that_is_unplugged_is_an_error() -> None:
    rig = Rig(STEERING_4)
    rig.axis.encoder = 100, 12
    rig.write(0x3000, 1, "I", 0x301)
    rig.heard.clear()
    rig.run(0.01)
    assert rig.emergencies() == []
    rig.axis.encoder = None
    rig.run(0.01)
    assert rig.emergencies() == [0x738D]
    assert rig.read(0x60E4, 2, "i") == 0


def test_the_home_switch_is_at_the_input_that_has_its_function_from_the_factory() -> None:
    rig = Rig(STEERING_4)
    assert rig.read(0x60FD, 0, "I") == 0
    rig.axis.home = True
    assert (rig.read(0x60FD, 0, "I"), rig.read(0x3141, 1, "H")) == (1 << 2, 1 << 2)
    rig.write(0x3141, 2, "H", 1 << 2)
    assert rig.read(0x60FD, 0, "I") == 0, "low is active"


def test_an_input_has_its_stored_use_again_after_a_restart() -> None:
    rig = Rig(TRACTION_4)
    rig.epos4.set_input(0, True, rig.now)
    rig.write(0x3142, 1, "B", 20)
    rig.write(0x3141, 2, "H", 0b10)
    assert rig.read(0x60FD, 0, "I") == 1 << 20 | 1 << 1
    rig.nmt(0x81)
    rig.run(0.25)
    assert rig.read(0x60FD, 0, "I") == 1 << 0
