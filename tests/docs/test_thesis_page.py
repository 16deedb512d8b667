"""The page on the thesis' experiments, and the arithmetic of the command that makes its figures."""

from __future__ import annotations

import math
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from artemis.axles import Geometry
from artemis.motion.ackermann import Ackermann
from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose

ROOT = Path(__file__).parents[2]
GEOMETRY = Geometry(wheelbase_m=0.56, track_m=0.436, scrub_radius_m=0.0625, driven_axle="front")
SPEED, ANGLE = 0.6, math.radians(40.0)


@pytest.fixture(scope="module")
def thesis() -> ModuleType:
    spec = spec_from_file_location("docs_images_thesis", ROOT / "docs/images/thesis.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_page_has_a_row_for_everything_that_is_run(thesis: ModuleType) -> None:
    page = (ROOT / "docs/thesis.md").read_text(encoding="utf-8")
    for _, title, _ in thesis.DRIVES:
        assert f"\n| {title} | " in page
    for words, _ in thesis.CAUSES:
        assert f"\n| {words} | " in page
    for name in ("circles", "drives", "causes", "transport"):
        assert f"<!-- {name}: make thesis -->" in page
        assert (ROOT / f"docs/images/thesis_{name}.png").stat().st_size < 300_000


def circle(thesis: ModuleType) -> Any:  # noqa: ANN401 (a class of the module)
    """A drive around a circle at constant speed and angle."""
    time = np.linspace(0.0, 12.0, 601)
    car = Ackermann(GEOMETRY)
    turn, radius = SPEED * math.sin(ANGLE) / GEOMETRY.wheelbase_m * time, GEOMETRY.wheelbase_m / math.tan(ANGLE)
    poses = np.column_stack([radius * np.sin(turn), radius * (1.0 - np.cos(turn)), turn])
    left, right = car.wheel_speeds(SPEED, ANGLE)
    ones = np.ones_like(time)
    wheels = np.column_stack([left * time, right * time, *(angle * ones for angle in car.wheel_angles(ANGLE))])
    pair = {"odometry": Trajectory(time=time, poses=poses), "true": Trajectory(time=time, poses=poses)}
    return thesis.Drive(**pair, wheels=wheels, geometry=GEOMETRY)


def off(odometry: Array, seen: Array) -> Array:
    distance: Array = np.hypot(*(odometry - seen)[:, :2].T)
    return distance


def test_formulas_of_the_thesis_drive_a_circle_a_little_too_far(thesis: ModuleType) -> None:
    run = circle(thesis)
    poses = thesis.by_the_thesis(run)
    mean = sum(Ackermann(GEOMETRY).speed_ratios(ANGLE)) / 2.0
    assert mean == pytest.approx(1.0067, abs=1e-4)
    turned = poses[-1, 2] - poses[0, 2]
    assert turned == pytest.approx(mean * (run.odometry.poses[-1, 2] - run.odometry.poses[0, 2]), rel=0.005)


def test_late_stamps_pair_odometry_with_where_the_robot_was(thesis: ModuleType) -> None:
    odometry, seen = thesis.matched_by_stamps(circle(thesis))
    late = off(odometry, seen) / (SPEED * math.cos(ANGLE))
    assert len(late) > 50
    assert late.max() <= 1.5 * thesis.BLOCK + 2 * thesis.NEAR
    assert 0.3 * thesis.BLOCK < late.mean() < 0.8 * thesis.BLOCK


def test_tracker_over_the_front_axle_parts_by_twice_the_wheelbase_at_most(thesis: ModuleType) -> None:
    run = circle(thesis)
    seen = run.true.of_point(Pose(x=0.56)).poses
    seen = seen - np.array([*seen[0, :2], 0.0])
    heading = run.odometry.poses[:, 2]
    assert off(run.odometry.poses, seen) == pytest.approx(2 * 0.56 * np.abs(np.sin(heading / 2)), abs=1e-9)
    assert np.all(seen[:, 0] - run.odometry.poses[:, 0] <= 1e-9)
