from __future__ import annotations

import itertools

import pytest
from sim_epos_rig import STEERING, Rig

from artemis.drive_states import DriveState
from artemis.sim.epos_errors import ERRORS, HISTORY_LENGTH, Reaction
from artemis.sim.epos_power import PATTERNS, TRANSITIONS, DeviceCommand, command_of
from artemis.sim.epos_settings import SimSettings

SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE = 0x0006, 0x0007, 0x000F, 0x000B, 0x0000
MASK = 0x417F


def moving(rpm: int = 1000) -> Rig:
    rig = Rig()
    rig.enable()
    rig.write(0x60FF, 0, "i", rpm)
    rig.control(ENABLE)
    rig.run(0.3)
    return rig


def in_state(state: DriveState) -> Rig:
    """A drive that was brought to a state the way a client would."""
    rig = Rig()
    if state is DriveState.SWITCH_ON_DISABLED:
        return rig
    if state is DriveState.FAULT:
        rig.node.emergency(0x1000, rig.now)
        rig.run(0.002)
        return rig
    rig.control(SHUTDOWN)
    if state is DriveState.SWITCHED_ON:
        rig.control(SWITCH_ON)
    elif state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE):
        rig.enable()
        if state is DriveState.QUICK_STOP_ACTIVE:
            rig.control(QUICK_STOP)
    return rig


STABLE = [
    DriveState.SWITCH_ON_DISABLED,
    DriveState.READY,
    DriveState.SWITCHED_ON,
    DriveState.OPERATION_ENABLE,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT,
]
DISABLED, READY, ON, OPERATING, STOPPING, FAULT = STABLE
# Rows: state; columns: what Shutdown, Switch On, Enable, Quick Stop and Disable Voltage lead to in the end.
EXPECTED = {
    DISABLED: (READY, DISABLED, DISABLED, DISABLED, DISABLED),
    READY: (READY, ON, OPERATING, DISABLED, DISABLED),
    ON: (READY, ON, OPERATING, DISABLED, DISABLED),
    OPERATING: (READY, ON, OPERATING, STOPPING, DISABLED),
    STOPPING: (STOPPING, STOPPING, OPERATING, STOPPING, DISABLED),
    FAULT: (FAULT, FAULT, FAULT, FAULT, FAULT),
}


@pytest.mark.parametrize("state", STABLE)
@pytest.mark.parametrize("column", range(5))
def test_every_command_in_every_state(state: DriveState, column: int) -> None:
    rig = in_state(state)
    assert rig.state() is state
    rig.control((SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE)[column])
    rig.run(0.02)
    assert rig.state() is EXPECTED[state][column]
    assert rig.status & MASK == PATTERNS[rig.state()]


def test_controlwords_are_told_apart_by_their_low_byte() -> None:
    for word in range(0x100):
        bits = [word >> n & 1 for n in range(8)]
        expected = None
        if bits[7]:
            pass
        elif not bits[1]:
            expected = DeviceCommand.DISABLE_VOLTAGE
        elif not bits[2]:
            expected = DeviceCommand.QUICK_STOP
        elif bits[0]:
            expected = DeviceCommand.ENABLE if bits[3] else DeviceCommand.SWITCH_ON
        else:
            expected = DeviceCommand.SHUTDOWN
        assert command_of(word | 0x100) is expected


def test_each_state_has_its_own_pattern() -> None:
    assert len(set(PATTERNS.values())) == len(PATTERNS) == len(DriveState) - 1  # all but UNKNOWN
    assert {state for state, _ in TRANSITIONS} <= set(PATTERNS)


def test_enabling_passes_refresh_and_measure_init() -> None:
    rig = Rig(settings=SimSettings(refresh_s=0.004, measure_s=0.006))
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    seen = []
    for _ in range(12):
        seen.append(rig.status & MASK)
        rig.run(0.001)
    assert [(word, len(list(group))) for word, group in itertools.groupby(seen)] == [
        (0x4123, 4),
        (0x4133, 6),
        (0x0137, 2),
    ]


def test_a_command_during_enabling_waits_for_its_end() -> None:
    rig = Rig()
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    rig.control(DISABLE)
    rig.run(0.005)
    assert rig.status & MASK == 0x4133
    rig.run(0.01)
    assert rig.status & MASK == 0x0140


def test_a_late_owner_still_gets_through_enabling_at_once() -> None:
    rig = Rig()
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    rig.node.advance(rig.now + 1.0)
    assert rig.state() is DriveState.OPERATION_ENABLE


def test_a_retained_target_spins_the_motor_at_enable() -> None:
    rig = moving()
    rig.control(DISABLE)
    rig.run(5.0)
    assert rig.axis.velocity == 0.0
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    rig.run(0.3)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


def test_disable_voltage_lets_the_shaft_coast() -> None:
    rig = moving()
    rig.control(DISABLE)
    rig.run(0.2)
    assert 800.0 < rig.axis.velocity < 1000.0
    assert rig.read(0x6078, 0, "h") == 0


def test_quick_stop_ramps_with_its_own_deceleration_and_never_ends_by_itself() -> None:
    rig = moving()
    rig.write(0x6085, 0, "I", 4000)
    rig.control(QUICK_STOP)
    rig.run(0.1)
    assert rig.axis.velocity == pytest.approx(600.0, abs=20.0)
    rig.run(10.0)
    assert rig.axis.velocity == 0.0
    assert rig.status & MASK == 0x0117
    assert not rig.status & 0x0020


def test_a_stopped_axis_resists_a_push() -> None:
    rig = moving()
    rig.control(QUICK_STOP)
    rig.run(1.0)
    rig.axis.load_current = 800.0
    rig.run(1.0)
    assert rig.axis.velocity == 0.0
    assert rig.read(0x6078, 0, "h") == 800


def test_enable_operation_leaves_quick_stop_and_moves_again() -> None:
    rig = moving()
    rig.control(QUICK_STOP)
    rig.run(0.5)
    rig.control(ENABLE)
    rig.run(0.5)
    assert rig.status & MASK == 0x0137
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


def test_set_points_are_not_obeyed_during_a_quick_stop() -> None:
    rig = moving()
    rig.control(QUICK_STOP)
    rig.write(0x60FF, 0, "i", 2000)
    rig.control(QUICK_STOP)
    rig.run(0.5)
    assert rig.axis.velocity == 0.0


# ---------------------------------------------------------------------------------------------- faults


@pytest.mark.parametrize("code", sorted(ERRORS))
def test_every_error_has_its_documented_reaction_when_enabled(code: int) -> None:
    rig = moving()
    rig.take(0x82)
    rig.node.emergency(code, rig.now)
    (data,) = rig.take(0x82)
    assert data == code.to_bytes(2, "little") + bytes((ERRORS[code].register,)) + bytes(5)
    state = rig.status & MASK
    reaction = ERRORS[code].reaction
    expected = {Reaction.POWER_OFF: 0x010F, Reaction.QUICK_STOP: 0x011F, Reaction.NONE: 0x0137}
    assert state == expected[reaction]
    rig.run(0.2)
    assert rig.status & MASK == (0x0137 if reaction is Reaction.NONE else 0x0108)
    slow = abs(rig.axis.velocity) < 100.0
    assert slow is (reaction is Reaction.QUICK_STOP)


@pytest.mark.parametrize("state", [DISABLED, READY, ON])
def test_a_ramp_error_in_a_disabled_state_cuts_the_power(state: DriveState) -> None:
    rig = in_state(state)
    rig.node.emergency(0x8130, rig.now)
    assert rig.status & MASK == 0x010F
    rig.run(0.002)
    assert rig.status & MASK == 0x0108


def test_an_error_while_enabling_cuts_the_power() -> None:
    rig = Rig()
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    rig.run(0.006)
    rig.node.emergency(0x8130, rig.now)
    rig.run(0.02)
    assert rig.status & MASK == 0x0108


def test_a_hard_error_during_a_fault_ramp_cuts_the_power() -> None:
    rig = moving()
    rig.node.emergency(0x8611, rig.now)
    rig.run(0.01)
    assert rig.status & MASK == 0x011F
    rig.node.emergency(0x8120, rig.now)
    assert rig.status & MASK == 0x011F
    rig.node.emergency(0x2310, rig.now)
    assert rig.status & MASK == 0x010F
    rig.run(0.05)
    assert rig.axis.velocity > 500.0
    assert rig.emergencies() == [0x8611, 0x8120, 0x2310]
    assert rig.read(0x1001, 0, "B") == 0x20 | 0x10 | 0x02


def test_an_error_out_of_the_table_is_generic() -> None:
    rig = Rig()
    rig.node.emergency(0x1234, rig.now)
    rig.run(0.002)
    assert rig.status & MASK == 0x0108
    assert rig.read(0x1001, 0, "B") == 0x01
    assert rig.read(0x1003, 1, "I") == 0x1234


def test_an_error_is_told_once_until_it_is_reset() -> None:
    rig = Rig()
    rig.node.emergency(0x1000, rig.now)
    rig.node.emergency(0x1000, rig.now)
    assert rig.read(0x1003, 0, "B") == 1
    assert rig.emergencies() == [0x1000]
    rig.run(0.002)
    rig.control(0x0080)
    rig.node.emergency(0x1000, rig.now)
    assert rig.emergencies() == [0x0000, 0x1000]


def test_a_fault_reset_is_a_rising_edge_of_bit_7() -> None:
    rig = in_state(DriveState.FAULT)
    rig.control(0x8000)
    assert rig.status & MASK == 0x0108
    rig.control(0x0080)
    assert rig.status & MASK == 0x0140
    assert rig.emergencies() == [0x1000, 0x0000]
    assert rig.read(0x1001, 0, "B") == 0
    rig.node.emergency(0x1000, rig.now)
    rig.run(0.002)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0108, "bit 7 was still set"
    rig.control(0x0000)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0140


def test_every_edge_of_bit_7_counts_however_often_it_came_for_nothing() -> None:
    rig = moving()
    for word in (0x008F, ENABLE, ENABLE, 0x008F, ENABLE):
        rig.control(word)
    rig.node.emergency(0x8150, rig.now)
    rig.control(0x008F)
    assert rig.emergencies() == [0x8150, 0x0000]


def test_a_fault_reset_is_refused_while_the_cause_remains() -> None:
    rig = Rig()
    rig.axis.supply_voltage = 35.0
    rig.run(0.01)
    assert rig.emergencies() == [0x3210]
    rig.control(0x0080)
    assert rig.status & MASK == 0x0108
    rig.axis.supply_voltage = 24.0
    rig.control(0x0000)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0140


def test_under_voltage_cuts_the_power() -> None:
    rig = moving()
    rig.axis.supply_voltage = 5.0
    rig.run(0.002)
    assert rig.emergencies() == [0x3220]
    assert rig.status & MASK == 0x0108


def test_can_passive_asks_for_a_communication_reset_first() -> None:
    rig = Rig()
    rig.node.emergency(0x8120, rig.now)
    rig.run(0.002)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0108
    rig.nmt(0x82)
    rig.run(0.06)
    rig.control(0x0000)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0140


def test_a_missing_hall_sensor_asks_for_a_node_reset() -> None:
    rig = Rig()
    rig.node.emergency(0xFF04, rig.now)
    rig.run(0.002)
    rig.nmt(0x82)
    rig.run(0.06)
    rig.control(0x0080)
    assert rig.status & MASK == 0x0108
    rig.nmt(0x81)
    rig.run(0.06)
    assert rig.status & MASK == 0x0140


def test_an_error_without_reaction_is_reset_in_passing() -> None:
    rig = moving()
    rig.node.emergency(0x8150, rig.now)
    rig.control(0x008F)
    rig.control(ENABLE)
    assert rig.emergencies() == [0x8150, 0x0000]
    assert rig.status & MASK == 0x0137
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


def test_a_fault_reset_during_the_reaction_changes_nothing() -> None:
    rig = moving()
    rig.node.emergency(0x8611, rig.now)
    rig.control(0x0080)
    rig.run(0.01)
    assert rig.status & MASK == 0x011F
    rig.run(0.2)
    assert rig.status & MASK == 0x0108


def test_a_new_error_in_fault_is_told_and_noted() -> None:
    rig = in_state(DriveState.FAULT)
    rig.node.emergency(0x2310, rig.now)
    assert rig.emergencies() == [0x1000, 0x2310]
    assert rig.read(0x1003, 1, "I") == 0x2310
    assert rig.status & MASK == 0x0108


def test_the_history_keeps_the_newest_first_and_is_cleared_by_0() -> None:
    rig = Rig()
    codes = [0x1000, 0x2310, 0x8110, 0x8210, 0xFF01, 0xFF08]
    for code in codes:
        rig.node.emergency(code, rig.now)
    assert rig.read(0x1003, 0, "B") == HISTORY_LENGTH
    assert [rig.read(0x1003, place, "I") for place in range(1, 6)] == codes[:0:-1]
    assert rig.refusal(0x1003, 0, "B", 1) == 0x06090030
    rig.write(0x1003, 0, "B", 0)
    assert rig.read(0x1003, 0, "B") == 0
    assert rig.read(0x1003, 1, "I") == 0


def test_motor_objects_are_locked_while_the_power_stage_is_on() -> None:
    for state in STABLE:
        rig = in_state(state)
        locked = state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE)
        assert rig.refusal(0x6410, 3, "B", 12) == (0x08000022 if locked else 0)


def test_hall_sensors_need_a_block_commutated_motor() -> None:
    rig = Rig(STEERING)
    assert rig.refusal(0x2210, 2, "H", 3) == 0x06040043
    rig.write(0x6402, 0, "H", 11)
    rig.write(0x2210, 2, "H", 3)
    assert rig.refusal(0x6402, 0, "H", 10) == 0x06040043


def test_an_error_without_power_goes_nowhere() -> None:
    rig = Rig()
    rig.node.power_off()
    rig.node.emergency(0x1000, rig.now)
    assert rig.node.outbox == []
    assert rig.node.read(0x1001) == 0
