"""The steering of Stanley, which won the DARPA Grand Challenge of 2005: the front axle is led onto the path.

G. Hoffmann, C. Tomlin, M. Montemerlo, S. Thrun: Autonomous Automobile Trajectory Tracking for Off-Road Driving:
Controller Design, Experimental Validation and Racing. American Control Conference 2007.

With psi the path's heading relative to the robot's and e the path's distance to the left of the front axle's centre,
both at the point of the path that is nearest to that centre, v the speed of the front wheel,

    delta = psi + arctan(k e / (k_soft + v))

within the robot's limits: the wheel is set along the path, and turned towards it by an angle that grows with the
distance. The front axle's error then falls as e' = -v sin(arctan(k e / v)), exponentially when it is small. The paper's
further terms (yaw damping, tyre slip, steering damping) belong to the speed and mass of a car.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.motion.angles import difference
from artemis.motion.path import Path
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.followers.progress import BRAKING, Progress
from artemis.values import DriveCommand, Pose, Snapshot
from artemis.vehicle import WishedSpeed


class StanleyConfig(Config):
    """Keys of `follower: {plugin: stanley, ...}`."""

    speed_m_s: WishedSpeed
    """Of the virtual front wheel."""
    gain_1_s: Annotated[float, Field(gt=0)] = 1.0
    """The paper's k: the rate at which a small error of the front axle falls."""
    softening_m_s: Annotated[float, Field(ge=0)] = 0.3
    """The paper's k_soft: keeps the steering calm at low speed. With less a robot that begins beside its path at rest
    turns too far: its wheels take 2 s to full lock."""


class StanleyFollower:
    """Follows a path by Stanley's law. Pure but for the progress along the path."""

    Config: ClassVar[type[Config]] = StanleyConfig
    contract: ClassVar[int] = 1

    def __init__(self, config: StanleyConfig, context: PluginContext) -> None:
        """Take the limits from the robot.

        Raises:
            ConfigError: the speed is more than the robot's.
        """
        limits = context.robot.limits
        self._config, self._speed = config, context.top_speed("speed_m_s", config.speed_m_s)
        self._wheelbase = context.robot.geometry.wheelbase_m
        self._steering_limit = math.radians(limits.steering_deg)
        self._deceleration = BRAKING * limits.deceleration_m_s2

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin at the start of `path` (in the frame of the snapshot's pose)."""
        self._path, self._progress = path, Progress(path)
        self._front = self._wheelbase

    def step(self, snapshot: Snapshot) -> Following:
        """Speed and angle of the virtual front wheel for this tick."""
        progress, pose = self._progress, snapshot.pose.pose
        tracking = progress.update(pose)
        front = self._path.project(*front_axle(pose, self._wheelbase), near=self._front)
        self._front = front.arc_length
        heading_error = difference(front.heading, pose.heading)
        angle = steering(heading_error, -front.cross_track, snapshot.odometry.speed, self._config)
        allowed = self._path.speed_at(progress.arc_length)
        speed = min(self._speed, allowed, progress.halting_speed(self._deceleration))
        return Following(
            command=DriveCommand(speed=speed, steering=min(max(angle, -self._steering_limit), self._steering_limit)),
            tracking=tracking,
            finished=progress.finished,
        )


def front_axle(pose: Pose, wheelbase: float) -> tuple[float, float]:
    """Its centre, x and y [m]; `wheelbase` [m]."""
    return pose.x + wheelbase * math.cos(pose.heading), pose.y + wheelbase * math.sin(pose.heading)


def steering(heading_error: float, error: float, speed: float, config: StanleyConfig) -> float:
    """The paper's equation 5 [rad]: left positive, before the limits.

    Args:
        heading_error: psi, heading of the path minus that of the robot [rad].
        error: e, how far the path is to the left of the front axle [m].
        speed: v [m/s].
        config: k and k_soft.
    """
    return heading_error + math.atan2(config.gain_1_s * error, config.softening_m_s + abs(speed))
