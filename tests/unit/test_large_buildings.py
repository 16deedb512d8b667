"""Loops where the drift is larger than the window around one place: how far off it may be, and whole buildings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from laser_worlds import SETTINGS, box, driven, odometry, readings, scan, walls

from artemis.mapping.drift import Drift, Drifts
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.mapper import Mapper
from artemis.mapping.pose_graph import Link, PoseGraph
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.wide_loops import WideLoops, likely

INFORMATION = np.diag([1e4, 1e4, 1e5])
POINTS = np.zeros((0, 4))


def chain(steps: list[Array], untold: list[Array], share: float) -> tuple[Drift, KeyScans, PoseGraph]:
    keys, graph = KeyScans(), PoseGraph()
    drift = Drift(SETTINGS, keys, graph)
    drift.share = share
    keys.append(POINTS, np.zeros(3))
    drift.add(-1, np.zeros(2))
    for number, (step, unknown) in enumerate(zip(steps, untold, strict=True)):
        keys.append(POINTS, compose(keys.poses[number], step))
        graph.add(Link(number, number + 1, step, INFORMATION, False))
        drift.add(number, unknown)
    return drift, keys, graph


STEP, TURN = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, np.pi / 2])
ALONG = [STEP] * 100
"""50 m."""


def test_what_only_the_odometry_tells_adds_up_along_the_corridor_and_not_beside_it() -> None:
    drift, *_ = chain(ALONG, [STEP[:2]] * 100, 0.1)
    told = chain(ALONG, [np.zeros(2)] * 100, 0.1)[0].seen_from_newest(1)
    found = drift.seen_from_newest(1)
    assert found.covariance[0, 0, 0] - told.covariance[0, 0, 0] == pytest.approx((0.1 * 50) ** 2)
    assert found.covariance[0, 1, 1] == pytest.approx(told.covariance[0, 1, 1])
    assert likely(np.array([9.0, 0.0, 0.1]), found.covariance[0])
    assert not likely(np.array([0.0, 9.0, 0.1]), found.covariance[0]), "there an equal corridor may be"
    assert found.most[0] == pytest.approx(found.covariance[0, 0, 0] ** 0.5)


def test_the_way_back_adds_to_what_is_not_known_of_the_way_there() -> None:
    there_and_back = [*ALONG, TURN, TURN, *ALONG]
    untold = [each[:2] for each in there_and_back]
    found = chain(there_and_back, untold, 0.1)[0].seen_from_newest(1)
    assert found.most[0] > 0.1 * 100, "the wheels may have counted too little first, and too much then"


def test_the_heading_moves_what_was_driven_after_it_to_the_side() -> None:
    drift, *_ = chain(ALONG, [np.zeros(2)] * 100, 0.1)
    found = drift.seen_from_newest(1).covariance[0]
    aside = found[1, 1] - SETTINGS.drift**2 * (50 + 100 * 0.02)
    integral = SETTINGS.drift_turn**2 * 50**3 / 3
    assert aside == pytest.approx(integral, rel=0.1)
    assert found[0, 0] < 0.1 * found[1, 1]


def test_a_loop_ends_the_drift_of_all_that_lies_beside_it() -> None:
    square = [*[STEP] * 20, TURN] * 4
    drift, keys, graph = chain(square, [0.5 * each[:2] for each in square], 0.2)
    before = drift.seen_from_newest(40).most
    graph.add(Link(0, len(keys) - 1, np.array([0.0, 0.0, 0.0]), INFORMATION, True))
    after = drift.seen_from_newest(40).most
    assert before[0] > 2.0
    assert after[0] < 0.02
    assert after[5] < 0.5 < before[5]
    assert after[39] == pytest.approx(before[39], rel=1.0)


def test_a_place_to_which_no_way_leads_may_be_anywhere_near() -> None:
    drift, keys, _ = chain(ALONG[:3], [np.zeros(2)] * 3, 0.1)
    keys.append(POINTS, np.zeros(3))
    drift.add(-1, np.zeros(2))
    assert np.isinf(drift.seen_from_newest(3).most).all()


def niches(width: float, height: float, every: float = 4.0) -> Array:
    """Along the inside of a box, equal and at equal distances."""
    parts = []
    for x in np.arange(4, width - 4, every):
        parts.append(walls([(x, 0), (x, 0.35), (x + 0.9, 0.35), (x + 0.9, 0)]))
        parts.append(walls([(x, height), (x, height - 0.35), (x + 0.9, height - 0.35), (x + 0.9, height)]))
    for y in np.arange(4, height - 4, every):
        parts.append(walls([(0, y), (0.35, y), (0.35, y + 0.9), (0, y + 0.9)]))
        parts.append(walls([(width, y), (width - 0.35, y), (width - 0.35, y + 0.9), (width, y + 0.9)]))
    return np.concatenate(parts)


LONG, WIDE, CORRIDOR, BLOCKS = 72.0, 36.0, 2.2, 3


def building() -> tuple[Array, Array]:
    """Three equal blocks with corridors around and between them, and a drive of 850 m that is four times in some."""
    width = (LONG - (BLOCKS + 1) * CORRIDOR) / BLOCKS
    blocks = [box(CORRIDOR + n * (width + CORRIDOR), CORRIDOR, width, WIDE - 2 * CORRIDOR) for n in range(BLOCKS)]
    world = np.concatenate([box(0, 0, LONG, WIDE), niches(LONG, WIDE), *blocks])
    across = [CORRIDOR / 2 + n * (width + CORRIDOR) for n in range(BLOCKS + 1)]
    corners = [(x, y) for x in across for y in (CORRIDOR / 2, WIDE - CORRIDOR / 2)]
    order = (0, 2, 4, 6, 7, 5, 3, 1, 0, 2, 3, 5, 4, 2, 0, 1, 3, 2, 4, 5, 7, 6, 4, 2, 0, 1, 7, 6, 0)
    return world, driven([corners[number] for number in order], step=0.4)


def drifting(world: Array, true: Array, seed: int) -> list[Reading]:
    """Wheels that count up to 7 % wrong, change by some percent on the way, and turn by up to 1 degree per metre."""
    dice, steps = np.random.default_rng(seed), len(true) - 1
    scale, turn = dice.uniform(0.93, 1.07), dice.uniform(-1, 1)
    walk = np.cumsum(dice.normal(0, 0.002, steps))
    scales = scale * (1 + 0.05 * dice.normal(size=steps)) + walk - walk.mean()
    return readings(world, true, odometry(true, scales, np.radians(turn)), seed=seed)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(1, 21))
def test_the_loops_of_a_large_building_are_found_and_none_is_wrong(seed: int) -> None:
    world, true = building()
    mapper = Mapper(replace(SETTINGS, cells=1024))
    for reading in drifting(world, true, seed):
        mapper.add(reading)
    of, wrong = mapper.key_readings, []
    for number, link in mapper.graph.loops.items():
        off = between(between(true[of[link.first]], true[of[link.second]]), link.motion)
        wrong += [number] if np.hypot(off[0], off[1]) >= 0.3 else []
    assert wrong == []
    assert len(mapper.graph.loops) > 300
    for number in list(mapper.graph.loops)[:5]:
        mapper.undo(number)
        assert number not in mapper.graph.loops


SHORT = 30.0


def test_a_place_is_found_six_metres_off_in_a_window_of_all_places_or_not_at_all() -> None:
    """A corner tells where along both corridors the robot is; a stretch of one corridor does not."""
    world = np.concatenate([box(0, 0, SHORT, SHORT), box(2.2, 2.2, SHORT - 4.4, SHORT - 4.4), niches(SHORT, SHORT)])
    true = driven([(1.1, 20.0), (1.1, 1.1), (20.0, 1.1)], step=0.5)
    settings, dice = replace(SETTINGS, cells=1024), np.random.default_rng(1)
    keys = KeyScans()
    for visit in range(2):
        for pose in true[: len(true) if visit == 0 else 44]:
            off = np.array([5.0 * visit, -3.5 * visit, 0.0])
            keys.append(scan(world, pose, 0.01, dice), compose(off, pose))
    none = np.zeros(len(true))
    sure = Drifts(np.tile(np.diag([9.0, 9.0]), (len(true), 1, 1)), none, none)
    wide = WideLoops(settings, keys, LikelihoodGrid(settings))
    found = wide.find(8.0, 0.1, sure)
    assert found is not None
    off = between(between(true[found.first], true[43]), found.motion)
    assert np.hypot(off[0], off[1]) < 0.1
    aside = Drifts(np.tile(np.diag([9.0, 0.01]), (len(true), 1, 1)), none, none)
    assert wide.find(8.0, 0.1, aside) is None, "the odometry cannot have been so wrong in this direction"
    while len(keys) > len(true) + 25:
        keys.points.pop()
    assert wide.find(8.0, 0.1, sure) is None, "it may be anywhere along the corridor"
