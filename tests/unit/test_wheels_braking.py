"""Whether a robot that shall come to rest does: RUN-03, reading by reading."""

from __future__ import annotations

import pytest
from core_builders import PERIOD, TRACTION
from supervision_rig import COASTING, STOPPING, road

from artemis.drive_states import DriveState
from artemis.values import Wish

LEFT, RIGHT = TRACTION
RAMP = 1.5
"""Quick stop of the robot file [m/s²]."""


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


@pytest.mark.parametrize(("speed", "steering"), [(0.5, 1.0), (0.5, -1.0), (-0.5, 1.0), (-0.5, -1.0)])
def test_fastest_that_either_wheel_was_told_lately_is_planned_in_a_controlled_stop(
    speed: float, steering: float
) -> None:
    made = road(speed, steering)
    made.stops = True
    made.drive(0.0, steering, actual=speed)
    assert made.history("RUN-03", 0.18) == [None] * 9
    made.ticks(0.1)
    assert made.value("RUN-03") is not None
