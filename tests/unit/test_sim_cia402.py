"""A simulated drive of the profile CiA 402: objects, units and option codes of the robot file, the profile's states."""

from __future__ import annotations

from typing import Any

import pytest
from sim_epos_rig import STEERING, TRACTION, Rig

from artemis.drive_schema import Drive
from artemis.drive_states import DriveState, Nmt
from artemis.families.cia402 import Cia402

VENDOR = 0x12345678
ABSENT, RANGE, IN_USE, READ_ONLY = 0x06020000, 0x06090030, 0x06010000, 0x06010002
RPM, RPM_S = 10.0, 0.5
"""Units per rpm and per rpm/s."""


def described(drive: Drive = TRACTION, **words: object) -> Drive:
    """The same motor at a drive that the robot file describes."""
    mode = 3 if drive.role == "traction" else 8
    given = {
        "vendor_id": VENDOR,
        "operating_mode": mode,
        "velocity_units_per_rpm": RPM,
        "acceleration_units_per_rpm_s": RPM_S,
        **words,
    }
    changes = {"family": "cia402", "hardware_version": 0x00020001, "min_firmware": 0x00010004}
    return drive.model_copy(update={**changes, "cia402": Cia402.model_validate(given)})


def codes(abort: int | None = None, quick: int | None = None, fault: int | None = None) -> dict[str, Any]:
    return {"option_codes": {"abort_connection": abort, "quick_stop": quick, "fault_reaction": fault}}


def running(rpm: float = 1000.0, **words: Any) -> Rig:  # noqa: ANN401 (words of a description)
    """In profile velocity mode, at this speed, with ramps of 2000 rpm/s, in a quick stop of 8000 rpm/s."""
    rig = Rig(described(**words))
    for index, ramp in ((0x6083, 100_000.0), (0x6084, 2000.0), (0x6085, 8000.0)):
        rig.write(index, 0, "I", round(ramp * RPM_S))
    for code, value in rig_codes(words):
        rig.write(code, 0, "h", value)
    rig.enable(3)
    rig.write(0x60FF, 0, "i", round(rpm * RPM))
    rig.control(0x000F)
    rig.run(0.3)
    assert rig.axis.velocity == pytest.approx(rpm, abs=1.0)
    return rig


def rig_codes(words: dict[str, object]) -> list[tuple[int, int]]:
    """The option codes that the robot file names, as a host writes them."""
    named = words.get("option_codes", {})
    assert isinstance(named, dict)
    indices = {"abort_connection": 0x6007, "quick_stop": 0x605A, "fault_reaction": 0x605E}
    return [(indices[name], value) for name, value in named.items() if value is not None]


# ---------------------------------------------------------------------------------------------- what it has


def test_it_is_who_the_robot_file_says() -> None:
    rig = Rig(described())
    assert [rig.read(0x1018, sub, "I") for sub in (1, 2, 3, 4)] == [VENDOR, 0x00020001, 0x00010004, 12345678]


def test_it_has_the_objects_of_the_robot_file_and_no_others() -> None:
    rig = Rig(described(settings=[{"index": 0x2200, "type": "u16", "value": 7}], **codes(abort=1)))
    rig.write(0x2200, 0, "H", 7)
    assert (rig.read(0x2200, 0, "H"), rig.read(0x6007, 0, "h")) == (7, 0)
    for index in (0x2201, 0x605A, 0x605E, 0x2003, 0x30D1):
        assert rig.refusal(index, 0, "h", 0) == ABSENT
    assert rig.refusal(0x60C2, 1, "B", 20) == 0
    assert Rig(described(interpolation_period=False)).refusal(0x60C2, 1, "B", 20) == ABSENT


@pytest.mark.parametrize(("index", "taken", "refused"), [(0x6007, 3, 4), (0x605A, 8, -1), (0x605E, 4, 5)])
def test_option_codes_that_the_profile_does_not_know_are_refused(index: int, taken: int, refused: int) -> None:
    rig = Rig(described(**codes(1, 6, 2)))
    assert rig.refusal(index, 0, "h", taken) == 0
    assert rig.refusal(index, 0, "h", refused) == RANGE
    assert rig.read(index, 0, "h") == taken


def test_modes_that_artemis_does_not_drive_with_are_refused() -> None:
    rig = Rig(described())
    assert [rig.refusal(0x6060, 0, "b", mode) for mode in (1, 3, 6, 8, 9, 10)] == [RANGE, 0, RANGE, 0, 0, RANGE]
    assert rig.read(0x6502, 0, "I") == 1 << 2 | 1 << 7 | 1 << 8


def test_what_it_measures_is_in_the_units_of_the_robot_file_as_far_as_its_type_goes() -> None:
    analog = [{"index": 0x2401, "subindex": sub, "type": "u8", "units_per_v": 100.0} for sub in (1, 2)]
    current = {"index": 0x6078, "type": "i16", "units_per_a": 200.0}
    rig = Rig(described(STEERING, analog_inputs=analog, current=current))
    rig.axis.analog, rig.axis.current_averaged = (1.234, 5.0), -1500.0
    assert [rig.read(0x2401, sub, "B") for sub in (1, 2)] == [123, 255]
    assert rig.read(0x6078, 0, "h") == -300
    assert rig.refusal(0x6078, 0, "h", 0) == READ_ONLY


def test_an_absolute_encoder_is_read_where_the_robot_file_says() -> None:
    rig = Rig(described(STEERING, absolute_encoder={"index": 0x2500, "type": "u32"}))
    assert rig.read(0x2500, 0, "I") == 0, "without contact"
    rig.axis.encoder = (1234, 13)
    assert rig.read(0x2500, 0, "I") == 1234


def test_the_home_switch_is_bit_2_of_the_digital_inputs() -> None:
    rig = Rig(described())
    assert rig.read(0x60FD, 0, "I") == 0
    rig.axis.home = True
    assert rig.read(0x60FD, 0, "I") == 4


def test_an_object_that_the_profile_has_too_is_the_profile_s() -> None:
    rig = Rig(described(settings=[{"index": 0x1029, "subindex": 1, "type": "u8", "value": 1}]))
    assert [rig.refusal(0x1029, 1, "B", value) for value in (0, 1, 2)] == [0, 0, 0]
    assert rig.refusal(0x1029, 1, "B", 3) != 0


def test_a_valid_pdo_keeps_its_identifier() -> None:
    rig = Rig(described())
    assert rig.refusal(0x1400, 1, "I", 0x300 + rig.id) == IN_USE
    rig.write(0x1400, 1, "I", 0x80000000 | 0x200 + rig.id)
    rig.write(0x1400, 1, "I", 0x80000000 | 0x300 + rig.id)
    rig.write(0x1400, 1, "I", 0x300 + rig.id)


def test_parameters_are_stored_and_defaults_restored_by_a_restart() -> None:
    rig = Rig(described())
    rig.write(0x6065, 0, "I", 777)
    rig.write(0x1010, 1, "I", 0x65766173)
    rig.node.power_on(rig.now)
    rig.run(0.1)
    assert rig.read(0x6065, 0, "I") == 777
    rig.write(0x1011, 1, "I", 0x64616F6C)
    assert rig.read(0x6065, 0, "I") == 777
    rig.node.power_on(rig.now)
    rig.run(0.1)
    assert rig.read(0x6065, 0, "I") == 2000


# ---------------------------------------------------------------------------------------------- modes and units


def test_velocities_and_accelerations_are_in_the_drive_s_units() -> None:
    rig = Rig(described())
    rig.write(0x6083, 0, "I", 1000)  # 2000 rpm/s
    rig.enable(3)
    rig.write(0x60FF, 0, "i", 5000)  # 500 rpm
    rig.control(0x000F)
    rig.run(0.1)
    assert rig.axis.demand_velocity == pytest.approx(200.0, abs=5.0)
    rig.run(0.4)
    assert rig.read(0x606C, 0, "i") == 5000
    rig.write(0x607F, 0, "I", 3000)
    rig.control(0x000F)
    rig.run(0.3)
    assert rig.read(0x606C, 0, "i") == 3000
    assert rig.status & 0x0800, "internal limit"
    rig.control(0x010F)
    rig.run(0.3)
    assert rig.axis.velocity == 0.0, "halt"


def test_cyclic_velocity_is_reached_within_the_interpolation_period() -> None:
    rig = Rig(described(operating_mode=9))
    rig.write(0x60C2, 1, "B", 2)
    rig.write(0x60C2, 2, "b", -1)
    rig.map_target(0x60FF)
    rig.enable(9)
    rig.set_point(4000)
    rig.run(0.1)
    assert rig.axis.demand_velocity == pytest.approx(200.0, abs=5.0), "half of 0.2 s"
    rig.run(0.2)
    assert rig.axis.velocity == pytest.approx(400.0, abs=1.0)
    rig.run(1.0)
    assert rig.state() is DriveState.OPERATION_ENABLE, "a set-point may be late"
    assert rig.status & 0x1000, "the drive follows"


def test_cyclic_position_keeps_to_the_position_limits_and_the_following_error() -> None:
    rig = Rig(described(STEERING))
    for sub, limit in ((1, -500), (2, 500)):
        rig.write(0x607D, sub, "i", limit)
    rig.write(0x60C2, 1, "B", 20)
    rig.map_target(0x607A)
    rig.enable(8)
    for target in range(0, 1000, 20):
        rig.set_point(target)
        rig.run(0.02)
    assert rig.read(0x6064, 0, "i") == 500
    assert rig.emergencies() == []
    rig.write(0x6065, 0, "I", 100)
    rig.axis.fail(blocked=True)
    rig.set_point(-500)
    rig.run(0.05)
    assert rig.emergencies() == [0x8611]


def test_without_an_interpolation_period_a_set_point_acts_at_once() -> None:
    rig = Rig(described(STEERING, interpolation_period=False))
    rig.map_target(0x607A)
    rig.enable(8)
    rig.set_point(300)
    rig.run(0.001)
    assert rig.axis.demand_position == 300.0


# ---------------------------------------------------------------------------------------------- quick stop


@pytest.mark.parametrize(
    ("code", "ramp"), [(1, 2000.0), (2, 8000.0), (3, None), (4, None), (5, 2000.0), (6, 8000.0), (7, None), (8, None)]
)
def test_a_quick_stop_ramps_as_its_option_code_says_and_stays_or_not(code: int, ramp: float | None) -> None:
    rig = running(**codes(quick=code))
    rig.control(0x0002)
    if ramp is not None:
        rig.run(0.05)
        assert rig.axis.demand_velocity == pytest.approx(1000.0 - 0.05 * ramp, abs=0.01 * ramp)
    assert rig.state() is DriveState.QUICK_STOP_ACTIVE
    rig.run(1.0)
    assert rig.axis.velocity == 0.0
    if code < 5:
        assert rig.state() is DriveState.SWITCH_ON_DISABLED
    else:
        assert rig.state() is DriveState.QUICK_STOP_ACTIVE
        rig.control(0x000F)
        assert rig.state() is DriveState.OPERATION_ENABLE


def test_a_quick_stop_that_ends_in_switch_on_disabled_is_not_left_for_operation() -> None:
    rig = running(**codes(quick=2))
    rig.control(0x0002)
    rig.control(0x000F)
    assert rig.state() is DriveState.QUICK_STOP_ACTIVE
    rig.control(0x0000)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize("brake", [False, True])
def test_a_quick_stop_without_ramp_cuts_the_power(brake: bool) -> None:
    rig = running(brake=brake, **codes(quick=0))
    rig.control(0x0002)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
    rig.run(0.01)
    assert (rig.axis.velocity == 0.0) is brake, "it coasts, or its brake holds it"


def test_a_drive_without_option_codes_does_what_the_profile_has_as_default() -> None:
    rig = running()
    rig.control(0x0002)
    rig.run(0.5)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
    rig = running()
    rig.control(0x0007)
    assert rig.state() is DriveState.OPERATION_ENABLE, "while it ramps down"
    rig.run(1.0)
    assert (rig.state(), rig.axis.velocity) == (DriveState.SWITCHED_ON, 0.0)
    rig = running()
    rig.control(0x0006)
    assert rig.state() is DriveState.READY
    rig.run(0.01)
    assert rig.axis.velocity > 900.0, "it coasts"


# ---------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(("code", "ramp"), [(0, None), (1, 2000.0), (2, 8000.0), (3, 1e9)])
def test_an_error_that_leaves_power_ramps_as_its_option_code_says(code: int, ramp: float | None) -> None:
    rig = running(**codes(fault=code))
    rig.node.emergency(0x8611, rig.now)
    rig.run(0.02)
    if ramp is None:
        assert rig.state() is DriveState.FAULT
        assert rig.axis.velocity > 900.0
        return
    assert rig.axis.demand_velocity == pytest.approx(max(0.0, 1000.0 - 0.02 * ramp), abs=20.0)
    rig.run(1.0)
    assert (rig.state(), rig.axis.velocity, rig.emergencies()) == (DriveState.FAULT, 0.0, [0x8611])


def lost(rig: Rig) -> Rig:
    """It watches a host, which stops."""
    rig.write(0x1016, 1, "I", 127 << 16 | 50)
    rig.nmt(0x01)
    rig.send(0x77F, b"\x05")
    rig.run(0.06)
    assert rig.emergencies() == [0x8130]
    return rig


@pytest.mark.parametrize(
    ("code", "then", "at_last"),
    [
        (0, DriveState.OPERATION_ENABLE, DriveState.OPERATION_ENABLE),
        (1, DriveState.FAULT_REACTION_ENABLED, DriveState.FAULT),
        (2, DriveState.SWITCH_ON_DISABLED, DriveState.SWITCH_ON_DISABLED),
        (3, DriveState.QUICK_STOP_ACTIVE, DriveState.QUICK_STOP_ACTIVE),
        (None, DriveState.FAULT_REACTION_ENABLED, DriveState.FAULT),
    ],
)
def test_a_lost_heartbeat_is_what_its_option_code_says(code: int | None, then: DriveState, at_last: DriveState) -> None:
    rig = lost(running(**codes(abort=code, quick=6)))
    assert rig.state() is then
    assert rig.node.nmt is Nmt.PRE_OPERATIONAL, "0x1029 is 0"
    rig.run(1.0)
    assert rig.state() is at_last
    assert rig.read(0x1001, 0, "B") == (0x10 if at_last is DriveState.FAULT else 0), "a command leaves no error behind"
    rig.send(0x77F, b"\x05")
    rig.run(0.06)
    assert rig.emergencies() == ([] if at_last is DriveState.FAULT else [0x8130]), "each loss is told"


@pytest.mark.parametrize(("value", "state"), [(0, Nmt.PRE_OPERATIONAL), (1, Nmt.OPERATIONAL), (2, Nmt.STOPPED)])
def test_what_a_lost_heartbeat_does_to_the_exchange_is_object_1029(value: int, state: Nmt) -> None:
    rig = Rig(described())
    rig.write(0x1029, 1, "B", value)
    assert lost(rig).node.nmt is state
    assert rig.state() is DriveState.FAULT


@pytest.mark.parametrize("waits", [False, True])
def test_a_fault_reset_waits_for_the_communication_s_where_the_robot_file_says_so(waits: bool) -> None:
    rig = lost(Rig(described(reset_after_lost_heartbeat=waits)))
    rig.control(0x0080)
    assert rig.state() is (DriveState.FAULT if waits else DriveState.SWITCH_ON_DISABLED)
    rig.nmt(0x82)
    rig.run(0.1)
    assert rig.read(0x1016, 1, "I") == 0, "what was not stored is forgotten"
    rig.control(0x0000)
    rig.control(0x0080)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED


def test_under_voltage_is_an_error_for_as_long_as_it_lasts() -> None:
    rig = running()
    rig.axis.supply_voltage = 5.0
    rig.run(0.01)
    assert (rig.emergencies(), rig.state()) == ([0x3220], DriveState.FAULT)
    rig.control(0x0080)
    assert rig.state() is DriveState.FAULT
    rig.axis.supply_voltage = 24.0
    rig.run(0.01)
    rig.control(0x0000)
    rig.control(0x0080)
    assert rig.state() is DriveState.SWITCH_ON_DISABLED
