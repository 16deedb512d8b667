"""What followers have in common: how far along its path the robot is, and where the path ends."""

from __future__ import annotations

import math

from artemis.motion.angles import difference
from artemis.motion.path import Path
from artemis.values import Pose, Tracking

FINISH = 0.02
"""So near to its end [m] a path counts as driven."""
BRAKING = 0.5
"""Share of the robot's deceleration that the approach to the end may use; the rest covers the delay of the drives."""


class Progress:
    """The robot's place on a path, which it drives from its start.

    Attributes:
        arc_length: of the point of the path that is nearest to the rear axle [m]; carried on from tick to tick.
        remaining: distance from there to the end [m].
        finished: the end was reached, once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.arc_length, self.remaining, self.finished = 0.0, path.length, False

    def update(self, pose: Pose) -> Tracking:
        """Take in where the robot is, once in each tick."""
        here = self._path.project(pose.x, pose.y, near=self.arc_length)
        self.arc_length, self.remaining = here.arc_length, self._path.length - here.arc_length
        self.finished = self.finished or self.remaining <= FINISH
        return Tracking(
            arc_length=here.arc_length,
            length=self._path.length,
            cross_track=here.cross_track,
            heading_error=difference(pose.heading, here.heading),
        )

    def halting_speed(self, deceleration: float) -> float:
        """From which the robot, braking with `deceleration` [m/s²], halts at the end [m/s]; 0 once it has finished."""
        return 0.0 if self.finished else math.sqrt(2 * deceleration * self.remaining)
