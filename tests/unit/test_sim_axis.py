from __future__ import annotations

import math

import pytest
from sim_epos_rig import STEERING, TRACTION

from artemis.sim.axis import LOADS, POSITION_GAIN, Axis, Failure, Load, Regulation


def traction() -> Axis:
    axis = Axis(TRACTION)
    axis.continuous_current, axis.output_current, axis.thermal_time = 5000.0, 10000.0, 52.6
    return axis


def steering() -> Axis:
    axis = Axis(STEERING)
    axis.continuous_current, axis.output_current, axis.thermal_time = 1000.0, 2000.0, 13.0
    return axis


def run(axis: Axis, seconds: float, dt: float = 0.001) -> None:
    for _ in range(round(seconds / dt)):
        axis.step(dt)


def test_velocity_ramps_with_the_given_acceleration() -> None:
    axis = traction()
    axis.acceleration = 2000.0
    axis.regulate(Regulation.VELOCITY, 1000.0)
    run(axis, 0.25)
    assert axis.velocity == pytest.approx(500.0, abs=10.0)
    assert not axis.arrived
    run(axis, 0.35)
    assert axis.velocity == pytest.approx(1000.0, abs=1.0)
    assert axis.arrived


def test_position_is_the_integral_of_the_velocity() -> None:
    axis = traction()
    axis.acceleration = 2000.0
    axis.regulate(Regulation.VELOCITY, 1000.0)
    run(axis, 1.5)
    # 0.5 s ramp and 1 s at 1000 rpm, behind by the lag of the speed loop: turns * 72 counts
    assert axis.position == pytest.approx((1000.0 / 60.0) * (0.25 + 1.0 - 0.003) * 72, rel=2e-3)


def test_a_change_of_sign_brakes_with_the_deceleration_first() -> None:
    axis = traction()
    axis.acceleration, axis.deceleration = 1000.0, 4000.0
    axis.demand_velocity = axis.velocity = 400.0
    axis.regulation = Regulation.VELOCITY
    axis.regulate(Regulation.VELOCITY, -400.0)
    run(axis, 0.1)
    assert axis.demand_velocity == pytest.approx(0.0, abs=5.0)
    run(axis, 0.1)
    assert axis.demand_velocity == pytest.approx(-100.0, abs=5.0)


@pytest.mark.parametrize("dt", [0.001, 0.004, 0.01])
@pytest.mark.parametrize("target", [100.0, 5000.0, 250000.0, -250000.0])
def test_a_profile_ends_exactly_on_its_target_without_overshoot(dt: float, target: float) -> None:
    axis = steering()
    axis.profile_velocity, axis.acceleration, axis.deceleration = 5000.0, 20000.0, 10000.0
    axis.regulate(Regulation.PROFILE, target)
    furthest = 0.0
    for _ in range(round(4.0 / dt)):
        axis.step(dt)
        furthest = max(furthest, abs(axis.demand_position))
    assert axis.arrived
    assert axis.demand_position == target
    assert furthest <= abs(target) + 1e-6
    assert axis.position == pytest.approx(target, abs=0.5)
    assert axis.velocity == 0.0


def test_a_profile_takes_the_time_of_its_trapezoid() -> None:
    axis = steering()
    axis.profile_velocity, axis.acceleration, axis.deceleration = 3000.0, 10000.0, 5000.0
    axis.regulate(Regulation.PROFILE, 200000.0)  # 100 turns
    elapsed = 0.0
    while not axis.arrived:
        axis.step(0.001)
        elapsed += 0.001
    ramps = 3000.0 / 10000.0 + 3000.0 / 5000.0
    assert elapsed == pytest.approx(100.0 / 50.0 + 0.5 * ramps, abs=0.02)


def test_a_profile_turns_round_for_a_target_behind_it() -> None:
    axis = steering()
    axis.profile_velocity, axis.acceleration, axis.deceleration = 3000.0, 10000.0, 10000.0
    axis.regulate(Regulation.PROFILE, 100000.0)
    run(axis, 0.5)
    axis.regulate(Regulation.PROFILE, 0.0)
    run(axis, 4.0)
    assert axis.arrived
    assert axis.position == pytest.approx(0.0, abs=0.5)


def test_a_halted_profile_brakes_and_stays() -> None:
    axis = steering()
    axis.profile_velocity = 3000.0
    axis.regulate(Regulation.PROFILE, 1e6)
    run(axis, 0.6)
    axis.halted = True
    run(axis, 0.5)
    where = axis.position
    run(axis, 0.5)
    assert axis.position == where
    assert axis.velocity == 0.0


def test_a_moving_position_demand_is_followed_behind() -> None:
    axis = steering()
    axis.regulate(Regulation.POSITION, 0.0)
    for step in range(2000):
        axis.target = step * 100.0  # 100000 counts/s
        axis.step(0.001)
    assert axis.lag == pytest.approx(100000.0 / POSITION_GAIN - 100.0, rel=0.01)


def test_the_output_current_limits_the_acceleration() -> None:
    axis = traction()
    axis.output_current = 1300.0
    axis.acceleration = math.inf
    axis.regulate(Regulation.VELOCITY, 2000.0)
    run(axis, 0.1)
    assert axis.current == 1300.0
    assert axis.velocity == pytest.approx(0.1 * (1300.0 - 300.0) / 0.63, rel=0.02)


def test_heat_brings_the_current_down_to_the_continuous_limit() -> None:
    axis = steering()
    axis.thermal_time = 1.0
    axis.failure = Failure(blocked=True)
    axis.regulate(Regulation.VELOCITY, 1000.0)
    run(axis, 0.2)
    assert axis.current == 2000.0
    assert not axis.limiting
    run(axis, 2.0)
    assert axis.limiting
    assert axis.current == 1000.0


def test_a_blocked_shaft_stands_and_draws_the_limit() -> None:
    axis = steering()
    axis.regulate(Regulation.POSITION, -5000.0)
    axis.failure = Failure(blocked=True)
    run(axis, 0.01)
    assert axis.position == 0.0
    assert axis.current == -2000.0
    assert axis.lag == -5000.0


def test_a_coasting_shaft_is_stopped_by_friction_alone() -> None:
    axis = traction()
    axis.velocity = 1000.0
    run(axis, 1.0)
    assert 400.0 < axis.velocity < 600.0
    run(axis, 3.0)
    assert axis.velocity == 0.0
    assert axis.current == 0.0


def test_a_self_locking_gear_stops_at_once() -> None:
    axis = steering()
    axis.velocity = 5000.0
    run(axis, 0.2)
    assert axis.velocity == 0.0


def test_a_slope_rolls_a_shaft_without_power_and_is_held_by_a_regulated_one() -> None:
    axis = traction()
    axis.load_current = 500.0
    run(axis, 0.5)
    assert axis.velocity < -50.0
    axis.deceleration = axis.acceleration = 10000.0
    axis.regulate(Regulation.VELOCITY, 0.0)
    run(axis, 1.0)
    assert axis.velocity == 0.0
    assert axis.current == 500.0


def test_current_mode_turns_torque_into_acceleration_up_to_its_speed_limit() -> None:
    axis = traction()
    axis.current_mode_rpm = 500.0
    axis.regulate(Regulation.CURRENT, 930.0)
    run(axis, 0.1)
    assert axis.velocity == pytest.approx(100.0, rel=0.02)
    run(axis, 2.0)
    assert axis.velocity == 500.0


def test_the_supply_limits_the_speed() -> None:
    axis = traction()
    axis.supply_voltage = 20.0
    axis.regulate(Regulation.VELOCITY, 3190.0)
    run(axis, 2.0)
    assert axis.velocity == pytest.approx(3190.0 * 0.9 * 20.0 / 24.0, rel=1e-3)


def test_the_length_of_a_step_hardly_matters() -> None:
    ends = []
    for dt in (0.001, 0.005, 0.01):
        axis = traction()
        axis.acceleration = 2000.0
        axis.regulate(Regulation.VELOCITY, 1000.0)
        run(axis, 1.0, dt)
        ends.append(axis.position)
    assert max(ends) - min(ends) < 0.01 * ends[0]


def test_averages_are_low_passes_of_5_and_50_hz() -> None:
    axis = Axis(TRACTION, Load(inertia=1.0, friction=0.0, viscous=0.0))
    axis.current_mode_rpm = 1000.0
    axis.velocity = 1000.0
    axis.regulate(Regulation.CURRENT, 400.0)  # keeps pushing against the speed limit
    run(axis, 1.0 / (math.tau * 50.0), dt=0.0001)
    assert axis.current_averaged == pytest.approx(400.0 * (1 - math.exp(-1)), rel=0.02)
    run(axis, 1.0 / (math.tau * 5.0) - 1.0 / (math.tau * 50.0), dt=0.0001)
    assert axis.velocity_averaged == pytest.approx(1000.0 * (1 - math.exp(-1)), rel=0.02)


def test_the_drive_is_told_after_each_step() -> None:
    axis = traction()
    told: list[float] = []
    axis.after_step = told.append
    axis.step(0.004)
    axis.step(0.0)
    assert told == [0.004]


def test_every_role_has_a_load() -> None:
    assert set(LOADS) == {"traction", "steering"}


# ---------------------------------------------------------------------------------------------- failures


def ramping(rpm: float, **failure: float) -> Axis:
    """At constant speed, then with a failure."""
    axis = traction()
    axis.acceleration = axis.deceleration = 5000.0
    axis.regulate(Regulation.VELOCITY, rpm)
    run(axis, 1.0)
    assert axis.velocity == pytest.approx(rpm)
    axis.fail(**failure)
    return axis


@pytest.mark.parametrize("gain", [2.0, 0.5, -1.0])
def test_gain_multiplies_the_speed_that_is_asked_for(gain: float) -> None:
    axis = ramping(500.0, gain=gain)
    run(axis, 0.5)
    assert axis.velocity == pytest.approx(500.0 * gain)
    assert axis.demand_velocity == 500.0


def test_gain_cannot_exceed_what_the_supply_gives() -> None:
    axis = ramping(2000.0, gain=5.0)
    run(axis, 2.0)
    assert axis.velocity == pytest.approx(0.9 * axis.no_load_rpm)


@pytest.mark.parametrize("rpm", [1000.0, -1000.0])
def test_faded_brake_leaves_this_deceleration(rpm: float) -> None:
    axis = ramping(rpm, braking=400.0)
    axis.regulate(Regulation.VELOCITY, 0.0)
    run(axis, 1.0)
    assert axis.demand_velocity == 0.0
    assert abs(axis.velocity) == pytest.approx(600.0, abs=5.0)
    run(axis, 2.0)
    assert axis.velocity == pytest.approx(0.0, abs=1e-6)


def test_faded_brake_does_not_hinder_the_acceleration() -> None:
    axis = ramping(500.0, braking=10.0)
    axis.regulate(Regulation.VELOCITY, 1000.0)
    run(axis, 0.5)
    assert axis.velocity == pytest.approx(1000.0, abs=1.0)


def test_failures_are_joined_and_mended_one_by_one() -> None:
    axis = traction()
    axis.fail(gain=2.0)
    axis.fail(blocked=True)
    assert axis.failure == Failure(gain=2.0, blocked=True)
    axis.fail(gain=1.0)
    assert axis.failure == Failure(blocked=True)
    axis.fail(blocked=False)
    assert axis.failure is None
