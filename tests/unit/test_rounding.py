"""Corners made drivable: bounded curvature, near the path, meeting it again; and corners that cannot be."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.path import Path, path_from_points
from artemis.motion.planned_route import packed_route, unpacked_route
from artemis.motion.rounding import CURVATURE_SHARE, rounded
from artemis.motion.route import Part, Route
from artemis.testing.contracts import ROBOT

BOUND = math.tan(math.radians(ROBOT.limits.steering_deg)) / ROBOT.geometry.wheelbase_m


def legs(*corners: tuple[float, float], step: float = 0.05) -> Array:
    """Points every `step` [m] on the way from corner to corner."""
    pieces = []
    for (ax, ay), (bx, by) in pairwise(corners):
        share = np.arange(0.0, 1.0 - 1e-9, step / math.dist((ax, ay), (bx, by)))[:, None]
        pieces.append(np.array([[ax, ay]]) + share * np.array([[bx - ax, by - ay]]))
    return np.vstack([*pieces, [corners[-1]]])


def path_of(points: Array) -> Path:
    return path_from_points(points[:, 0], points[:, 1])


def assert_is_a_curve(path: Path) -> None:
    """Position, heading and curvature belong together, sampled at constant arc length."""
    steps = np.hypot(np.diff(path.x), np.diff(path.y))
    assert steps == pytest.approx(path.spacing, rel=1e-3)
    middle = (path.heading[:-1] + path.heading[1:]) / 2
    assert np.diff(path.x) == pytest.approx(path.spacing * np.cos(middle), abs=2e-4)
    assert np.diff(path.y) == pytest.approx(path.spacing * np.sin(middle), abs=2e-4)
    turned = path.spacing * (path.curvature[:-1] + path.curvature[1:]) / 2
    assert np.diff(path.heading) == pytest.approx(turned, abs=2e-3)


@pytest.mark.parametrize(
    ("corners", "farthest"),
    [
        (((0, 0), (4, 0), (4, 4)), 0.10),
        (((0, 0), (3, 0), (2.15, 1.81)), 0.14),  # 115 degrees
        (((0, 0), (3, 0), (3, 0.5), (0, 0.5)), 0.10),  # closer together than a circle of the robot is wide
        (((0, 0), (2, 0), (2, 0.5), (4, 0.5)), 0.12),
        (((0, 0), (1, 1), (2, 0), (3, 1), (4, 0)), 0.10),
        (((0, 0), (0.5, 0), (0.5, 0.5)), 0.12),  # at both ends of the path
    ],
)
def test_corners_become_drivable(corners: tuple[tuple[float, float], ...], farthest: float) -> None:
    path = path_of(legs(*corners))
    made, cuts = rounded(path, ROBOT)
    assert np.abs(path.curvature).max() > 2 * BOUND
    assert np.abs(made.curvature).max() <= CURVATURE_SHARE * BOUND * 1.001
    assert_is_a_curve(made)
    assert max(cut.distance for cut in cuts) <= farthest
    off = np.hypot(made.x[:, None] - path.x, made.y[:, None] - path.y).min(axis=1)
    assert off.max() == pytest.approx(max(cut.distance for cut in cuts), abs=0.01)  # samples of 2 cm
    for end in (0, -1):
        assert (made.x[end], made.y[end]) == pytest.approx((path.x[end], path.y[end]), abs=0.002)


@pytest.mark.parametrize("steering_deg", [41.0, 47.0, 53.0, 59.0])
def test_a_packed_path_is_not_rounded_again(steering_deg: float) -> None:
    robot = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"steering_deg": steering_deg})})
    made, cuts = rounded(path_of(legs((0, 0), (3, 0), (2.15, 1.81))), robot)
    assert cuts
    (part,) = unpacked_route(packed_route(Route((Part(path=made),)))).parts
    assert rounded(part.path, robot) == (part.path, [])


def test_what_can_be_driven_stays_as_it_is() -> None:
    path = path_of(legs((0, 0), (4, 0)))
    assert rounded(path, ROBOT) == (path, [])


def test_every_corner_is_named() -> None:
    points = legs((0, 0), (4, 0), (4, 4), (8, 4))
    _, cuts = rounded(path_of(points), ROBOT)
    assert [(round(cut.x), round(cut.y)) for cut in cuts] == [(4, 0), (4, 4)]
    assert [cut.arc_length for cut in cuts] == pytest.approx([4.0, 8.0], abs=0.1)


@pytest.mark.parametrize("start", [(0.0, 0.0), (1.0, 0.0)])
def test_around_a_closed_path_it_begins_where_it_did(start: tuple[float, float]) -> None:
    corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)]
    points = legs(*(corners if start == corners[0] else [start, *corners[1:], start]))
    path = path_from_points(points[:, 0], points[:, 1], closed=True).with_laps(3)
    made, cuts = rounded(path, ROBOT)
    assert made.closed
    assert made.laps == 3
    assert len(cuts) == 4
    assert math.dist((made.x[0], made.y[0]), start) < 0.15
    assert math.dist((made.x[0], made.y[0]), (made.x[-1], made.y[-1])) < 1e-6
    assert made.heading[-1] - made.heading[0] == pytest.approx(math.tau, abs=1e-3)
    assert_is_a_curve(made)


def test_what_is_done_of_a_closed_path_is_not_driven_again() -> None:
    points = legs((0, 0), (2, 0), (2, 2), (0, 2), (0, 0))
    lap = path_from_points(points[:, 0], points[:, 1], closed=True)
    path = lap.with_laps(2).begun_at(5.0, done=1.5 * lap.length)
    made, _ = rounded(path, ROBOT)
    assert path.length == pytest.approx(0.5 * lap.length)
    assert path.length - 0.5 < made.length < path.length


def test_the_speed_of_a_recording_stays_at_its_place() -> None:
    points = legs((0, 0), (4, 0), (4, 4))
    speed = np.where(points[:, 1] > 2.0, 0.2, 0.5)
    made, _ = rounded(path_from_points(points[:, 0], points[:, 1], speed=speed), ROBOT)
    assert made.speed is not None
    assert np.interp([1.0, 3.0], made.y[made.y > 0.5], made.speed[made.y > 0.5]) == pytest.approx([0.5, 0.2])


def test_a_spiral_tighter_than_the_robot_is_refused_with_its_place() -> None:
    angle = np.linspace(0.0, 6 * math.pi, 600)
    points = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle)])
    with pytest.raises(ConfigError, match=r"too sharp at \d.*no curve of radius 0\.34 m"):
        rounded(path_of(points), ROBOT)
