"""Poses seen from other poses."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.motion.poses import placed, seen_from
from artemis.values import Pose

lengths = st.floats(-1e3, 1e3)
poses = st.builds(Pose, x=lengths, y=lengths, heading=st.floats(-10.0, 10.0))


def test_a_pose_is_placed_ahead_and_to_the_left_of_its_origin() -> None:
    there = placed(Pose(x=1.0, y=2.0, heading=math.pi / 2), Pose(x=3.0, y=0.5, heading=math.pi))

    assert (there.x, there.y) == pytest.approx((0.5, 5.0))
    assert there.heading == pytest.approx(-math.pi / 2)


@given(poses, poses)
def test_a_pose_is_placed_where_it_is_seen(origin: Pose, pose: Pose) -> None:
    there = placed(origin, seen_from(origin, pose))

    assert (there.x, there.y) == pytest.approx((pose.x, pose.y), abs=1e-9)
    assert math.remainder(there.heading - pose.heading, math.tau) == pytest.approx(0.0, abs=1e-9)
