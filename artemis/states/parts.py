"""A follower on a whole route: part by part, and backwards where the route wants that.

A bicycle that reverses is the same bicycle, driven forwards with its steered wheel behind: with theta + pi for theta,
-u for u and -alpha for alpha,

    x' = u cos(theta),    y' = u sin(theta),    theta' = u tan(alpha) / L

stay as they are. So a follower always drives forwards along a path of its own, and need not know.
"""

from __future__ import annotations

import math

from msgspec.structs import replace

from artemis.motion.angles import wrap
from artemis.motion.route import Part, Route
from artemis.motion.totals import total
from artemis.plugins.answers import plain_following
from artemis.plugins.contracts import Follower, Following
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Fault, Pose, SetPoints, Snapshot
from artemis.vehicle import RobotFile

STEERED = math.radians(6)
"""Before the robot drives off, its wheels are turned so near to where the follower wants them [rad]."""


def flipped(snapshot: Snapshot) -> Snapshot:
    """The snapshot of the robot that drives the other end ahead; its own inverse. What is sensed stays as it is."""
    located, odometry, points = snapshot.pose, snapshot.odometry, snapshot.set_points
    return replace(
        snapshot,
        pose=replace(located, pose=_turned(located.pose)),
        odometry=replace(
            odometry,
            pose=_turned(odometry.pose),
            speed=-odometry.speed,
            steering=-odometry.steering,
            distance=-odometry.distance,
        ),
        set_points=SetPoints(
            speed=-points.speed,
            steering=-points.steering,
            speed_left=-points.speed_right,
            speed_right=-points.speed_left,
            steering_left=-points.steering_right,
            steering_right=-points.steering_left,
        ),
    )


def _turned(pose: Pose) -> Pose:
    return Pose(x=pose.x, y=pose.y, heading=wrap(pose.heading + math.pi))


def flipped_command(command: DriveCommand) -> DriveCommand:
    """What the robot does when the one that drives the other end ahead is given `command`; its own inverse."""
    return replace(command, speed=-command.speed, steering=-command.steering)


class PartByPart:
    """A follower that is started on one part of a route after the other, the robot standing.

    Attributes:
        end: Arc length at which the present part ends [m].
    """

    def __init__(self, follower: Follower, route: Route, driven: float, robot: RobotFile) -> None:
        """`route` is what is left of a longer one, of which so much is `driven` [m]."""
        self._follower, self._route, self._driven = follower, route, driven
        self._limit = math.radians(robot.limits.steering_deg)
        self._patience = 3 * robot.limits.steering_deg / robot.limits.steering_rate_wheel_deg_s
        self._begin(0)

    def _begin(self, index: int) -> None:
        """A part is next; the robot stands."""
        parts = self._route.parts
        self._index, self._part = index, parts[index]
        self._before = self._driven + self._route.begins[index]
        self.end = self._before + self._part.path.length
        self._after = total(part.path.length for part in parts[index + 1 :])
        self._started = self._finished = False
        self.resume()

    def resume(self) -> None:
        """The robot stands, and will drive off: its wheels are turned first."""
        self._steering: float | None = 0.0

    def step(self, snapshot: Snapshot) -> Following | Fault:
        """The follower's answer, with the arc length of the whole route; finished at its end only."""
        if self._finished and snapshot.standing and self._index + 1 < len(self._route.parts):
            self._begin(self._index + 1)
        part = self._part
        seen = flipped(snapshot) if part.backward else snapshot
        answer = self._ask(part, seen)
        if isinstance(answer, Fault):
            return answer
        self._finished = answer.finished
        told = answer.tracking
        self.end = self._before + told.length
        tracking = replace(told, arc_length=self._before + told.arc_length, length=self.end + self._after)
        command = DriveCommand(steering=seen.set_points.steering) if answer.finished else answer.command
        command = self._steered(command, seen)
        return Following(
            command=flipped_command(command) if part.backward else command,
            tracking=tracking,
            finished=answer.finished and self._index + 1 == len(self._route.parts),
        )

    def _ask(self, part: Part, snapshot: Snapshot) -> Following | Fault:
        try:
            if not self._started:
                self._follower.start(part.path, snapshot)
                self._started = True
            answer = self._follower.step(snapshot)
        except PLUGIN_ERRORS as error:
            return catalogue.fault("PLG-02", "follower", f"{'' if self._started else 'start: '}{told(error)}")
        return plain_following(answer) or catalogue.fault("PLG-06", "follower", told(answer))

    def _steered(self, command: DriveCommand, snapshot: Snapshot) -> DriveCommand:
        """Without its speed until the wheels were turned once to where it wants them, or could have been.

        A speed that is no number stays, for the gate to see (RUN-11).
        """
        if self._steering is None or not math.isfinite(command.speed):
            return command
        self._steering += snapshot.dt
        target = min(max(command.steering, -self._limit), self._limit)
        if abs(target - snapshot.odometry.steering) <= STEERED or self._steering > self._patience:
            self._steering = None
            return command
        return replace(command, speed=0.0)
