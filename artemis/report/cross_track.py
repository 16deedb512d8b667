"""Where the robot really was on the path that it followed by its odometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from artemis.errors import ConfigError
from artemis.motion.fitting import route_for
from artemis.motion.path import Path
from artemis.motion.route import Route, route_from_csv
from artemis.motion.spline import Array
from artemis.recording.mcap_reader import Recording

SAME = 1e-3
"""A path whose length differs by more [m] from what was followed is another one."""
PROJECTION_WINDOW = 0.5
"""The true pose is looked for this far [m] around its last place on the path."""


def routes_of(recording: Recording) -> dict[int, tuple[Route, bool]]:
    """The path files that the mission follows and that can be read, by the step's number.

    As it wants them driven; and whether they are begun at the place that is nearest to the robot.
    """
    routes = {}
    for number, step in enumerate(recording.mission.get("steps", ())):
        follow = step.get("follow") or {}
        name, direction = follow.get("path"), follow.get("direction")
        if not isinstance(name, str):
            continue  # another step, or a path that was recorded
        try:
            route, _ = route_for(
                route_from_csv(recording.files[name].decode(), name),
                recording.robot,
                (follow.get("follower") or {}).get("speed_m_s") or recording.robot.limits.speed_m_s,
                from_end=follow.get("from_end", False),
                backward=None if direction is None else direction == "backward",
                round_corners=follow.get("round_corners_m", 0.0),
            )
        except (KeyError, UnicodeDecodeError, ConfigError):
            continue  # no file, or damaged in the recording: then there is no path to compare with
        routes[number] = route, follow.get("start") == "nearest"
    return routes


def _followed(route: Route, nearest: bool, tracking: Array, pose: Array) -> tuple[Route, float] | None:
    """What was left of a route, or of some laps of it, when it was begun with this `tracking` at this `pose`.

    And how much of it was driven before [m]. None: it is not what was followed, for its length is another.
    """
    arc_length, _, length = tracking.tolist()
    laps = max(1, round(length / route.length)) if route.closed else 1
    if abs(laps * route.length - length) > SAME:
        return None
    route = route.with_laps(laps)
    if not nearest or not route.closed or not np.isfinite(pose[0]):
        return route, 0.0
    begun = route.begun_at(route.nearest(*pose[:2].tolist()), arc_length)
    return begun, route.length - begun.length


def follow_true_pose(
    routes: Mapping[int, tuple[Route, bool]],
    following: NDArray[np.bool_],
    steps: Sequence[int],
    tracking: Array,
    true: Array,
) -> tuple[list[Path], Array]:
    """The paths that were followed, and where the true pose was on them: arc length and cross-track, shape (n, 2).

    Args:
        routes: as of `routes_of`.
        following: in which ticks one was followed, shape (n,).
        steps: the step at each tick.
        tracking: arc length, cross-track and length of the route by the estimated pose [m], shape (n, 3).
        true: pose, shape (n, 3).
    """
    followed: list[Path] = []
    projected = np.full((len(true), 2), np.nan)
    indices = np.flatnonzero(following)
    for rows in np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1):
        step = routes.get(steps[rows[0]]) if len(rows) else None
        found = None if step is None else _followed(*step, tracking[rows[0]], true[rows[0]])
        if found is None:
            continue
        route, driven = found
        begins = [begin + driven for begin in route.begins]
        numbers = np.searchsorted(begins, tracking[rows, 0], side="right").clip(1) - 1
        for number, (part, begin) in enumerate(zip(route.parts, begins, strict=True)):
            if not any(part.path.x is other.x for other in followed):
                followed.append(part.path)
            own = rows[numbers == number]
            if len(own):
                near = float(tracking[own[0], 0]) - begin
                projected[own] = _project(part.path, true[own], near) + np.array([begin, 0.0])
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
