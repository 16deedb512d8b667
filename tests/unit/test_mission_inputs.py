"""Missions with several inputs in one step: what is loaded, planned and refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from pad import MISSIONS

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.planning import plan_from
from artemis.plugins.inputs.profiles import SHIPPED
from artemis.states.plan import TeleopStep

G27, F310 = {"plugin": "gamepad", "profile": "logitech-g27"}, {"plugin": "gamepad", "profile": "logitech-f310"}
AUTO, KEYS = {"plugin": "gamepad"}, {"plugin": "keyboard"}


def load(folder: Path, teleop: dict[str, Any], **inputs: dict[str, Any]) -> TeleopStep:
    """The step of a mission with these inputs."""
    shutil.copy(MISSIONS / "robots" / "artemis.yaml", folder / "artemis.yaml")
    steps = [{"teleop": {"until": {"button": "done"}, **teleop}}]
    mission = {"mission": "m", "robot": "artemis.yaml", "bus": "simulation", "inputs": inputs, "steps": steps}
    (folder / "m.yaml").write_text(json.dumps(mission, indent=1))
    (step,) = plan_from(load_mission(folder / "m.yaml")).steps
    assert isinstance(step, TeleopStep)
    return step


def test_inputs_are_planned_in_their_order_and_no_faster_than_the_fastest(tmp_path: Path) -> None:
    slow, fast = {**G27, "max_speed_m_s": 0.2}, {**F310, "max_speed_m_s": 0.5}
    step = load(tmp_path, {"inputs": ["a", "b"]}, a=slow, b=fast)
    assert (step.input, step.lower, step.inputs, step.speed) == ("a", ("b",), ("a", "b"), 0.5)
    assert load(tmp_path, {"inputs": ["b", "a"]}, a=slow, b=F310).speed is None
    assert load(tmp_path, {"input": "a"}, a=slow, b=fast) == TeleopStep(
        input="a", seconds=None, speed=0.2, stale=(0.15,)
    )


def test_what_is_held_is_named_once_for_each_kind(tmp_path: Path) -> None:
    assert load(tmp_path, {"inputs": ["a", "b"]}, a=G27, b=F310).enabled_by == "the enable button"
    assert load(tmp_path, {"inputs": ["a", "b"]}, a=G27, b=KEYS).enabled_by == "the enable button or an arrow key"
    for enabled_by, held in (("topic", "the topic enable at true"), ("command", "a command to move")):
        assert load(tmp_path, {"input": "a"}, a={"plugin": "ros1", "enabled_by": enabled_by}).enabled_by == held


@pytest.mark.parametrize(
    ("teleop", "expected"),
    [
        ({}, "teleop: expected input: NAME, or inputs: [FIRST, SECOND]"),
        ({"input": "a", "inputs": ["a", "b"]}, "teleop: expected input: NAME, or inputs: [FIRST, SECOND]"),
        ({"inputs": ["a", "a"]}, "inputs: one of them twice: a, a"),
        ({"inputs": ["a"]}, "inputs: expected a list of at least 2, found a list of 1"),
        ({"inputs": ["a", "c"]}, "steps[0].teleop.inputs[1]: no such input: c"),
    ],
)
def test_inputs_that_make_no_sense_are_refused(tmp_path: Path, teleop: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, teleop, a=G27, b=F310)
    assert expected in str(caught.value)


def test_speed_of_each_is_checked(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"inputs\.b\.max_speed_m_s: 0\.9 m/s is above the robot's"):
        load(tmp_path, {"inputs": ["a", "b"]}, a=G27, b={**F310, "max_speed_m_s": 0.9})


@pytest.mark.parametrize(
    ("a", "b", "accepted"),
    [
        (G27, F310, True),
        (G27, KEYS, True),
        (G27, G27, False),
        (G27, {**G27, "serial": "1"}, False),
        ({**G27, "serial": "2"}, {**G27, "serial": "1"}, True),
        ({**G27, "serial": "1"}, {**G27, "serial": "1", "max_speed_m_s": 0.3}, False),
        (AUTO, F310, False),
        ({**AUTO, "serial": "1"}, {**F310, "serial": "2"}, True),
        (KEYS, {**KEYS, "max_speed_m_s": 0.3}, False),
    ],
)
def test_two_inputs_of_a_step_that_may_be_one_device_are_refused(
    tmp_path: Path, a: dict[str, Any], b: dict[str, Any], accepted: bool
) -> None:
    if accepted:
        assert load(tmp_path, {"inputs": ["a", "b"]}, a=a, b=b).lower == ("b",)
        return
    with pytest.raises(ConfigError, match=r"teleop\.inputs: a and b may be one device: tell them apart by"):
        load(tmp_path, {"inputs": ["a", "b"]}, a=a, b=b)
    assert load(tmp_path, {"input": "a"}, a=a, b=b).lower == ()


def test_profile_file_is_compared_by_its_devices(tmp_path: Path) -> None:
    shutil.copy(SHIPPED / "logitech-g27.yaml", tmp_path / "own.yaml")
    own = {"plugin": "gamepad", "profile_file": "own.yaml"}
    assert load(tmp_path, {"inputs": ["a", "b"]}, a=own, b=F310).lower == ("b",)
    with pytest.raises(ConfigError, match="may be one device"):
        load(tmp_path, {"inputs": ["a", "b"]}, a=own, b=G27)
    (tmp_path / "own.yaml").write_text("name: 1")
    assert load(tmp_path, {"inputs": ["a", "b"]}, a=own, b=G27)  # what is wrong in it is told when it is made
