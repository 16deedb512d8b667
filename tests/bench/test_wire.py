"""Bring-up is bound by the wire: held here for every family, on virtual time; the benchmark shows the numbers."""

from __future__ import annotations

import pytest

from .wire import ROBOTS, SLOW, WIRE_TIMES, configure, robot_named


@pytest.mark.parametrize("name", ROBOTS)
def test_four_drives_are_configured_as_fast_as_the_wire_carries_their_frames(name: str) -> None:
    robot = robot_named(name)
    took, wire, _ = configure(robot, list(robot.drives), answer_time=0.0)
    assert took <= WIRE_TIMES * wire


@pytest.mark.parametrize("name", ROBOTS)
def test_slow_drives_are_configured_side_by_side(name: str) -> None:
    robot = robot_named(name)
    four, _, _ = configure(robot, list(robot.drives), answer_time=SLOW)
    assert four <= 1.1 * max(configure(robot, [each], answer_time=SLOW)[0] for each in robot.drives)
