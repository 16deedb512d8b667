"""Matches one scan against the last key scans, with what the odometry says."""

from __future__ import annotations

import numpy as np

from artemis.mapping.likelihood import NOWHERE, LikelihoodGrid, Match
from artemis.mapping.se2 import Array, within
from artemis.mapping.settings import MapSettings

_LITTLE = np.diag([1e-3, 1e-3, 0.5])
"""Information of the odometry in the other directions: where no beam constrains the pose, it stays."""
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


def untold(information: Array, least: float) -> tuple[float, Array] | None:
    """The direction that a match constrains too little: how many beams constrain it, and the direction.

    The direction: x, y of a unit vector in the frame of the grid, shape (2,).

    Args:
        information: of the match, shape (3, 3).
        least: beams that have to constrain every direction; None is returned where they do.
    """
    of_place = information[:2, :2] - np.outer(information[:2, 2], information[2, :2]) / (information[2, 2] + 1e-9)
    told, directions = np.linalg.eigh(of_place)
    return None if told[0] >= least else (float(told[0]), np.asarray(directions[:, 0]))


def _window(settings: MapSettings, step: Array | None) -> tuple[float, float]:
    if step is None:
        return settings.blind_window, settings.blind_turn
    moved = settings.window_share * np.hypot(step[0], step[1])
    return settings.window + float(moved), settings.window_turn + settings.window_share * float(abs(step[2]))


def odometry_trust(settings: MapSettings, step: Array) -> float:
    """How many beams a step of the odometry is worth along one direction."""
    noise = settings.odometry_noise + settings.odometry_share * float(np.hypot(step[0], step[1]))
    return (settings.odometry_beam / noise) ** 2


def _with_odometry(
    grid: LikelihoodGrid, settings: MapSettings, scan: Array, found: Match, predicted: Array, step: Array
) -> Match:
    """Where the scan hardly constrains the position along a corridor, that alone is taken from the odometry."""
    weak = untold(found.information, settings.weak * len(scan))
    if weak is None:
        return found
    weakest = np.append(weak[1], 0.0)
    trust = np.outer(weakest, weakest) * odometry_trust(settings, step) + _LITTLE
    held = grid.refine(scan, found.pose, expected=predicted, trust=trust)
    return Match(found.score, held.pose, held.information)
