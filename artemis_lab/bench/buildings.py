"""A large building in which everything looks alike, driven with wheels that are wrong all along: how far off a map is.

The drive is longer than the drift that a loop may have to correct, and leads again and again to where it was before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from artemis.clock import cpu_time
from artemis.mapping.laser import Reading
from artemis.mapping.mapper import Mapper
from artemis.mapping.se2 import Array, between, compose
from artemis_lab.bench.laser_worlds import SETTINGS, box, driven, odometry, readings, walls

LONG, WIDE, CORRIDOR, BLOCKS = 72.0, 36.0, 2.2, 3
"""Of the building [m]."""
BLOCK = (LONG - (BLOCKS + 1) * CORRIDOR) / BLOCKS
"""Length of a block between corridors [m]."""
OFF = 0.3
"""A loop or a place that is further off is wrong, or left open [m]."""
_REVISIT = 0.6
"""Two key scans that are no further apart are of one place [m],"""
_GAP = SETTINGS.gap
"""and of two visits if so many others were taken between."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MappedBuilding:
    """A map of it, beside the truth."""

    mapper: Mapper
    true: Array
    """Poses of the key scans, shape (n, 3)."""
    distances: Array
    """Of the key scans from the truth, after the map was laid on it [m], shape (n,)."""
    wrong: int
    """Loops that are."""
    revisits: Array
    """At each key scan of a place that was visited before: how far off the map has the two [m], shape (m,)."""
    seconds: float
    """Of processor time, without the simulation."""


def niches(width: float, height: float) -> Array:
    """Along the inside of a box, equal and at equal distances."""
    parts = []
    for x in np.arange(4, width - 4, 4.0):
        parts.append(walls([(x, 0), (x, 0.35), (x + 0.9, 0.35), (x + 0.9, 0)]))
        parts.append(walls([(x, height), (x, height - 0.35), (x + 0.9, height - 0.35), (x + 0.9, height)]))
    for y in np.arange(4, height - 4, 4.0):
        parts.append(walls([(0, y), (0.35, y), (0.35, y + 0.9), (0, y + 0.9)]))
        parts.append(walls([(width, y), (width - 0.35, y), (width - 0.35, y + 0.9), (width, y + 0.9)]))
    return np.concatenate(parts)


def building_walls() -> Array:
    """Three equal blocks with corridors around and between them, as segments."""
    blocks = [box(CORRIDOR + n * (BLOCK + CORRIDOR), CORRIDOR, BLOCK, WIDE - 2 * CORRIDOR) for n in range(BLOCKS)]
    return np.concatenate([box(0, 0, LONG, WIDE), niches(LONG, WIDE), *blocks])


def building(laps: int = 1) -> tuple[Array, Array]:
    """Its walls, and laps of 850 m that are four times in some of the corridors."""
    across = [CORRIDOR / 2 + n * (BLOCK + CORRIDOR) for n in range(BLOCKS + 1)]
    corners = [(x, y) for x in across for y in (CORRIDOR / 2, WIDE - CORRIDOR / 2)]
    order = (0, 2, 4, 6, 7, 5, 3, 1, 0, 2, 3, 5, 4, 2, 0, 1, 3, 2, 4, 5, 7, 6, 4, 2, 0, 1, 7, 6, 0)
    return building_walls(), driven([corners[number] for number in (*order[:1], *laps * order[1:])], step=0.4)


def drifting(world: Array, true: Array, seed: int) -> list[Reading]:
    """Wheels that count up to 7 % wrong, change by some percent on the way, and turn by up to 1 degree per metre."""
    dice, steps = np.random.default_rng(seed), len(true) - 1
    scale, turn = dice.uniform(0.93, 1.07), dice.uniform(-1, 1)
    walk = np.cumsum(dice.normal(0, 0.002, steps))
    scales = scale * (1 + 0.05 * dice.normal(size=steps)) + walk - walk.mean()
    return readings(world, true, odometry(true, scales, np.radians(turn)), seed=seed)


def mapped(seed: int, laps: int = 1) -> MappedBuilding:
    """Make the map of one drive."""
    world, poses = building(laps)
    given = drifting(world, poses, seed)
    mapper, begin = Mapper(replace(SETTINGS, cells=1024)), cpu_time()
    for reading in given:
        mapper.add(reading)
    mapper.finish()
    seconds, true = cpu_time() - begin, poses[mapper.key_readings]
    loops = mapper.graph.loops.values()
    return MappedBuilding(
        mapper=mapper,
        true=true,
        distances=distances(mapper.keys.poses, true),
        wrong=len([link for link in loops if _off(between(true[link.first], true[link.second]), link.motion) >= OFF]),
        revisits=revisits(mapper.keys.poses, true),
        seconds=seconds,
    )


def distances(poses: Array, true: Array) -> Array:
    """From the true places [m], after the map was moved and turned to where the squares are least; shape (n,).

    The turn: B. Horn, Closed-form solution of absolute orientation using unit quaternions, Journal of the Optical
    Society of America A 4(4), 1987, in the plane.
    """
    middle, true_middle = poses[:, :2].mean(0), true[:, :2].mean(0)
    (x, y), (u, v) = (poses[:, :2] - middle).T, (true[:, :2] - true_middle).T
    turn = np.arctan2((x * v - y * u).sum(), (x * u + y * v).sum())
    laid = compose([*true_middle, turn], np.c_[x, y, np.zeros(len(x))])
    return np.asarray(np.hypot(*(laid - true)[:, :2].T))


def revisits(poses: Array, true: Array) -> Array:
    """At each pose of a place that was visited before: how far off the map has the two of them [m], shape (m,)."""
    found = []
    for key in range(_GAP + 1, len(true)):
        away = np.hypot(*(true[: key - _GAP, :2] - true[key, :2]).T)
        if away.min() < _REVISIT:
            place = int(away.argmin())
            found.append(_off(between(true[place], true[key]), between(poses[place], poses[key])))
    return np.array(found)


def _off(motion: Array, other: Array) -> float:
    return float(np.hypot(*between(motion, other)[:2]))
