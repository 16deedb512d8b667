"""What only a simulation knows: where the robot really is."""

from __future__ import annotations

from math import degrees, radians

from artemis.motion.poses import placed, seen_from
from artemis.sim.world import PlantParameters, World
from artemis.values import Pose, Tick


class Truth:
    """The true pose in the frame `odom`, whose origin is the true pose where the odometry was reset; or a fixed one."""

    def __init__(self, world: World, origin: Pose, *, fixed: bool = False) -> None:
        """`origin`: until the odometry is reset, which a run does not that resumes another; `fixed`: for good."""
        self._world, self._origin, self._fixed = world, origin, fixed

    def pose(self, tick: Tick) -> Pose:
        """At the end of a tick."""
        if tick.wish.reset_pose and not self._fixed:
            self._origin = self._world.pose
        return seen_from(self._origin, self._world.pose)


def origin_of(true: PlantParameters) -> Pose:
    """Where the machine stands when a mission begins."""
    return Pose(x=true.x_m, y=true.y_m, heading=radians(true.heading_deg))


def moved_to(true: PlantParameters, origin: Pose, pose: Pose) -> PlantParameters:
    """The same machine at `pose`, seen from `origin` in the world."""
    there = placed(origin, pose)
    return true.model_copy(update={"x_m": there.x, "y_m": there.y, "heading_deg": degrees(there.heading)})
