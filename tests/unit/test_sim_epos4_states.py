"""Device states of a simulated EPOS4: option codes, STO and inputs, the wait for standstill, resets."""

from __future__ import annotations

import pytest
from sim_epos_rig import STEERING_4, TRACTION_4, Rig

from artemis.drive_states import DriveState
from artemis.sim.cia402_power import PATTERNS_402
from artemis.sim.epos4_errors import ERRORS_4
from artemis.sim.epos_errors import Reaction
from artemis.sim.epos_settings import Epos4Settings, SimSettings

SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE, RESET = 0x0006, 0x0007, 0x000F, 0x000B, 0x0000, 0x0080
DISABLED, READY, ON, ENABLED, STOPPED, REACTING, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08


def state(rig: Rig) -> int:
    """The statusword's bits of the device state (CiA 402)."""
    return rig.status & 0x6F


def driving(rpm: int = 2000, settings: SimSettings | None = None) -> Rig:
    rig = Rig(TRACTION_4, settings=settings)
    rig.enable(3)
    rig.write(0x60FF, 0, "i", rpm)
    rig.control(ENABLE)
    rig.run(1.0)
    assert rig.axis.velocity == pytest.approx(rpm, rel=0.01)
    return rig


def steps_in(rig: Rig, present: int, limit: float = 2.0) -> float:
    """How long it stays in a state [s]."""
    begun = rig.now
    while state(rig) == present and rig.now - begun < limit:
        rig.run(0.001)
    return rig.now - begun


def test_states_are_those_of_cia_402() -> None:
    rig = Rig(TRACTION_4)
    assert state(rig) == DISABLED
    rig.control(ENABLE)
    assert state(rig) == DISABLED, "there is no way from here"
    rig.control(SHUTDOWN)
    assert state(rig) == READY
    rig.control(SWITCH_ON)
    rig.run(0.01)
    assert state(rig) == ON
    rig.control(ENABLE)
    assert state(rig) == ENABLED
    rig.control(QUICK_STOP & ~0x01)
    assert state(rig) == STOPPED
    rig.run(2.0)
    assert state(rig) == STOPPED, "0x605A is 6: it stays"
    rig.control(ENABLE)
    assert state(rig) == ENABLED
    rig.control(DISABLE)
    assert state(rig) == DISABLED


def test_no_statusword_has_the_bits_of_the_first_generation() -> None:
    assert all(not pattern & 0x4100 for pattern in PATTERNS_402.values())


def test_enabling_measures_offsets_in_switched_on() -> None:
    rig = Rig(TRACTION_4, settings=SimSettings(measure_s=0.02))
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    assert state(rig) == ON
    rig.run(0.019)
    assert state(rig) == ON
    rig.run(0.002)
    assert state(rig) == ENABLED


def test_remote_shows_the_nmt_state() -> None:
    rig = Rig(TRACTION_4)
    assert not rig.status & 0x0200
    rig.nmt(1)
    assert rig.status & 0x0200


def test_shutdown_coasts_from_the_factory_and_ramps_when_told_to() -> None:
    rig = driving()
    rig.control(SHUTDOWN)
    assert state(rig) == READY
    rig.run(0.01)
    assert rig.axis.current == 0.0
    rig = driving()
    rig.write(0x605B, 0, "h", 1)
    rig.control(SHUTDOWN)
    assert steps_in(rig, ENABLED) == pytest.approx(2000 / 10000, abs=0.02)
    assert state(rig) == READY
    assert abs(rig.axis.velocity) < 30


def test_disabling_operation_ramps_from_the_factory_and_coasts_when_told_to() -> None:
    rig = driving()
    rig.write(0x6084, 0, "I", 4000)
    rig.control(SWITCH_ON)
    assert steps_in(rig, ENABLED) == pytest.approx(0.5, abs=0.02)
    assert state(rig) == ON
    rig = driving()
    rig.write(0x605C, 0, "h", 0)
    rig.control(SWITCH_ON)
    assert state(rig) == ON
    rig.run(0.01)
    assert rig.axis.velocity > 1000


def test_a_command_during_a_ramp_waits_but_for_a_harder_stop() -> None:
    rig = driving()
    rig.control(SWITCH_ON)
    rig.control(ENABLE)
    rig.run(0.1)
    assert state(rig) == ENABLED
    rig.run(0.4)
    assert state(rig) == ENABLED, "on, and enabled again"
    assert rig.axis.velocity > 100, "the profile velocity mode begins with its target"
    rig.control(SWITCH_ON)
    rig.control(DISABLE)
    assert state(rig) == DISABLED
    rig = driving()
    rig.control(SWITCH_ON)
    rig.control(QUICK_STOP & ~0x01)
    assert state(rig) == STOPPED


def test_leaving_operation_waits_for_standstill_and_not_for_ever() -> None:
    rig = driving()
    rig.axis.fail(braking=500.0)
    rig.write(0x30E0, 3, "H", 300)
    rig.control(SWITCH_ON)
    assert steps_in(rig, ENABLED) == pytest.approx(0.2 + 0.3, abs=0.02), "the ramp, and the time-out"
    assert abs(rig.axis.velocity) > 1000


@pytest.mark.parametrize(
    ("code", "index", "option", "ramp"),
    [
        (0x8611, 0x605E, 0, None),
        (0x8611, 0x605E, 1, 0x6084),
        (0x8611, 0x605E, 2, 0x6085),
        (0x8250, 0x6007, 2, None),
        (0x8250, 0x6007, 3, 0x6085),
        (0x2310, 0x605E, 2, None),
    ],
)
def test_errors_brake_as_the_option_codes_say(code: int, index: int, option: int, ramp: int | None) -> None:
    rig = driving()
    rig.write(index, 0, "h", option)
    for deceleration, value in ((0x6084, 4000), (0x6085, 8000)):
        rig.write(deceleration, 0, "I", value)
    rig.node.emergency(code, rig.now)
    assert state(rig) == REACTING
    time = {None: 0.001, 0x6084: 0.5, 0x6085: 0.25}[ramp]
    assert steps_in(rig, REACTING) == pytest.approx(time, abs=0.02)
    assert state(rig) == FAULT
    assert (abs(rig.axis.velocity) < 30) == (ramp is not None)


@pytest.mark.parametrize("code", sorted(ERRORS_4))
def test_every_error_leads_to_fault_and_is_reset_but_for_warnings(code: int) -> None:
    rig = Rig(TRACTION_4)
    rig.enable(3)
    rig.node.emergency(code, rig.now)
    rig.run(0.1)
    warning = ERRORS_4[code].reaction is Reaction.WARNING
    assert state(rig) == (ENABLED if warning else FAULT)
    assert bool(rig.status & 0x0080) == warning
    assert rig.read(0x603F, 0, "H") == code
    assert rig.read(0x1003, 1, "I") == code
    assert rig.read(0x1001, 0, "B") == ERRORS_4[code].register
    if code in (0x8120, 0x8130):
        rig.nmt(0x82)
        rig.run(0.25)
    rig.control(RESET)
    assert state(rig) == (ENABLED if warning else DISABLED)
    assert rig.read(0x603F, 0, "H") == 0


def test_clearing_the_history_takes_warnings_back() -> None:
    rig = Rig(TRACTION_4)
    rig.node.emergency(0xFF01, rig.now)
    assert rig.status & 0x0080
    rig.write(0x1003, 0, "B", 0)
    assert not rig.status & 0x0080


def test_older_firmware_takes_an_overload_for_an_error() -> None:
    rig = Rig(TRACTION_4, settings=SimSettings(epos4=Epos4Settings(overload_warns=False)))
    rig.enable(3)
    rig.node.emergency(0xFF01, rig.now)
    rig.run(0.01)
    assert state(rig) == FAULT


@pytest.mark.parametrize("code", [0x8120, 0x8130])
def test_errors_of_the_bus_wait_for_its_reset(code: int) -> None:
    rig = Rig(TRACTION_4)
    rig.node.emergency(code, rig.now)
    rig.run(0.01)
    for _ in range(2):
        rig.control(0)
        rig.control(RESET)
        assert state(rig) == FAULT
    rig.nmt(0x82)
    rig.run(0.25)
    rig.control(0)
    rig.control(RESET)
    assert state(rig) == DISABLED


# ---------------------------------------------------------------------------------------------- STO and inputs


def test_open_sto_keeps_a_drive_in_switch_on_disabled_without_an_error() -> None:
    rig = Rig(TRACTION_4)
    assert rig.read(0x3202, 1, "B") == 3
    rig.epos4.open_sto(True, rig.now)
    rig.control(SHUTDOWN)
    assert state(rig) == DISABLED
    assert rig.read(0x3202, 1, "B") == 0
    assert rig.emergencies() == []
    rig.epos4.open_sto(False, rig.now)
    rig.control(SHUTDOWN)
    assert state(rig) == READY
    rig.epos4.open_sto(True, rig.now)
    assert state(rig) == DISABLED


def test_sto_that_opens_in_operation_cuts_the_torque_and_is_an_error_until_it_closes() -> None:
    rig = driving()
    rig.epos4.open_sto(True, rig.now)
    rig.run(0.01)
    assert rig.emergencies() == [0x8A88]
    assert state(rig) == FAULT
    assert rig.axis.current == 0.0
    assert rig.axis.velocity > 1000, "it coasts"
    rig.control(RESET)
    assert state(rig) == FAULT
    rig.epos4.open_sto(False, rig.now)
    rig.control(0)
    rig.control(RESET)
    assert state(rig) == DISABLED


def test_a_drive_enable_input_is_needed_where_one_is_configured() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x3142, 3, "B", 27)
    rig.control(SHUTDOWN)
    assert state(rig) == DISABLED
    rig.epos4.set_input(2, True, rig.now)
    rig.enable(3)
    assert rig.read(0x60FD, 0, "I") == 1 << 27
    rig.epos4.set_input(2, False, rig.now)
    assert state(rig) == DISABLED
    assert rig.emergencies() == []


def test_a_quick_stop_input_stops() -> None:
    rig = driving()
    rig.write(0x3142, 4, "B", 28)
    rig.epos4.set_input(3, True, rig.now)
    assert state(rig) == STOPPED
    rig.run(0.5)
    assert rig.axis.velocity == 0.0


def test_an_inverted_input_is_active_when_it_is_low() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x3141, 2, "H", 0b100)
    assert rig.read(0x3141, 1, "H") == 0b100
    assert rig.read(0x60FD, 0, "I") == 1 << 2, "the home switch is input 3"


@pytest.mark.parametrize(("pin", "rpm", "code"), [(0, -500, 0x8A80), (1, 500, 0x8A81)])
def test_limit_switches_are_errors_in_their_own_direction(pin: int, rpm: int, code: int) -> None:
    rig = driving(-rpm)
    rig.epos4.set_input(pin, True, rig.now)
    rig.run(0.05)
    assert rig.emergencies() == [], "it moves away"
    rig.write(0x60FF, 0, "i", rpm)
    rig.control(ENABLE)
    rig.run(0.5)
    assert rig.emergencies() == [code]
    assert state(rig) == FAULT


def test_a_holding_brake_closes_before_the_power_goes() -> None:
    rig = Rig(STEERING_4)
    rig.write(0x3151, 1, "B", 24)
    rig.write(0x3158, 1, "H", 50)
    rig.enable(3)
    assert (rig.read(0x3158, 3, "B"), rig.read(0x3150, 1, "H") & 1) == (0, 1)
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.5)
    rig.control(SWITCH_ON)
    while not rig.read(0x3158, 3, "B"):
        rig.run(0.001)
    assert state(rig) == ENABLED
    assert steps_in(rig, ENABLED) == pytest.approx(0.05, abs=0.002)
    rig.axis.load_current = 5000.0
    rig.run(0.1)
    assert rig.axis.velocity == 0.0, "it is clamped"
    rig.control(ENABLE)
    rig.run(0.1)
    assert rig.axis.velocity != 0.0


def test_states_that_are_refused_are_not_entered() -> None:
    rig = Rig(TRACTION_4)
    accept = rig.node.failures.refuse_states(DriveState.OPERATION_ENABLE)
    rig.control(SHUTDOWN)
    rig.control(ENABLE)
    rig.run(0.05)
    assert state(rig) == READY
    accept()
    rig.control(ENABLE)
    rig.run(0.05)
    assert state(rig) == ENABLED
