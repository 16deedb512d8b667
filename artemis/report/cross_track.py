"""Where the robot really was on the path that it followed by its odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from artemis.errors import ConfigError
from artemis.motion.path import Path, path_from_csv
from artemis.motion.spline import Array
from artemis.recording.mcap_reader import Recording

PROJECTION_WINDOW = 0.5
"""The true pose is looked for this far [m] around its last place on the path."""


def paths_of(recording: Recording) -> list[Path]:
    """Every path that the mission names and that can be read."""
    paths = []
    files = recording.files
    for name in dict.fromkeys(_values_of("path", recording.mission)):
        try:
            paths.append(path_from_csv(files[name].decode(), name))
        except (KeyError, UnicodeDecodeError, ConfigError):
            continue  # no file, or damaged in the recording: then there is no path to compare with
    return paths


def _values_of(key: str, node: object) -> Iterator[str]:
    """Every text under `key`, anywhere in JSON."""
    if isinstance(node, dict):
        if isinstance(node.get(key), str):
            yield node[key]
        for part in node.values():
            yield from _values_of(key, part)
    elif isinstance(node, list):
        for part in node:
            yield from _values_of(key, part)


def _path_of_length(candidates: list[Path], length: float) -> Path | None:
    """The path of which some laps are `length` long [m], or None: then it was none of the mission's files."""
    for path in candidates:
        laps = max(1, round(length / path.length))
        if abs(laps * path.length - length) < 1e-3:
            return path.with_laps(laps) if path.closed else path
    return None


def follow_true_pose(
    candidates: list[Path], following: NDArray[np.bool_], tracking: Array, true: Array
) -> tuple[list[Path], Array]:
    """The paths that were followed, and where the true pose was on them: arc length and cross-track, shape (n, 2)."""
    followed: list[Path] = []
    projected = np.full((len(true), 2), np.nan)
    indices = np.flatnonzero(following)
    for rows in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1):
        path = _path_of_length(candidates, float(tracking[rows[0], 2])) if len(rows) else None
        if path is not None:
            if not any(path.x is other.x for other in followed):
                followed.append(path)
            projected[rows] = _project(path, true[rows], float(tracking[rows[0], 0]))
    return followed, projected


def _project(path: Path, poses: Array, near: float) -> Array:
    """Arc length and cross-track of each pose, shape (n, 2), carried on from the arc length `near` [m]."""
    rows = np.full((len(poses), 2), np.nan)
    for index, (x, y, _) in enumerate(poses.tolist()):
        if np.isfinite(x):
            projection = path.project(x, y, near, PROJECTION_WINDOW)
            near = projection.arc_length
            rows[index] = near, projection.cross_track
    return rows
