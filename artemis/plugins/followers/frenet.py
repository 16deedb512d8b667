"""artemis' own path follower: feedback in the path's frame, ahead of its time by the delay of the drives.

e is the robot's distance to the left of the path, psi its heading relative to the tangent, kappa_p the path's
curvature; s is the distance of the rear axle. Then (Samson 1992; Micaelli and Samson 1993)

    de/ds = sin(psi),    dpsi/ds = kappa - kappa_p cos(psi) / (1 - kappa_p e).

The approach is a field of headings, psi_a(e) = -atan(e / a), on which e falls as exp(-s / a) without overshoot. With

    kappa = kappa_p cos(psi) / (1 - kappa_p e) + psi_a'(e) sin(psi) - b (psi - psi_a(e))

the robot turns into the field as exp(-b s), from any distance and heading. Nothing in it depends on the speed: the
steering is right at standstill, too.

What makes it exact on a real robot lies around the law: the pose it acts on is the one at which the command takes
effect; the speed leaves the steering time; and the steering's zero is estimated while driving.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from msgspec.structs import replace
from pydantic import Field

from artemis.config import Config
from artemis.motion.ackermann import Ackermann
from artemis.motion.angles import difference, wrap
from artemis.motion.odometry import move
from artemis.motion.path import Path
from artemis.motion.pose_filter import PoseFilter
from artemis.motion.rounding import rounded
from artemis.motion.speed_profile import BRAKING_SHARE, speed_profile
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.followers.progress import Progress
from artemis.values import DriveCommand, Pose, Snapshot
from artemis.vehicle import WishedSpeed

APPROACH, LAG = 1.5, 0.15
"""Distances for which the robot's smallest radius is the measure: the approach, and what the robot rolls at most while
its wheels turn to where they should be. For a start off the path or askew, and for kinks, it slows down by that, if
need be almost to standstill."""
NARROWEST = 0.2
"""Least 1 - kappa_p e: nearer to the centre of curvature, or beyond it, the law's first term would have no bound."""


Positive = Annotated[float, Field(gt=0)]  # of its own: compiled, the other one is no type in a union


class FrenetConfig(Config):
    """Keys of `follower: {plugin: frenet, ...}`. All but the speed fit every path and robot as they are."""

    speed_m_s: WishedSpeed
    """Highest speed of the virtual front wheel; slower where the steering or a wheel needs it."""
    approach_m: Positive | None = None
    """The formulas' a: after which a distance from the path falls to 37 %. None: 1.5 of the robot's smallest radii.
    The heading turns into the approach on half of it (1 / b)."""
    delay_s: Annotated[float, Field(ge=0, le=0.2)] = 0.033
    """From a snapshot until the wheels do what was commanded in it."""


class FrenetFollower:
    """Follows a path with feedback in its frame."""

    Config: ClassVar[type[Config]] = FrenetConfig
    contract: ClassVar[int] = 1
    rounds_corners: ClassVar[bool] = True

    def __init__(self, config: FrenetConfig, context: PluginContext) -> None:
        """Take the limits from the robot.

        Raises:
            ConfigError: the speed is more than the robot's.
        """
        limits = context.robot.limits
        self._config, self._robot = config, context.robot
        self._top_speed = context.top_speed("speed_m_s", config.speed_m_s)
        self._car = Ackermann(context.robot.geometry)
        self._limit = math.radians(limits.steering_deg)
        self._rate = math.radians(limits.steering_rate_wheel_deg_s)
        radius = self._car.wheelbase / math.tan(self._limit)
        self._approach = config.approach_m or APPROACH * radius
        self._lag = LAG * radius
        self._deceleration = BRAKING_SHARE * limits.deceleration_m_s2

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin at the start of `path` (in the frame of the snapshot's pose); its corners become what the robot can do.

        Raises:
            ConfigError: no curve that the robot can drive is near a corner.
        """
        path, _ = rounded(path, self._robot)  # in a mission that is done before: nothing is left to be done
        self._path = path.with_speed(speed_profile(path, self._robot, self._top_speed))
        self._progress = Progress(self._path)
        self._filter = PoseFilter(self._car.wheelbase, snapshot.pose.pose, snapshot.odometry)

    def step(self, snapshot: Snapshot) -> Following:
        """Speed and angle of the virtual front wheel for this tick."""
        path, progress, odometry = self._path, self._progress, snapshot.odometry
        self._filter.update(snapshot.pose.pose, odometry)
        pose = self._filter.pose
        tracking = progress.update(pose)

        zero = self._filter.steering_zero
        steering, ahead = self._ahead(snapshot, pose, zero)
        there = path.project(ahead.x, ahead.y, near=progress.arc_length)
        turning = min(abs(steering - odometry.steering) / self._rate, snapshot.dt)
        middle = odometry.speed * math.cos(steering + zero) * (snapshot.dt + turning) / 2
        curvature_ahead = path.at(there.arc_length + middle).curvature
        wish = law(
            there.cross_track,
            difference(ahead.heading, there.heading),
            curvature_ahead,
            self._approach,
            2 / self._approach,
        )
        target = _clamp(self._car.steering_from_curvature(wish) - zero, self._limit)
        speed = min(
            path.speed_at(there.arc_length),
            self._turning_speed(target, target - steering),
            progress.halting_speed(self._deceleration),
        )
        return Following(
            command=DriveCommand(speed=speed, steering=target),
            tracking=replace(
                tracking,
                planned_speed=path.speed_at(tracking.arc_length),
                feedforward=self._car.steering_from_curvature(curvature_ahead),
            ),
            finished=progress.finished,
        )

    def _ahead(self, snapshot: Snapshot, pose: Pose, zero: float) -> tuple[float, Pose]:
        """Steering (as measured) and pose when this tick's command takes effect: the last command acts until then."""
        odometry, delay = snapshot.odometry, self._config.delay_s
        turn = _clamp(snapshot.set_points.steering - odometry.steering, self._rate * delay)
        steering = odometry.steering + turn
        middle = odometry.steering + turn / 2 + zero
        distance = 0.5 * (odometry.speed + snapshot.set_points.speed) * delay
        return steering, move(pose, distance * math.cos(middle), distance * math.sin(middle) / self._car.wheelbase)

    def _turning_speed(self, steering: float, turn: float) -> float:
        """So slow that the wheels turn by `turn` to `steering` [rad] on a short distance [m/s]."""
        faster = max(self._car.wheel_rates(steering, 1.0))
        return self._lag * self._rate / max(abs(turn) * faster, 1e-6)


def law(e: float, psi: float, path_curvature: float, approach: float, turning: float) -> float:
    """Curvature that leads the rear axle onto the path [1/m], left positive; formulas above.

    Args:
        e: distance to the left of the path [m].
        psi: heading relative to the tangent [rad].
        path_curvature: [1/m].
        approach: a [m].
        turning: b [1/m].
    """
    askew = -math.atan(e / approach)
    slope = -1 / (approach * (1 + (e / approach) ** 2))
    ahead = path_curvature * math.cos(psi) / max(1 - path_curvature * e, NARROWEST)
    return ahead + slope * math.sin(psi) - turning * wrap(psi - askew)


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
