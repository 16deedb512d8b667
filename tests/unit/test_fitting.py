"""A route made to fit a robot: only as far as is allowed, and every change is told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.fitting import fitted
from artemis.motion.path import path_from_points
from artemis.motion.route import Part, Route
from artemis.testing.contracts import ROBOT


def corner() -> Route:
    distance = np.arange(0.0, 4.0, 0.05)
    x, y = np.concatenate([distance, np.full(81, 4.0)]), np.concatenate([0 * distance, np.arange(81) * 0.05])
    return Route((Part(path=path_from_points(x, y)),))


def slalom() -> Route:
    x = np.arange(0.0, 8.001, 0.05)
    return Route((Part(path=path_from_points(x, 0.5 * np.sin(math.tau * x / 4.0))),))


def test_nothing_is_changed_that_was_not_allowed() -> None:
    for route in (corner(), slalom()):
        same, words = fitted(route, ROBOT, 0.7)
        assert [part.path for part in same.parts] == [part.path for part in route.parts]
        assert words == []
        assert same.problems(ROBOT, 0.7)


def test_a_rounded_corner_at_its_planned_speed_is_drivable() -> None:
    route, words = fitted(corner(), ROBOT, 0.7, round_corners=0.15, allow_slowdown=True)
    assert route.problems(ROBOT, 0.7) == []
    assert words[0].startswith("corner at 3.98 m (x 3.98 m, y 0.01 m) rounded: the path leaves it by 9")
    assert words[1].startswith("slowed down to 0.")


def test_a_corner_that_must_be_left_too_far_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"corner at 3\.98 m .* must be left by 0\.09\d m; round_corners_m allows 0\.05"
    ):
        fitted(corner(), ROBOT, 0.7, round_corners=0.05)


def test_too_fast_a_path_is_slowed_down_and_no_other() -> None:
    route, words = fitted(slalom(), ROBOT, 0.7, allow_slowdown=True)
    assert route.problems(ROBOT, 0.7) == []
    speed = route.parts[0].path.speed
    assert speed is not None
    assert speed.min() < 0.6
    assert len(words) == 1
    same, words = fitted(slalom(), ROBOT, 0.2, allow_slowdown=True)
    assert same.parts[0].path.speed is None
    assert words == []


def test_parts_are_told_apart() -> None:
    route = Route((slalom().parts[0], Part(path=slalom().parts[0].path, backward=True)))
    _, words = fitted(route, ROBOT, 0.7, allow_slowdown=True)
    assert [word[:7] for word in words] == ["part 1:", "part 2:"]
