"""A fast kinematic robot for followers: a bicycle behind the true gate, with delay and disturbances.

It mirrors the timing of the robot: a follower sees the pose that was measured when the command before began to act, so
its own begins to act one period after that pose (`delay` 1). All wheels are one: a `bicycle` file makes the gate's
limits those of the virtual wheel; any other robot file makes them those of each of its wheels.
"""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass

from artemis.motion.angles import wrap
from artemis.motion.limits import Gate
from artemis.motion.odometry import move
from artemis.values import DriveCommand, LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis.vehicle import RobotFile

SUB_STEPS = 4
"""Of a period: in each the steering angle counts as constant, which errs by 0.03 mm in 7 m."""
STANDING_TIME, STANDING_DISTANCE = 0.1, 0.001
"""The robot stands when it rolled no further than this [m] in this time [s]."""
NARROW = 1e-6
"""Track of a bicycle [m]: wheel and virtual wheel are one to nine digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """How a run begins, and what is not as the follower believes."""

    period: float = 1 / 30
    """Of the ticks [s]."""
    delay: float = 1.0
    """Periods from the measurement of a pose to the effect of its command; parts count."""
    position_noise: float = 0.0
    """Standard deviation of x and of y of the pose [m], new at every tick."""
    heading_noise: float = 0.0
    """Of its heading [rad]."""
    steering_zero: float = 0.0
    """True angle of the wheel where 0 is measured [rad]."""
    wheel_scale: float = 1.0
    """True distance per measured distance."""
    slip: float = 0.0
    """Share of its distance that the wheel loses on average; as much of its turn, drawn apart (it slides out)."""
    steering_rate: float = math.inf
    """What the wheel truly steers with [rad/s], where that is less than the robot file says."""
    start_speed: float = 0.7
    """[m/s]; at most the robot's."""
    start_offset: float = 0.0
    """Of the start, to the left of the path [m]; counted beside the course's own."""
    start_heading: float = 0.0
    """Of the start, relative to the path [rad]."""
    backward: bool = False
    """The rear is ahead: the follower sees, and commands, the robot that drives the other end ahead."""


def bicycle(robot: RobotFile, steering_rate_deg_s: float) -> RobotFile:
    """The robot with all front wheels in one: steering rate and speed limits are the virtual wheel's."""
    geometry = robot.geometry.model_copy(update={"track_m": NARROW, "scrub_radius_m": 0.0})
    limits = robot.limits.model_copy(update={"steering_rate_wheel_deg_s": steering_rate_deg_s})
    return robot.model_copy(update={"geometry": geometry, "limits": limits})


class Plant:
    """A robot that moves by `step` and is seen by `snapshot`.

    Attributes:
        pose: True place of the rear axle's centre, heading wrapped.
        time: Since the run began [s].
        set_points: What left the gate last.
        speed: Of the virtual front wheel, as the drives measure it [m/s].
        steering: Measured angle of the virtual front wheel [rad].
        distance: True distance of the rear axle's centre [m], counted up both ways.
    """

    def __init__(self, robot: RobotFile, conditions: Conditions, start: Pose, seed: int) -> None:
        """Roll straight on at `start` with the start's speed; its offsets are already in `start`."""
        limits = robot.limits
        self.pose, self.time, self.distance = start, 0.0, 0.0
        speed = min(conditions.start_speed, limits.speed_m_s)
        self.speed, self.steering = -speed if conditions.backward else speed, 0.0
        self.set_points = SetPoints(speed=self.speed, speed_left=self.speed, speed_right=self.speed)
        self._target = self.set_points
        self._conditions, self._wheelbase = conditions, robot.geometry.wheelbase_m
        self._gate = Gate(robot, period=conditions.period)
        self._rate = min(conditions.steering_rate, math.radians(limits.steering_rate_wheel_deg_s))
        self._acceleration, self._deceleration = limits.acceleration_m_s2, limits.deceleration_m_s2
        self._dice = random.Random(seed)
        self._pending: deque[tuple[float, SetPoints]] = deque()
        self._ticks, self._distance, self._rolled = 0, 0.0, self.speed * conditions.period
        ticks = math.ceil(STANDING_TIME / conditions.period)
        self._distances = deque([math.inf] * ticks, maxlen=ticks)

    def snapshot(self) -> Snapshot:
        """What a follower sees now. Asked once a tick: it draws the noise of the pose."""
        noise, pose, dice = self._conditions, self.pose, self._dice
        if noise.position_noise or noise.heading_noise:
            pose = Pose(
                x=pose.x + dice.gauss(0.0, noise.position_noise),
                y=pose.y + dice.gauss(0.0, noise.position_noise),
                heading=wrap(pose.heading + dice.gauss(0.0, noise.heading_noise)),
            )
        speed = self._rolled / noise.period
        return Snapshot(
            sensed=Sensed(index=self._ticks, time=self.time),
            dt=noise.period,
            pose=LocatedPose(pose=pose),
            odometry=Odometry(pose=pose, speed=speed, steering=self.steering, distance=self._distance),
            standing=sum(self._distances) <= STANDING_DISTANCE,
            set_points=self.set_points,
            verdict=Verdict(),
        )

    def step(self, command: DriveCommand) -> None:
        """Take a command through the gate and let one period pass."""
        conditions = self._conditions
        self.set_points = self._gate.limit(command, self.set_points, conditions.period)
        self._pending.append((self._ticks + conditions.delay, self.set_points))
        moment, end, self._rolled = float(self._ticks), self._ticks + 1.0, 0.0
        kept = [1.0, 1.0]
        if conditions.slip:
            kept = [1.0 - self._dice.uniform(0.0, 2.0 * conditions.slip) for _ in kept]
        while moment < end:
            while self._pending and self._pending[0][0] <= moment:
                self._target = self._pending.popleft()[1]
            until = min(end, self._pending[0][0]) if self._pending else end
            self._advance((until - moment) * conditions.period, *kept)
            moment = until
        self._ticks += 1
        self.time = self._ticks * conditions.period
        self._distances.append(abs(self._rolled))

    def _advance(self, duration: float, kept_way: float, kept_turn: float) -> None:
        """Let a time [s] pass in which the target stays, with these shares of distance and turn."""
        count = max(1, math.ceil(duration / self._conditions.period * SUB_STEPS - 1e-9))
        dt = duration / count
        zero, scale = self._conditions.steering_zero, self._conditions.wheel_scale * kept_way
        for _ in range(count):
            speed, steering = self.speed, self.steering
            faster = abs(self._target.speed) > abs(speed)
            change = (self._acceleration if faster else self._deceleration) * dt
            self.speed = _towards(speed, self._target.speed, change)
            self.steering = _towards(steering, self._target.steering, self._rate * dt)
            rolled, angle = (speed + self.speed) / 2 * dt, (steering + self.steering) / 2
            self._rolled += rolled
            self._distance += rolled * math.cos(angle)
            distance, angle = rolled * scale, angle + zero
            advance = distance * math.cos(angle)
            self.pose = move(self.pose, advance, distance * math.sin(angle) / self._wheelbase * kept_turn)
            self.distance += abs(advance)


def _towards(value: float, target: float, change: float) -> float:
    return min(max(target, value - change), value + change)
