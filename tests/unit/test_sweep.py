"""The way to contact on an arc, against a robot that is rolled in steps of half a millimetre."""

from math import inf, isfinite, pi, radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.motion.sweep import Rectangle, free_distances, stopping_speed

BOX = Rectangle(-0.20, 0.78, 0.32)
STEP, FARTHEST = 5e-4, 2.0
WHEELBASE = 0.56


def rolled_until_contact(points: np.ndarray, curvature: float, box: Rectangle, forward: bool) -> float:
    way = np.arange(0.0, FARTHEST, STEP) * (1.0 if forward else -1.0)
    turn = curvature * way
    x, y = (np.sin(turn) / curvature, (1.0 - np.cos(turn)) / curvature) if curvature else (way, 0.0 * way)
    dx, dy = points[0][:, None] - x, points[1][:, None] - y
    c, s = np.cos(turn), np.sin(turn)
    ahead, left = c * dx + s * dy, c * dy - s * dx
    touched = (ahead >= box.rear) & (ahead <= box.front) & (np.abs(left) <= box.half_width)
    return float(np.argmax(touched.any(axis=0)) * STEP) if touched.any() else inf


def test_contact_is_where_a_robot_rolled_in_small_steps_touches() -> None:
    dice, touched = np.random.default_rng(1), 0
    for number in range(1500):
        box = Rectangle(dice.uniform(-0.6, 0.2), dice.uniform(0.5, 1.0), dice.uniform(0.1, 0.6)) if number % 2 else BOX
        points = dice.uniform(-2.0, 2.0, (2, 3))
        curvature = 0.0 if number % 10 == 0 else tan(dice.uniform(-1.0, 1.0) * radians(60.0)) / WHEELBASE
        forward = bool(dice.integers(2))
        half_turn = pi / abs(curvature) if curvature else inf

        found = free_distances(points, [curvature], box, forward=forward)[0]
        truth = rolled_until_contact(points, curvature, box, forward)

        touched += isfinite(truth)
        if truth < half_turn:
            assert found == pytest.approx(truth, abs=2e-3), (number, curvature)
        else:
            assert found >= min(FARTHEST, half_turn) - 2e-3, (number, curvature)
    assert touched > 500


def test_no_points_are_no_contact() -> None:
    assert free_distances(np.zeros((2, 0)), [0.3], BOX) == [inf]


def test_what_is_inside_is_touched() -> None:
    assert free_distances(np.array([[0.1], [0.0]]), [-0.3, 0.3], BOX) == [0.0, 0.0]
    assert free_distances(np.array([[0.1], [0.0]]), [0.0], BOX, forward=False) == [0.0]


@given(
    x=st.floats(-2, 2),
    y=st.floats(-2, 2),
    curvature=st.floats(-3, 3),
    margin=st.floats(0.001, 0.3),
    forward=st.booleans(),
)
def test_a_larger_outline_is_touched_no_later(
    x: float, y: float, curvature: float, margin: float, forward: bool
) -> None:
    point = np.array([[x], [y]])

    small = free_distances(point, [curvature], BOX, forward=forward)[0]
    large = free_distances(point, [curvature], BOX.grown(margin), forward=forward)[0]

    half_turn = pi / max(abs(curvature), 1e-3)
    assert large <= small + 1e-6 or small >= half_turn - 1e-6


@given(x=st.floats(-2, 2), y=st.floats(-2, 2), curvature=st.floats(-3, 3), forward=st.booleans())
def test_left_and_right_are_mirrored(x: float, y: float, curvature: float, forward: bool) -> None:
    left = free_distances(np.array([[x], [y]]), [curvature], BOX, forward=forward)[0]
    right = free_distances(np.array([[x], [-y]]), [-curvature], BOX, forward=forward)[0]

    assert left == pytest.approx(right, abs=1e-3)


def test_several_arcs_at_once_and_nothing_that_is_farther() -> None:
    dice, limited = np.random.default_rng(2), 0
    for _ in range(500):
        points = dice.uniform(-2.0, 2.0, (2, 20))
        points = points[:, (np.abs(points[1]) > BOX.half_width) | (points[0] > BOX.front) | (points[0] < BOX.rear)]
        largest = dice.choice([0.1, 1.0, 3.0])
        curvatures = dice.uniform(-largest, largest, 3).tolist()
        within, forward = dice.uniform(0.2, 1.0), bool(dice.integers(2))

        found = free_distances(points, curvatures, BOX, within, forward=forward)
        alone = [free_distances(points, [each], BOX, forward=forward)[0] for each in curvatures]

        limited += within in found
        assert found == [min(within, each) for each in alone]
    assert 100 < limited < 500


@given(distance=st.floats(0.001, 20), reaction=st.floats(0.0, 1.0), deceleration=st.floats(0.1, 10))
def test_a_robot_stands_within_the_distance(distance: float, reaction: float, deceleration: float) -> None:
    speed = stopping_speed(distance, reaction, deceleration)

    assert speed * reaction + speed**2 / (2 * deceleration) == pytest.approx(distance, rel=1e-6)


def test_no_distance_no_speed() -> None:
    assert stopping_speed(-0.1, 0.1, 1.0) == stopping_speed(0.0, 0.1, 1.0) == 0.0
    assert stopping_speed(inf, 0.1, 1.0) == inf


def test_what_lies_within_a_rectangle() -> None:
    """Its edges do not."""
    box = Rectangle(-0.15, 0.73, 0.27)
    inside = [(0.0, 0.0), (0.72, 0.26), (-0.14, -0.26)]
    outside = [(0.73, 0.0), (-0.15, 0.0), (0.0, 0.27), (0.0, -0.27), (0.8, 0.0), (-0.3, 0.0), (0.0, 0.5), (0.0, -0.5)]

    assert box.holds(np.array(inside).T).all()
    assert not box.holds(np.array(outside).T).any()
