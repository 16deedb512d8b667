"""Courses are what their formulas say, and random ones what the robot can drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.motion.arrays import Array
from artemis.testing.contracts import ROBOT
from artemis_lab.bench.courses import LONGEST, SHARE, SPACING, Course, five_courses, random_course

COURSES = {course.name: course for course in five_courses()}
BOUND = math.tan(math.radians(60)) / 0.56


def curvature(course: Course, stride: int = 10) -> Array:
    dx, dy = np.diff(course.points[::stride], axis=0).T
    return np.asarray(np.diff(np.unwrap(np.arctan2(dy, dx))) / np.hypot(dx, dy)[:-1])


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_points_are_evenly_spaced(course: Course) -> None:
    gaps = np.hypot(*np.diff(course.points, axis=0).T)
    assert gaps.max() <= SPACING * 1.0001
    assert gaps.min() > 0.9 * SPACING


def test_the_five() -> None:
    assert COURSES["straight"].length == pytest.approx(15.0)
    assert COURSES["circle"].length == pytest.approx(math.radians(320) * 2.0, rel=1e-6)
    assert curvature(COURSES["circle"]) == pytest.approx(0.5, rel=1e-3)
    eight = COURSES["figure-eight"]
    assert np.ptp(eight.points, axis=0) == pytest.approx([6.0, 2.2], abs=1e-4)
    steering = np.degrees(np.arctan(0.56 * np.abs(curvature(eight))))
    assert steering.max() == pytest.approx(37, abs=0.5)
    assert np.degrees(np.arctan(0.56 * curvature(COURSES["slalom"]))).max() == pytest.approx(34.6, abs=0.2)
    assert [course.name for course in five_courses() if course.closed] == ["figure-eight"]


def test_the_corner_is_one_of_its_points() -> None:
    corner = COURSES["corner"]
    assert [4.0, 0.0] in corner.points.tolist()
    assert corner.length == pytest.approx(8.0)


def test_a_start_is_beside_the_beginning() -> None:
    pose = COURSES["straight"].start(offset=-0.2, heading=0.3)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0.0, 0.3, 0.3))  # 0.5 m are the course's own
    slope = COURSES["slalom"].start(offset=0.1)
    assert math.hypot(slope.x, slope.y) == pytest.approx(0.1)
    assert slope.heading == pytest.approx(math.atan(math.pi / 4), abs=1e-3)


@pytest.mark.parametrize("seed", range(50))
def test_random_courses_can_be_driven(seed: int) -> None:
    course = random_course(seed, ROBOT)
    assert np.array_equal(course.points, random_course(seed, ROBOT).points)
    assert 3.0 < course.length <= LONGEST
    gaps = np.hypot(*np.diff(course.points, axis=0).T)
    assert 0.9 * SPACING < gaps.min()
    assert gaps.max() < 1.02 * SPACING
    kind = course.name.partition("-")[0]
    assert course.closed == (kind in ("loop", "crossing"))
    if kind == "kinks":
        headings = np.arctan2(*np.diff(course.points, axis=0).T[::-1])
        assert np.abs((np.diff(headings) + math.pi) % math.tau - math.pi).max() <= math.radians(90.01)
    else:
        assert np.abs(curvature(course)).max() <= 1.02 * SHARE * BOUND


def test_crossing_courses_cross_themselves() -> None:
    course = random_course(4, ROBOT)
    assert course.name == "crossing-4"
    points = course.points[::8]
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    index = np.arange(len(points))
    distant = np.abs(index[:, None] - index[None])
    distant = np.minimum(distant, len(points) - 1 - distant) > 25
    assert apart[distant].min() < 0.05


def test_kinds_go_round() -> None:
    kinds = [random_course(seed, ROBOT).name.partition("-")[0] for seed in range(5)]
    assert sorted(kinds) == ["clothoids", "crossing", "kinks", "loop", "spline"]


def test_a_path_of_a_course_is_the_course() -> None:
    for course in five_courses():
        path = course.path()
        assert path.length == pytest.approx(course.length, abs=0.2)
        assert path.closed == course.closed
