"""Poses from other programs: the goal (`goal_pose`), and the approximate pose of the robot (`initialpose`).

Both are messages as rviz sends them: geometry_msgs/PoseStamped, geometry_msgs/PoseWithCovarianceStamped, in the frame
`map`. The heading is the yaw of the orientation, of a quaternion x, y, z, w: atan2(2 (w z + x y), 1 - 2 (y² + z²)).
"""

from __future__ import annotations

from math import atan2, fsum, isfinite
from typing import Any

from artemis.values import LocatedPose, Pose

FRAME = "map"
GOAL_POSE, INITIAL_POSE = "goal_pose", "initialpose"
POSE_TYPES = {
    GOAL_POSE: "geometry_msgs/msg/PoseStamped",
    INITIAL_POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
}
"""By the name of the topic, relative."""
OLDEST = 10.0
"""A stamp is at most so far from this computer's clock [s]; one of 0 is none, and counts as now."""
FARTHEST = 1e6
"""A pose is not farther away [m]."""
UNIT = 0.1
"""So far from 1 may the square of a rotation's length be."""
_OF_PLANE = (0, 1, 5, 7, 11, 35)
"""Places of xx, xy, xh, yy, yh, hh in the covariance of x, y, z, roll, pitch, yaw, row by row."""


def asked_pose(message: Any, now: float) -> Pose:  # noqa: ANN401 (of each network another class)
    """The pose of a PoseStamped, or of one with covariance, that arrives at wall time `now` [s since 1970].

    Raises:
        ValueError: why it cannot be used.
    """
    header = message.header
    if header.frame_id.removeprefix("/") != FRAME:
        raise ValueError(f"it is in the frame '{header.frame_id:.40}', and {FRAME} is needed")
    if stamp := header.stamp.sec + 1e-9 * header.stamp.nanosec:
        if not abs(age := now - stamp) <= OLDEST:
            when = f"{age:.0f} s ago" if age > 0 else f"{-age:.0f} s ahead"
            raise ValueError(f"it is stamped {when} by this computer's clock; at most {OLDEST:g} s are allowed")
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    place, turn = pose.position, pose.orientation
    length = fsum(part * part for part in (turn.x, turn.y, turn.z, turn.w))
    if not (abs(place.x) <= FARTHEST and abs(place.y) <= FARTHEST):
        raise ValueError(f"its position is x {place.x:g}, y {place.y:g}")
    if not abs(length - 1.0) <= UNIT:
        raise ValueError("its orientation is no rotation: a quaternion of length 1")
    heading = atan2(2 * (turn.w * turn.z + turn.x * turn.y), length - 2 * (turn.y**2 + turn.z**2))
    return Pose(x=float(place.x), y=float(place.y), heading=heading)


def asked_initial_pose(message: Any, now: float, source: str) -> LocatedPose:  # noqa: ANN401 (as above)
    """About where the robot is, by a PoseWithCovarianceStamped; a covariance of zeros is none.

    Raises:
        ValueError: why it cannot be used.
    """
    pose, given = asked_pose(message, now), [float(each) for each in message.pose.covariance]
    covariance = tuple(given[place] for place in _OF_PLANE)
    xx, xy, xh, yy, yh, hh = covariance
    if not all(map(isfinite, covariance)) or any(covariance) != (xx > 0 and yy > 0 and hh > 0):
        raise ValueError("its covariance is none: the variances of x, y and yaw are above 0, or all is 0")
    whole = xx * (yy * hh - yh * yh) - xy * (xy * hh - yh * xh) + xh * (xy * yh - yy * xh)
    if any(covariance) and not (xx * yy > xy * xy and whole > 0):
        raise ValueError("its covariance is none: it is not positive definite")
    return LocatedPose(pose=pose, frame=FRAME, source=source, covariance=covariance if any(covariance) else ())
