"""The thesis' odometry experiments as missions."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from rig import MISSIONS, Run, run

from artemis.mission import load_mission
from artemis.values import Mode

ran = cache(lambda name: run(MISSIONS / f"{name}.yaml", longest=200.0))


def told(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a mission says, but for its name and its follower; and its follower."""
    mission = load_mission(MISSIONS / f"{name}.yaml").mission.model_dump(exclude={"mission"})
    follow = mission["steps"][-1]["follow"]
    del follow["allow_slowdown"]
    return mission, follow.pop("follower")


@pytest.mark.parametrize(
    ("one", "other", "differs"),
    [
        ("thesis_slow", "thesis_fast", {"speed_m_s": (0.2, 0.6)}),
        ("thesis_every_angle", "thesis_hysteresis", {"hysteresis_deg": (None, 11.46)}),
    ],
)
def test_twins_differ_in_one_thing(one: str, other: str, differs: dict[str, tuple[float | None, float]]) -> None:
    """So one of them is run here."""
    (mission, follower), (other_mission, other_follower) = told(one), told(other)
    assert mission == other_mission
    keys = follower.keys() | other_follower.keys()
    different = {key: (follower.get(key), other_follower.get(key)) for key in keys}
    assert {key: pair for key, pair in different.items() if pair[0] != pair[1]} == differs


def whole(name: str) -> Run:
    seen = ran(name)
    assert (seen.status, seen.fault_ids) == (0, [])
    return seen


@pytest.mark.exhaustive
def test_circles_are_the_circles_of_their_angles() -> None:
    seen = whole("thesis_circles").in_mode(Mode.TELEOP)
    for degrees in (40.0, 60.0):
        part = [s for s in seen if abs(math.degrees(s.tick.set_points.steering) - degrees) < 1e-3]
        radius = 0.56 / math.tan(math.radians(degrees))
        begin, end = part[0].tick.snapshot.odometry, part[-1].tick.snapshot.odometry
        assert end.distance - begin.distance == pytest.approx(math.tau * radius, rel=0.03)
        x, y = (
            begin.pose.x - radius * math.sin(begin.pose.heading),
            begin.pose.y + radius * math.cos(begin.pose.heading),
        )
        poses = [s.tick.snapshot.odometry.pose for s in part]
        assert [math.hypot(pose.x - x, pose.y - y) for pose in poses] == pytest.approx([radius] * len(part), abs=1e-3)


@pytest.mark.exhaustive
def test_wheels_are_turned_only_at_standstill() -> None:
    points = [seen.tick.set_points for seen in whole("thesis_stop_and_steer").in_mode(Mode.TELEOP)]
    steered = [abs(b.steering - a.steering) > 1e-9 for a, b in pairwise(points)]
    assert sum(steered) > 500
    assert all(point.speed == 0.0 for point, turns in zip(points[1:], steered, strict=True) if turns)
    assert sum(a.speed == 0.0 != b.speed for a, b in pairwise(points)) == 13


@pytest.mark.exhaustive
def test_hysteresis_leaves_out_small_changes() -> None:
    commands = [seen.tick.wish.command for seen in whole("thesis_hysteresis").in_mode(Mode.FOLLOW)]
    changes = np.abs(np.diff([command.steering for command in commands if command.speed > 0.0]))
    assert 10 < np.count_nonzero(changes) < 100
    assert changes[changes > 0].min() >= math.radians(11.46)


@pytest.mark.exhaustive
def test_fast_lap_is_fast_and_comes_round() -> None:
    seen = whole("thesis_fast").in_mode(Mode.FOLLOW)
    last = seen[-1].tick.snapshot.odometry
    assert max(s.tick.set_points.speed for s in seen) > 0.59
    assert last.distance == pytest.approx(16.9, abs=0.1)
    assert math.hypot(last.pose.x, last.pose.y) < 0.05
