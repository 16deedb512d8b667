"""Loops where the drift is larger than the window around one place: how far off it may be, and whole buildings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from artemis.mapping.drift import Drift, Drifts
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.loops import LoopFinder
from artemis.mapping.pose_graph import Link, PoseGraph
from artemis.mapping.se2 import Array, between, compose
from artemis.mapping.wide_loops import WideLoops, likely
from artemis_lab.bench.buildings import mapped, niches
from artemis_lab.bench.laser_worlds import SETTINGS, box, driven, scan

INFORMATION = np.diag([1e4, 1e4, 1e5])
POINTS = np.zeros((0, 4))


def chain(steps: list[Array], untold: list[Array], share: float) -> tuple[Drift, KeyScans, PoseGraph]:
    keys, graph = KeyScans(), PoseGraph()
    drift = Drift(SETTINGS, keys, graph)
    drift.share = share
    keys.append(POINTS, np.zeros(3), np.zeros(2))
    drift.add(-1, np.zeros(2))
    for number, (step, unknown) in enumerate(zip(steps, untold, strict=True)):
        keys.append(POINTS, compose(keys.poses[number], step), np.zeros(2))
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
    keys.append(POINTS, np.zeros(3), np.zeros(2))
    drift.add(-1, np.zeros(2))
    assert np.isinf(drift.seen_from_newest(3).most).all()


def test_two_loops_agree_if_the_wheels_alone_tell_what_lies_between_them_and_only_in_its_direction() -> None:
    """Along a corridor and back: of 20 m between two loops the wheels may have counted metres too many each time."""
    there_and_back = [*ALONG, TURN, TURN, *ALONG]
    drift, keys, graph = chain(there_and_back, [each[:2] for each in there_and_back], 0.1)
    finder = LoopFinder(SETTINGS, keys, graph, LikelihoodGrid(replace(SETTINGS, cells=64)))
    finder.drift = drift

    def believed(along: float, aside: float, turn: float, wide: bool) -> int:
        """Loops, of one at a corner that is 5 m off, and one at the next that is off by so much more."""
        finder._waiting = []
        off = np.array([5.0, 0.0, 0.0])
        assert finder._confirmed(loop(keys, 60, 142, off), wide=wide) == []
        return len(finder._confirmed(loop(keys, 20, 182, off + np.array([along, aside, turn])), wide=wide))

    assert believed(3.0, 0.0, 0.0, wide=True) == 2
    assert believed(0.0, 3.0, 0.0, wide=True) == 0, "the wheels cannot have been so wrong in this direction"
    assert believed(3.0, 0.0, 0.2, wide=True) == 0
    assert believed(9.0, 0.0, 0.0, wide=True) == 0
    assert believed(3.0, 0.0, 0.0, wide=False) == 0


def loop(keys: KeyScans, place: int, key: int, off: Array) -> Link:
    """That has the key scan so far off on the map: x, y [m], heading [rad]."""
    return Link(place, key, between(keys.poses[place], keys.poses[key] + off), INFORMATION, True)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(1, 21))
def test_a_large_building_is_mapped_to_centimetres_though_the_wheels_are_wrong_all_along(seed: int) -> None:
    made = mapped(seed)
    assert made.wrong == 0
    assert made.revisits.max() < 0.3, "nothing is left open"
    assert made.distances.max() < 0.2
    mapper = made.mapper
    assert len(mapper.graph.loops) > 300
    for number in list(mapper.graph.loops)[:5]:
        mapper.graph.remove(number)
        mapper.solve()
        assert number not in mapper.graph.loops


SHORT = 30.0


def test_a_place_is_found_six_metres_off_in_a_window_of_all_places_or_not_at_all() -> None:
    """A corner tells where along both corridors the robot is; a stretch of one corridor does not."""
    world = np.concatenate([box(0, 0, SHORT, SHORT), box(2.2, 2.2, SHORT - 4.4, SHORT - 4.4), niches(SHORT, SHORT)])
    true = driven([(1.1, 20.0), (1.1, 1.1), (20.0, 1.1)], step=0.5)
    settings, dice = replace(SETTINGS, cells=1024), np.random.default_rng(1)
    keys = KeyScans()
    for visit in range(2):
        for pose in true[: len(true) if visit == 0 else 53]:
            off = np.array([5.0 * visit, -3.5 * visit, 0.0])
            keys.append(scan(world, pose, 0.01, dice), compose(off, pose), np.zeros(2))
    none = np.zeros(len(true))
    sure = Drifts(np.tile(np.diag([9.0, 9.0]), (len(true), 1, 1)), none, none)
    wide = WideLoops(settings, keys, LikelihoodGrid(settings))
    for count in (53, 44):  # four metres behind the corner, where only scans before this one tell all, and at it
        while len(keys) > len(true) + count:
            keys.points.pop()
        found = wide.find(8.0, 0.1, sure)
        assert found is not None
        assert (found.second == len(keys) - 1) == (count == 44)
        off = between(between(true[found.first], true[found.second - len(true)]), found.motion)
        assert np.hypot(off[0], off[1]) < 0.1
    aside = Drifts(np.tile(np.diag([9.0, 0.01]), (len(true), 1, 1)), none, none)
    assert wide.find(8.0, 0.1, aside) is None, "the odometry cannot have been so wrong in this direction"
    while len(keys) > len(true) + 25:
        keys.points.pop()
    assert wide.find(8.0, 0.1, sure) is None, "it may be anywhere along the corridor"
