"""Worlds of straight walls, and what a perfect or a noisy laser scanner sees in them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from artemis.mapping.laser import Reading, surface_points
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.settings import MapSettings

SETTINGS = MapSettings()
ANGLES = np.radians(np.arange(-135, 135.1, 1.5))
"""Of the beams: fewer than a real scanner's, so that tests are fast."""


def walls(*lines: Sequence[tuple[float, float]]) -> Array:
    """Segments of polylines, shape (n, 4): x, y, x, y."""
    return np.array([[*a, *b] for line in lines for a, b in itertools.pairwise(line)], float)


def box(x: float, y: float, width: float, height: float) -> Array:
    """The four walls of a box with its lower left corner at x, y."""
    right, top = x + width, y + height
    return walls([(x, y), (right, y), (right, top), (x, top), (x, y)])


def seen(world: Array, pose: Array, angles: Array = ANGLES, farthest: float = 30.0) -> Array:
    """Distances to the nearest wall along each beam [m], 0 where there is none, shape (len(angles),)."""
    heading = pose[2] + angles
    dx, dy = np.cos(heading)[:, None], np.sin(heading)[:, None]
    ax, ay, wx, wy = world[:, 0] - pose[0], world[:, 1] - pose[1], *(world[:, 2:] - world[:, :2]).T
    across = dx * wy - dy * wx
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (ax * wy - ay * wx) / across
        along = (ax * dy - ay * dx) / across
    hit = np.where((distance > 0) & (along >= 0) & (along <= 1), distance, np.inf).min(1)
    return np.where(hit < farthest, hit, 0.0)


def scan(
    world: Array,
    pose: Array,
    noise: float = 0.0,
    dice: np.random.Generator | None = None,
    angles: Array = ANGLES,
    farthest: float = 30.0,
) -> Array:
    """Points and normals of a scan, seen from the robot."""
    ranges = seen(world, pose, angles, farthest)
    if dice is not None:
        ranges = np.where(ranges > 0, ranges + dice.normal(0, noise, len(ranges)), 0.0)
    return surface_points(ranges, angles, SETTINGS)


def driven(corners: Sequence[tuple[float, float]], step: float = 0.2, turn: float = 0.2) -> Array:
    """Poses along straight lines from corner to corner, turning on the spot at each; shape (n, 3)."""
    poses: list[tuple[float, float, float]] = []
    for (ax, ay), (bx, by) in itertools.pairwise(corners):
        heading = np.arctan2(by - ay, bx - ax)
        if poses:
            last = poses[-1][2]
            swing = (heading - last + np.pi) % (2 * np.pi) - np.pi
            count = int(abs(swing) / turn) + 1
            poses += [(ax, ay, last + swing * k / count) for k in range(1, count)]
        count = int(np.hypot(bx - ax, by - ay) / step)
        poses += [(ax + (bx - ax) * k / count, ay + (by - ay) * k / count, heading) for k in range(count)]
    return np.array(poses)


def odometry(poses: Array, scales: Iterable[float], turn_per_metre: float = 0.0) -> Array:
    """What wheels would count: each step's length times its scale, and a turn for each metre."""
    counted = [np.zeros(3)]
    for motion, scale in zip(between(poses[:-1], poses[1:]), scales, strict=True):
        length = float(np.hypot(motion[0], motion[1]))
        counted.append(
            compose(counted[-1], [scale * motion[0], scale * motion[1], motion[2] + turn_per_metre * length])
        )
    return np.array(counted)


def readings(
    world: Array,
    poses: Array,
    counted: Array | None,
    noise: float = 0.01,
    seed: int = 1,
    *,
    angles: Array = ANGLES,
    farthest: float = 30.0,
    period: float = 0.1,
) -> list[Reading]:
    """Scans at all poses, one each `period` [s]."""
    dice = np.random.default_rng(seed)
    return [
        Reading(
            time=period * number,
            odometry=None if counted is None else counted[number],
            points=scan(world, pose, noise, dice, angles, farthest),
        )
        for number, pose in enumerate(poses)
    ]
