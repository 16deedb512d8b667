"""Courses from formulas: five of known shape, and reproducible random ones that the robot can drive."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline  # scipy has no types

from artemis.motion.arrays import Array
from artemis.motion.path import Path, path_from_points
from artemis.values import Pose
from artemis.vehicle import RobotFile

SPACING = 0.005
"""Of a course's points [m]: a chord of the tightest curve is 10 um off."""
SHARE = 0.85
"""Of the robot's greatest curvature that a random course uses: the rest is the follower's to correct with."""
LONGEST = 40.0
"""Length of a random course, at most [m] for ARTEMIS."""
CURVATURE_RATE = 4.0
"""Of a random chain of clothoids, at most [1/m²]: 30 deg/s of an ARTEMIS wheel at 0.23 m/s."""
USUAL = 2.6
"""Greatest curvature of a random course for ARTEMIS [1/m]; for robots with wider curves courses are larger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """A line to follow with the centre of the rear axle.

    Attributes:
        name: of the course.
        points: x, y [m] along it, shape (n, 2), `SPACING` apart or a little less; every kink is one of them.
        start_offset: where the robot starts, to the left of its beginning [m].
        settled_from: arc length of what has to be settled after [m]: the start, or a kink.
    """

    name: str
    points: Array
    start_offset: float = 0.0
    settled_from: float = 0.0

    @property
    def length(self) -> float:
        """[m]."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())

    @property
    def closed(self) -> bool:
        """It ends where it begins."""
        return math.dist(self.points[0], self.points[-1]) < SPACING

    def start(self, offset: float = 0.0, heading: float = 0.0) -> Pose:
        """Pose at its beginning, `offset` [m] further to the left than the course wants, turned by `heading` [rad]."""
        (x, y), (dx, dy) = self.points[0], self.points[1] - self.points[0]
        tangent, left = math.atan2(dy, dx), self.start_offset + offset
        return Pose(x=x - left * math.sin(tangent), y=y + left * math.cos(tangent), heading=tangent + heading)

    def path(self) -> Path:
        """As a follower gets it."""
        return path_from_points(*self.points.T)


# ---------------------------------------------------------------------------------------------- the five


def five_courses() -> tuple[Course, ...]:
    """Straight with 0.5 m offset, circle, figure-eight (Gerono's lemniscate), 90 degree corner, slalom."""
    turn = np.linspace(0.0, math.tau, 20_001)
    eight = np.column_stack([3.0 * np.sin(turn), 1.1 * np.sin(2.0 * turn)])
    arc = np.radians(np.linspace(0.0, 320.0, 20_001))
    circle = np.column_stack([2.0 * np.sin(arc), 2.0 - 2.0 * np.cos(arc)])
    x = np.linspace(0.0, 12.0, 20_001)
    slalom = np.column_stack([x, 0.5 * np.sin(math.tau * x / 4.0)])
    return (
        Course(name="straight", points=_legs([(0, 0), (15, 0)]), start_offset=0.5),
        Course(name="circle", points=_resampled(circle)),
        Course(name="figure-eight", points=_resampled(eight)),
        Course(name="corner", points=_legs([(0, 0), (4, 0), (4, 4)]), settled_from=4.0),
        Course(name="slalom", points=_resampled(slalom)),
    )


# ---------------------------------------------------------------------------------------------- random ones


def random_course(seed: int, robot: RobotFile) -> Course:
    """A course that the robot can drive; the kind goes round with the seed.

    Chains of clothoids, splines through random points, legs with kinks of up to 90 degrees, closed loops, closed
    curves that cross themselves. Turned, mirrored and shifted anyhow.
    """
    dice = np.random.default_rng(seed)
    bound = SHARE * math.tan(math.radians(robot.limits.steering_deg)) / robot.geometry.wheelbase_m
    kinds = {"clothoids": _clothoids, "spline": _spline, "kinks": _kinks, "loop": _loop, "crossing": _crossing}
    name, make = list(kinds.items())[seed % len(kinds)]
    longest = LONGEST * max(1.0, USUAL / bound)
    points = make(dice, bound)
    while (make is not _kinks and _sharpest(points) > bound) or len(points) * SPACING > longest:
        points = make(dice, bound)
    turn, mirror = dice.uniform(0.0, math.tau), dice.choice([-1.0, 1.0])
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    return Course(name=f"{name}-{seed}", points=points * [1.0, mirror] @ rotation + dice.uniform(-5.0, 5.0, 2))


def _clothoids(dice: np.random.Generator, bound: float) -> Array:
    """Curvature in linear pieces, 6 to 15 m in all."""
    larger = max(1.0, USUAL / bound)
    curvature, length = [0.0], dice.uniform(6.0, 15.0) * larger
    steps = CURVATURE_RATE / larger**2 * SPACING
    while len(curvature) * SPACING < length:
        target = dice.uniform(-bound, bound) * dice.uniform()
        count = max(int(abs(target - curvature[-1]) / steps / dice.uniform(0.2, 1.0)), 1)
        curvature += np.linspace(curvature[-1], target, count + 1)[1:].tolist()
        curvature += [target] * int(dice.uniform(0.0, min(2.0 * larger, 4.0 / (abs(target) + 0.1))) / SPACING)
    heading = np.cumsum(curvature) * SPACING
    return np.column_stack([np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading))]) * SPACING


def _spline(dice: np.random.Generator, bound: float) -> Array:
    """A cubic spline through 5 to 9 points, about 1.5 m apart or more, with turns of up to 70 degrees."""
    count = int(dice.integers(4, 9))
    reach = max(1.0, 2.0 / bound)
    steps, turns = dice.uniform(1.5 * reach, 2.5 * reach, count), np.radians(dice.uniform(-70.0, 70.0, count))
    heading = np.cumsum(turns)
    corners = np.column_stack([steps * np.cos(heading), steps * np.sin(heading)]).cumsum(axis=0)
    corners = np.vstack([np.zeros(2), corners])
    at = np.append(0.0, steps.cumsum())
    return _resampled(CubicSpline(at, corners)(np.linspace(0.0, at[-1], 20_001)))


def _kinks(dice: np.random.Generator, bound: float) -> Array:
    """Straight legs with kinks between, each leg long enough for the curves that round its kinks."""
    count = int(dice.integers(2, 6))
    heading = np.append(0.0, np.radians(dice.uniform(-90.0, 90.0, count)).cumsum())
    legs = dice.uniform(max(1.0, 4.0 / bound), max(4.0, 8.0 / bound), count + 1)
    corners = np.column_stack([legs * np.cos(heading), legs * np.sin(heading)]).cumsum(axis=0)
    return _legs([(0.0, 0.0), *map(tuple, corners.tolist())])


def _loop(dice: np.random.Generator, bound: float) -> Array:
    """A closed curve: a circle whose radius varies by some waves."""
    angle = np.linspace(0.0, math.tau, 20_001)
    radius = dice.uniform(3.0, 8.0) / bound * np.ones_like(angle)
    size = radius[0]
    for waves in (2, 3, 4):
        radius += size * dice.uniform(0.0, 0.5) / waves * np.cos(waves * angle + dice.uniform(0.0, math.tau))
    return _resampled(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


def _crossing(dice: np.random.Generator, bound: float) -> Array:
    """A closed curve that crosses itself: one circle rolls on another, the pen is outside (a trochoid)."""
    angle = np.linspace(0.0, math.tau, 20_001)
    turns = [2, 3, 4, -1, -2, -3][dice.integers(6)]
    share = dice.uniform(1.6, 2.6) / abs(turns)
    points = np.column_stack(
        [np.cos(angle) + share * np.cos(turns * angle), np.sin(angle) + share * np.sin(turns * angle)]
    )
    return _resampled(points * _sharpest(points) / (bound * dice.uniform(0.4, 0.98)))


# ---------------------------------------------------------------------------------------------- points


def _resampled(points: Array) -> Array:
    """Points of a smooth curve at constant distance along it."""
    arc = np.append(0.0, np.hypot(*np.diff(points, axis=0).T).cumsum())
    places = np.linspace(0.0, arc[-1], math.ceil(arc[-1] / SPACING) + 1)
    return np.column_stack([np.interp(places, arc, column) for column in points.T])


def _legs(corners: list[tuple[float, ...]]) -> Array:
    """Straight legs between corners, all of which are kept."""
    legs = [_resampled(np.array([begin, end], float)) for begin, end in itertools.pairwise(corners)]
    return np.vstack([legs[0], *(leg[1:] for leg in legs[1:])])


def _sharpest(points: Array) -> float:
    """Greatest curvature [1/m] over pieces of a few centimetres."""
    dx, dy = np.diff(points[::4], axis=0).T
    heading = np.unwrap(np.arctan2(dy, dx))
    return float(np.max(np.abs(np.diff(heading)) / np.hypot(dx, dy)[:-1]))
