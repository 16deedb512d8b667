"""A route made to fit a robot, as far as a mission allows that: corners rounded, speeds lowered; and what was done."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from artemis.errors import ConfigError
from artemis.motion.path import Path, place_on
from artemis.motion.rounding import rounded
from artemis.motion.route import Route
from artemis.motion.speed_profile import speed_profile
from artemis.vehicle import RobotFile


def route_for(
    route: Route,
    robot: RobotFile,
    speed: float,
    *,
    laps: int = 1,
    from_end: bool = False,
    backward: bool | None = None,
    round_corners: float = 0.0,
    allow_slowdown: bool = False,
) -> tuple[Route, list[str]]:
    """A route as it was read, as a mission wants it driven by a robot; and in words what was changed for that.

    Raises:
        ConfigError: a corner that cannot be rounded; laps over a route that is not closed.
    """
    route = route.directed(from_end=from_end, backward=backward)
    route, words = fitted(route, robot, speed, round_corners=round_corners, allow_slowdown=allow_slowdown)
    return route.with_laps(laps), words


def with_reserve(route: Route, robot: RobotFile) -> Route:
    """The route without corners that leave the steering no reserve for corrections (`rounded`).

    Raises:
        ConfigError: a corner cannot be rounded.
    """
    return Route(tuple([replace(part, path=rounded(part.path, robot)[0]) for part in route.parts]))


def fitted(
    route: Route, robot: RobotFile, speed: float, *, round_corners: float = 0.0, allow_slowdown: bool = False
) -> tuple[Route, list[str]]:
    """The route as the robot can drive it, and in words what was changed, smoothing of noise among it.

    Args:
        route: as read.
        robot: that drives it.
        speed: highest wish for the virtual front wheel [m/s].
        round_corners: how far the new path may be from the given one at a corner [m]; 0: corners stay.
        allow_slowdown: whether its speed is to be lowered to what steering and wheels can do.

    Raises:
        ConfigError: a corner needs more than `round_corners`, or no curve leads around it.
    """
    parts, lines = [], []
    for number, part in enumerate(route.parts, start=1):
        path = part.path
        told = [words] if path.drawn is not None and (words := path.drawn.words()) else []
        if round_corners > 0.0:
            path, cuts = _rounded(path, robot, round_corners)
            told += cuts
        if allow_slowdown:
            path, slowest = _slowed(path, robot, speed)
            told += slowest
        parts.append(replace(part, path=path))
        lines += [f"part {number}: {line}" if len(route.parts) > 1 else line for line in told]
    return Route(tuple(parts)), lines


def _rounded(path: Path, robot: RobotFile, farthest: float) -> tuple[Path, list[str]]:
    made, cuts = rounded(path, robot)
    for cut in cuts:
        if cut.distance > farthest:
            raise ConfigError(
                f"the corner at {cut.arc_length:.2f} m (x {cut.x:.2f} m, y {cut.y:.2f} m) must be left by "
                f"{cut.distance:.3f} m; round_corners_m allows {farthest:g}"
            )
    return made, [
        f"corner at {cut.arc_length:.2f} m (x {cut.x:.2f} m, y {cut.y:.2f} m) rounded: the path leaves it by "
        f"{1e3 * cut.distance:.0f} mm"
        for cut in cuts
    ]


def _slowed(path: Path, robot: RobotFile, speed: float) -> tuple[Path, list[str]]:
    """With its planned speed as its own; where it is slowest, if that is less than what was asked for."""
    profile = speed_profile(path, robot, speed)
    if np.all(profile > path.speeds(speed) - 1e-6):
        return path, []
    slowest = int(np.argmin(profile))
    return path.with_speed(profile), [f"slowed down to {profile[slowest]:.2f} m/s at {place_on(path, slowest)}"]
