"""A robot's place on its path: carried on, finished once and for all, and halting at the end."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.motion.path import path_from_points
from artemis.plugins.followers.progress import FINISH, Progress
from artemis.values import Pose

STRAIGHT = path_from_points(np.linspace(0.0, 2.0, 21), np.zeros(21))


def driven_to(end: float) -> Progress:
    """Along the straight."""
    progress = Progress(STRAIGHT)
    for x in np.linspace(0.0, end, 21).tolist():
        progress.update(Pose(x=x))
    return progress


def test_tracking_is_that_of_the_pose() -> None:
    tracking = Progress(STRAIGHT).update(Pose(x=0.2, y=0.1, heading=-0.3))
    assert (tracking.arc_length, tracking.length) == pytest.approx((0.2, 2.0))
    assert (tracking.cross_track, tracking.heading_error) == pytest.approx((0.1, -0.3))


def test_the_place_is_carried_on_where_a_path_crosses_itself() -> None:
    turn = np.linspace(0.0, math.tau, 401)
    eight = path_from_points(2 * np.sin(turn), np.sin(2 * turn))
    progress = Progress(eight)
    for place in np.arange(0.0, eight.length, 0.1).tolist():
        point = eight.at(place)
        assert progress.update(Pose(x=point.x, y=point.y)).arc_length == pytest.approx(place, abs=0.001)


def test_a_robot_halts_at_the_end() -> None:
    progress = driven_to(1.5)
    assert progress.halting_speed(0.25) == pytest.approx(0.5)
    assert not progress.finished
    progress = driven_to(2.0 - FINISH / 2)
    assert progress.finished
    assert progress.halting_speed(0.25) == 0.0


def test_finished_stays_finished() -> None:
    progress = driven_to(2.05)
    progress.update(Pose(x=1.8))
    assert progress.finished
    assert progress.halting_speed(0.25) == 0.0
    assert progress.remaining == pytest.approx(0.2)
