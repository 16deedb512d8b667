"""The thesis' path follower (section 3.7): switching between straight lines, with bounded curvature.

G. Indiveri and M. L. Corradini: Switching Linear Path Following for Bounded Curvature Car-Like Vehicles. IFAC Symposium
on Intelligent Autonomous Vehicles, Lisbon 2004.

The path is a chain of straight segments. On the active one, y is the robot's distance to the left of the line, theta
its heading relative to the line, u the speed of its rear axle. Then

    y' = u sin(theta),    theta' = omega = -h u y sin(theta) / theta - gamma theta,    gamma = 2 a u sqrt(h)

lets V = (h y^2 + theta^2) / 2 fall (V' = -gamma theta^2), without oscillation for a > 1. As V never rises,
|omega / u| <= (1 + 2 a) sqrt(h) sqrt(h y^2 + theta^2): the largest h for which the right side stays within the robot's
curvature is the one to take, and nothing needs to be cut off.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.motion.angles import difference, sinc
from artemis.motion.path import Path
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.followers.progress import BRAKING, Progress
from artemis.values import DriveCommand, Pose, Snapshot
from artemis.vehicle import WishedSpeed


class IndiveriConfig(Config):
    """Keys of `follower: {plugin: indiveri, ...}`."""

    speed_m_s: WishedSpeed
    """Of the virtual front wheel."""
    damping: Annotated[float, Field(gt=1, le=3)] = 1.2
    """The paper's a."""
    distance_floor_m: Annotated[float, Field(gt=0)] = 0.01
    heading_floor_rad: Annotated[float, Field(gt=0)] = 0.3
    """Smaller errors do not raise the gain further: below, steering rate and delay would make it oscillate. 0.34 in the
    laboratory's code."""
    segment_m: Annotated[float, Field(ge=0.002, le=1)] = 0.005
    """Length of the straight segments. About the distance of one tick: longer ones make the steering jump at each
    switch, and the wheels' roll about their kingpins then spoils the odometry."""
    switch_m: Annotated[float, Field(ge=0, le=1)] = 0.15
    """The next segment becomes active so far before the end of the present one: about 1 / (2 a sqrt(h)) with h from the
    floors, where the heading of the line ahead asks for just the path's curvature. 0.1 in the laboratory's code."""
    hysteresis_deg: Annotated[float, Field(ge=0, le=20)] = 0.0
    """A new steering angle is taken only if it differs by more from the one in force; 5 and 11.5 in the thesis."""


class IndiveriFollower:
    """Follows a path with the switching law. Pure but for the segment and angle in force."""

    Config: ClassVar[type[Config]] = IndiveriConfig
    contract: ClassVar[int] = 1

    def __init__(self, config: IndiveriConfig, context: PluginContext) -> None:
        """Take the limits from the robot.

        Raises:
            ConfigError: the speed is more than the robot's.
        """
        limits = context.robot.limits
        self._config, self._speed = config, context.top_speed("speed_m_s", config.speed_m_s)
        self._wheelbase = context.robot.geometry.wheelbase_m
        self._curvature_limit = math.tan(math.radians(limits.steering_deg)) / self._wheelbase
        self._deceleration = BRAKING * limits.deceleration_m_s2
        self._hysteresis = math.radians(config.hysteresis_deg)

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin at the start of `path` (in the frame of the snapshot's pose)."""
        self._path, self._progress = path, Progress(path)
        self._segments = max(round(path.length / self._config.segment_m), 1)
        self._segment_length = path.length / self._segments
        self._steering = snapshot.odometry.steering
        self._activate(0)

    def step(self, snapshot: Snapshot) -> Following:
        """Speed and angle of the virtual front wheel for this tick."""
        progress, pose = self._progress, snapshot.pose.pose
        tracking = progress.update(pose)
        if not progress.finished:
            self._switch()
            self._steer(*self._error(pose))
        allowed = self._path.speed_at(progress.arc_length)
        speed = min(self._speed, allowed, progress.halting_speed(self._deceleration))
        return Following(
            command=DriveCommand(speed=speed, steering=self._steering), tracking=tracking, finished=progress.finished
        )

    def _switch(self) -> None:
        """Make the segment active that the robot is on, or about to enter.

        Progress is the projection onto the true path, not onto the segment: that cannot skip a part of the path.
        """
        segment = int((self._progress.arc_length + self._config.switch_m) / self._segment_length)
        if segment > self._segment:
            self._activate(min(segment, self._segments - 1))

    def _activate(self, segment: int) -> None:
        self._segment = segment
        start = self._path.at(segment * self._segment_length)
        end = self._path.at((segment + 1) * self._segment_length)
        self._line = Pose(x=start.x, y=start.y, heading=math.atan2(end.y - start.y, end.x - start.x))

    def _error(self, pose: Pose) -> tuple[float, float]:
        """Distance to the left of the active line, and heading relative to it: y [m] and theta [rad]."""
        line = self._line
        y = (pose.y - line.y) * math.cos(line.heading) - (pose.x - line.x) * math.sin(line.heading)
        return y, difference(pose.heading, line.heading)

    def _steer(self, y: float, theta: float) -> None:
        """Take the angle that the law wants, unless it is within the hysteresis of the one in force."""
        config = self._config
        floored_y, floored_theta = max(abs(y), config.distance_floor_m), max(abs(theta), config.heading_floor_rad)
        h = gain(floored_y, floored_theta, self._curvature_limit, config.damping)
        steering = math.atan(self._wheelbase * curvature(y, theta, h, config.damping))
        if abs(steering - self._steering) > self._hysteresis:
            self._steering = steering


def gain(y: float, theta: float, curvature_limit: float, damping: float) -> float:
    """The largest h [1/m^2] that bounds the curvature from y [m] and theta [rad] on: y > 0.

    Solves h^2 y^2 + h theta^2 = (curvature_limit / (1 + 2 a))^2, written so that a small y costs no digits.
    """
    bound = (curvature_limit / (1 + 2 * damping)) ** 2
    return 2 * bound / (theta**2 + math.sqrt(theta**4 + 4 * y**2 * bound))


def curvature(y: float, theta: float, h: float, damping: float) -> float:
    """What the law commands: omega / u [1/m], left positive.

    The speed u drops out of omega / u, so that alpha = atan(L omega / u) holds at standstill too.
    """
    return -h * y * sinc(theta) - 2 * damping * math.sqrt(h) * theta
