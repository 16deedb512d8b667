"""The pose graph against a dense solution, wrong loops, and loops that are taken back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from artemis.mapping.pose_graph import Link, PoseGraph, match_information
from artemis.mapping.se2 import Array, between, compose, effort, shares, within
from artemis.motion.arrays import wrapped

INFORMATION = np.diag([400.0, 900.0, 2500.0])


def circle(count: int = 24, noise: float = 0.0, seed: int = 1) -> tuple[Array, PoseGraph]:
    """Two rounds on a circle, and a graph of measured steps and of some loops."""
    dice = np.random.default_rng(seed)
    turn = np.arange(2 * count) * 2 * np.pi / count
    true = np.stack([3 * np.cos(turn), 3 * np.sin(turn), wrapped(turn + np.pi / 2)], 1)
    graph = PoseGraph()
    pairs = [(k, k + 1, False) for k in range(len(true) - 1)] + [(k, k + count, True) for k in range(0, count, 3)]
    for first, second, loop in pairs:
        motion = between(true[first], true[second]) + noise * dice.normal(size=3)
        graph.add(Link(first, second, motion, INFORMATION, loop))
    return true, graph


def chained(graph: PoseGraph, true: Array) -> Array:
    poses = [true[0]]
    for link in graph.links.values():
        if not link.loop:
            poses.append(compose(poses[-1], link.motion))
    return np.array(poses)


def test_exact_motions_give_the_true_poses() -> None:
    true, graph = circle()
    start = true + np.random.default_rng(2).normal(0, 0.05, true.shape) * (np.arange(len(true)) > 0)[:, None]
    found = graph.solve(start, 30, 1e3, 1e3)
    assert np.abs(between(true, found)).max() < 1e-6


def test_the_sparse_solution_is_the_dense_one() -> None:
    true, graph = circle(noise=0.02)
    start = chained(graph, true)
    roots = {number: np.linalg.cholesky(link.information) for number, link in graph.links.items()}

    def residuals(free: Array) -> Array:
        poses = np.concatenate([true[:1], free.reshape(-1, 3)])
        rows = []
        for number, link in graph.links.items():
            off = between(poses[link.first], poses[link.second]) - link.motion
            rows.append(roots[number].T @ np.array([off[0], off[1], float(wrapped(off[2]))]))
        return np.concatenate(rows)

    dense = least_squares(residuals, start[1:].reshape(-1), xtol=1e-12, ftol=1e-12).x.reshape(-1, 3)
    sparse = graph.solve(start, 50, 1e6, 1e6)
    assert np.abs(between(np.concatenate([true[:1], dense]), sparse)).max() < 1e-4


@pytest.mark.slow
def test_the_share_of_the_wheels_is_found_with_the_poses_as_in_the_dense_solution() -> None:
    true, steps = circle(count=60, noise=0.02)
    graph = PoseGraph()
    for link in steps.links.values():
        motion = link.motion * (1.0 if link.loop else np.array([0.9, 0.9, 1.0]))
        graph.add(replace(link, motion=motion, untold=np.zeros(2) if link.loop else 0.5 * motion[:2]))
    start = chained(graph, true)
    roots = {number: np.linalg.cholesky(link.information) for number, link in graph.links.items()}

    def residuals(free: Array) -> Array:
        shares, poses = free[:3], np.concatenate([true[:1], free[3:].reshape(-1, 3)])
        rows = [shares[:1] / 0.05, np.diff(shares) / 0.01]
        for number, link in graph.links.items():
            off = between(poses[link.first], poses[link.second]) - link.motion
            off[:2] -= shares[link.first // 40] * link.untold
            rows.append(roots[number].T @ np.array([off[0], off[1], float(wrapped(off[2]))]))
        return np.concatenate(rows)

    free = np.concatenate([np.zeros(3), start[1:].reshape(-1)])
    dense = least_squares(residuals, free, xtol=1e-12, ftol=1e-12).x[3:].reshape(-1, 3)
    sparse = graph.solve(start, 50, 1e6, 1e6)
    assert np.abs(between(np.concatenate([true[:1], dense]), sparse)).max() < 1e-4


def test_a_loop_metres_off_is_closed_evenly_where_wheels_are_wrong_all_along_a_corridor() -> None:
    """40 m along a corridor, where the wheels count 10 % too much, and back along another, where scans tell all."""
    turn = np.array([0.0, 0.0, np.pi / 2])
    side = [np.array([0.5, 0.0, 0.0])] * 80
    steps = [*side, turn, np.array([5.0, 0.0, 0.0]), turn, *side, turn, np.array([5.0, 0.0, 0.0]), turn]
    sure, unsure = np.diag([1e4, 1e4, 1e5]), np.diag([400.0, 1e4, 1e5])  # 1 cm; 10 % of 0.5 m
    graph, true, begin = PoseGraph(), [np.zeros(3)], [np.zeros(3)]
    for number, step in enumerate(steps):
        in_first = number < len(side)
        motion = step * 1.1 if in_first else step
        untold = motion[:2] if in_first else np.zeros(2)
        graph.add(Link(number, number + 1, motion, unsure if in_first else sure, False, untold))
        true.append(compose(true[-1], step))
        begin.append(compose(begin[-1], motion))
    graph.add(Link(0, len(steps), np.zeros(3), sure, True))
    assert np.hypot(*begin[-1][:2]) == pytest.approx(4.0)
    found = graph.solve(np.array(begin), 20, 1.5, 3.0)
    off = found - np.array(true)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert max(graph.deviations(found).values()) < 2.0


def test_a_wrong_loop_is_outvoted() -> None:
    true, graph = circle(noise=0.01)
    graph.add(Link(2, 14, np.array([1.0, 0.0, 0.0]), INFORMATION, True))
    found = graph.solve(chained(graph, true), 50, 1.5, 3.0)
    assert np.hypot(*(found - true)[:, :2].T).max() < 0.3
    worst = max(graph.deviations(found).items(), key=lambda item: item[1])
    assert worst[0] == max(graph.links)
    assert worst[1] > 50


def test_loops_taken_back_leave_the_graph_as_if_they_had_never_been_added() -> None:
    true, graph = circle(noise=0.01)
    _, never = circle(noise=0.01)
    start = chained(graph, true)
    taken = [graph.add(Link(a, b, np.array([0.5, 0.2, 0.1]), INFORMATION, True)) for a, b in ((3, 20), (5, 31))]
    graph.solve(start, 20, 1.5, 3.0)
    for number in taken:
        graph.remove(number)
    assert list(graph.links) == list(never.links)
    assert np.array_equal(graph.solve(start, 20, 1.5, 3.0), never.solve(start, 20, 1.5, 3.0))
    assert np.array_equal(graph.distances_from(5, len(true)), never.distances_from(5, len(true)))


def test_a_graph_of_one_pose_or_no_links_stays() -> None:
    poses = np.array([[1.0, 2.0, 3.0]])
    assert PoseGraph().solve(poses, 5, 1.0, 1.0) is poses
    assert PoseGraph().deviations(poses) == {}


def test_a_match_that_tells_nothing_has_little_information() -> None:
    nothing, much = match_information(np.zeros((3, 3)), 0.3, 0.03), match_information(100 * np.eye(3), 0.3, 0.03)
    assert np.linalg.eigvalsh(nothing).max() < 11
    assert np.linalg.eigvalsh(much).min() > 1000
    turned = match_information(np.diag([100.0, 0.0, 0.0]), np.pi / 2, 0.03)
    assert turned[1, 1] > 100 * turned[0, 0], "what is along x of the map is across the robot that looks along y"


def test_motions_and_poses() -> None:
    poses = np.array([[0, 0, 0], [1, 0, 0], [1, 0, np.pi / 2], [1, 2, np.pi / 2]])
    for a in poses:
        for b in poses:
            assert compose(a, between(a, b)) == pytest.approx(b)
    assert np.allclose(compose(poses[:-1], between(poses[:-1], poses[1:])), poses[1:])
    assert effort(between(poses[:-1], poses[1:])) == pytest.approx([1, np.pi / 4, 2])
    assert shares(poses)[-1] == 1
    assert within(np.array([0.1, 0, 2 * np.pi]), 0.2, 0.1)
    assert not within(np.array([0.1, 0, 0.2]), 0.2, 0.1)
