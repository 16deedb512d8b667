"""How long a follower's step takes, on a short path and on one of a million points."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from artemis.clock import stopwatch
from artemis.motion.arrays import Array
from artemis.motion.path import SPACING, Path
from artemis.plugins.contracts import Follower
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis_lab.bench.plant import Conditions, Plant

SIZES = (1_000, 1_000_000)
"""Points of the paths."""
STEPS, WARM = 500, 20
"""Steps that are measured, after the first few."""
ROUNDS = 3
"""Equal runs: the quickest counts for each step, so that what else the computer does takes little part."""
WAVE, SWING = 4.4, 0.6
"""Length of a wave of the path [m], and how far its heading swings to both sides [rad]."""
LONGEST = 20.0
"""A round is ended after this time [s]."""


def weaving_path(samples: int) -> Path:
    """A path that weaves, of so many points."""
    arc = np.arange(samples) * SPACING
    phase = np.pi * 2 / WAVE * arc
    heading, curvature = SWING * np.sin(phase), SWING * 2 * np.pi / WAVE * np.cos(phase)
    middle = SWING * np.sin(phase[:-1] + np.pi / WAVE * SPACING)
    x, y = (np.append(0.0, np.cumsum(part(middle)) * SPACING) for part in (np.cos, np.sin))
    return Path(x, y, heading, curvature, spacing=SPACING)


def step_times(followers: Iterable[Follower], path: Path, robot: RobotFile) -> Array:
    """Time that each step takes [s], shape (n,), n <= `STEPS`, the quickest of the same followers' equal runs.

    They drive from the start of the path.
    """
    took = [_round(follower, path, robot) for follower in followers]
    count = min(map(len, took))
    return np.asarray(np.min([times[:count] for times in took], axis=0)[WARM:])


def _round(follower: Follower, path: Path, robot: RobotFile) -> Array:
    plant = Plant(robot, Conditions(), Pose(), seed=1)
    follower.start(path, plant.snapshot())
    took: list[float] = []
    begun = stopwatch()
    while len(took) < STEPS + WARM and (stopwatch() - begun < LONGEST or len(took) <= WARM):
        snapshot = plant.snapshot()
        before = stopwatch()
        following = follower.step(snapshot)
        took.append(stopwatch() - before)
        plant.step(following.command)
    return np.array(took)
