"""How fast the robot may drive for what its laser scanners see: the ceiling of the gate.

Deterministic: the same scans and odometry give the same ceilings, on every machine (see `sweep`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, inf, radians, sin, tan

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.beams import LOST
from artemis.motion.ground import Ground
from artemis.motion.sweep import Rectangle, free_distances, stopping_speed
from artemis.motion.view import View
from artemis.scan import USUAL, Clearance, ObstacleRules
from artemis.values import SetPoints, Snapshot, Wish
from artemis.vehicle import RobotFile

REACTION = 0.12
"""Until the wheels slow down for what a scan shows [s]: the tick after it, the drives' cycle, the first ramp; the
scan's own age comes on top."""
CREEP = 0.1
"""Below this speed every return nearby counts [m/s]."""
UNKNOWN_SPEED, UNKNOWN_DISTANCE = 0.15, 0.5
"""What stood within the least range when the run began was never seen: so slow [m/s], for so far [m]."""
UNKNOWN_AFTER = 5.0
"""The same holds after the robot stood for so long [s]: somebody may have stepped up from where no scanner looks."""
REVERSE_SPEED = 0.2
"""Backwards, or forwards, where no scanner looks [m/s]."""
UNSEEING_SPEED = 0.3
"""With `obstacles: off` [m/s]."""
SLOW_SPEED = 0.1
"""With `obstacles: slow` the robot is so slow where it would stop else [m/s]."""
BLOCKED_SPEED, BLOCKED_TIME = 0.05, 0.06
"""The path is blocked once the ceiling was below this [m/s] for so long [s]; `ObstacleRules.free_after` says when it is
free again."""
SPARE = 0.2
"""The robot looks so much farther than it needs to stop [m]: for the distance that it keeps, and for late scans."""
MEASURED = 0.3
"""What moves is looked for so much longer than the robot needs to stop [s]."""
ARCS = 0.0, 0.5, 1.0
"""Of the steering during the reaction time, from where it is to where it may be then; one where it stands still."""


class ObstacleStop:
    """Keeps what the scanners saw from tick to tick, and gives the speed from which the robot still stops in time."""

    def __init__(self, robot: RobotFile, rules: Iterable[ObstacleRules]) -> None:
        """Begin.

        Args:
            robot: with an outline and scanners.
            rules: all that there are in the mission.
        """
        assert robot.outline is not None
        outline, limits = robot.outline, robot.limits
        self._box = Rectangle(-outline.rear_m, outline.front_m, outline.half_width_m)
        self._wheelbase, self._deceleration = robot.geometry.wheelbase_m, limits.deceleration_m_s2
        self._rate, self._steering = radians(limits.steering_rate_wheel_deg_s), radians(limits.steering_deg)
        self._top = top = limits.speed_m_s
        self._horizon = top * (REACTION + LOST) + top * top / (2.0 * self._deceleration) + SPARE
        lookahead = REACTION + top / self._deceleration + MEASURED
        reach = self._horizon + max(self._box.front, -self._box.rear) + self._box.half_width
        rules = tuple(rules)
        reach += max([_farther(each) + max(each.margin - USUAL.margin, 0.0) for each in rules], default=0.0)
        margin = max([each.margin for each in rules], default=USUAL.margin)
        self._views = {
            name: View(scanner, self._box, reach, lookahead, margin) for name, scanner in robot.scanners.items()
        }
        horizon = self._horizon + max(map(_farther, rules), default=0.0)
        self._ground = Ground(self._box, self._views.values(), horizon)
        self._low_since = self._free_since = self._blocked_since = self._stands_since = inf
        self._at, self._unseen = 0.0, False
        self.reset()

    def reset(self) -> None:
        """Forget everything: the odometry begins anew, or means nothing."""
        for view in self._views.values():
            view.forget()
        self._ground.forget()
        self._driven = 0.0

    def look(self, wish: Wish, last: SetPoints, snapshot: Snapshot, rules: ObstacleRules) -> Clearance | None:
        """What is free for the robot as it is commanded, or rolls still; None: nothing limits it.

        Args:
            wish: of this tick's mode.
            last: what left the gate in the tick before.
            snapshot: of this tick.
            rules: of the mission's present step.
        """
        now = snapshot.time
        self._see(snapshot, now)
        if wish.reset_pose:
            self.reset()
            self._at = 0.0
        towards = last.speed if last.speed != 0.0 else wish.command.speed
        if rules.mode == "off":
            return Clearance(speed=UNSEEING_SPEED)
        if towards == 0.0:
            return self._judged(None, now, rules)
        found = self._free(wish.command.steering, last.steering, now, rules, forward=towards > 0.0)
        return self._judged(found, now, rules)

    def _see(self, snapshot: Snapshot, now: float) -> None:
        """Take what is new in a tick."""
        odometry = snapshot.odometry
        self._driven, self._at = self._driven + abs(odometry.distance - self._at), odometry.distance
        if odometry.uncounted:
            self.reset()
        self._stands_since = min(self._stands_since, now) if snapshot.standing else inf
        if now - self._stands_since >= UNKNOWN_AFTER:
            self._driven = 0.0
        speed = odometry.speed * cos(odometry.steering)
        turn = odometry.speed * sin(odometry.steering) / self._wheelbase
        renewed = {scan.source for scan in snapshot.sensed.scans}
        for name, view in self._views.items():
            view.move(odometry.pose, replaced=name in renewed)
        for scan in snapshot.sensed.scans:
            view = self._views[scan.source]
            view.take(scan, now, speed, turn, creeping=abs(odometry.speed) < CREEP)
        self._ground.mark(odometry.pose, now)

    def _judged(self, found: Clearance | None, now: float, rules: ObstacleRules) -> Clearance | None:
        """What was found, or nothing that may move, with how long the path has been blocked."""
        if found is not None and found.no_scan:
            return found
        if found is None or (rules.mode == "slow" and not self._unseen):
            self._low_since = self._blocked_since = inf
            return found and Clearance(speed=max(found.speed, SLOW_SPEED), distance=found.distance)
        if found.speed >= BLOCKED_SPEED:
            self._low_since, self._free_since = inf, min(self._free_since, now)
            if now - self._free_since >= rules.free_after:
                self._blocked_since = inf
        else:
            self._low_since, self._free_since = min(self._low_since, now), inf
            if now - self._low_since >= BLOCKED_TIME:
                self._blocked_since = min(self._blocked_since, self._low_since)
        if self._blocked_since < inf:
            blocked = now - self._blocked_since
            return Clearance(speed=0.0, distance=found.distance, blocked=blocked, unseen=self._unseen)
        return found if found.speed < self._top else None

    def _free(self, wanted: float, steering: float, now: float, rules: ObstacleRules, *, forward: bool) -> Clearance:
        """On the arcs from where the wheels are to where they may be when the robot slows down."""
        views = self._views.values()
        age = max([view.age(now) for view in views])
        if age == inf:
            return Clearance(speed=0.0, distance=0.0, no_scan=True)
        reaction = REACTION + max(age, 0.0)
        turned = min(max(wanted - steering, -self._rate * reaction), self._rate * reaction)
        angles = [min(max(steering + turned * arc, -self._steering), self._steering) for arc in ARCS]
        angles = angles if turned else angles[:1]
        curvatures = [tan(angle) / self._wheelbase for angle in angles]
        horizon = self._horizon + _farther(rules)
        near = np.concatenate([points for view in views for points in view.around()], 1)
        grown = self._box.grown(rules.margin)
        free = free_distances(near, curvatures, grown, horizon, forward=forward)
        if not any(free):
            near = self._not_left(near, curvatures, grown, forward=forward)
            free = free_distances(near, curvatures, grown, horizon, forward=forward)
        distance = min([(roll - rules.clear) / cos(angle) for roll, angle in zip(free, angles, strict=True)])
        self._unseen = False
        if forward or not rules.unseen_reverse:
            known = self._ground.known(curvatures, now, forward=forward)
            if known is not None:
                nearest = min([(roll - rules.clear) / cos(angle) for roll, angle in zip(known, angles, strict=True)])
                self._unseen, distance = nearest < distance, min(nearest, distance)
        speed = stopping_speed(distance, reaction, self._deceleration)
        if not self._ground.faced[forward]:
            speed = min(speed, REVERSE_SPEED)
        if self._driven < UNKNOWN_DISTANCE:
            speed = min(speed, UNKNOWN_SPEED)
        return Clearance(speed=speed, distance=distance)

    def _not_left(self, near: Array, curvatures: Sequence[float], grown: Rectangle, *, forward: bool) -> Array:
        """Points without those within the margin before an end of the outline that the robot rolls away from.

        They stay there, whatever the arc, where its centre lies outside the outline.
        """
        if max(map(abs, curvatures)) * grown.half_width >= 1.0:
            return near
        left = near[0] < self._box.rear if forward else near[0] > self._box.front
        return np.asarray(near.take((~(left & grown.holds(near))).nonzero()[0], 1))


def _farther(rules: ObstacleRules) -> float:
    """How much farther than usual the robot has to look to keep its distance [m]."""
    return max(rules.clear - USUAL.clear, 0.0)
