"""What only a simulation knows: where the robot really is."""

from __future__ import annotations

from math import degrees, radians

from artemis.motion.poses import placed, seen_from
from artemis.sim.world import TrueRobot, World
from artemis.values import Pose, Tick


class Truth:
    """The true pose in the frame `odom`: its origin is the true pose where the odometry was reset."""

    def __init__(self, world: World, origin: Pose) -> None:
        """`origin`: until the odometry is reset; a run that goes on with another does not do that."""
        self._world, self._origin = world, origin

    def pose(self, tick: Tick) -> Pose:
        """At the end of a tick."""
        if tick.wish.reset_pose:
            self._origin = self._world.pose
        return seen_from(self._origin, self._world.pose)


def origin_of(true: TrueRobot) -> Pose:
    """Where the machine stands when a mission begins."""
    return Pose(x=true.x_m, y=true.y_m, heading=radians(true.heading_deg))


def moved_to(true: TrueRobot, pose: Pose) -> TrueRobot:
    """The same machine at `pose`, seen from where its mission begins."""
    there = placed(origin_of(true), pose)
    return true.model_copy(update={"x_m": there.x, "y_m": there.y, "heading_deg": degrees(there.heading)})
