"""What is measured of the driven wheels, reading by reading. Limits and times: test_supervisor.py."""

from __future__ import annotations

from dataclasses import replace
from math import cos
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, TRACTION
from supervision_rig import CAR, COASTING, DRIVING, OFF, STEER_LEFT, STOPPING, UNWATCHED, Road, points, road

from artemis.values import DriveCommand, DriveState, SetPoints, Wish

LEFT, RIGHT = TRACTION
RAMP = 1.5
"""Quick stop of the robot file [m/s²]."""
SCRUB = 0.0625
"""Scrub radius of the robot file [m]."""


@pytest.mark.parametrize("speed", [0.0, 0.05, 0.3, 0.7, -0.3, -0.7])
@pytest.mark.parametrize("steering", [0.0, 0.3, -1.0])
def test_robot_that_does_what_it_is_told_gives_no_reading(speed: float, steering: float) -> None:
    made = road(speed, steering)
    made.reference()
    for _ in range(100):
        made.tick()
        assert made.seen == {}


@pytest.mark.parametrize("speed", [0.5, -0.5, 0.0])
def test_robot_that_steers_as_it_is_told_gives_no_reading(speed: float) -> None:
    made = road(speed)
    made.reference()
    made.wish = replace(DRIVING, command=DriveCommand(speed=speed, steering=1.0))
    steering = 0.0
    for _ in range(90):
        rate = 0.3 * cos(made.time)
        steering += rate * PERIOD
        rates = CAR.wheel_rates(steering, rate)
        left, right = CAR.wheel_speeds(speed, steering, *rates)
        made.points = replace(points(speed, steering), speed_left=left, speed_right=right)
        made.speeds, made.rates = (left, right), rates
        made.tick()
        made.angles = list(CAR.wheel_angles(steering))
        assert made.seen == {}


# ---------------------------------------------------------------------------------------------- how fast it rolls


@pytest.mark.parametrize(("left", "right"), [(0.3, 0.2), (-0.3, 0.2), (0.1, -0.4)])
def test_speed_is_that_of_the_faster_wheel(left: float, right: float) -> None:
    made = Road()
    assert made.wheels.speed == 0.0
    made.speeds = left, right
    made.tick()
    assert made.wheels.speed == 0.0, "one moment tells no speed"
    made.ticks(0.1)
    assert made.wheels.speed == pytest.approx(max(abs(left), abs(right)))


def test_speed_is_over_forty_milliseconds() -> None:
    made = road()
    made.speeds = 0.4, 0.0
    made.tick()
    assert made.wheels.speed == pytest.approx(0.2)
    made.tick()
    assert made.wheels.speed == pytest.approx(0.4)


@pytest.mark.parametrize("trouble", [{"age": None}, {"age": 0.0801}], ids=str)
@pytest.mark.parametrize("name", TRACTION)
def test_nothing_is_said_of_wheels_that_are_not_heard(trouble: dict[str, Any], name: str) -> None:
    made = road(0.4)
    made.roll(0.7)
    made.ill(name, **trouble)
    assert made.history("RUN-01", 1.0, LEFT) == [None] * 50
    assert made.wheels.speed == 0.0
    made.well()
    made.tick()
    assert made.wheels.speed == 0.0, "the way passed unseen is no speed"
    made.tick()
    assert made.wheels.speed == pytest.approx(0.7)


def test_nothing_is_said_while_nothing_is_exchanged() -> None:
    made = road(0.4)
    made.wish = replace(DRIVING, exchange=False)
    made.roll(0.0)
    made.tick()
    assert (made.seen, made.wheels.speed) == ({}, 0.0)


def test_steering_is_not_measured_while_nobody_watches_and_rolling_is() -> None:
    made = road()
    made.wish = UNWATCHED
    made.ill(STEER_LEFT, potentiometers=(0.0, 0.0), current=9.0)
    made.tick()
    made.roll(0.3)
    made.ticks(0.1)
    assert made.rows() == {"RUN-02"}


# ---------------------------------------------------------------------------------------------- RUN-01


@pytest.mark.parametrize(
    ("commanded", "actual", "beyond"),
    [
        (0.2, 0.24, None),
        (0.2, 0.26, 0.06),
        (0.2, -0.06, 0.06),
        (0.2, -0.04, None),
        (-0.2, -0.26, 0.06),
        (-0.2, -0.24, None),
        (-0.2, 0.06, 0.06),
        (0.6, 0.71, None),  # a fifth
        (0.6, 0.73, 0.13),
        (0.6, 0.1, None),  # slower is no runaway
        (0.6, -0.13, 0.13),
    ],
)
@pytest.mark.parametrize("side", [0, 1])
def test_wheel_that_runs_away_is_read_with_its_excess(
    commanded: float, actual: float, beyond: float | None, side: int
) -> None:
    made = road(commanded)
    made.speeds = (actual, commanded) if side == 0 else (commanded, actual)
    made.ticks(0.2)
    assert made.value("RUN-01", TRACTION[side]) == (None if beyond is None else pytest.approx(beyond))
    assert made.value("RUN-01", TRACTION[1 - side]) is None
    if beyond is not None:
        assert made.words["RUN-01"] == f"{actual:+.2f} m/s, commanded {commanded:+.2f}"


@pytest.mark.parametrize(("before", "after"), [(0.2, 0.5), (0.5, 0.2), (0.3, -0.3), (-0.5, 0.0)])
def test_wheel_has_a_tenth_of_a_second_to_answer(before: float, after: float) -> None:
    made = road(before)
    made.drive(after, actual=before)
    told = made.history("RUN-01", 0.5, LEFT)
    first = next((number for number, value in enumerate(told) if value is not None), None)
    if abs(before) > abs(after) or before * after < 0:
        assert first in (4, 5), "five ticks after the command"
        assert told[-1] is not None
    else:
        assert first is None


def test_wheel_that_slows_down_from_twice_its_command_is_read() -> None:
    made = road(0.5)
    told = []
    for tick in range(20):
        made.drive(0.5 - PERIOD * tick, actual=1.0 - 2.0 * PERIOD * tick)
        made.tick()
        told.append(made.value("RUN-01", LEFT) or 0.0)
    assert sum(value > 0.15 for value in told) * PERIOD > 0.2, "1 m/s² of the robot file"


# ---------------------------------------------------------------------------------------------- RUN-02


@pytest.mark.parametrize("wish", [OFF, DRIVING], ids=["off", "standing"])
@pytest.mark.parametrize(("speed", "there"), [(0.049, False), (0.051, True), (-0.051, True)])
def test_motion_that_nobody_asked_for_is_read(wish: Wish, speed: float, there: bool) -> None:
    made = Road()
    made.wish, made.speeds = wish, (0.0, speed)
    made.ticks(0.3)
    assert made.value("RUN-02") == (pytest.approx(abs(speed)) if there else None)


@pytest.mark.parametrize(("rate", "there"), [(1.0, False), (0.9, True), (-1.0, False), (0.0, True)])
def test_wheel_that_is_steered_may_roll_about_its_kingpin(rate: float, there: bool) -> None:
    made = Road()
    made.wish = OFF
    made.speeds, made.rates = (0.0, 0.05 + 0.95 * SCRUB), (0.0, rate)
    made.ticks(0.2)
    expected = 0.05 + (0.95 - abs(rate)) * SCRUB
    assert made.value("RUN-02") == (pytest.approx(expected) if there else None)


def test_robot_that_still_slows_down_is_not_pushed() -> None:
    made = road(0.6)
    made.wish = STOPPING
    speed, told = 0.6, []
    while speed > 0.0:
        made.roll(speed)
        made.tick()
        told.append(made.rows())
        speed -= RAMP * PERIOD
    made.roll(0.0)
    for _ in range(50):
        made.tick()
        told.append(made.rows())
    assert told == [set()] * len(told)


# ---------------------------------------------------------------------------------------------- RUN-03


def braking(wish: Wish, deceleration: float, *, of: float = 0.6, seconds: float = 3.0) -> list[float | None]:
    """Readings of RUN-03 of a robot that slows down like this."""
    made = road(of)
    made.wish = wish
    speed, told = of, []
    for _ in range(round(seconds / PERIOD)):
        speed = max(0.0, speed - deceleration * PERIOD)
        made.roll(speed)
        told += made.history("RUN-03", PERIOD)
    return told


@pytest.mark.parametrize(
    ("wish", "deceleration"), [(STOPPING, RAMP), (STOPPING, 1.4), (COASTING, 0.2), (COASTING, 3.0)]
)
def test_robot_that_slows_down_as_planned_is_well(wish: Wish, deceleration: float) -> None:
    assert set(braking(wish, deceleration)) == {None}


@pytest.mark.parametrize(("wish", "deceleration"), [(STOPPING, 0.7), (STOPPING, 0.0), (COASTING, 0.05)])
def test_robot_that_slows_down_too_little_is_read_with_its_excess(wish: Wish, deceleration: float) -> None:
    values = [value for value in braking(wish, deceleration) if value is not None]
    assert values
    assert max(values) > 0.15


def test_excess_is_over_a_ramp_that_begins_after_a_tenth_of_a_second() -> None:
    told = braking(STOPPING, 0.0, seconds=0.5)
    excess = [RAMP * max(0.0, number * PERIOD - 0.1) for number in range(25)]
    assert [value or 0.0 for value in told] == pytest.approx([x if x > 0.05 else 0.0 for x in excess], abs=0.06)
    assert told[-1] == pytest.approx(excess[-1], abs=RAMP * PERIOD + 1e-9)


def test_ramp_begins_at_the_speed_at_hand_if_that_is_higher() -> None:
    made = road(0.4)
    made.roll(0.46)
    made.ticks(0.2)
    made.wish = STOPPING
    assert made.history("RUN-03", 0.1) == [None] * 5


@pytest.mark.parametrize(("actual", "excess"), [(0.54, None), (0.56, 0.06), (-0.56, 0.06)])
def test_controlled_stop_is_judged_by_the_set_points(actual: float, excess: float | None) -> None:
    made = road(0.5)
    made.stops = True
    made.roll(actual)
    made.ticks(0.3)
    assert made.value("RUN-03") == (None if excess is None else pytest.approx(excess))
    assert made.value("RUN-01", LEFT) is None, "one row for one thing"


def test_plan_may_begin_anew_from_the_speed_at_hand() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.ticks(0.4)
    assert made.value("RUN-03") == pytest.approx(0.45, abs=0.01)
    made.wheels.plan_from_here()
    made.tick()
    assert made.value("RUN-03") is None
    made.ticks(0.2)
    assert made.value("RUN-03") == pytest.approx(0.3 + RAMP * PERIOD, abs=0.01)


def test_robot_that_came_to_rest_and_is_pushed_is_pushed_and_does_not_fail_to_brake() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.roll(0.0)
    made.ticks(1.0)
    made.roll(0.3)
    made.ticks(0.2)
    assert made.rows() == {"RUN-02"}


def test_end_of_a_slow_drive_is_no_braking() -> None:
    made = road(0.04)
    made.wish = STOPPING
    made.tick()
    made.roll(0.3)
    made.ticks(0.06)
    assert "RUN-03" not in made.rows()


# ---------------------------------------------------------------------------------------------- RUN-04, RUN-06


@pytest.mark.parametrize(
    ("commanded", "actual", "there"),
    [
        (0.11, 0.0, True),
        (-0.11, 0.0, True),
        (0.09, 0.0, False),
        (0.3, 0.029, True),
        (0.3, -0.029, True),
        (0.3, 0.031, False),
    ],
)
def test_wheel_that_does_not_move_is_read(commanded: float, actual: float, there: bool) -> None:
    made = road(commanded)
    made.speeds = commanded, actual
    made.ticks(0.2)
    assert made.value("RUN-04", RIGHT) == (1.0 if there else None)
    assert made.value("RUN-04", LEFT) is None


def test_wheel_that_shall_move_only_now_is_not_blocked_yet() -> None:
    made = road()
    made.drive(0.3, actual=0.0)
    told = made.history("RUN-04", 0.4, LEFT)
    first = told.index(1.0)
    assert first in (9, 10), "ten ticks after the command"
    assert set(told[first:]) == {1.0}


@pytest.mark.parametrize("off", TRACTION)
@pytest.mark.parametrize(("speed", "there"), [(0.06, True), (0.04, False)])
def test_driven_wheel_that_pushes_alone_is_read(off: str, speed: float, there: bool) -> None:
    made = road(speed)
    made.ill(off, state=DriveState.SWITCH_ON_DISABLED)
    made.tick()
    (other,) = set(TRACTION) - {off}
    assert made.seen == ({("RUN-06", other): 1.0} if there else {})


def test_both_off_or_stopping_is_no_pushing_alone() -> None:
    made = road(0.4)
    made.ill(LEFT, state=DriveState.SWITCH_ON_DISABLED)
    made.ill(RIGHT, state=DriveState.SWITCH_ON_DISABLED)
    made.tick()
    assert made.value("RUN-06", LEFT) is made.value("RUN-06", RIGHT) is None
    made.well()
    made.ill(LEFT, state=DriveState.SWITCH_ON_DISABLED)
    made.wish = STOPPING
    made.tick()
    assert made.rows() == set()


# ---------------------------------------------------------------------------------------------- RUN-05


@pytest.mark.parametrize(("left", "right", "slip"), [(0.4, 0.4, None), (0.4, 0.33, None), (0.4, 0.3, 0.25),
                                                    (0.3, 0.4, 0.25), (0.4, 0.0, 1.0), (-0.4, -0.2, 0.5),
                                                    (0.4, -0.4, 2.0)])  # fmt: skip
def test_slip_is_the_difference_of_the_wheels_over_the_faster(left: float, right: float, slip: float | None) -> None:
    made = road(0.4)
    made.speeds = left, right
    made.ticks(0.3)
    assert made.value("RUN-05") == (None if slip is None else pytest.approx(slip))


@pytest.mark.parametrize("steering", [0.5, -0.9])
def test_slip_is_measured_against_the_wheels_of_a_robot_in_a_curve(steering: float) -> None:
    made = road(0.4, steering)
    made.speeds = 0.4, 0.4  # as if it went straight
    made.ticks(0.3)
    ratios = CAR.speed_ratios(steering)
    rolled = [0.4 / ratio for ratio in ratios]
    assert made.value("RUN-05") == pytest.approx(abs(rolled[0] - rolled[1]) / max(rolled))


def test_slow_wheels_do_not_slip() -> None:
    made = road(0.05)
    made.speeds = 0.095, 0.0
    made.ticks(0.3)
    assert made.value("RUN-05") is None


def test_rolling_about_the_kingpins_is_no_slip() -> None:
    made = road()
    made.rates = 1.9, 1.9
    made.speeds = CAR.wheel_speeds(0.0, 0.0, *made.rates)
    made.points = replace(points(), speed_left=made.speeds[0], speed_right=made.speeds[1])
    made.tick()
    made.tick()
    assert made.wheels.speed > 0.1
    assert made.value("RUN-05") is None


def test_wheels_that_are_not_driven_do_not_slip() -> None:
    made = road(0.4)
    made.wish, made.speeds = STOPPING, (0.4, 0.0)
    made.ticks(0.3)
    assert made.value("RUN-05") is None


# ---------------------------------------------------------------------------------------------- a drive without power


@pytest.mark.parametrize("state", DriveState)
def test_wheel_whose_drive_cannot_brake_it_rolls_out_and_the_other_is_judged(state: DriveState) -> None:
    brakes = state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ENABLED)
    made = road(0.6)
    made.wish, speed, told = STOPPING, 0.6, set()
    made.ill(LEFT, state=state)
    for _ in range(25):
        speed = max(0.0, speed - RAMP * PERIOD)
        made.speeds = 0.6, speed
        made.tick()
        told |= made.rows()
    assert ("RUN-03" in told) is brakes


def test_robot_that_no_drive_can_brake_is_judged_by_both_wheels_as_one_that_rolls_out() -> None:
    made = road(0.6)
    made.wish = STOPPING
    for name in TRACTION:
        made.ill(name, state=DriveState.FAULT)
    made.ticks(0.6)
    assert made.value("RUN-03") == pytest.approx(0.2 * 0.5, abs=0.011)


def test_all_drives_have_names_of_the_robot_file() -> None:
    made = Road()
    made.points = SetPoints(steering_left=1.0, steering_right=1.0)
    made.tick()
    assert {device for _, device in made.seen} <= {"", *NAMES}
