"""The thesis' mapping of a stick, and what it leaves open."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from artemis.plugins.inputs.joystick import (
    Gate,
    deflection_from_stick,
    reverse_at_standstill,
    speed_from_stick,
    steering_from_stick,
    step_range,
    trail,
)

LIMIT = math.pi / 3
level = st.floats(-1, 1)
angle = st.floats(-LIMIT, LIMIT)
gates = st.sampled_from(["square", "round"])


@given(x=level, y=level)
def test_six_steps_equal_the_closed_form(x: float, y: float) -> None:
    assume((x, y) != (0.0, 0.0))
    closed_form = max(-LIMIT, min(LIMIT, math.atan2(x, abs(y))))
    assert steering_from_stick(x, y, LIMIT) == pytest.approx(-closed_form, abs=1e-12)


@given(x=level, y=level)
def test_angle_is_the_same_forward_and_backward(x: float, y: float) -> None:
    assume(abs(x) > 1e-9 and abs(y) > 1e-9)
    assert steering_from_stick(x, -y, LIMIT) == pytest.approx(steering_from_stick(x, y, LIMIT), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "degrees"),
    [(0, 1, 0), (0, -1, 0), (-1, 1, 45), (1, 1, -45), (-1, -1, 45), (1, -1, -45), (-1, 0, 60), (1, 0, -60)],
)
def test_stick_to_the_left_steers_left(x: float, y: float, degrees: float) -> None:
    assert steering_from_stick(x, y, LIMIT) == pytest.approx(math.radians(degrees), abs=1e-12)


@given(x=level, y=level, gate=gates, deadzone=st.floats(0, 0.5))
def test_deflection_is_a_share_and_zero_exactly_in_the_deadzone(
    x: float, y: float, gate: Gate, deadzone: float
) -> None:
    deflection = deflection_from_stick(x, y, gate, deadzone)
    radius = max(abs(x), abs(y)) if gate == "square" else math.hypot(x, y)
    assert 0 <= deflection <= 1
    assert (deflection == 0) == (radius <= deadzone)


@given(x=level, y=level, gate=gates, dx=st.floats(-1e-6, 1e-6), dy=st.floats(-1e-6, 1e-6))
def test_deflection_is_continuous(x: float, y: float, gate: Gate, dx: float, dy: float) -> None:
    here, there = deflection_from_stick(x, y, gate, 0.1), deflection_from_stick(x + dx, y + dy, gate, 0.1)
    assert abs(here - there) < 4e-6


@pytest.mark.parametrize("direction", range(0, 360, 15))
def test_deflection_reaches_one_at_every_stop(direction: int) -> None:
    x, y = math.cos(math.radians(direction)), math.sin(math.radians(direction))
    assert deflection_from_stick(x, y, "round", 0.05) == pytest.approx(1)
    side = max(abs(x), abs(y))
    assert deflection_from_stick(x / side, y / side, "square", 0.05) == pytest.approx(1)


def test_speed_has_the_sign_of_the_stick() -> None:
    assert speed_from_stick(0.3, 0.5, 0.7) == pytest.approx(0.35)
    assert speed_from_stick(-0.3, 0.5, 0.7) == pytest.approx(-0.35)


@pytest.mark.parametrize("y", [0.0, -0.0])
def test_stick_held_sideways_still_moves_forward(y: float) -> None:
    assert speed_from_stick(y, 1.0, 0.7) == pytest.approx(0.7)


@given(wished=angle, in_force=angle, band=st.floats(0, 0.2))
def test_angle_trails_within_its_band(wished: float, in_force: float, band: float) -> None:
    taken = trail(wished, in_force, band, LIMIT)
    assert abs(taken - wished) <= band + 1e-12
    assert min(wished, in_force) - 1e-12 <= taken <= max(wished, in_force) + 1e-12


def test_jitter_within_the_band_moves_nothing() -> None:
    band = math.radians(1)
    taken = 0.3
    for wished in itertools.islice(itertools.cycle([0.31, 0.29, 0.305]), 30):
        taken = trail(wished, taken, band, LIMIT)
    assert taken == 0.3


def test_straight_and_limit_are_reached_in_spite_of_the_band() -> None:
    band = math.radians(5)
    assert trail(0.0, math.radians(4), band, LIMIT) == 0.0
    assert trail(LIMIT, 0.9 * LIMIT, band, LIMIT) == LIMIT
    assert trail(-LIMIT, 0.9 * LIMIT, band, LIMIT) == -LIMIT


@pytest.mark.parametrize(
    ("wished", "speed", "allowed"),
    [(-0.5, 0.3, 0.0), (0.5, -0.3, 0.0), (-0.5, 0.04, -0.5), (-0.5, 0.0, -0.5), (0.5, 0.3, 0.5), (0.0, 0.3, 0.0)],
)
def test_direction_changes_only_near_standstill(wished: float, speed: float, allowed: float) -> None:
    assert reverse_at_standstill(wished, speed) == allowed


def test_range_buttons_step_between_a_fifth_and_all() -> None:
    speed_range = 0.5
    steps = [speed_range := step_range(speed_range, True, False) for _ in range(7)]
    assert steps == [0.6, 0.7, 0.8, 0.9, 1.0, 1.0, 1.0]
    steps = [speed_range := step_range(speed_range, False, True) for _ in range(9)]
    assert steps == [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.2]
    assert step_range(0.5, True, True) == 0.5
