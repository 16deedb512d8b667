"""The route of a path file as a step of a mission wants it, and why a robot cannot follow it."""

from __future__ import annotations

from artemis.errors import ConfigError
from artemis.mission.schema import Follow
from artemis.motion.fitting import route_for
from artemis.motion.route import Route
from artemis.vehicle import RobotFile


def drivable_route(follow: Follow, route: Route, robot: RobotFile, speed: float) -> tuple[Route, list[str]]:
    """A route as `follow` wants it, at a speed of the virtual front wheel [m/s]; and in words what was changed.

    Raises:
        ConfigError: why the robot cannot follow it (PTH-03).
    """
    route, remarks = route_for(route, robot, speed, **follow.wanted)
    problems = [_with_hint(problem, follow) for problem in route.problems(robot, speed)]
    if problems:
        raise ConfigError(problems)
    return route, remarks


def _with_hint(problem: str, follow: Follow) -> str:
    """What `follow` has keys against."""
    if "too sharp" in problem and not follow.round_corners_m:
        return f"{problem}, or write how far the path may leave it: round_corners_m: 0.15"
    if "too fast" in problem and not follow.allow_slowdown:
        return f"{problem}, or write allow_slowdown: true"
    return problem
