"""The drives from which the machine's measures are learnt: where they go, and what they contain."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from rig import MISSIONS, Run, run

from artemis.motion.arrays import Array
from artemis.values import Mode

pytestmark = pytest.mark.exhaustive

ran = cache(lambda name: run(MISSIONS / f"{name}.yaml", longest=200.0))
BODY = ((-0.15, -0.3), (-0.15, 0.3), (0.7, -0.3), (0.7, 0.3))
"""Corners of the robot, seen from the centre of its rear axle [m]."""
STANDING = 0.01
"""[m/s]."""


def true_poses(seen: Run, *modes: Mode) -> Array:
    """x, y [m], heading [rad] of the rear axle in the frame of the start, at each tick in these modes."""
    origin = seen.first(lambda s: s.tick.wish.reset_pose).pose
    cos, sin = math.cos(origin.heading), math.sin(origin.heading)
    rows = []
    for tick in seen.in_mode(*modes):
        x, y = tick.pose.x - origin.x, tick.pose.y - origin.y
        rows.append((x * cos + y * sin, y * cos - x * sin, tick.pose.heading - origin.heading))
    return np.array(rows)


def test_pattern_takes_two_minutes_and_stays_where_it_says() -> None:
    seen = ran("calibration_pattern")
    assert (seen.status, seen.fault_ids) == (0, [])
    driving = [each.time for each in seen.in_mode(Mode.TELEOP) if each.tick.set_points.speed]
    assert 100.0 < driving[-1] - driving[0] < 120.0
    assert driving[0] > 30.0, "the alignment of slow drives has time"
    x, y, heading = true_poses(seen, Mode.TELEOP).T
    corners = [
        (x + a * np.cos(heading) - b * np.sin(heading), y + a * np.sin(heading) + b * np.cos(heading)) for a, b in BODY
    ]
    across, along = np.concatenate([c[0] for c in corners]), np.concatenate([c[1] for c in corners])
    area = across.min(), across.max(), along.min(), along.max()
    assert area == pytest.approx((-1.1, 2.9, -1.0, 2.0), abs=0.25)  # with hidden errors


def test_pattern_has_all_that_the_fit_needs() -> None:
    points = [seen.tick.set_points for seen in ran("calibration_pattern").in_mode(Mode.TELEOP)]
    moving = [abs(point.speed) > STANDING for point in points]
    starts = [(a, b) for (a, was), (b, now) in pairwise(zip(points, moving, strict=True)) if now and not was]
    assert len(starts) == 12
    assert [math.copysign(1, b.speed) for _, b in starts] == [1, -1] * 6
    assert [round(math.degrees(b.steering)) for _, b in starts] == [0, 0, 40, -40, -60, 60, -40, 40, 60, -60, 15, -15]
    steered = [abs(b.steering - a.steering) for a, b in pairwise(points)]
    assert all(change < 1e-6 for change, drives in zip(steered, moving[1:], strict=True) if drives)


@pytest.mark.parametrize(("name", "side"), [("return_to_start_ccw", 1), ("return_to_start_cw", -1)])
def test_square_returns_to_its_start_as_far_as_the_robot_knows(name: str, side: int) -> None:
    seen = ran(name)
    assert (seen.status, seen.fault_ids) == (0, [])
    last = seen.ticks[-1].snapshot.odometry
    assert math.hypot(last.pose.x, last.pose.y) < 0.02
    assert abs(last.pose.heading) < math.radians(1.0)
    assert last.distance == pytest.approx(9.1, abs=0.1)
    x, y, heading = true_poses(seen, Mode.FOLLOW)[-1]
    assert 0.03 < math.hypot(x, y) < 0.3  # hidden errors
    assert heading == pytest.approx(side * math.tau, abs=math.radians(10.0))
    assert abs(heading - side * math.tau) > math.radians(1.0)
