"""Windows and limits of what is measured of the wheels, to the edge: at it, and a little beyond."""

from __future__ import annotations

from math import radians

import pytest
from core_builders import TRACTION, volts
from msgspec.structs import replace
from supervision_rig import CAR, COASTING, DRIVING, OFF, STEER_LEFT, STEER_RIGHT, STOPPING, Road, road

from artemis.drive_states import DriveState
from artemis.values import DriveCommand, Tracking, Wish

LEFT, RIGHT = TRACTION
RAMP, COAST = 1.5, 0.2
"""Quick stop of the robot file, and the least of a robot that is off [m/s²]."""


def exactly(made: Road, left: float, right: float) -> Road:
    """The driven wheels roll so fast, without an error of rounding."""
    made.time, made.distances, made.speeds = 4.0, [0.0, 0.0], (left, right)
    made.tick(after=0.0)
    made.tick(after=1.0)
    return made


# ---------------------------------------------------------------------------------------------- windows


@pytest.mark.parametrize(("after", "part"), [(0.0395, 0.0395 / 0.0595), (0.0397, 1.0)])
def test_speed_is_over_forty_milliseconds_at_least_but_for_a_hundredth(after: float, part: float) -> None:
    made = road()
    made.speeds = 0.4, 0.0
    made.tick(after=after)
    assert made.wheels.speed == pytest.approx(0.4 * part)


@pytest.mark.parametrize(("after", "slip"), [(0.197, 1.0 - 0.02 / 0.217), (0.199, 1.0)])
def test_slip_is_over_a_fifth_of_a_second_at_least_but_for_a_hundredth(after: float, slip: float) -> None:
    made = road(0.4)
    made.speeds = 0.4, 0.0
    made.tick(after=after)
    assert made.value("RUN-05") == pytest.approx(slip)


def test_command_counts_for_a_tenth_of_a_second() -> None:
    made = road(0.5)
    made.drive(0.2, actual=0.5)
    made.tick()
    made.tick(after=0.079)
    assert made.value("RUN-01", LEFT) is None, "the one before it was given 0.099 s ago"
    made.tick(after=0.002)
    assert made.value("RUN-01", LEFT) == pytest.approx(0.3)


def test_command_of_exactly_a_tenth_of_a_second_ago_counts() -> None:
    made = Road()
    made.drive(0.5)
    made.tick(after=0.0)
    made.drive(0.2, actual=0.5)
    made.tick(after=0.1)
    assert made.seen == {}


def test_words_tell_the_latest_command() -> None:
    made = road(0.5)
    made.drive(0.2, actual=0.9)
    made.tick()
    assert made.words["RUN-01"] == "+0.70 m/s, commanded +0.20"
    made = road(0.5)
    made.roll(0.0)
    made.ticks(0.1)
    made.drive(0.3, actual=0.0)
    made.tick()
    assert made.words["RUN-04"] == "+0.00 m/s, commanded +0.30"


# ---------------------------------------------------------------------------------------------- what may be expected


@pytest.mark.parametrize(("wish", "ramp"), [(STOPPING, RAMP), (COASTING, COAST)])
def test_ramp_begins_after_a_tenth_of_a_second_and_falls_as_planned(wish: Wish, ramp: float) -> None:
    made = road(0.6)
    made.wish = wish
    made.tick()
    made.tick(after=0.099)
    made.tick(after=0.002)
    made.tick(after=0.3)
    assert made.value("RUN-03") == pytest.approx(0.302 * ramp)


def test_at_the_end_of_the_tenth_of_a_second_the_ramp_has_not_begun() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.tick()
    made.tick(after=0.1)
    made.tick(after=0.2)
    assert made.value("RUN-03") == pytest.approx(0.2 * RAMP)


def test_plan_waits_while_the_wheels_are_not_heard() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.ticks(0.2)
    made.ill(LEFT, age=None)
    made.tick()
    made.well()
    made.ticks(0.2)
    assert made.rows() == set(), "it may still roll"
    made.ticks(0.2)
    assert made.rows() == {"RUN-02"}


def test_one_drive_that_can_brake_is_held_to_the_ramp() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.ill(LEFT, state=DriveState.FAULT)
    made.ticks(0.3)
    assert made.value("RUN-03") == pytest.approx(0.2 * RAMP, abs=0.031)
    assert made.words["RUN-03"] == "0.60 m/s, 0.30 planned"


@pytest.mark.parametrize(("rest", "row"), [(0.021, "RUN-03"), (0.019, "RUN-02")])
def test_robot_slower_than_two_centimetres_in_a_second_has_come_to_rest(rest: float, row: str) -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.roll(rest)
    made.ticks(1.0)
    made.roll(0.3)
    made.ticks(0.2)
    assert made.rows() == {row}


def test_robot_of_exactly_two_centimetres_in_a_second_has_come_to_rest() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.roll(0.1)
    made.ticks(0.7)
    exactly(made, 0.02, 0.02)
    made.roll(0.3)
    made.ticks(0.2)
    assert made.rows() == {"RUN-02"}


def test_robot_that_is_told_to_stand_after_it_braked_is_pushed_if_it_rolls() -> None:
    made = road(0.6)
    made.wish = STOPPING
    made.tick()
    made.drive(0.0, actual=0.6)
    made.ticks(0.3)
    assert "RUN-02" in made.rows()


def test_robot_that_is_commanded_to_stop_is_not_driven_whatever_its_drives_shall_do() -> None:
    made = road(0.5)
    made.wish = replace(DRIVING, command=STOPPING.command)
    made.ticks(0.6)
    assert made.value("RUN-03") == pytest.approx(0.48 * COAST, abs=0.005)


def test_robot_that_was_driven_at_five_centimetres_in_a_second_does_not_brake() -> None:
    made = road(0.05)
    made.drive(0.05, actual=0.04)
    made.ticks(0.5)
    made.wish = STOPPING
    made.tick()
    made.roll(0.3)
    made.ticks(0.06)
    assert "RUN-03" not in made.rows()


@pytest.mark.parametrize(("speed", "steering"), [(0.5, 1.0), (0.5, -1.0), (-0.5, 1.0), (-0.5, -1.0)])
def test_both_wheels_and_both_directions_are_planned_in_a_controlled_stop(speed: float, steering: float) -> None:
    made = road(speed, steering)
    made.stops = True
    made.ticks(0.3)
    assert made.seen == {}


def test_wheels_may_trail_a_controlled_stop_by_a_fifth_of_a_second() -> None:
    made = road(0.5)
    made.stops = True
    made.drive(0.3, actual=0.5)
    made.ticks(0.18)
    assert made.value("RUN-03") is None
    made.ticks(0.1)
    assert made.value("RUN-03") == pytest.approx(0.2)


@pytest.mark.parametrize("side", [0, 1])
def test_robot_that_stood_shall_not_drive_faster_than_told(side: int) -> None:
    made = road()
    made.wish = OFF
    made.ticks(0.3)
    made.drive(0.2)
    made.speeds = (0.3, 0.2) if side == 0 else (0.2, 0.3)
    made.ticks(0.06)
    assert made.value("RUN-01", TRACTION[side]) == pytest.approx(0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fifth_of_the_faster_command_counts(sign: float) -> None:
    made = road(sign * 0.6)
    made.drive(sign * 0.3, actual=sign * 0.7)
    made.ticks(0.04)
    assert made.value("RUN-01", LEFT) is None
    made.roll(sign * 0.73)
    made.ticks(0.04)
    assert made.value("RUN-01", LEFT) == pytest.approx(0.13)


def test_steered_wheel_that_is_not_heard_does_not_hide_the_driven_ones() -> None:
    made = road(0.4)
    made.ill(STEER_LEFT, age=None)
    made.tick()
    assert made.wheels.speed == pytest.approx(0.4)


@pytest.mark.parametrize("name", [LEFT, STEER_LEFT])
def test_feedback_at_its_greatest_age_still_counts(name: str) -> None:
    made = road(0.4)
    made.ill(name, age=0.08, current=1.9)
    made.tick()
    assert made.wheels.speed == pytest.approx(0.4)
    assert (made.value("STE-02", name) is None) is (name == LEFT)


# ---------------------------------------------------------------------------------------------- driven wheels


def test_a_centimetre_in_a_second_is_not_creeping() -> None:
    made = road()
    made.wish = OFF
    assert exactly(made, 0.01, 0.01).value("RUN-02") is None


def test_five_centimetres_in_a_second_are_not_moving() -> None:
    made = road()
    made.ill(LEFT, state=DriveState.READY)
    made.drive(0.05)
    assert exactly(made, 0.05, 0.05).value("RUN-06", RIGHT) is None


def test_five_centimetres_in_a_second_too_much_are_no_excess() -> None:
    made = road(0.05)
    made.stops = True
    assert exactly(made, 0.1, 0.1).value("RUN-03") is None
    made.stops = False
    assert exactly(made, 0.1, 0.1).value("RUN-01", LEFT) is None


def test_wheel_at_the_limit_of_standing_and_slow_commands_are_not_blocked() -> None:
    assert exactly(road(0.3), 0.3, 0.03).value("RUN-04", RIGHT) is None
    assert exactly(road(0.1), 0.1, 0.0).value("RUN-04", RIGHT) is None


@pytest.mark.parametrize("rates", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_either_wheel_may_be_the_one_that_is_steered(rates: tuple[float, float]) -> None:
    made = road()
    made.wish = OFF
    made.ticks(0.3)
    made.rates, made.speeds = rates, (0.1, 0.1)
    made.ticks(0.1)
    assert made.value("RUN-02") is None
    made.rates = 0.0, 0.0
    made.tick()
    assert made.value("RUN-02") == pytest.approx(0.1)


def test_words_of_what_is_clear_are_none() -> None:
    made = road(0.4)
    made.ill(LEFT, state=DriveState.READY)
    made.tick()
    assert made.words == {"RUN-06": ""}


# ---------------------------------------------------------------------------------------------- slip


@pytest.mark.parametrize("rates", [(0.36, 0.0), (0.0, 0.36), (-0.36, 0.0), (0.0, -0.36)])
def test_wheels_that_are_steered_quickly_say_nothing_about_slip(rates: tuple[float, float]) -> None:
    made = road(0.4)
    made.speeds = 0.4, 0.2
    made.ticks(0.3)
    assert made.value("RUN-05") is not None
    made.rates = rates
    made.tick()
    assert made.value("RUN-05") is None


def test_wheels_that_are_steered_slowly_do() -> None:
    made = road(0.4)
    made.speeds, made.rates = (0.4, 0.2), (0.0, 0.0)
    made.ticks(0.3)
    for name in (STEER_LEFT, STEER_RIGHT):
        made.ill(name, velocity=0.35)
    made.tick()
    assert made.value("RUN-05") is not None


def test_rolling_about_the_kingpins_is_taken_off_each_wheel() -> None:
    made = road(0.15)
    made.speeds = CAR.wheel_speeds(0.15, 0.0, 0.34, 0.34)
    made.ticks(0.3)
    made.ill(STEER_LEFT, velocity=0.34)
    made.ill(STEER_RIGHT, velocity=0.34)
    made.tick()
    assert made.value("RUN-05") is None


def test_slip_of_wheels_that_roll_backwards_is_the_part_of_the_faster() -> None:
    made = road(-0.4)
    made.speeds = -0.2, -0.4
    made.ticks(0.3)
    assert made.value("RUN-05") == pytest.approx(0.5)


def test_robot_that_stopped_slips_no_more() -> None:
    made = road(0.4)
    made.speeds = 0.4, 0.0
    made.ticks(0.3)
    made.speeds = 0.0, 0.0
    made.ticks(0.06)
    assert made.value("RUN-05") is None


def test_slow_robot_in_a_curve_does_not_slip() -> None:
    made = road(0.4, 1.0)
    assert exactly(made, 0.1, 0.0).value("RUN-05") is None


def test_wheel_that_has_only_begun_to_roll_does_not_slip_yet() -> None:
    made = road()
    made.drive(0.3)
    made.speeds = 0.3, 0.0
    made.ticks(0.04)
    assert made.wheels.speed == pytest.approx(0.3)
    assert made.value("RUN-05") is None


def test_a_fifth_of_the_speed_is_no_slip() -> None:
    assert exactly(road(0.5), 0.625, 0.5).value("RUN-05") is None


# ---------------------------------------------------------------------------------------------- steered wheels


def test_steered_wheel_at_the_limit_of_being_worth_a_look_is_not_told() -> None:
    made = road()
    made.reference()
    made.angles = [0.02, 0.0]
    made.ill(STEER_LEFT, potentiometers=volts("left", 0.0), current=1.0)
    made.tick()
    assert made.rows() == set()
    made = road()
    made.reference()
    made.angles = [0.0, 0.02]
    made.tick()
    assert made.rows() == set()


@pytest.mark.parametrize(("turned", "told"), [(0.05, None), (0.051, 0.051), (-0.051, 0.051)])
def test_potentiometer_may_stay_over_a_twentieth_of_a_radian(turned: float, told: float | None) -> None:
    made = road()
    made.reference()
    made.angles[0] = turned
    made.ill(STEER_LEFT, potentiometers=(volts("left", 0.0)[0], volts("left", turned)[1]))
    made.tick()
    assert made.value("STE-07", STEER_LEFT) == told


def test_people_read_degrees() -> None:
    made = road()
    made.reference()
    made.angles = [radians(10.0), radians(20.0)]
    made.ill(STEER_LEFT, potentiometers=(volts("left", radians(10.0))[0], volts("left", radians(16.0))[1]))
    made.wish = replace(DRIVING, command=DriveCommand(speed=0.1, steering=radians(90.0)))
    made.tick()
    assert made.words["STE-03"] == "10.0 and 16.0 degrees"
    assert made.words["STE-05"] == "3.0 degrees"
    assert made.words["STE-06"] == "10.0 and 20.0 degrees"
    assert made.words["RUN-12"] == "+0.10 m/s, +90 degrees"


# ---------------------------------------------------------------------------------------------- the wish itself


def along(speed: float, *arc_lengths: float) -> list[set[str]]:
    """Rows that are told at these places along a path."""
    made, told = Road(), []
    for arc_length in arc_lengths:
        tracking = Tracking(arc_length=arc_length, length=9.0, cross_track=0.0)
        made.wish = replace(DRIVING, command=DriveCommand(speed=speed), tracking=tracking)
        made.tick()
        told.append(made.rows())
    return told


def test_a_centimetre_is_no_progress_of_a_robot_that_shall_move_and_a_little_more_is() -> None:
    assert along(0.3, 0.0, 0.01) == [set(), {"PTH-07"}]
    assert along(0.3, 0.0, 0.0105) == [set(), set()]
    assert along(0.05, 1.0, 1.0) == [set(), {"PTH-07"}]
    assert along(0.049, 1.0, 1.0) == [set(), set()]
