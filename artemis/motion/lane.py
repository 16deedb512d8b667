"""Whether scanners see the ground ahead of a robot before it drives over it, by the robot file alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from artemis.motion.beams import seeing
from artemis.motion.ground import BEFORE_MASK, CELL, SHRUNK
from artemis.vehicle import RobotFile

ACROSS, ALONG = 0.01, 0.02
"""Ground is looked at so often [m]."""


def unseen_ahead(robot: RobotFile, fields: Mapping[str, tuple[float, float]]) -> tuple[float, float] | None:
    """Where it drives straight over ground that no scanner has seen: from the right to the left [m]; None: nowhere.

    Ground has to be seen before it comes nearer than the least range; what is nearer at the start stays unknown.

    Args:
        robot: with an outline and scanners.
        fields: in which sector each scanner measures, by its name: from, to in its frame [degrees], left positive.
    """
    outline = robot.outline
    assert outline is not None
    half = outline.half_width_m - SHRUNK
    y = np.linspace(-half, half, round(2.0 * half / ACROSS) + 1)
    x = outline.front_m + np.arange(0.0, BEFORE_MASK, ALONG)
    seen, near = np.zeros((len(y), len(x)), np.bool_), np.zeros((len(y), len(x)), np.bool_)
    for name, scanner in robot.scanners.items():
        dx, dy = x - scanner.x_m, y[:, np.newaxis] - scanner.y_m
        distance = np.hypot(dx, dy)
        bearing = np.degrees(np.arctan2(dy, dx)) - scanner.heading_deg
        low, high = fields[name]
        within = (bearing - low) % 360.0 <= high - low
        unmasked = seeing(bearing.ravel(), scanner.mask).reshape(bearing.shape)
        seen |= within & unmasked & (distance >= scanner.least_range_m)
        near |= distance < scanner.least_range_m + 1.5 * CELL
    first = np.where(seen.any(axis=1), seen.argmax(axis=1), len(x))
    before = np.arange(len(x)) < first[:, np.newaxis]
    wrong = y[(first == len(x)) | (before & ~near).any(axis=1)]
    return (float(wrong[0]), float(wrong[-1])) if wrong.size else None
