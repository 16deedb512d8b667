from __future__ import annotations

from math import inf, nan, radians
from pathlib import Path

import pytest
import yaml

from artemis.mission.speeds import stopping_distance
from artemis.motion.ackermann import Ackermann
from artemis.motion.limits import SHORTEST_STEP, Gate, is_sane
from artemis.values import Action, DriveCommand, SetPoints
from artemis.vehicle import RobotFile

FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
ROBOT = RobotFile.model_validate(yaml.safe_load(FILE.read_text(encoding="utf-8")))
CAR = Ackermann(ROBOT.geometry)
DT = 0.02
RATE = radians(33.0)
STANDING = SetPoints()


def gate(**limits: float) -> Gate:
    return Gate(ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update=limits)}), period=DT)


def moving(speed: float, steering: float = 0.0) -> SetPoints:
    left, right = CAR.wheel_angles(steering)
    speed_left, speed_right = CAR.wheel_speeds(speed, steering)
    return SetPoints(
        speed=speed,
        steering=steering,
        speed_left=speed_left,
        speed_right=speed_right,
        steering_left=left,
        steering_right=right,
    )


def settle(made: Gate, command: DriveCommand, last: SetPoints = STANDING, ticks: int = 400) -> SetPoints:
    for _ in range(ticks):
        last = made.limit(command, last, DT)
    return last


# ---------------------------------------------------------------------------------------------- stops


@pytest.mark.parametrize("action", [Action.QUICKSTOP, Action.DISABLE])
@pytest.mark.parametrize("dt", [0.0, DT, 10.0])
@pytest.mark.parametrize("number", [0.0, 0.5, nan, inf])
def test_quick_stop_is_at_once_and_holds_the_wheels(action: Action, dt: float, number: float) -> None:
    last = moving(0.7, 0.3)
    made = gate().limit(DriveCommand(speed=number, steering=number, action=action), last, dt)
    assert made == SetPoints(
        steering=last.steering, steering_left=last.steering_left, steering_right=last.steering_right
    )


def test_controlled_stop_brakes_at_the_deceleration_and_holds_the_wheels() -> None:
    last = moving(0.5, 0.3)
    made = gate().limit(DriveCommand(speed=0.7, steering=-0.3), last, DT, stop=True)
    assert made == moving(0.5 - 1.0 * DT, 0.3)


@pytest.mark.parametrize("speed", [0.7, -0.7])
def test_controlled_stop_stands_in_time_and_stays(speed: float) -> None:
    made, last, ticks = gate(), moving(speed, -0.2), 0
    while last.speed != 0.0:
        last = made.limit(DriveCommand(speed=speed), last, DT, stop=True)
        ticks += 1
    assert ticks == 35  # 0.7 m/s at 1 m/s² in steps of 20 ms
    assert made.limit(DriveCommand(speed=speed), last, DT, stop=True) == moving(0.0, -0.2)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_number_that_is_not_finite_stops_and_holds(bad: float) -> None:
    last = moving(0.5, 0.3)
    stopped = gate().limit(DriveCommand(), last, DT, stop=True)
    for command in (DriveCommand(speed=bad, steering=0.1), DriveCommand(speed=0.5, steering=bad)):
        assert not is_sane(command)
        assert gate().limit(command, last, DT) == stopped


def test_finite_command_and_stops_are_sane() -> None:
    assert is_sane(DriveCommand(speed=1e300, steering=-1e300))
    assert is_sane(DriveCommand(speed=nan, action=Action.QUICKSTOP))
    assert is_sane(DriveCommand(steering=inf, action=Action.DISABLE))


def test_stopping_distance_is_reaction_plus_braking() -> None:
    assert stopping_distance(1.0, 0.24, 1.5) == pytest.approx(0.24 + 1 / 3)
    assert stopping_distance(-1.0, 0.24, 1.5) == stopping_distance(1.0, 0.24, 1.5)
    assert stopping_distance(0.0, 0.24, 1.5) == 0.0


# ---------------------------------------------------------------------------------------------- time


@pytest.mark.parametrize("dt", [0.0, -1.0, nan, SHORTEST_STEP / 2])
@pytest.mark.parametrize("stop", [False, True])
def test_without_time_nothing_changes(dt: float, stop: bool) -> None:
    last = moving(0.3, 0.2)
    assert gate().limit(DriveCommand(speed=-0.5, steering=-1.0), last, dt, stop=stop) is last


def test_a_microsecond_is_time() -> None:
    last, command = moving(0.3, 0.2), DriveCommand(speed=-0.5, steering=-1.0)
    assert gate().limit(command, last, 0.95e-6) is last
    assert gate().limit(command, last, 1e-6) != last


def test_pause_does_not_open_the_ramps() -> None:
    command = DriveCommand(speed=0.7, steering=1.0)
    assert gate().limit(command, STANDING, 60.0) == gate().limit(command, STANDING, 0.1)


# ---------------------------------------------------------------------------------------------- speed


def test_standing_robot_accelerates() -> None:
    assert gate().limit(DriveCommand(speed=0.7), STANDING, DT) == moving(0.5 * DT)
    assert gate().limit(DriveCommand(speed=-0.7), STANDING, DT) == moving(-0.5 * DT)


def test_small_change_is_taken_whole() -> None:
    assert gate().limit(DriveCommand(speed=0.305), moving(0.3), DT).speed == 0.305
    assert gate().limit(DriveCommand(speed=0.29), moving(0.3), DT).speed == 0.29


def test_slowing_down_takes_the_deceleration() -> None:
    assert gate().limit(DriveCommand(speed=0.1), moving(0.5), DT).speed == pytest.approx(0.5 - 1.0 * DT)
    assert gate().limit(DriveCommand(speed=-0.1), moving(-0.5), DT).speed == pytest.approx(-0.5 + 1.0 * DT)


def test_change_of_direction_brakes_to_a_halt_first() -> None:
    made, last, speeds = gate(), moving(0.03), []
    for _ in range(4):
        last = made.limit(DriveCommand(speed=-0.7), last, DT)
        speeds.append(last.speed)
    assert speeds == pytest.approx([0.01, 0.0, -0.01, -0.02])


@pytest.mark.parametrize(("wish", "expected"), [(5.0, 0.7), (-5.0, -0.7), (0.4, 0.4)])
def test_speed_is_limited_both_ways(wish: float, expected: float) -> None:
    assert settle(gate(), DriveCommand(speed=wish)).speed == pytest.approx(expected)


@pytest.mark.parametrize(("ceiling", "expected"), [(0.3, 0.3), (9.0, 0.7), (0.0, 0.0), (-0.2, 0.0), (nan, 0.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ceiling_lowers_the_speed(ceiling: float, expected: float, sign: float) -> None:
    made, last = gate(), STANDING
    for _ in range(100):
        last = made.limit(DriveCommand(speed=sign * 0.7), last, DT, ceiling=ceiling)
    assert last.speed == pytest.approx(sign * expected)


def test_lowered_ceiling_is_reached_by_the_deceleration() -> None:
    made = gate().limit(DriveCommand(speed=0.7), moving(0.7), DT, ceiling=0.3)
    assert made.speed == pytest.approx(0.7 - 1.0 * DT)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_wheel_passes_its_limit_at_full_lock(sign: float) -> None:
    last = settle(gate(), DriveCommand(speed=0.7, steering=sign * radians(60)))
    assert max(last.speed_left, last.speed_right) == pytest.approx(0.72)
    assert last.speed == pytest.approx(0.72 / 1.236, abs=0.001)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("target", [1.0, -1.0])
def test_robot_slows_down_before_it_steers_into_the_wheel_limit(direction: float, target: float) -> None:
    made = gate(wheel_speed_m_s=0.7)
    last, command = moving(0.7 * direction), DriveCommand(speed=0.7 * direction, steering=target)
    first = made.limit(command, last, DT)
    assert first == moving((0.7 - 1.0 * DT) * direction)
    second = made.limit(command, first, DT)
    assert second.steering * target > 0.0
    assert max(abs(second.speed_left), abs(second.speed_right)) <= 0.7


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize(("start", "target"), [(0.8, 1.0), (-0.8, -1.0), (0.8, -1.0), (-0.8, 1.0)])
def test_wheels_keep_room_for_the_roll_of_steering(direction: float, start: float, target: float) -> None:
    last = settle(gate(), DriveCommand(speed=0.7 * direction, steering=start))
    command = DriveCommand(speed=0.7 * direction, steering=target)
    last = settle(gate(), command, last, ticks=5)
    made = gate().limit(command, last, DT)
    rates = [abs(made.steering_left - last.steering_left) / DT, abs(made.steering_right - last.steering_right) / DT]
    assert max(rates) == pytest.approx(RATE)
    assert abs(made.speed) * max(CAR.speed_ratios(made.steering)) == pytest.approx(0.72 - 0.0625 * max(rates))


# ---------------------------------------------------------------------------------------------- steering


@pytest.mark.parametrize("target", [1.0, -1.0])
@pytest.mark.parametrize("start", [-0.8, -0.3, 0.0, 0.5])
def test_faster_wheel_turns_at_its_limit_and_the_pair_stays_exact(start: float, target: float) -> None:
    last = moving(0.0, start)
    made = gate().limit(DriveCommand(steering=target), last, DT)
    turned = abs(made.steering_left - last.steering_left), abs(made.steering_right - last.steering_right)
    assert max(turned) == pytest.approx(RATE * DT, abs=1e-12)
    assert (made.steering_left, made.steering_right) == CAR.wheel_angles(made.steering)


def test_close_target_is_taken_exactly() -> None:
    made = gate().limit(DriveCommand(steering=0.305), moving(0.0, 0.3), DT)
    assert made.steering == 0.305
    assert (made.steering_left, made.steering_right) == CAR.wheel_angles(0.305)


@pytest.mark.parametrize(("wish", "expected"), [(9.0, 60.0), (-9.0, -60.0)])
def test_steering_ends_at_its_limit(wish: float, expected: float) -> None:
    assert settle(gate(), DriveCommand(steering=wish)).steering == pytest.approx(radians(expected))


def test_lock_to_lock_takes_as_long_as_the_wheels_need() -> None:
    made, last, ticks = gate(), moving(0.0, radians(-60)), 0
    while last.steering < radians(60):
        last = made.limit(DriveCommand(steering=radians(60)), last, DT)
        ticks += 1
    assert ticks * DT == pytest.approx(2 * 73.32 / 33.0, abs=2 * DT)  # the inner wheel leads on both sides


def test_standing_wheels_roll_freely_while_they_are_steered() -> None:
    last = moving(0.0, 0.4)
    made = gate().limit(DriveCommand(steering=0.9), last, DT)
    left, right = made.steering_left - last.steering_left, made.steering_right - last.steering_right
    assert made.speed == 0.0
    assert (made.speed_left, made.speed_right) == pytest.approx((-0.0625 * left / DT, 0.0625 * right / DT))


def test_steering_waits_for_a_drive_axle_that_cannot_follow() -> None:
    """Wheels too slow to roll as fast as steering makes them: the steering rate gives way."""
    made = gate(wheel_speed_m_s=0.01)
    last = made.limit(DriveCommand(speed=0.7, steering=1.0), STANDING, DT)
    assert 0.0 < last.steering
    assert max(abs(last.speed_left), abs(last.speed_right)) <= 0.01 + 1e-12
    last = settle(made, DriveCommand(speed=0.7, steering=1.0), last, ticks=1000)
    assert last.steering == pytest.approx(1.0)
    assert max(last.speed_left, last.speed_right) == pytest.approx(0.01)


# ---------------------------------------------------------------------------------------------- alignment


@pytest.mark.parametrize(("left", "right"), [(0.5, -0.5), (-0.9, 0.2), (0.4, 0.4), (1.6, 1.6), (-1.9, 2.0)])
@pytest.mark.parametrize("target", [0.0, -0.4])
def test_wheels_found_anywhere_become_a_pair_each_at_its_own_rate(left: float, right: float, target: float) -> None:
    made, last = gate(), SetPoints(steering_left=left, steering_right=right)
    needed = max(abs(a - b) for a, b in zip((left, right), CAR.wheel_angles(target), strict=True)) / RATE
    for _ in range(int(1.02 * needed / DT) + 2):
        following = made.limit(DriveCommand(steering=target), last, DT)
        assert abs(following.steering_left - last.steering_left) <= RATE * DT + 1e-12
        assert abs(following.steering_right - last.steering_right) <= RATE * DT + 1e-12
        last = following
    assert (last.steering_left, last.steering_right) == CAR.wheel_angles(target)
    assert last.steering == target


@pytest.mark.parametrize(("periods", "counted"), [(1.25, 1.25), (1.5, 1.5), (3.0, 1.5)])
def test_step_counts_as_one_and_a_half_periods_at_most(periods: float, counted: float) -> None:
    made = gate().limit(DriveCommand(speed=0.5), STANDING, periods * DT)
    assert made.speed == pytest.approx(0.5 * counted * DT)


def test_step_that_comes_early_rolls_what_its_wheels_turn_until_the_next_is_due() -> None:
    last = moving(0.5, 0.3)
    early = gate().limit(DriveCommand(speed=0.5, steering=1.0), last, DT / 20)
    turned = early.steering_left - last.steering_left
    assert turned == pytest.approx(RATE * DT / 20)
    rolled = early.speed_left - CAR.wheel_speeds(early.speed, early.steering)[0]
    assert abs(rolled) == pytest.approx(CAR.scrub_radius * turned / DT)


@pytest.mark.parametrize("axle", ["front", "rear"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_wheels_found_turned_backwards_come_round(axle: str, side: float) -> None:
    geometry = ROBOT.geometry.model_copy(update={"driven_axle": axle})
    made, last = Gate(ROBOT.model_copy(update={"geometry": geometry}), period=DT), moving(0.0, side * 2.2)
    assert settle(made, DriveCommand(), last).steering == 0.0


def test_wheels_that_are_no_pair_do_not_drive() -> None:
    last = SetPoints(steering_left=0.5, steering_right=-0.5)
    made = gate().limit(DriveCommand(speed=0.5), last, DT)
    assert made.speed == 0.0
    assert made.steering == pytest.approx(CAR.steering_from_wheel_angles(made.steering_left, made.steering_right))


def test_moving_wheels_that_are_no_pair_stop_before_they_are_aligned() -> None:
    last = SetPoints(speed=0.5, steering_left=0.5, steering_right=-0.5)
    made = gate().limit(DriveCommand(speed=0.5), last, DT)
    assert made.speed == pytest.approx(0.5 - 1.0 * DT)
    assert (made.steering_left, made.steering_right) == (0.5, -0.5)


def test_moving_wheels_that_are_no_pair_are_aligned_from_the_step_on_that_ends_at_standstill() -> None:
    last = SetPoints(speed=1.0 * DT, steering_left=0.5, steering_right=-0.5)
    made = gate().limit(DriveCommand(speed=0.5), last, DT)
    assert made.speed == 0.0
    assert (made.steering_left, made.steering_right) == pytest.approx((0.5 - RATE * DT, -0.5 + RATE * DT))


def test_wheels_that_can_just_become_a_pair_are_one_and_drive() -> None:
    last = SetPoints(steering_left=-RATE * DT, steering_right=RATE * DT)
    made = gate().limit(DriveCommand(speed=0.5), last, DT)
    assert (made.steering, made.steering_left, made.steering_right) == (0.0, 0.0, 0.0)
    assert made.speed == 0.5 * DT


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_rear_wheels_keep_their_limit_while_wheels_found_turned_backwards_come_round(side: float) -> None:
    geometry = ROBOT.geometry.model_copy(update={"driven_axle": "rear"})
    limits = ROBOT.limits.model_copy(update={"wheel_speed_m_s": 0.1})
    made = Gate(ROBOT.model_copy(update={"geometry": geometry, "limits": limits}), period=DT)
    left, right = Ackermann(geometry).wheel_angles(side * 2.2)
    last = SetPoints(steering=side * 2.2, steering_left=left, steering_right=right)
    for _ in range(200):
        last = made.limit(DriveCommand(speed=0.7, steering=side * 2.2), last, DT)
        assert max(abs(last.speed_left), abs(last.speed_right)) <= 0.1 + 1e-12
    assert last.speed > 0.0


def test_rear_driven_robot_is_limited_by_its_outer_rear_wheel() -> None:
    geometry = ROBOT.geometry.model_copy(update={"driven_axle": "rear"})
    made = Gate(ROBOT.model_copy(update={"geometry": geometry}), period=DT)
    last = settle(made, DriveCommand(speed=0.7, steering=radians(30)))
    assert last.speed_right == pytest.approx(0.72)
    assert last.speed == pytest.approx(0.72 / Ackermann(geometry).speed_ratios(radians(30))[1])


def test_steered_rear_driven_robot_stands_still() -> None:
    geometry = ROBOT.geometry.model_copy(update={"driven_axle": "rear"})
    made = Gate(ROBOT.model_copy(update={"geometry": geometry}), period=DT)
    last = made.limit(DriveCommand(steering=1.0), STANDING, DT)
    assert last.steering > 0.0
    assert (last.speed_left, last.speed_right) == (0.0, 0.0)
