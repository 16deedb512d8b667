"""At the end of a map: every key scan is matched once more with its neighbours, then scans between them."""

from __future__ import annotations

import numpy as np

from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.pose_graph import Link, PoseGraph, match_information
from artemis.mapping.se2 import Array, between, compose, shares, within
from artemis.mapping.settings import MapSettings
from artemis.mapping.stations import Stations

_OLD_LINKS = 0.05
"""Weight of the links before this pass: they hold together only what the new ones do not."""
_ROUNDS = 15
_LEAST_SCORE, _LEAST_TOLD, _FARTHEST, _MOST_TURN = 0.3, 1.0, 0.3, 0.1
"""Of a match with a neighbour: its score, the beams for its weakest direction, and what it corrects [m, rad]."""
_STEP_SCORE, _STEP_FARTHEST, _STEP_TURN = 0.4, 0.15, 0.05
"""Likewise of a scan between two key scans."""


def matched_again(settings: MapSettings, keys: KeyScans, graph: PoseGraph, grid: LikelihoodGrid) -> Array:
    """Poses of the key scans from matches one by one between neighbours, shape (n, 3).

    Args:
        settings: how many neighbours.
        keys: with poses that are nearly right.
        graph: what led to them.
        grid: is overwritten.
    """
    pairs: dict[int, set[int]] = {}
    for key in range(len(keys)):
        for other in keys.neighbours(key, settings.neighbours, settings.neighbour_radius):
            pairs.setdefault(min(key, other), set()).add(max(key, other))
    new = PoseGraph()
    for link in graph.links.values():
        new.add(Link(link.first, link.second, link.motion, _OLD_LINKS * link.information, link.loop, link.untold))
    for key, others in pairs.items():
        pose = keys.poses[key]
        grid.build([keys.points[key]], [pose])
        for other in sorted(others):
            found = grid.refine(keys.points[other], keys.poses[other], rounds=_ROUNDS)
            if (
                found.score > _LEAST_SCORE
                and within(found.pose - keys.poses[other], _FARTHEST, _MOST_TURN)
                and np.linalg.eigvalsh(found.information)[0] > _LEAST_TOLD
            ):
                information = match_information(found.information, float(pose[2]), settings.beam)
                new.add(Link(key, other, between(pose, found.pose), information, True))
    return new.solve(keys.poses, _ROUNDS, settings.cauchy_loop, settings.cauchy_step)


def refined_steps(
    settings: MapSettings, keys: KeyScans, graph: PoseGraph, grid: LikelihoodGrid, stations: Stations
) -> Array:
    """Pose of every station, shape (m, 3): matched on the map of the key scans around.

    Args:
        settings: how many neighbours.
        keys: with their last poses.
        graph: what led to them.
        grid: is overwritten.
        stations: with the motion of each from its key scan.
    """
    of, odometry = np.array(stations.keys), stations.odometry[stations.readings]
    poses = compose(keys.poses[of], stations.motions)
    steps = {link.first: link.motion for link in graph.links.values() if not link.loop}
    begins = np.searchsorted(of, np.arange(len(keys) + 1))
    for key, (begin, end) in enumerate(zip(begins[:-1].tolist(), begins[1:].tolist(), strict=True)):
        if end - begin < 2:
            continue
        if key in steps and not np.isnan(odometry[begin : end + 1]).any():
            gap = between(compose(keys.poses[key], steps[key]), keys.poses[key + 1])
            share = shares(odometry[begin : end + 1])[:-1]
            poses[begin + 1 : end] = compose(poses[begin + 1 : end], share[:, None] * gap)
        around = [key, *keys.neighbours(key, settings.neighbours, settings.neighbour_radius)]
        grid.build([keys.points[each] for each in around], keys.poses[around])
        poses[begin:end] = compose(poses[begin:end], _corrections(grid, stations, poses[begin:end], begin))
    return poses


def _corrections(grid: LikelihoodGrid, stations: Stations, poses: Array, first: int) -> Array:
    """By which motions to correct the poses of consecutive stations, of which the first is right, shape (n, 3).

    Those whose points were kept are matched; between them corrections are interpolated.
    """
    matched, found = [0], [np.zeros(3)]
    for number in range(1, len(poses)):
        points = stations.points_of(first + number)
        if points is None:
            continue
        match, motion = grid.refine(points, poses[number]), np.zeros(3)
        if match.score > _STEP_SCORE and within(match.pose - poses[number], _STEP_FARTHEST, _STEP_TURN):
            motion = between(poses[number], match.pose)
        matched.append(number)
        found.append(motion)
    columns = [np.interp(np.arange(len(poses)), matched, column) for column in np.array(found).T]
    return np.stack(columns, 1)
