"""Whether each path begins where the robot stands then."""

from __future__ import annotations

import math
from typing import Any

import pytest

from artemis.mission.starts import far_starts, start_pose
from artemis.motion.joining import straight
from artemis.motion.route import Route
from artemis.sim.world import PlantParameters
from artemis.values import Pose

EAST, BACK, ASIDE = [[0.0, 0.0], [5.0, 0.0]], [[5.0, 0.0], [0.0, 0.0]], [[0.0, 1.1], [5.0, 1.1]]
START = Pose()


def far(steps: list[Any], *lines: list[list[float]] | Route | None, pose: Pose | None = START) -> list[str]:
    """The key paths of steps that are not begun; the paths of the steps that take time, by number."""
    routes = {n: straight(line, closed=False) if isinstance(line, list) else line for n, line in enumerate(lines)}
    found = far_starts(steps, {n: route for n, route in routes.items() if route is not None}, pose)
    return [remark.partition(": ")[0] for remark in found]


def follow(**keys: object) -> dict[str, Any]:
    return {"follow": {"path": "p.csv", **keys}}


CALIBRATE, TELEOP = {"calibrate": {"steering": "align"}}, {"teleop": {"input": "stick"}}


def test_the_first_path_begins_where_the_run_does() -> None:
    assert far([CALIBRATE, follow()], None, EAST) == []
    assert far([CALIBRATE, follow()], None, ASIDE) == ["steps[1].follow"]
    assert far([CALIBRATE, follow()], None, BACK) == ["steps[1].follow"]
    assert far([CALIBRATE, follow()], None, ASIDE, pose=Pose(y=0.2)) == []
    assert far([CALIBRATE, follow()], None, EAST, pose=Pose(heading=math.radians(61))) == ["steps[1].follow"]


def test_the_next_begins_where_the_one_before_ends() -> None:
    assert far([follow(), {"wait": {"seconds": 1}}, follow()], EAST, None, EAST) == []  # along its line
    assert far([follow(), follow()], EAST, ASIDE) == ["steps[1].follow"]
    assert far([follow(), follow()], EAST, BACK) == ["steps[1].follow"]
    backward = straight(BACK, closed=False).directed(from_end=False, backward=True)
    assert far([follow(), follow(), follow()], EAST, backward, EAST) == []


def test_a_path_may_begin_at_its_nearest_point() -> None:
    corner = [[-3.0, -3.0], [0.0, 0.0], [3.0, 3.0]]
    assert far([follow()], corner, pose=Pose(x=2.0, y=-2.0, heading=0.8)) == ["steps[0].follow"]
    assert far([follow()], [[0.0, -3.0], [0.0, 3.0]], pose=Pose(x=0.5, heading=1.0)) == []
    assert far([follow(start="nearest")], [[-3.0, 2.0], [0.0, 0.5]], pose=Pose(heading=-0.5)) == []


@pytest.mark.parametrize(
    "between",
    [
        TELEOP,
        follow(),
        {"choose": [{"if": "run_s > 1", "steps": [{"wait": {"seconds": 1}}]}]},
        {"try": {"steps": [{"wait": {"seconds": 1}}], "catch": {"timeout": [{"wait": {"seconds": 1}}]}}},
    ],
)
def test_where_nobody_knows_the_place_nothing_is_said(between: dict[str, Any]) -> None:
    steps, lines = [between, follow()], [None] * len(str(between).split("wait")[1:]) or [None]
    assert far(steps, *lines, ASIDE) == []
    assert far([follow()], ASIDE, pose=None) == []
    assert far([*steps, follow()], *lines, ASIDE, EAST) == [f"steps[{len(steps)}].follow"]


def test_words_are_looked_into() -> None:
    looped = {"repeat": {"times": 2, "steps": [{"try": {"steps": [follow()]}}]}}
    assert far([looped], ASIDE) == ["steps[0].repeat.steps[0].try.steps[0].follow"]


def test_a_localizers_map_says_where_a_simulated_robot_begins() -> None:
    true = PlantParameters(x_m=1.0, y_m=2.0, heading_deg=90.0)
    tracker = {"plugin": "simulated_tracker"}
    assert start_pose({}, true, simulated=True) == Pose()
    assert start_pose({"localizer": tracker}, true, simulated=False) is None
    there = Pose(x=1.0, y=2.0, heading=math.pi / 2)
    assert start_pose({"localizer": tracker}, true, simulated=True) == there
    assert start_pose({"simulation": {"localizer": tracker}}, true, simulated=True) == there
    assert start_pose({"simulation": {"localizer": tracker}}, true, simulated=False) == Pose()
