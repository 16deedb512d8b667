"""A path that is begun at its point nearest to the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.motion.path import Path, path_from_points


def circle(laps: int = 1) -> Path:
    angle = np.linspace(0.0, math.tau, 201)
    return path_from_points(np.sin(angle), 1 - np.cos(angle)).with_laps(laps)


def line() -> Path:
    return path_from_points(np.linspace(0.0, 4.0, 41), np.zeros(41))


LAP = math.tau
"""Of the circle [m]."""


@pytest.mark.parametrize("laps", [1, 2, 3])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_closed_path_is_driven_for_all_its_laps_from_wherever_it_is_begun(laps: int, share: float) -> None:
    path = circle(laps)
    begun = path.begun_at(share * LAP, 0.0)
    assert begun.closed
    assert begun.length == pytest.approx(path.length, abs=1e-9)
    expected = path.at(math.floor(share * LAP / path.spacing) * path.spacing)
    assert (begun.at(0.0).x, begun.at(0.0).y) == pytest.approx((expected.x, expected.y), abs=1e-6)
    end = begun.at(begun.length)
    assert (end.x, end.y) == pytest.approx((expected.x, expected.y), abs=1e-6)


@pytest.mark.parametrize("done", [0.0, 1.0, LAP - 0.1, LAP + 0.1, 2 * LAP + 1.0])
def test_what_is_done_of_a_closed_path_is_not_driven_again(done: float) -> None:
    path = circle(3)
    assert path.begun_at(2.0, done).length == pytest.approx(path.length - done, abs=1e-9)


def test_an_open_path_is_begun_as_its_rest() -> None:
    path = line()
    begun = path.begun_at(1.5, 0.0)
    assert begun.length == pytest.approx(2.5, abs=path.spacing)
    assert begun.at(0.0).x == pytest.approx(1.5, abs=path.spacing)
    assert path.length == pytest.approx(4.0)


def test_beginning_changes_nothing_of_the_path_itself() -> None:
    path = circle(2)
    path.begun_at(3.0, 7.0)
    assert path.length == pytest.approx(2 * LAP, abs=1e-3)
    assert path.laps == 2


@pytest.mark.parametrize("share", [0.01, 0.25, 0.6, 0.98])
@pytest.mark.parametrize("off", [-0.3, 0.0, 0.4])
def test_the_nearest_point_is_where_the_perpendicular_through_the_robot_meets_the_path(
    share: float, off: float
) -> None:
    path = circle()
    point = path.at(share * LAP)
    x, y = point.x - off * math.sin(point.heading), point.y + off * math.cos(point.heading)
    assert path.nearest(x, y) == pytest.approx(point.arc_length, abs=2e-3)


@pytest.mark.parametrize(("x", "expected"), [(-1.0, 0.0), (0.0, 0.0), (2.345, 2.345), (4.0, 4.0)])
def test_the_nearest_point_of_an_open_path_is_not_before_its_start(x: float, expected: float) -> None:
    assert line().nearest(x, 0.2) == pytest.approx(expected, abs=1e-6)


def test_the_nearest_point_is_found_anywhere_on_a_long_path() -> None:
    x = np.linspace(0.0, 300.0, 3001)
    path = path_from_points(x, np.sin(x / 5))
    assert path.at(path.nearest(237.0, math.sin(237.0 / 5))).x == pytest.approx(237.0, abs=1e-3)
