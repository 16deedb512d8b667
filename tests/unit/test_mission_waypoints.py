"""Waypoints in a mission: straight lines, whose corners become what the robot can drive."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.mission import load_mission
from artemis.motion.joining import straight
from artemis.motion.waypoints import distances

ROOT = FilePath(__file__).parents[2]
MISSION = """mission: waypoints
robot: robot.yaml
bus: simulation
steps:
  - calibrate: {{steering: from_potentiometers}}
  - follow: {{path: {{waypoints: {points}}}, follower: {{speed_m_s: 0.5}}{more}}}
"""


def mission(folder: FilePath, points: str, more: str = "") -> FilePath:
    (folder / "robot.yaml").write_bytes((ROOT / "missions/robots/artemis.yaml").read_bytes())
    (folder / "mission.yaml").write_text(MISSION.format(points=points, more=more))
    return folder / "mission.yaml"


def problems_of(file: FilePath) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_mission(file)
    return [problem.removeprefix(f"{file}:") for problem in caught.value.problems]


def test_corners_become_what_the_robot_can_drive(tmp_path: FilePath) -> None:
    loaded = load_mission(mission(tmp_path, "[[0, 0], [3, 0], [3, 3]]"))
    (part,) = loaded.routes[1].parts
    assert part.path.length == pytest.approx(5.9, abs=0.1)
    assert (part.path.x[-1], part.path.y[-1]) == pytest.approx((3.0, 3.0), abs=1e-6)
    line = np.column_stack([part.path.x, part.path.y])
    assert distances(np.array([[1.0, 0.0], [3.0, 2.0]]), line).max() < 1e-4
    assert 0.05 < distances(np.array([[3.0, 0.0]]), line)[0] < 0.2
    assert any("rounded: the path leaves it by" in remark for remark in loaded.remarks)
    assert any("slowed down to" in remark for remark in loaded.remarks)


def test_a_square_has_laps_and_a_turn_back_is_a_reversal(tmp_path: FilePath) -> None:
    loaded = load_mission(mission(tmp_path, "[[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]", ", laps: 2"))
    assert loaded.routes[1].closed
    assert loaded.routes[1].length == pytest.approx(2 * 7.6, abs=0.4)
    loaded = load_mission(mission(tmp_path, "[[0, 0], [3, 0], [0, 0.2]]"))
    assert [part.backward for part in loaded.routes[1].parts] == [False, True]


@pytest.mark.parametrize(
    ("points", "more", "expected"),
    [
        ("[[0, 0]]", "", "6:21: steps[1].follow.path.waypoints: expected a list of at least 2"),
        ("[[0, 0], [0, 0]]", "", "6:21: steps[1].follow.path.waypoints: waypoint 2 is at the place of the one before"),
        ("[[0, 0], [1]]", "", "6:41: steps[1].follow.path.waypoints[1]: expected a list of at least 2"),
        ("[[0, 0], [1, x]]", "", "6:45: steps[1].follow.path.waypoints[1][1]: expected a number, found 'x'"),
        ("[[0, 0], [1, 1e9]]", "", "6:45: steps[1].follow.path.waypoints[1][1]: expected at most 20000"),
        ("[[0, 0], [19000, 0], [-19000, 5]]", "", "6:14: steps[1].follow.path: path of 57000 m; expected at"),
        ("[[0, 0], [3, 0], [3, 3]]", ", round_corners_m: 0", "6:14: steps[1].follow.path: line of waypoints: too"),
        (
            "[[0, 0], [3, 0], [1.85, 1.64]]",
            "",
            "6:14: steps[1].follow.path: waypoint x 3.00 m, y 0.00 m: the robot would turn by 55 deg on the spot here",
        ),
        (
            "[[0, 0], [2, 0], [1.98, 0], [4, 0]]",
            "",
            "6:14: steps[1].follow.path: waypoint x 2.00 m, y 0.00 m: reverses twice within 0.020 m; exp",
        ),
        ("[[0, 0], [3, 0], [3, 3]]", ", laps: 2", "6:87: steps[1].follow.laps: 2 laps need a closed path; line of way"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(tmp_path: FilePath, points: str, more: str, expected: str) -> None:
    assert problems_of(mission(tmp_path, points, more))[0].startswith(expected)


def test_waypoints_that_come_near_each_other_stay_in_order() -> None:
    (part,) = straight([[0, 0], [4, 0], [4, 4], [2, 4], [2, -4]]).parts
    assert part.path.length == pytest.approx(18, abs=0.2)
