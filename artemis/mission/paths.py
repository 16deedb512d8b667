"""What is wrong with a path for the robot that is to follow it, and what the mission has changed in it."""

from __future__ import annotations

from artemis.errors import ConfigError
from artemis.mission.schema import Follow
from artemis.motion.fitting import route_for
from artemis.vehicle import Robot


def judge_path(follow: Follow, text: str, source: str, robot: Robot, speed: float) -> tuple[list[str], list[str]]:
    """Remarks and problems of a path file that can be read, at a speed of the virtual front wheel [m/s] (PTH-03)."""
    try:
        route, remarks = route_for(text, source, robot, speed, **follow.wanted)
    except ConfigError as error:
        return [], list(error.problems)
    return remarks, [_with_hint(problem, follow) for problem in route.problems(robot, speed)]


def _with_hint(problem: str, follow: Follow) -> str:
    """What `follow` has keys against."""
    if "too sharp" in problem and not follow.round_corners_m:
        return f"{problem}, or write how far the path may leave it: round_corners_m: 0.15"
    if "too fast" in problem and not follow.allow_slowdown:
        return f"{problem}, or write allow_slowdown: true"
    return problem
