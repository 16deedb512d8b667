"""Whether each path begins where the robot stands then, as far as the mission states that."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from artemis.motion.route import Route
from artemis.plugins.registry import declarations
from artemis.plugins.used import localizer_used
from artemis.states.follow import START_ANGLE, START_DISTANCE
from artemis.states.outcomes import FOLLOWING
from artemis.states.outline import behaviours_in, numbered, steps_in
from artemis.values import Pose
from artemis.yaml_file import dotted

if TYPE_CHECKING:
    from artemis.sim.world import PlantParameters

_AT_TIMES = ("choose", "catch", "between", "when")
"""Steps within these may run or not: after them the robot's place is unknown."""


def start_pose(mission: Mapping[str, Any], true: PlantParameters, *, simulated: bool) -> Pose | None:
    """The robot's at the start of a run of a mission as its file has it; None: not known.

    Odometry begins at 0 where the robot is armed. Of those on a localizer's map only a simulated robot's is known.
    """
    if localizer_used(mission, simulated=simulated) is None:
        return Pose()
    return Pose(x=true.x_m, y=true.y_m, heading=math.radians(true.heading_deg)) if simulated else None


def far_starts(steps: Any, routes: Mapping[int, Route], pose: Pose | None) -> Iterator[str]:  # noqa: ANN401 (of a file)
    """In words, each path that the robot will not begin from where the steps before leave it (PTH-05).

    Of a `repeat` the first round counts, of a `try` the first attempt.

    Args:
        steps: The mission's steps as they stand in its file.
        routes: Those known, by the numbers of their steps, in the frame of `pose`.
        pose: The robot's at the start of the run; None: not known.
    """
    moving = {
        *FOLLOWING,
        "teleop",
        *(name for name, facts in declarations(behaviours_in(steps)).items() if facts.moves),
    }
    numbers = {path: number for number, (path, _, _) in enumerate(numbered(steps))}
    for path, word, body in steps_in(steps):
        if any(name in path for name in _AT_TIMES):
            pose = None
        if word not in moving:
            continue
        if (route := routes.get(numbers[path])) is None:
            pose = None
            continue
        if pose is not None and (away := _away(route, pose, nearest=body.get("start") == "nearest")):
            yield f"{dotted(path)}: {away} (PTH-05)"
        last = route.parts[-1]
        end = last.path.at(last.path.length)
        pose = Pose(x=end.x, y=end.y, heading=last.heading_at(last.path.length))


def _away(route: Route, pose: Pose, *, nearest: bool) -> str:
    """How far a robot at `pose` is from where it is to begin; empty: near enough."""
    if nearest:
        route = route.begun_at(route.nearest(pose.x, pose.y), 0.0)
    beside, askew = route.seen_from(pose)
    if abs(beside) <= START_DISTANCE and abs(askew) <= START_ANGLE:
        return ""
    here = f"x {pose.x:.2f} m, y {pose.y:.2f} m, heading {math.degrees(pose.heading):.0f} degrees"
    off = f"{abs(beside):.2f} m beside the start of the path, {math.degrees(abs(askew)):.0f} degrees off its direction"
    most = f"at most {START_DISTANCE:g} m, {math.degrees(START_ANGLE):.0f} degrees"
    return f"the robot is expected at {here} then: {off}; {most}"
