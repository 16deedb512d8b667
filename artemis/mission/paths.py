"""The route of a path file as a step of a mission wants it, and why a robot cannot follow it."""

from __future__ import annotations

from artemis.errors import ConfigError
from artemis.mission.actions import Follow, Waypoints
from artemis.motion.fitting import route_for, with_reserve
from artemis.motion.joining import straight
from artemis.motion.route import Route, noise_words, route_from_csv
from artemis.vehicle import RobotFile


def named(follow: Follow) -> str:
    """Its path, for people."""
    return follow.path if isinstance(follow.path, str) else "line of waypoints"


def route_of(follow: Follow, raw: bytes | None, source: str) -> Route:
    """The route of the waypoints of `follow`, or of its path file, read from `source`.

    Raises:
        ConfigError: every problem found; of a file with file:line:column.
        UnicodeDecodeError: the file is no text.
    """
    if isinstance(follow.path, Waypoints):
        return straight(follow.path.waypoints, closed=follow.laps > 1)
    return route_from_csv((raw or b"").decode(), source)


def drivable_route(
    follow: Follow, route: Route, robot: RobotFile, speed: float, *, reserve: bool
) -> tuple[Route, list[str]]:
    """A route as `follow` wants it, at a speed of the virtual front wheel [m/s]; and in words what was changed.

    `reserve`: its follower wants it `with_reserve`, too.

    Raises:
        ConfigError: why the robot cannot follow it (PTH-03).
    """
    route, remarks = route_for(route, robot, speed, **follow.wanted)
    problems = [_with_hint(problem, follow) for problem in route.problems(robot, speed)]
    if problems:
        raise ConfigError([*problems, *noise_words(route)])
    return with_reserve(route, robot) if reserve else route, remarks


def _with_hint(problem: str, follow: Follow) -> str:
    """What `follow` has keys against."""
    if "too sharp" in problem and not follow.wanted["round_corners"]:
        return f"{problem}, or write how far the path may leave it: round_corners_m: 0.15"
    if "too fast" in problem and not follow.wanted["allow_slowdown"]:
        return f"{problem}, or write allow_slowdown: true"
    return problem
