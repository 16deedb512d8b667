"""Modes, units, homing, limits of a simulated EPOS4."""

from __future__ import annotations

import pytest
from sim_epos_rig import STEERING_4, TRACTION_4, Rig

from artemis.drive_states import DriveState
from artemis.sim.epos4_homing import METHODS
from artemis.sim.epos4_objects import HOMING_METHODS
from artemis.sim.epos_settings import Epos4Settings, SimSettings

ENABLE, START = 0x000F, 0x001F
RPM, MILLI_RPM = 0x00B44700, 0xFDB44700
REACHED, ATTAINED, FAILED, REFERENCED, LIMITED = 0x0400, 0x1000, 0x2000, 0x8000, 0x0800


def test_the_unit_of_velocities_is_a_power_of_ten_of_rpm() -> None:
    rig = Rig(TRACTION_4)
    rig.write(0x60A9, 0, "I", MILLI_RPM)
    rig.write(0x6080, 0, "I", 3_000_000)
    rig.write(0x607F, 0, "I", 3_000_000)
    rig.enable(3)
    assert rig.refusal(0x60A9, 0, "I", RPM) == 0x08000022, "not while it is enabled"
    rig.write(0x60FF, 0, "i", 1_500_500)
    rig.control(ENABLE)
    rig.run(1.0)
    assert rig.axis.velocity == pytest.approx(1500.5)
    assert rig.read(0x606C, 0, "i") == pytest.approx(1_500_500, abs=2)
    assert rig.read(0x606B, 0, "i") == 1_500_500
    assert rig.read(0x30D3, 1, "i") == pytest.approx(1_500_500, abs=10)


def test_a_motor_speed_limit_holds_in_every_mode_and_is_shown() -> None:
    for mode in (3, 9):
        rig = Rig(TRACTION_4)
        rig.write(0x6080, 0, "I", 500)
        rig.enable(mode)
        rig.write(0x60FF, 0, "i", 2000)
        rig.control(ENABLE)
        rig.run(0.5)
        assert rig.axis.velocity == pytest.approx(500.0, abs=1.0)
        assert rig.status & LIMITED
    rig = Rig(STEERING_4)
    rig.write(0x6080, 0, "I", 600)
    rig.write(0x6065, 0, "I", 0xFFFFFFFF)
    rig.write(0x60C2, 1, "B", 10)
    rig.enable(8)
    rig.map_target(0x607A)
    for _ in range(10):
        rig.set_point(100_000)
        rig.run(0.01)
        assert rig.axis.demand_velocity <= 600.0


def test_profile_limits_do_not_hold_in_cyclic_modes() -> None:
    rig = Rig(TRACTION_4)
    for index, limit in ((0x607F, 100), (0x6083, 100), (0x60C5, 100)):
        rig.write(index, 0, "I", limit)
    rig.enable(9)
    rig.write(0x60FF, 0, "i", 1000)
    rig.run(0.05)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


def test_offsets_add_to_targets() -> None:
    rig = Rig(TRACTION_4)
    rig.enable(9)
    rig.write(0x60B1, 0, "i", 200)
    rig.write(0x60FF, 0, "i", 300)
    rig.run(0.1)
    assert rig.axis.velocity == pytest.approx(500.0, abs=1.0)
    rig = Rig(STEERING_4)
    rig.enable(8)
    rig.write(0x60B0, 0, "i", 50)
    rig.write(0x607A, 0, "i", 100)
    rig.run(0.5)
    assert rig.read(0x6064, 0, "i") == 150


def test_an_old_target_is_followed_as_soon_as_it_is_enabled() -> None:
    rig = Rig(STEERING_4)
    rig.write(0x607A, 0, "i", 500)
    rig.enable(8)
    rig.run(0.5)
    assert rig.read(0x6064, 0, "i") == 500


def test_halt_stops_a_cyclic_mode_until_it_is_taken_back() -> None:
    rig = Rig(TRACTION_4)
    rig.enable(9)
    rig.write(0x60FF, 0, "i", 1000)
    rig.run(0.1)
    assert rig.status & 0x1000
    rig.control(ENABLE | 0x0100)
    rig.run(0.3)
    assert rig.axis.velocity == 0.0
    assert not rig.status & 0x1000, "it does not follow"
    rig.control(ENABLE)
    rig.run(0.1)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


@pytest.mark.parametrize("periods", [0.5, 3.0])
def test_how_late_a_set_point_may_be_is_a_setting(periods: float) -> None:
    rig = Rig(TRACTION_4, settings=SimSettings(epos4=Epos4Settings(late_set_points=periods)))
    rig.write(0x60C2, 1, "B", 20)
    rig.enable(9)
    rig.write(0x60FF, 0, "i", 100)
    rig.run(0.02 * (1.0 + periods) - 0.002)
    assert rig.emergencies() == []
    rig.run(0.005)
    assert rig.emergencies() == [0x8250]


def test_a_blocked_shaft_is_a_following_error() -> None:
    rig = Rig(STEERING_4)
    rig.enable(8)
    rig.axis.fail(blocked=True)
    rig.write(0x607A, 0, "i", 5000)
    rig.run(0.01)
    assert rig.emergencies() == [0x8611]
    assert rig.status & 0x2000


def test_position_limits_of_zero_are_off_and_others_hold() -> None:
    rig = Rig(STEERING_4)
    rig.write(0x6065, 0, "I", 0xFFFFFFFF)
    rig.enable(8)
    rig.write(0x607A, 0, "i", 3000)
    rig.run(0.5)
    assert rig.emergencies() == []
    rig.write(0x607D, 1, "i", -4000)
    rig.write(0x607D, 2, "i", 4000)
    rig.write(0x607A, 0, "i", 5000)
    rig.run(0.1)
    assert rig.emergencies() == [0x8A82]


def test_objects_of_motor_and_sensor_change_only_without_power() -> None:
    rig = Rig(TRACTION_4)
    rig.enable(3)
    for index, sub, code, value in (
        (0x3000, 1, "I", 1),
        (0x3001, 3, "B", 4),
        (0x3010, 1, "I", 1024),
        (0x6402, 0, "H", 1),
    ):
        assert rig.refusal(index, sub, code, value) == 0x08000022
    rig.control(0)
    rig.write(0x3010, 1, "I", 1024)
    assert rig.read(0x3000, 5, "I") == 4096


def test_other_sensors_lose_the_reference() -> None:
    rig = Rig(STEERING_4)
    rig.write(0x6098, 0, "b", 37)
    rig.write(0x30B0, 0, "i", 1234)
    rig.write(0x6060, 0, "b", 6)
    rig.control(0x0010)
    assert rig.read(0x6064, 0, "i") == 1234, "method 37 needs no power"
    assert rig.status & REFERENCED
    rig.write(0x3000, 1, "I", 1)
    assert rig.read(0x6064, 0, "i") == 0
    assert not rig.status & REFERENCED


# ---------------------------------------------------------------------------------------------- homing


def homing(method: int, **objects: int) -> Rig:
    rig = Rig(STEERING_4)
    rig.write(0x6099, 1, "I", 300)
    rig.write(0x6098, 0, "b", method)
    for name, value in objects.items():
        rig.write(int(name[1:], 16), 0, "i", value)
    rig.enable(6)
    rig.axis.position += 700.0
    return rig


def home(rig: Rig, limit: float = 5.0) -> bool:
    """Start, and let it run to its end; whether it is home."""
    rig.control(START)
    ends = rig.now + limit
    while rig.now < ends and not rig.status & (ATTAINED | FAILED):
        rig.run(0.005)
    return bool(rig.status & ATTAINED)


def test_methods_are_those_that_the_drive_lists() -> None:
    rig = Rig(STEERING_4)
    assert set(METHODS) == set(HOMING_METHODS)
    assert {rig.read(0x60E3, sub, "b") for sub in range(1, 16)} == set(METHODS)


def test_the_present_place_becomes_the_home_position_after_the_way_off() -> None:
    rig = homing(37, x30B0=5000, x30B1=400)
    assert home(rig)
    assert rig.axis.position == pytest.approx(1100.0, abs=1.0), "with power it moves by 0x30B1"
    assert rig.read(0x6064, 0, "i") == pytest.approx(5000, abs=1)
    assert rig.status & REFERENCED


@pytest.mark.parametrize(("method", "direction"), [(34, 1), (33, -1)])
def test_an_index_is_found(method: int, direction: int) -> None:
    rig = homing(method)
    assert home(rig, 20.0)
    place = 2000.0 if direction > 0 else 0.0
    assert rig.axis.position == pytest.approx(place, abs=20.0)
    assert rig.read(0x6064, 0, "i") == pytest.approx(0, abs=1)


@pytest.mark.parametrize(
    ("method", "pin", "edge"), [(17, 0, -1500.0), (18, 1, 2500.0), (23, 2, 2500.0), (27, 2, -1500.0)]
)
def test_a_switch_is_met_and_left_again(method: int, pin: int, edge: float) -> None:
    rig = homing(method)
    rig.control(START)
    for _ in range(4000):
        position = rig.axis.position
        rig.epos4.set_input(pin, position < edge if edge < 0 else position > edge, rig.now)
        rig.run(0.005)
        if rig.status & ATTAINED:
            break
    assert rig.axis.position == pytest.approx(edge, abs=30.0)
    assert rig.read(0x6064, 0, "i") == pytest.approx(0, abs=1)
    assert rig.emergencies() == [], "a limit switch is no error while it is sought"


@pytest.mark.parametrize(("method", "stop"), [(-3, 2000.0), (-4, -1000.0)])
def test_a_hard_stop_is_felt_by_the_current(method: int, stop: float) -> None:
    rig = homing(method, x30B1=-300 if stop > 0 else 300)
    rig.write(0x30B2, 0, "H", 1500)
    rig.write(0x6099, 1, "I", 100)
    rig.control(START)
    for _ in range(4000):
        beyond = rig.axis.position >= stop if stop > 0 else rig.axis.position <= stop
        rig.axis.fail(blocked=beyond and abs(rig.axis.current) < 1500.0)
        rig.run(0.002)
        if rig.status & ATTAINED:
            break
    assert rig.axis.position == pytest.approx(stop - 300 if stop > 0 else stop + 300, abs=30.0)
    assert rig.read(0x6064, 0, "i") == pytest.approx(0, abs=1)


def test_homing_that_is_halted_is_not_attained() -> None:
    rig = homing(34)
    rig.control(START)
    rig.run(0.2)
    assert rig.axis.velocity > 0.0
    rig.control(START | 0x0100)
    rig.run(1.0)
    assert rig.axis.velocity == 0.0
    assert not rig.status & ATTAINED
    assert rig.state() is DriveState.OPERATION_ENABLE


def test_a_drive_that_is_referenced_forgets_it_with_its_encoder() -> None:
    rig = homing(37)
    assert home(rig)
    rig.node.emergency(0x7382, rig.now)
    assert not rig.status & REFERENCED
