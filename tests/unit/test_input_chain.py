"""The stages from counts to a wish: calibration, deadzones, curve; a wheel with two pedals."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.plugins.inputs.chain import calibrate, calibrate_pedal, centre_pedal, curve, push
from artemis.plugins.inputs.hands import Grip, Hands
from artemis.plugins.inputs.joystick import STANDSTILL, Gate, deflection_from_stick
from artemis.plugins.inputs.wheel import speed_from_pedals, steering_from_wheel
from artemis.values import OperatorInput, Request

LIMIT = math.pi / 3
TOP = 0.7
level, share = st.floats(-1, 1), st.floats(0, 1)
gates = st.sampled_from(["square", "round"])

# ---------------------------------------------------------------------------------------------- calibration


@pytest.mark.parametrize(
    ("raw", "inverted", "expected"),
    [
        (508, False, 0.0),
        (1023, False, 1.0),
        (0, False, -1.0),
        (254, False, -0.5),
        (0, True, 1.0),
        (1023, True, -1.0),
        (2000, False, 1.0),
        (-5, False, -1.0),
    ],
)
def test_axis_is_a_share_of_its_way_to_either_side(raw: int, inverted: bool, expected: float) -> None:
    assert calibrate(raw, 0, 508, 1023, inverted) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("raw", "inverted", "expected"),
    [(255, True, 0.0), (0, True, 1.0), (0, False, 0.0), (255, False, 1.0), (300, True, 0.0), (51, False, 0.2)],
)
def test_pedal_is_a_share_of_its_only_way(raw: int, inverted: bool, expected: float) -> None:
    assert calibrate_pedal(raw, 0, 255, inverted) == pytest.approx(expected)


# ---------------------------------------------------------------------------------------------- deadzone and curve


@given(pressed=share, deadzone=st.floats(0, 0.5))
def test_pedal_begins_at_the_edge_of_its_deadzone(pressed: float, deadzone: float) -> None:
    centred = centre_pedal(pressed, deadzone)
    assert 0 <= centred <= 1
    assert (centred == 0) == (pressed <= deadzone)
    assert centre_pedal(1.0, deadzone) == 1.0


@given(distance=level, other=level, expo=share)
def test_curve_is_odd_and_monotone_and_keeps_its_ends(distance: float, other: float, expo: float) -> None:
    assert curve(0.0, expo) == 0.0
    assert curve(1.0, expo) == pytest.approx(1.0)
    assert curve(-distance, expo) == pytest.approx(-curve(distance, expo))
    assert abs(curve(distance, expo)) <= abs(distance) + 1e-12
    if distance < other:
        assert curve(distance, expo) <= curve(other, expo) + 1e-12


def test_curve_without_expo_is_none() -> None:
    assert [curve(distance, 0.0) for distance in (-1.0, -0.3, 0.0, 0.7)] == [-1.0, -0.3, 0.0, 0.7]


@given(x=level, y=level, gate=gates, deflection=share)
def test_pushed_stick_keeps_its_direction(x: float, y: float, gate: Gate, deflection: float) -> None:
    if deflection_from_stick(x, y, gate, 0.0) < 1e-6:
        return
    pushed = push(x, y, gate, deflection)
    assert deflection_from_stick(*pushed, gate, 0.0) == pytest.approx(deflection)
    assert pushed[0] * y == pytest.approx(pushed[1] * x, abs=1e-9)


# ---------------------------------------------------------------------------------------------- a wheel


def test_wheel_to_the_left_steers_left_over_its_whole_way() -> None:
    assert [math.degrees(steering_from_wheel(turned, LIMIT)) for turned in (-1, -0.5, 0, 1)] == pytest.approx(
        [60, 30, 0, -60]
    )


@given(gas=share, brake=share, more=share)
def test_brake_takes_back_what_the_gas_gives(gas: float, brake: float, more: float) -> None:
    speed = speed_from_pedals(gas, brake, 0.8, TOP)
    assert 0 <= speed <= gas * TOP
    assert speed_from_pedals(gas, min(brake + more, 1.0), 0.8, TOP) <= speed
    assert speed_from_pedals(gas, max(brake, 0.8), 0.8, TOP) == 0.0


class Wheel:
    """Hands at a wheel, tick by tick."""

    def __init__(self, expo: float = 0.0) -> None:
        grip = Grip(
            kind="wheel", top_speed=TOP, steering_limit=LIMIT, acceleration=0.5, deceleration=1.0, band=0.0, expo=expo
        )
        self.hands, self.now = Hands("wheel", grip, 1.0), 0.0

    def hold(
        self, turned: float = 0.0, gas: float = 0.0, brake: float = 0.0, *down: str, seconds: float = 0.02
    ) -> tuple[OperatorInput, list[Request]]:
        requests = self.hands.grasp((turned, gas, brake), frozenset(down))
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            wish = self.hands.wish(self.now)
        return wish, requests


def test_gas_drives_and_the_wheel_steers() -> None:
    wish, _ = Wheel().hold(-0.5, 1.0)
    assert wish.speed == pytest.approx(TOP)
    assert math.degrees(wish.steering) == pytest.approx(30)
    assert not wish.neutral


def test_expo_makes_the_wheel_finer_around_the_centre() -> None:
    wish, _ = Wheel(expo=0.3).hold(0.5)
    assert math.degrees(wish.steering) == pytest.approx(-60 * (0.3 * 0.125 + 0.7 * 0.5))
    assert wish.shaped[0] == pytest.approx(0.3875)


def test_brake_wins_over_the_gas() -> None:
    wheel = Wheel()
    assert wheel.hold(0.0, 1.0, 0.5)[0].speed == 0.0  # from standstill gas under the brake does not start
    wheel.hold(0.0, 1.0, seconds=2.0)
    slowed = wheel.hold(0.0, 1.0, 0.43)[0].speed
    assert slowed == pytest.approx(0.5 * TOP)
    wheel.hold(0.0, 1.0, 0.43, seconds=1.0)
    assert wheel.hold(0.0, 1.0, 0.2)[0].speed == pytest.approx(slowed)  # half released: no faster
    assert wheel.hold(0.0, 1.0, 0.0)[0].speed == pytest.approx(TOP)


def test_robot_that_still_gathers_speed_gathers_no_more_under_the_brake() -> None:
    wheel = Wheel()
    wheel.hold(0.0, 1.0, seconds=0.4)
    assert wheel.hold(0.0, 1.0, 0.1)[0].speed == pytest.approx(0.5 * 0.4, abs=0.011)


def test_hard_brake_asks_for_a_quick_stop_once() -> None:
    wheel = Wheel()
    wheel.hold(0.0, 1.0)
    assert wheel.hold(0.0, 1.0, 0.7)[1] == []
    wish, requests = wheel.hold(0.0, 1.0, 0.9)
    assert (wish.speed, requests) == (0.0, [Request.QUICKSTOP])
    assert wheel.hold(0.0, 1.0, 0.95)[1] == []
    assert wheel.hold(0.0, 0.0, 0.0)[1] == []
    assert wheel.hold(0.0, 0.0, 1.0, "quickstop")[1] == [Request.QUICKSTOP]


def test_direction_changes_at_standstill_only() -> None:
    wheel = Wheel()
    wheel.hold(0.0, 0.5)
    wheel.hold(0.0, 0.5, 0.0, "reverse")
    assert wheel.hold(0.0, 0.5)[0].speed > 0
    wheel.hold(0.0, 0.0, 0.0, "reverse")  # released, but still rolling
    assert wheel.hold(0.0, 0.5, seconds=1.0)[0].speed > 0
    wheel.hold(seconds=(0.7 - STANDSTILL) / 1.0 + 0.1)
    wheel.hold(0.0, 0.0, 0.0, "reverse")
    wheel.hold()
    wish, _ = wheel.hold(-0.5, 1.0)
    assert wish.speed == pytest.approx(-TOP)
    assert wish.steering > 0
    wheel.hold(seconds=1.0)
    wheel.hold(0.0, 0.0, 0.0, "reverse")
    assert wheel.hold(0.0, 1.0)[0].speed == pytest.approx(TOP)


@pytest.mark.parametrize("rest", [1.0, 1.02])
def test_press_in_motion_is_not_kept_for_later(rest: float) -> None:
    wheel = Wheel()
    wheel.hold(0.0, 0.5)
    wheel.hold(0.0, 0.5, 0.0, "reverse")
    wheel.hold(seconds=rest)
    assert wheel.hold(0.0, 0.5)[0].speed > 0


def test_direction_does_not_change_under_gas() -> None:
    wheel = Wheel()
    wheel.hold(0.0, 1.0, 0.5, "reverse")
    assert wheel.hold(0.0, 1.0)[0].speed > 0


def test_a_wheel_is_neutral_with_pedals_released_and_not_far_off_its_centre() -> None:
    cases = {(0.05, 0.0, 0.0): True, (0.2, 0.0, 0.0): False, (0.0, 0.1, 0.0): False, (0.0, 0.0, 0.1): False}
    assert {axes: Wheel().hold(*axes)[0].neutral for axes in cases} == cases


@pytest.mark.slow
@settings(derandomize=True, deadline=None)
@given(st.lists(st.tuples(level, share, share, st.booleans()), min_size=1, max_size=30))
def test_no_hands_at_a_wheel_reverse_in_motion(moves: list[tuple[float, float, float, bool]]) -> None:
    wheel, before = Wheel(), 0.0
    for turned, gas, brake, reverse in moves:
        wish, _ = wheel.hold(turned, gas, brake, *(["reverse"] if reverse else []))
        assert abs(wish.speed) <= TOP
        assert abs(wish.steering) <= LIMIT + 1e-12
        assert wish.speed * before >= 0 or abs(before) <= STANDSTILL + 0.02
        before = wish.speed
