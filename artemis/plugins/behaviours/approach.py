"""The behaviour `approach`: drive straight ahead until a condition holds, and no farther than a limit.

The robot keeps to the line on which it began. With the distance s along it, the cross-track error e and the heading
error theta, e' = sin(theta) and theta' = curvature; the curvature -(e / l^2 + 2 sin(theta) / l) makes
e'' + 2 e' / l + e / l^2 = 0 for small theta: critically damped over the length l, at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.motion.angles import difference
from artemis.plugins.contracts import Acting, PluginContext, State
from artemis.plugins.followers.progress import BRAKING, FINISH
from artemis.values import DriveCommand, Pose, Snapshot

LENGTH = 0.5
"""Over which the robot comes back to its line [m]."""
TOO_FAR = "too-far"


class ApproachConfig(Config):
    """Keys of the step."""

    until: str
    """A condition over the mission's signals: once it holds the robot comes to rest, and the step is done."""
    at_most_m: Annotated[float, Field(gt=0, le=1000)]
    """So far it drives; then the step ends with the outcome `too-far`."""
    speed_m_s: Annotated[float, Field(gt=0)] = 0.2
    """Of the virtual front wheel."""


class ApproachBehaviour:
    """Drives straight ahead. Its state is the pose at which it began, in the frame of the snapshot's pose."""

    Config: ClassVar[type[Config]] = ApproachConfig
    contract: ClassVar[int] = 1
    outcomes: ClassVar[tuple[str, ...]] = (TOO_FAR,)
    moves: ClassVar[bool] = True
    resumable: ClassVar[bool] = True
    signals: ClassVar[Mapping[str, str]] = {"approached_m": "m"}

    def __init__(self, config: ApproachConfig, context: PluginContext) -> None:
        """Take the limits from the robot. Raises ConfigError: the speed is above the robot's limit."""
        self._far, self._speed = config.at_most_m, context.top_speed("speed_m_s", config.speed_m_s)
        self._wheelbase = context.robot.geometry.wheelbase_m
        self._limit = math.radians(context.robot.limits.steering_deg)
        self._deceleration = BRAKING * context.robot.limits.deceleration_m_s2

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        """From where the robot stands, or where it began before."""
        x, y, heading = (float(number) for number in state) if state else _of(snapshot.pose.pose)
        self._begin = Pose(x=x, y=y, heading=heading)

    def step(self, snapshot: Snapshot) -> Acting:
        """Speed and angle of the virtual front wheel for this tick."""
        begin, pose = self._begin, snapshot.pose.pose
        cos, sin = math.cos(begin.heading), math.sin(begin.heading)
        along = (pose.x - begin.x) * cos + (pose.y - begin.y) * sin
        aside = (pose.y - begin.y) * cos - (pose.x - begin.x) * sin
        left = max(self._far - along, 0.0)
        speed = min(self._speed, math.sqrt(2 * self._deceleration * left))
        return Acting(
            command=DriveCommand(speed=speed, steering=self._steering(aside, difference(pose.heading, begin.heading))),
            outcome=TOO_FAR if left <= FINISH else None,
            state=_of(begin),
            phase="approaching",
            signals={"approached_m": along},
        )

    def _steering(self, aside: float, askew: float) -> float:
        """Angle [rad] towards the line, from `aside` [m, left positive] of it and `askew` [rad]."""
        curvature = -(aside / LENGTH**2 + 2 * math.sin(askew) / LENGTH)
        return min(max(math.atan(self._wheelbase * curvature), -self._limit), self._limit)


def _of(pose: Pose) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.heading
