"""Pure pursuit, regulated: steers along the arc that leads through a point of the path some way ahead.

R. C. Coulter: Implementation of the Pure Pursuit Path Tracking Algorithm. CMU-RI-TR-92-01, 1992.
S. Macenski, S. Singh, F. Martín, J. Ginés: Regulated Pure Pursuit for Robot Path Tracking. Autonomous Robots 47, 2023.

The look-ahead point (x, y), seen from the rear axle with x ahead and y to the left, is at the distance l. The circle
through it that begins along the robot's heading has the curvature

    gamma = 2 y / l^2

(Coulter). The look-ahead is a time's distance, l = v t within bounds; the speed is v, less where the commanded curve
has a smaller radius than r_min, v' = v / (r_min |gamma|), and falls with the distance that is left over the last metre
or so (Macenski et al., adaptive look-ahead, curvature heuristic and approach).
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.followers.progress import Progress
from artemis.values import DriveCommand, Pose, Snapshot
from artemis.vehicle import WishedSpeed

STEP = 0.05
"""Along the path, in the search of the look-ahead point [m]; between two steps it is interpolated."""


class PurePursuitConfig(Config):
    """Keys of `follower: {plugin: pure_pursuit, ...}`.

    Defaults are those of Nav2's controller, by the same authors, but for the least look-ahead: with its 0.3 m a robot
    whose steering takes 2 s to full lock circles beside its path.
    """

    speed_m_s: WishedSpeed
    """Of the virtual front wheel."""
    lookahead_time_s: Annotated[float, Field(gt=0)] = 1.5
    min_lookahead_m: Annotated[float, Field(gt=0)] = 0.7
    max_lookahead_m: Annotated[float, Field(gt=0)] = 0.9
    regulated_min_radius_m: Annotated[float, Field(ge=0)] = 0.9
    """Curves below are driven more slowly; 0: none is."""
    regulated_min_speed_m_s: WishedSpeed = 0.25
    """A curve does not slow the robot down further."""
    approach_m: Annotated[float, Field(gt=0)] = 0.6
    """Before the end, the speed falls with the distance that is left."""
    min_approach_speed_m_s: WishedSpeed = 0.05

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min_lookahead_m > self.max_lookahead_m:
            raise ValueError(f"min_lookahead_m {self.min_lookahead_m:g} is more than max_lookahead_m")
        return self


class PurePursuitFollower:
    """Follows a path by regulated pure pursuit. Pure but for the progress along the path."""

    Config: ClassVar[type[Config]] = PurePursuitConfig
    contract: ClassVar[int] = 1

    def __init__(self, config: PurePursuitConfig, context: PluginContext) -> None:
        """Take the limits from the robot.

        Raises:
            ConfigError: the speed is more than the robot's.
        """
        self._config, self._speed = config, context.top_speed("speed_m_s", config.speed_m_s)
        self._wheelbase = context.robot.geometry.wheelbase_m
        self._steering_limit = math.radians(context.robot.limits.steering_deg)

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin at the start of `path` (in the frame of the snapshot's pose)."""
        self._path, self._progress = path, Progress(path)

    def step(self, snapshot: Snapshot) -> Following:
        """Speed and angle of the virtual front wheel for this tick."""
        progress, pose = self._progress, snapshot.pose.pose
        tracking = progress.update(pose)
        lookahead = lookahead_distance(snapshot.odometry.speed, self._config)
        curvature = curvature_through(pose, *self._point_ahead(pose, lookahead))
        speed = min(self._speed, self._path.speed_at(progress.arc_length))
        speed = 0.0 if progress.finished else regulated(speed, curvature, progress.remaining, self._config)
        angle = math.atan(self._wheelbase * curvature)
        return Following(
            command=DriveCommand(speed=speed, steering=min(max(angle, -self._steering_limit), self._steering_limit)),
            tracking=tracking,
            finished=progress.finished,
        )

    def _point_ahead(self, pose: Pose, lookahead: float) -> tuple[float, float]:
        """Where the path, from the robot's projection on, first is at the look-ahead distance or further."""
        here = self._progress.arc_length
        arc, nearer = here, 0.0
        point = self._path.at(arc)
        while (distance := math.dist((point.x, point.y), (pose.x, pose.y))) < lookahead:
            arc, nearer = arc + STEP, distance
            point = self._path.at(arc)
        if arc > here:
            point = self._path.at(arc - STEP * (distance - lookahead) / (distance - nearer))
        return point.x, point.y


def lookahead_distance(speed: float, config: PurePursuitConfig) -> float:
    """The distance of the look-ahead time at a speed [m/s], within its bounds [m]."""
    return min(max(abs(speed) * config.lookahead_time_s, config.min_lookahead_m), config.max_lookahead_m)


def curvature_through(pose: Pose, x: float, y: float) -> float:
    """Curvature [1/m], left positive, of the circle that begins at a pose and leads through a point (Coulter 1992)."""
    dx, dy = x - pose.x, y - pose.y
    left = dy * math.cos(pose.heading) - dx * math.sin(pose.heading)
    return 2.0 * left / (dx * dx + dy * dy)


def regulated(speed: float, curvature: float, remaining: float, config: PurePursuitConfig) -> float:
    """A speed [m/s] made slower for the curvature that is commanded [1/m] and for the distance to the end [m]."""
    tightness = config.regulated_min_radius_m * abs(curvature)
    if tightness > 1.0:
        speed = min(speed, max(speed / tightness, config.regulated_min_speed_m_s))
    if remaining < config.approach_m:
        speed = min(speed, max(speed * remaining / config.approach_m, config.min_approach_speed_m_s))
    return speed
