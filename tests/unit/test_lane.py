"""Whether a robot file's scanners see the ground that the robot drives over."""

from __future__ import annotations

import pytest

from artemis.motion.lane import unseen_ahead
from artemis_lab.bench.obstacle_scenes import OUTLINE, SCANNER, robot_with_scanner

HALF = OUTLINE.half_width_m - 0.03
LMS = (-135.0, 135.0)
ALL = (-HALF, HALF)


@pytest.mark.parametrize(
    ("changes", "field", "unseen"),
    [
        ({}, LMS, None),
        ({"mask": ((35, 60), (-60, -35))}, LMS, None),
        ({"mask": ((10, 26),)}, LMS, (0.11, 0.21)),
        ({"mask": ((-2, 2),)}, LMS, (-0.02, 0.02)),
        ({"heading_deg": 45.0}, LMS, None),
        ({"heading_deg": 180.0, "x_m": 0.1}, LMS, ALL),
        ({"heading_deg": 180.0, "x_m": 0.1}, (-180.0, 180.0), None),
        ({}, (-30.0, 30.0), None),
        ({}, (-10.0, 10.0), ALL),
    ],
)
def test_each_strip_of_ground_has_to_be_seen_before_it_comes_too_near(
    changes: dict[str, object], field: tuple[float, float], unseen: tuple[float, float] | None
) -> None:
    robot = robot_with_scanner().model_copy(update={"scanners": {"front": SCANNER.model_copy(update=changes)}})
    found = unseen_ahead(robot, {"front": field})
    assert found == (unseen and pytest.approx(unseen, abs=0.011))


def test_two_scanners_see_what_each_alone_does_not() -> None:
    left = SCANNER.model_copy(update={"mask": ((-27, 0),), "y_m": 0.3})
    right = SCANNER.model_copy(update={"mask": ((0, 27),), "y_m": -0.3})
    robot = robot_with_scanner()
    fields = {"left": LMS, "right": LMS}
    alone = robot.model_copy(update={"scanners": {"left": left}})
    assert unseen_ahead(alone, fields) is not None
    assert unseen_ahead(robot.model_copy(update={"scanners": {"left": left, "right": right}}), fields) is None
