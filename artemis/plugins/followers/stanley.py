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
from artemis.errors import ConfigError
from artemis.motion.angles import difference
from artemis.motion.path import Path
from artemis.plugins.contracts import Following, Setup
from artemis.values import DriveCommand, Pose, Snapshot, Tracking

FINISH = 0.02
"""So near to its end [m] a path counts as driven."""
BRAKING = 0.5
"""Share of the robot's deceleration that the approach to the end uses; the rest covers the delay of the drives."""


class StanleyConfig(Config):
    """Keys of `follower: {plugin: stanley, ...}`."""

    speed_m_s: Annotated[float, Field(gt=0)]
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

    def __init__(self, config: StanleyConfig, setup: Setup) -> None:
        """Take the limits from the robot.

        Raises:
            ConfigError: the speed is more than the robot's.
        """
        limits = setup.robot.limits
        if config.speed_m_s > limits.speed_m_s:
            raise ConfigError(
                f"{setup.name}: speed_m_s: {config.speed_m_s:g}; the robot's limit is {limits.speed_m_s:g}"
            )
        self._config = config
        self._wheelbase = setup.robot.geometry.wheelbase_m
        self._steering_limit = math.radians(limits.steering_deg)
        self._deceleration = BRAKING * limits.deceleration_m_s2

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin at the start of `path` (frame of the odometry)."""
        self._path = path
        self._rear, self._front = 0.0, self._wheelbase
        self._finished = False

    def step(self, snapshot: Snapshot) -> Following:
        """Speed and angle of the virtual front wheel for this tick."""
        pose = snapshot.odometry.pose
        front = self._path.project(*front_axle(pose, self._wheelbase), near=self._front)
        rear = self._path.project(pose.x, pose.y, near=self._rear)
        self._front, self._rear = front.arc_length, rear.arc_length
        remaining = self._path.length - rear.arc_length
        self._finished = self._finished or remaining <= FINISH
        heading_error = difference(front.heading, pose.heading)
        angle = steering(heading_error, -front.cross_track, snapshot.odometry.speed, self._config)
        speed = 0.0
        if not self._finished:
            speed = min(self._config.speed_m_s, self._path.speed_at(rear.arc_length))
            speed = min(speed, math.sqrt(2 * self._deceleration * remaining))
        return Following(
            command=DriveCommand(speed=speed, steering=min(max(angle, -self._steering_limit), self._steering_limit)),
            tracking=Tracking(
                arc_length=rear.arc_length,
                length=self._path.length,
                cross_track=rear.cross_track,
                heading_error=difference(pose.heading, rear.heading),
            ),
            finished=self._finished,
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
