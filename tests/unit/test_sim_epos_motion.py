from __future__ import annotations

import struct

import pytest
from sim_epos_rig import STEERING, TRACTION, Rig

from artemis.drive_states import DriveState
from artemis.sim.axis import Failure
from artemis.sim.epos_settings import SimSettings

ENABLE, HALT, QUICK_STOP = 0x000F, 0x010F, 0x000B
START_NOW, START_LATER, RELATIVE = 0x003F, 0x001F, 0x005F
BIT_10, BIT_11, BIT_12, BIT_13, REFERENCED = 0x0400, 0x0800, 0x1000, 0x2000, 0x8000


def enabled(mode: int, settings: SimSettings | None = None) -> Rig:
    rig = Rig(TRACTION if mode in (3, -3) else STEERING, settings=settings)
    rig.write(0x607F, 0, "I", 5000)
    rig.enable(mode)
    return rig


# ---------------------------------------------------------------------------------------------- profile velocity


def test_a_target_velocity_waits_for_the_controlword() -> None:
    rig = enabled(3)
    rig.write(0x60FF, 0, "i", 500)
    rig.run(0.1)
    assert rig.axis.velocity == 0.0
    rig.control(ENABLE)
    rig.run(0.1)
    assert rig.axis.velocity == pytest.approx(500.0, rel=0.01)


def test_profile_velocity_uses_its_own_ramps() -> None:
    rig = enabled(3)
    rig.write(0x6083, 0, "I", 2000)
    rig.write(0x6084, 0, "I", 500)
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.25)
    assert rig.axis.velocity == pytest.approx(500.0, abs=15.0)
    rig.run(0.5)
    rig.write(0x60FF, 0, "i", 0)
    rig.control(ENABLE)
    rig.run(1.0)
    assert rig.axis.velocity == pytest.approx(500.0, abs=15.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_maximal_profile_velocity_clips_the_target(sign: int) -> None:
    rig = enabled(3)
    rig.write(0x607F, 0, "I", 800)
    rig.write(0x60FF, 0, "i", sign * 3000)
    rig.control(ENABLE)
    rig.run(0.5)
    assert rig.axis.velocity == pytest.approx(sign * 800.0, rel=0.01)


def test_bits_10_and_12_tell_target_reached_and_standstill() -> None:
    rig = enabled(3)
    assert rig.status & (BIT_10 | BIT_12) == BIT_10 | BIT_12
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.05)
    assert rig.status & (BIT_10 | BIT_12) == 0
    rig.run(0.2)
    assert rig.status & (BIT_10 | BIT_12) == BIT_10


def test_halt_brakes_with_the_profile_deceleration_and_its_end_moves_on() -> None:
    rig = enabled(3)
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.3)
    rig.control(HALT)
    rig.run(0.05)
    assert rig.axis.velocity == pytest.approx(500.0, abs=40.0)
    rig.run(0.2)
    assert rig.status & (BIT_10 | BIT_12) == BIT_10 | BIT_12
    rig.control(ENABLE)
    rig.run(0.3)
    assert rig.axis.velocity == pytest.approx(1000.0, rel=0.01)


# ---------------------------------------------------------------------------------------------- profile position


def test_the_set_point_handshake() -> None:
    rig = enabled(1)
    rig.write(0x607A, 0, "i", 20000)
    rig.control(START_LATER)
    assert rig.status & (BIT_10 | BIT_12) == BIT_12
    rig.run(0.01)
    assert rig.status & BIT_12, "bit 4 is still up"
    rig.control(ENABLE)
    assert not rig.status & BIT_12
    rig.run(2.0)
    assert rig.status & BIT_10
    assert rig.read(0x6064, 0, "i") == rig.read(0x6062, 0, "i") == 20000


def test_without_a_rising_edge_nothing_moves() -> None:
    rig = enabled(1)
    rig.control(START_LATER)
    rig.write(0x607A, 0, "i", 20000)
    rig.control(START_LATER)
    rig.run(1.0)
    assert rig.read(0x6064, 0, "i") == 0


def test_a_second_set_point_waits_for_the_end_of_the_first() -> None:
    rig = enabled(1)
    rig.write(0x607A, 0, "i", 20000)
    rig.control(START_LATER)
    rig.control(ENABLE)
    rig.write(0x607A, 0, "i", 10000)
    rig.control(START_LATER)
    rig.control(ENABLE)
    assert rig.status & BIT_12, "the place for a waiting set-point is taken"
    furthest = 0
    for _ in range(200):
        rig.run(0.01)
        furthest = max(furthest, rig.read(0x6064, 0, "i"))
    assert furthest == pytest.approx(20000, abs=50)
    assert rig.read(0x6064, 0, "i") == 10000
    assert rig.status & (BIT_10 | BIT_12) == BIT_10


def test_a_third_set_point_overloads_the_device() -> None:
    rig = enabled(1)
    for target in (20000, 30000, 40000):
        rig.write(0x607A, 0, "i", target)
        rig.control(START_LATER)
        rig.control(ENABLE)
    assert rig.emergencies() == [0xFF0B]


def test_change_at_once_replaces_the_running_move() -> None:
    rig = enabled(1)
    rig.write(0x607A, 0, "i", 200000)
    rig.control(START_LATER)
    rig.control(ENABLE)
    rig.run(0.5)
    rig.write(0x607A, 0, "i", 5000)
    rig.control(START_NOW)
    rig.control(ENABLE)
    rig.run(4.0)
    assert rig.read(0x6064, 0, "i") == 5000


def test_relative_moves_start_from_the_demand() -> None:
    rig = enabled(1)
    rig.write(0x607A, 0, "i", 3000)
    for _ in range(2):
        rig.control(RELATIVE)
        rig.control(ENABLE)
        rig.run(1.0)
    assert rig.read(0x6064, 0, "i") == 6000


def test_a_profile_is_limited_by_both_velocities() -> None:
    rig = enabled(1)
    rig.write(0x6081, 0, "I", 600)
    rig.write(0x607A, 0, "i", 1000000)
    rig.control(START_LATER)
    rig.run(0.5)
    assert rig.axis.velocity == pytest.approx(600.0, abs=5.0)
    rig.write(0x607F, 0, "I", 300)
    rig.control(ENABLE)
    rig.control(START_NOW)
    rig.run(0.5)
    assert rig.axis.velocity == pytest.approx(300.0, abs=5.0)


def test_a_halted_move_tells_when_it_stands_and_goes_on_afterwards() -> None:
    rig = enabled(1)
    rig.write(0x607A, 0, "i", 50000)
    rig.control(START_LATER)
    rig.run(0.3)
    rig.control(HALT)
    assert not rig.status & BIT_10
    rig.run(0.5)
    assert rig.status & BIT_10
    assert rig.read(0x6064, 0, "i") < 40000
    rig.control(ENABLE)
    rig.run(3.0)
    assert rig.read(0x6064, 0, "i") == 50000


def test_a_position_window_must_be_held_for_its_time() -> None:
    rig = enabled(1)
    rig.write(0x6067, 0, "I", 500)
    rig.write(0x6068, 0, "H", 50)
    rig.write(0x607A, 0, "i", 10000)
    rig.control(START_LATER)
    first_inside, reached = None, None
    while reached is None:
        rig.run(0.001)
        if first_inside is None and abs(rig.axis.position - 10000) <= 500:
            first_inside = rig.now
        if rig.status & BIT_10:
            reached = rig.now
    assert first_inside is not None
    assert reached - first_inside == pytest.approx(0.05, abs=0.003)


def test_a_mode_change_in_motion_comes_to_rest() -> None:
    rig = enabled(3)
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.3)
    rig.write(0x6060, 0, "b", 1)
    assert rig.read(0x6061, 0, "b") == 1
    rig.run(1.0)
    assert rig.axis.velocity == 0.0
    assert rig.state() is DriveState.OPERATION_ENABLE


# ---------------------------------------------------------------------------------------------- modes without a ramp


def test_position_mode_follows_a_small_step_at_once() -> None:
    rig = enabled(-1)
    rig.write(0x2062, 0, "i", 1500)
    rig.run(0.3)
    assert rig.read(0x6064, 0, "i") == 1500


def test_position_mode_trips_over_a_step_beyond_the_following_limit() -> None:
    rig = enabled(-1)
    rig.write(0x2062, 0, "i", 2100)
    rig.run(0.002)
    assert rig.emergencies() == [0x8611]
    rig.run(0.5)
    assert rig.status & 0x417F == 0x0108


def test_a_position_demand_retained_from_before_trips_at_enable() -> None:
    rig = Rig(STEERING)
    rig.write(0x2062, 0, "i", 50000)
    rig.write(0x6060, 0, "b", -1)
    rig.control(0x0006)
    rig.control(ENABLE)
    rig.run(0.05)
    assert rig.emergencies() == [0x8611]


def test_the_following_limit_can_be_switched_off() -> None:
    rig = enabled(-1)
    rig.write(0x6065, 0, "I", 0xFFFFFFFF)
    rig.write(0x2062, 0, "i", 50000)
    rig.run(2.0)
    assert rig.read(0x6064, 0, "i") == 50000


def test_a_blocked_axis_ends_in_a_following_error_with_bit_13() -> None:
    rig = enabled(1)
    rig.axis.failure = Failure(blocked=True)
    rig.write(0x607A, 0, "i", 20000)
    rig.control(START_LATER)
    rig.run(0.5)
    assert rig.emergencies() == [0x8611]
    assert rig.status & BIT_13
    rig.control(0x0080)
    assert not rig.status & BIT_13


def test_the_following_error_can_be_read() -> None:
    rig = enabled(-1)
    rig.axis.failure = Failure(blocked=True)
    rig.write(0x2062, 0, "i", -1900)
    rig.run(0.002)
    assert rig.read(0x20F4, 0, "h") == -1900
    assert rig.read(0x6062, 0, "i") == -1900


def test_velocity_mode_has_no_ramp() -> None:
    rig = enabled(-2)
    rig.write(0x206B, 0, "i", 3000)
    rig.run(0.02)
    assert rig.axis.velocity == pytest.approx(3000.0, rel=0.01)
    rig.control(QUICK_STOP)
    rig.run(0.02)
    assert abs(rig.axis.velocity) < 20.0


def test_a_fault_ramps_down_even_in_a_mode_without_ramps() -> None:
    rig = enabled(-2)
    rig.write(0x206B, 0, "i", 3000)
    rig.run(0.02)
    rig.node.emergency(0x8130, rig.now)
    rig.run(0.1)
    assert rig.axis.velocity == pytest.approx(2000.0, abs=50.0)


def test_current_mode_obeys_the_write_and_not_the_past() -> None:
    rig = Rig()
    rig.write(0x2030, 0, "h", 2000)
    rig.write(0x6060, 0, "b", -3)
    rig.control(0x0006)
    rig.control(ENABLE)
    rig.run(0.1)
    assert rig.axis.current == 0.0
    rig.write(0x2030, 0, "h", 1500)
    rig.run(0.1)
    assert rig.read(0x6078, 0, "h") == 1500
    assert rig.axis.velocity > 100.0
    rig.control(0x0002)
    rig.run(1.0)
    assert rig.axis.velocity == 0.0


@pytest.mark.parametrize("mode", [-4, -5, -6])
def test_modes_that_are_not_simulated_stand_still(mode: int) -> None:
    rig = enabled(mode)
    rig.run(0.1)
    assert rig.axis.velocity == 0.0
    assert rig.read(0x6061, 0, "b") == mode


# ---------------------------------------------------------------------------------------------- homing, limits


def test_method_35_gives_the_present_place_its_value() -> None:
    rig = Rig(STEERING)
    rig.axis.position = 400.0
    rig.write(0x6098, 0, "b", 35)
    rig.write(0x2081, 0, "i", -12345)
    rig.enable(6)
    assert not rig.status & (BIT_12 | REFERENCED)
    rig.control(0x001F)
    assert rig.status & (BIT_10 | BIT_12 | BIT_13 | REFERENCED) == BIT_10 | BIT_12 | REFERENCED
    assert rig.read(0x6064, 0, "i") == -12345
    assert rig.read(0x2020, 0, "H") == 400
    rig.run(0.2)
    assert rig.axis.position == 400.0
    rig.control(ENABLE)
    rig.write(0x6060, 0, "b", 1)
    assert rig.status & (BIT_12 | REFERENCED) == REFERENCED
    rig.write(0x607A, 0, "i", -12000)
    rig.control(START_LATER)
    rig.run(0.5)
    assert rig.read(0x6064, 0, "i") == -12000
    assert rig.axis.position == pytest.approx(745.0, abs=0.5)


def test_method_0_needs_no_homing() -> None:
    rig = Rig(STEERING)
    rig.write(0x6098, 0, "b", 0)
    rig.enable(6)
    rig.control(0x001F)
    assert rig.status & (BIT_12 | BIT_13 | REFERENCED) == BIT_12 | REFERENCED


def test_other_methods_end_in_a_homing_error_where_they_stand() -> None:
    rig = Rig(STEERING)
    rig.write(0x6098, 0, "b", 17)
    rig.enable(6)
    rig.control(0x001F)
    assert rig.status & (BIT_10 | BIT_12 | BIT_13 | REFERENCED) == BIT_13
    assert rig.axis.velocity == 0.0


def test_a_position_beyond_its_limits_is_an_error() -> None:
    rig = enabled(1)
    rig.write(0x607D, 2, "i", 10000)
    rig.write(0x607A, 0, "i", 30000)
    rig.control(START_LATER)
    rig.run(1.0)
    assert rig.emergencies() == [0xFF09]
    assert 10000 <= rig.read(0x6064, 0, "i") < 12000


def test_a_position_pushed_beyond_its_limits_is_an_error_too() -> None:
    rig = enabled(-2)
    rig.write(0x607D, 1, "i", -10000)
    rig.write(0x206B, 0, "i", -3000)
    rig.run(0.2)
    assert rig.emergencies() == [0xFF09]


@pytest.mark.parametrize(("mode", "target"), [(1, 0x607A), (-1, 0x2062)])
def test_limits_clip_the_set_point_when_so_configured(mode: int, target: int) -> None:
    rig = enabled(mode, settings=SimSettings(position_limits_clip=True))
    rig.write(0x607D, 2, "i", 1000)
    rig.write(target, 0, "i", 30000)
    rig.control(START_LATER)
    rig.run(1.0)
    assert rig.emergencies() == []
    assert rig.read(0x6064, 0, "i") == 1000


def test_the_encoder_counter_wraps_at_16_bit() -> None:
    rig = Rig()
    rig.axis.position = 65536.0 + 7.0
    assert rig.read(0x2020, 0, "H") == 7
    rig.axis.position = -1.0
    assert rig.read(0x2020, 0, "H") == 0xFFFF


@pytest.mark.parametrize("direction", [1, -1])
def test_the_position_wraps_at_32_bit_and_loses_its_reference(direction: int) -> None:
    rig = Rig(STEERING)
    rig.write(0x6098, 0, "b", 35)
    rig.enable(6)
    rig.control(0x001F)
    rig.axis.position = direction * (2.0**31 + 5)
    rig.axis.target = rig.axis.demand_position = rig.axis.position
    rig.run(0.001)
    assert rig.read(0x6064, 0, "i") == -direction * (2**31 - 5)
    assert not rig.status & REFERENCED


# ---------------------------------------------------------------------------------------------- measured values


def test_velocity_comes_in_steps_of_one_count_per_millisecond() -> None:
    rig = enabled(3)
    rig.write(0x60FF, 0, "i", 1000)  # 1.2 counts/ms with halls only
    rig.control(ENABLE)
    rig.run(0.3)
    seen = set()
    total = 0
    for _ in range(1000):
        rig.run(0.001)
        value = rig.node.read(0x606C)
        assert isinstance(value, int)
        seen.add(value)
        total += value
    assert seen == {833, 1667}
    assert total / 1000 == pytest.approx(1000.0, rel=0.01)
    assert rig.read(0x2028, 0, "i") == pytest.approx(1000, abs=2)
    assert rig.read(0x606B, 0, "i") == 1000


def test_velocity_can_be_measured_finer() -> None:
    rig = Rig()
    rig.write(0x2008, 0, "H", 0x08)
    rig.enable(3)
    rig.write(0x60FF, 0, "i", 1000)
    rig.control(ENABLE)
    rig.run(0.3)
    assert rig.read(0x606C, 0, "i") == 1000


def test_the_velocity_sensor_speaks_counts_per_second() -> None:
    rig = enabled(-2)
    rig.write(0x206B, 0, "i", 3000)
    rig.run(0.1)
    assert rig.read(0x6069, 0, "i") == 100000
    assert rig.read(0x606C, 0, "i") == 3000


@pytest.mark.parametrize(
    ("voltage", "millivolts"), [(0.0, 0), (-1.0, 0), (2.5, 2499), (0.0025, 5), (4.9, 4900), (7.0, 4992)]
)
def test_analog_inputs_have_10_bit(voltage: float, millivolts: int) -> None:
    rig = Rig(STEERING)
    rig.axis.analog = (voltage, 1.0)
    assert rig.read(0x207C, 1, "h") == millivolts
    assert rig.read(0x207C, 2, "h") == 1000


def test_current_is_reported_and_averaged() -> None:
    rig = enabled(-3)
    rig.write(0x2030, 0, "h", 2000)
    rig.run(0.003)
    assert rig.read(0x6078, 0, "h") == 2000
    assert 500 < rig.read(0x2027, 0, "h") < 1900


def test_the_thermal_limit_shows_in_bit_11() -> None:
    rig = Rig(STEERING)
    rig.write(0x6410, 5, "H", 10)
    rig.write(0x6065, 0, "I", 0xFFFFFFFF)
    rig.enable(-1)
    rig.axis.failure = Failure(blocked=True)
    rig.write(0x2062, 0, "i", 50000)
    rig.run(0.1)
    assert not rig.status & BIT_11
    assert rig.read(0x6078, 0, "h") == 2000
    rig.run(1.0)
    assert rig.status & BIT_11
    assert rig.read(0x6078, 0, "h") == 1000


def test_current_limits_act_as_they_are_written() -> None:
    rig = enabled(-3)
    rig.write(0x6410, 2, "H", 700)
    rig.write(0x2030, 0, "h", 2000)
    rig.run(0.01)
    assert rig.read(0x6078, 0, "h") == 700


def test_process_data_follows_the_axis() -> None:
    rig = Rig(STEERING)
    rig.map(0x1A00, 0x60640020, 0x20200010, 0x207C0110)
    rig.write(0x1800, 2, "B", 1)
    rig.nmt(0x01)
    rig.axis.position, rig.axis.analog = -70000.4, (1.0, 0.0)
    rig.send(0x80)
    assert rig.take(0x183) == [struct.pack("<iHh", -70000, -70000 & 0xFFFF, 1000)]


def test_the_home_switch_is_seen_at_input_4_with_mask_and_polarity() -> None:
    rig = Rig(STEERING)
    assert rig.read(0x2071, 1, "H") == 0
    rig.axis.home = True
    assert rig.read(0x2071, 1, "H") == 1 << 2
    rig.write(0x2071, 3, "H", 1 << 2)
    assert rig.read(0x2071, 1, "H") == 0, "low is active"
    rig.axis.home = False
    assert rig.read(0x2071, 1, "H") == 1 << 2
    rig.write(0x2071, 2, "H", 0xE003)
    assert rig.read(0x2071, 1, "H") == 0, "masked"
