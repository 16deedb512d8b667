"""What is measured of the driven wheels, reading by reading. Limits and times: test_supervisor_rows.py."""

from __future__ import annotations

from math import cos
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, TRACTION
from msgspec.structs import replace
from supervision_rig import CAR, DRIVING, OFF, STEER_LEFT, STOPPING, UNWATCHED, Road, points, road

from artemis.drive_states import DriveState
from artemis.values import DriveCommand, SetPoints, Wish

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


def test_speed_is_over_exactly_a_hundredth_less_if_a_tick_came_just_then() -> None:
    made = Road()
    made.time = -0.25
    made.tick(after=0.0)
    made.tick(after=0.25)
    made.speeds = 0.4, 0.0
    made.tick(after=0.99 * 0.04)
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
    assert made.wheels.speed == 0.0, "the distance passed unseen is no speed"
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


def test_robot_that_shall_stop_from_the_first_tick_on_is_read_as_any_other() -> None:
    made = Road()
    made.wish, made.stops = OFF, True
    made.roll(0.3)
    made.ticks(0.2)
    assert made.rows() == {"RUN-02"}


def test_robot_that_rolls_off_though_nobody_drove_it_is_held_to_a_ramp_once_it_shall_stop() -> None:
    made = road()
    made.wish = OFF
    made.ticks(0.3)
    for speed in (0.1, 0.2, 0.3):
        made.roll(speed)
        made.ticks(0.1)
    assert made.rows() == {"RUN-02"}
    made.stops = True
    for speed in (0.4, 0.5, 0.6, 0.7, 0.8):
        made.roll(speed)
        made.ticks(0.1)
    assert made.rows() == {"RUN-03"}


# ---------------------------------------------------------------------------------------------- RUN-02


@pytest.mark.parametrize("wish", [OFF, DRIVING], ids=["off", "standing"])
@pytest.mark.parametrize(("speed", "there"), [(0.009, False), (0.011, True), (-0.011, True)])
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


@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_wheel_that_shall_move_only_now_is_not_blocked_yet(speed: float) -> None:
    made = road()
    made.drive(speed, actual=0.0)
    made.tick()
    made.tick(after=0.179)
    assert made.value("RUN-04", LEFT) is None, "it was to stand 0.199 s ago"
    made.tick(after=0.002)
    assert made.value("RUN-04", LEFT) == 1.0
    assert set(made.history("RUN-04", 0.4, LEFT)) == {1.0}


def test_wheel_that_was_to_stand_exactly_a_fifth_of_a_second_ago_is_not_blocked_yet() -> None:
    made = Road()
    made.tick(after=0.0)
    made.drive(0.3, actual=0.0)
    made.tick(after=0.2)
    assert made.seen == {}
    made.tick()
    assert made.rows() == {"RUN-04"}


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


def test_wheel_that_rolled_just_a_tenth_of_a_metre_per_second_is_slow() -> None:
    made = road(0.05)
    made.time, made.speeds = 4.0, (0.0, 0.0)
    made.tick(after=0.0)
    made.tick(after=0.1875)
    made.speeds = 0.4, 0.0
    made.tick(after=0.0625)
    assert made.wheels.speed == pytest.approx(0.4)
    assert made.value("RUN-05") is None, "0.1 m/s over the time of slip"


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


def test_all_drives_have_names_of_the_robot_file() -> None:
    made = Road()
    made.points = SetPoints(steering_left=1.0, steering_right=1.0)
    made.tick()
    assert {device for _, device in made.seen} <= {"", *NAMES}
