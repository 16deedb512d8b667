"""Scanners and the outline in a robot file: what is refused, and with which words."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.mounting import Mounting, Outline
from artemis.vehicle import RobotFile

PLAIN = (Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").read_text()
OUTLINE = {"front_m": 0.68, "rear_m": 0.12, "half_width_m": 0.27}
FRONT = {"plugin": "lms1xx", "host": "192.168.0.1", "x_m": 0.6, "y_m": 0.0, "heading_deg": 90.0, "height_m": 0.3}
FRONT |= {"least_range_m": 0.5}


def loaded(
    tmp_path: Path, outline: Mapping[str, object], front: Mapping[str, object], name: str = "front"
) -> RobotFile:
    file = tmp_path / "robot.yaml"
    file.write_text(f"{PLAIN}\noutline: {dict(outline)}\nscanners:\n  {name}: {dict(front)}\n".replace("'", ""))
    return load_model(file, RobotFile)


def test_a_robot_without_scanner_and_outline_is_as_before(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(PLAIN)
    robot = load_model(file, RobotFile)
    assert (robot.outline, robot.scanners) == (None, {})


def test_mounting_and_outline_are_read(tmp_path: Path) -> None:
    robot = loaded(tmp_path, OUTLINE, {**FRONT, "mask": [[-135, -120.5], [130, 135]]})
    assert robot.outline == Outline(front_m=0.68, rear_m=0.12, half_width_m=0.27)
    front = robot.scanners["front"]
    assert isinstance(front, Mounting)
    assert front.options == {"host": "192.168.0.1"}
    assert front.heading == pytest.approx(pi / 2)
    assert front.mask == ((-135.0, -120.5), (130.0, 135.0))
    assert not front.upside_down


@pytest.mark.parametrize(
    ("outline", "front", "problem"),
    [
        (
            {"front_m": 0.5},
            {},
            "outline.front_m: expected more than wheelbase_m (0.56 m): it counts from the rear axle",
        ),
        ({"half_width_m": 0.2}, {}, "outline.half_width_m: expected more than half of track_m (0.218 m), found 0.2 m"),
        ({"rear_m": -0.1}, {}, "outline.rear_m: expected 0 to 10 m, found -0.1 m: leave the minus sign out"),
        ({"front_mm": 3}, {}, "outline.front_mm: unknown key; did you mean front_m?"),
        (
            {},
            {"x_m": 600.0},
            "scanners.front.x_m: expected 0 to 10 m, positive or negative, found 600 m: is it in mill",
        ),
        ({}, {"mask": [[10, 5]]}, "scanners.front: mask: [10, 5]: sectors go from right to left"),
        ({}, {"mask": [[5, 10], [9, 12]]}, "scanners.front: mask: [9, 12]: sectors go from right to left"),
        ({}, {"mask": [[-135, -80]]}, "scanners.front: mask: 55 degrees are masked, at most 54 can be"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(
    outline: Mapping[str, object], front: Mapping[str, object], problem: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as refused:
        loaded(tmp_path, {**OUTLINE, **outline}, {**FRONT, **front})
    assert problem in str(refused.value)


@pytest.mark.parametrize("key", ["plugin", "x_m", "y_m", "heading_deg", "height_m", "least_range_m"])
def test_what_only_the_machine_knows_has_no_default(key: str, tmp_path: Path) -> None:
    front = {name: value for name, value in FRONT.items() if name != key}
    with pytest.raises(ConfigError, match=f"scanners.front.{key}: this key is missing"):
        loaded(tmp_path, OUTLINE, front)


def test_a_scanner_has_no_drives_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="a drive has this name"):
        loaded(tmp_path, OUTLINE, FRONT, "steer-left")
