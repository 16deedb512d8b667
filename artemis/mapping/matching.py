"""Matches one scan against the last key scans, with what the odometry says."""

from __future__ import annotations

import numpy as np

from artemis.mapping.likelihood import NOWHERE, LikelihoodGrid, Match
from artemis.mapping.se2 import Array, within
from artemis.mapping.settings import MapSettings

_LITTLE = np.diag([1e-3, 1e-3, 0.5])
"""Information of the odometry in the other directions: where the beams tell nothing at all, the pose stays."""
_FAR_OFF = 4
"""A match further from the odometry than so many windows is none."""
_WIDE = 3
"""The window is widened by it where nothing fits well."""


def match(grid: LikelihoodGrid, settings: MapSettings, scan: Array, predicted: Array, step: Array | None) -> Match:
    """Where a scan was taken.

    From the predicted pose first: a search prefers poses that see more of the known map, so that a robot that drives
    backwards would be drawn back. It is searched only where that fits badly, and what is found has to fit clearly
    better.

    Args:
        grid: of the last key scans.
        settings: windows and scores.
        scan: points and normals, shape (n, 4).
        predicted: pose, shape (3,).
        step: by the odometry, that led there, shape (3,); None: there is no odometry.

    Returns:
        The match; with the score -1 and the predicted pose, if the scan fits nowhere near.
    """
    nowhere = Match(NOWHERE, predicted, np.zeros((3, 3)))
    if len(scan) < settings.least_points:
        return nowhere
    distance, turn = _window(settings, step)
    found = grid.refine(scan, predicted)
    for enough, wide in ((settings.sure, 1), (settings.poor, _WIDE)):
        strayed = not within(found.pose - predicted, wide * distance, wide * turn)
        if found.score >= enough and not strayed and not (step is None and wide == 1):
            continue
        searched = grid.search(scan, predicted, wide * distance, wide * turn, prior=settings.prior)
        other = grid.refine(scan, searched.pose)
        if other.score > found.score + wide * settings.margin or (wide == 1 and strayed):
            found = other
    if step is not None:
        found = _with_odometry(grid, settings, scan, found, predicted, step)
    near = within(found.pose - predicted, _FAR_OFF * distance, _FAR_OFF * turn)
    return found if found.score > settings.least_score and near else nowhere


def _window(settings: MapSettings, step: Array | None) -> tuple[float, float]:
    if step is None:
        return settings.blind_window, settings.blind_turn
    moved = settings.window_share * np.hypot(step[0], step[1])
    return settings.window + float(moved), settings.window_turn + settings.window_share * float(abs(step[2]))


def _with_odometry(
    grid: LikelihoodGrid, settings: MapSettings, scan: Array, found: Match, predicted: Array, step: Array
) -> Match:
    """Where little tells how far along a corridor the robot is, the odometry says it, and only there."""
    of_place = found.information[:2, :2] - np.outer(found.information[:2, 2], found.information[2, :2]) / (
        found.information[2, 2] + 1e-9
    )
    told, directions = np.linalg.eigh(of_place)
    if told[0] >= settings.weak * len(scan):
        return found
    weakest = np.append(directions[:, 0], 0.0)
    noise = settings.odometry_noise + settings.odometry_share * np.hypot(step[0], step[1])
    trust = np.outer(weakest, weakest) * (settings.odometry_beam / noise) ** 2 + _LITTLE
    held = grid.refine(scan, found.pose, expected=predicted, trust=trust)
    return Match(found.score, held.pose, held.information)
