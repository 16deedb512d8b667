"""Poses in frames."""

from __future__ import annotations

from math import cos, sin

from artemis.motion.angles import difference, wrap
from artemis.values import Pose


def placed(origin: Pose, pose: Pose) -> Pose:
    """`pose`, which is seen from `origin`, in the frame of `origin` itself: the inverse of `seen_from`."""
    c, s = cos(origin.heading), sin(origin.heading)
    return Pose(
        x=origin.x + c * pose.x - s * pose.y,
        y=origin.y + s * pose.x + c * pose.y,
        heading=wrap(origin.heading + pose.heading),
    )


def seen_from(origin: Pose, pose: Pose) -> Pose:
    """`pose` in the frame whose origin, in `pose`'s own frame, is `origin`."""
    dx, dy = pose.x - origin.x, pose.y - origin.y
    c, s = cos(origin.heading), sin(origin.heading)
    return Pose(x=c * dx + s * dy, y=c * dy - s * dx, heading=difference(pose.heading, origin.heading))
