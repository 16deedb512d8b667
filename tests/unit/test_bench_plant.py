"""The kinematic plant: its timing, its limits, and each disturbance alone."""

from __future__ import annotations

import math

import pytest

from artemis.motion.ackermann import Ackermann
from artemis.testing.contracts import ROBOT
from artemis.values import DriveCommand, Pose
from artemis_lab.bench.plant import Conditions, Plant, bicycle

BICYCLE = bicycle(ROBOT, 38.0)
PERIOD = 1 / 30
STEP = math.radians(38.0) * PERIOD
LEFT = DriveCommand(speed=0.7, steering=1.0)
STRAIGHT = DriveCommand(speed=0.7)


def plant(conditions: Conditions | None = None, seed: int = 1) -> Plant:
    return Plant(BICYCLE, conditions or Conditions(), Pose(), seed)


def run(car: Plant, command: DriveCommand, ticks: int) -> Plant:
    for _ in range(ticks):
        car.step(command)
    return car


# ---------------------------------------------------------------------------------------------- timing


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0, 1.5, 3.0])
def test_a_command_acts_after_its_delay(delay: float) -> None:
    """The wheel turns at its rate from then on, also in the middle of a period."""
    car = run(plant(Conditions(delay=delay)), LEFT, 5)
    assert car.steering == pytest.approx((5 - delay) * STEP)


def test_the_follower_sees_what_left_the_gate_last() -> None:
    car = run(plant(), LEFT, 2)
    seen = car.snapshot()
    assert seen.set_points.steering == pytest.approx(2 * STEP)
    assert seen.odometry.steering == pytest.approx(STEP)  # one period behind
    assert seen.sensed.index == 2
    assert seen.time == pytest.approx(2 * PERIOD)
    assert seen.dt == PERIOD


def test_it_rolls_straight_on_before_the_first_command_acts() -> None:
    car = run(plant(Conditions(delay=3.0)), DriveCommand(), 3)
    assert car.pose.x == pytest.approx(0.7 * 3 * PERIOD)
    assert car.pose.y == 0.0
    assert car.snapshot().odometry.distance == pytest.approx(0.7 * 3 * PERIOD)


def test_it_stands_a_tenth_of_a_second_after_its_last_roll() -> None:
    car = plant()
    assert not car.snapshot().standing
    ticks = 0
    while not car.snapshot().standing:
        car.step(DriveCommand())
        ticks += 1
    assert car.speed == 0.0
    assert ticks * PERIOD == pytest.approx(0.7 / 1.0 + PERIOD + 0.1, abs=2 * PERIOD)


# ---------------------------------------------------------------------------------------------- motion


def test_at_a_constant_angle_it_drives_the_exact_circle() -> None:
    angle = math.atan(0.56 / 2.0)
    car = run(plant(Conditions(start_speed=0.0)), DriveCommand(steering=angle), 20)
    assert car.pose == Pose()
    run(car, DriveCommand(speed=0.7, steering=angle), 100)
    turned = car.distance / 2.0
    assert car.pose.x == pytest.approx(2.0 * math.sin(turned), abs=1e-9)
    assert car.pose.y == pytest.approx(2.0 - 2.0 * math.cos(turned), abs=1e-9)
    assert car.pose.heading == pytest.approx(turned)


def test_finer_steps_change_hundredths_of_a_millimetre(monkeypatch: pytest.MonkeyPatch) -> None:
    def weave() -> Pose:
        car = plant()
        for tick in range(300):
            car.step(DriveCommand(speed=0.7, steering=math.sin(tick / 20)))
        return car.pose

    coarse = weave()
    monkeypatch.setattr("artemis_lab.bench.plant.SUB_STEPS", 64)
    fine = weave()
    assert math.dist((coarse.x, coarse.y), (fine.x, fine.y)) < 50e-6


def test_it_drives_backwards() -> None:
    car = run(plant(Conditions(start_speed=0.0)), DriveCommand(speed=-0.3), 60)
    assert car.pose.x == pytest.approx(-car.distance)
    assert car.snapshot().odometry.speed == pytest.approx(-0.3)
    assert car.snapshot().odometry.distance == pytest.approx(-car.distance)


def test_limits_are_the_virtual_wheels_for_a_bicycle_and_each_wheels_else() -> None:
    def rate(car: Plant, ticks: int) -> float:
        before = run(car, LEFT, ticks).set_points.steering
        car.step(LEFT)
        return math.degrees(car.set_points.steering - before) / PERIOD

    assert rate(plant(), 10) == pytest.approx(38.0)
    real = Plant(ROBOT, Conditions(), Pose(), 1)
    rate(real, 30)
    inner, _ = Ackermann(ROBOT.geometry).wheel_rates(real.set_points.steering, 1.0)
    assert inner > 1.1
    assert rate(real, 1) * inner == pytest.approx(33.0, rel=0.02)


# ---------------------------------------------------------------------------------------------- disturbances


def test_a_false_steering_zero_turns_the_robot_and_is_not_seen() -> None:
    car = run(plant(Conditions(steering_zero=0.02)), STRAIGHT, 60)
    assert car.pose.heading == pytest.approx(0.7 * 2.0 * math.sin(0.02) / 0.56)
    assert car.snapshot().odometry.steering == 0.0


def test_larger_wheels_roll_further_than_is_seen() -> None:
    car = run(plant(Conditions(wheel_scale=1.01)), STRAIGHT, 60)
    assert car.pose.x == pytest.approx(1.01 * 1.4)
    assert car.snapshot().odometry.distance == pytest.approx(1.4)
    assert car.snapshot().odometry.speed == pytest.approx(0.7)


def test_slip_loses_its_share_of_way_and_turn() -> None:
    angle = math.atan(0.56 / 2.0)
    steered = run(plant(Conditions(slip=0.1, start_speed=0.0)), DriveCommand(steering=angle), 20)
    car = run(steered, DriveCommand(speed=0.7, steering=angle), 600)
    seen = car.snapshot().odometry.distance
    assert car.distance == pytest.approx(0.9 * seen, rel=0.01)
    laps = round(0.9 * seen / 2.0 / math.tau)
    assert car.pose.heading + laps * math.tau == pytest.approx(0.81 * seen / 2.0, rel=0.02)


def test_slower_steering_than_the_file_says() -> None:
    car = run(plant(Conditions(steering_rate=math.radians(10.0))), LEFT, 31)
    assert math.degrees(car.steering) == pytest.approx(10.0)


def test_noise_is_that_of_the_pose_and_comes_from_the_seed() -> None:
    noisy = Conditions(position_noise=0.005, heading_noise=0.004, start_speed=0.0)

    def poses(seed: int) -> list[Pose]:
        car = plant(noisy, seed)
        return [car.snapshot().odometry.pose for _ in range(2000)]

    first = poses(1)
    assert first == poses(1)
    assert first != poses(2)
    for values, deviation in (([p.x for p in first], 0.005), ([p.heading for p in first], 0.004)):
        assert math.sqrt(sum(value**2 for value in values) / len(values)) == pytest.approx(deviation, rel=0.1)


def test_it_begins_no_faster_than_the_robot_can_be() -> None:
    slow = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"speed_m_s": 0.4})})
    assert Plant(slow, Conditions(), Pose(), 1).speed == 0.4
