"""What follows from what is sensed, without judgement: pose, odometry, standstill, and where the wheels are."""

from __future__ import annotations

from collections import deque
from math import inf
from operator import itemgetter

from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.drive_states import DriveState
from artemis.motion.ackermann import Ackermann
from artemis.motion.charge import ChargeEstimate
from artemis.motion.localisation import Localisation
from artemis.motion.odometry import Odometer
from artemis.values import (
    DriveFeedback,
    JobKind,
    LocatedPose,
    Odometry,
    Pose,
    Sensed,
    SetPoints,
    Snapshot,
    Verdict,
)
from artemis.vehicle import RobotFile

STANDING_TIME, STANDING_DISTANCE = 0.1, 0.001
"""The robot stands when no driven wheel rolled further than this [m] in this time [s]."""
UNCOUNTED_DISTANCE, UNHEARD_TIME = 0.01, 0.5
"""A driven wheel that rolled further than this [m] while it was not heard, or was not heard for so long [s] since it
rolled, is anywhere."""

_ON = DriveState.OPERATION_ENABLE


def stale_age(tick: float) -> float:
    """Feedback older than this [s] says nothing any more; `tick`: period of the scheduled ticks [s]."""
    return max(0.08, 2.5 * tick)


def moment(time: float, left: DriveFeedback, right: DriveFeedback, stale: float) -> float:
    """When the older of the positions of both driven wheels was measured [s of the run]: the pose is of that moment.

    By the times of their frames on the bus, at run time `time` [s]. A drive that was not heard for longer than `stale`
    [s] counts as standing.
    """
    first, second = left.age or 0.0, right.age or 0.0
    age = first if first > second else second
    return time - (age if age < stale else stale)


class Perception:
    """Keeps pose and odometry from tick to tick. Deterministic: the same feedback gives the same snapshots."""

    def __init__(self, robot: RobotFile, tick: float, start: Pose | None = None, *, localized: bool = False) -> None:
        """Begin.

        Args:
            robot: Its geometry counts.
            tick: Period of the scheduled ticks [s]; `dt` never passes two of them.
            start: Where the robot is by its odometry.
            localized: A localizer tells where it is; until it does, the pose is lost.
        """
        self._localisation = Localisation(tick) if localized else None
        self._start = start or Pose()
        self._dt_max = 2 * tick
        self._stale = stale_age(tick)
        self._odometer, self._odometry = Odometer(robot.geometry), Odometry(pose=self._start)
        self.reset()
        self._ackermann = Ackermann(robot.geometry)
        self._charge = ChargeEstimate(robot.battery, robot) if robot.battery else None
        self._battery: BatteryState | None = None
        self._by_place = itemgetter(*robot.places)
        """Traction left, right, steering left, right."""
        self._measured: float | None = None
        """When the newest positions were measured [s of the run], the mean of both; None: a drive was not heard."""
        self._rolled: deque[tuple[float, float, float]] = deque()
        self._stood = 0.0, 0.0
        """What both driven wheels had rolled [m] when they were last heard together; infinite: they were rolling."""
        self._uncounted = False

    def reset(self) -> None:
        """Make the present place the one where the run starts: the origin, if nothing else is known."""
        self._odometer.reset(self._start)
        if self._localisation is not None:
            self._localisation.reset(self._start)
        self._lost = False

    def perceive(self, sensed: Sensed, verdict: Verdict, last: SetPoints) -> Snapshot:
        """The snapshot of this tick. An urgent tick has dt = 0: its feedback is the last scheduled one's."""
        dt, driven = 0.0, self._odometry.driven
        left, right, steer_left, steer_right = self._by_place(sensed.drives)
        if sensed.results and any(result.kind is JobKind.REFERENCE for result in sensed.results):
            self._odometer.forget_angles()
        if uncounted := self._is_uncounted(sensed, left, right):
            self._lost = True
            if self._localisation is not None:
                self._localisation.forget()
        if not sensed.urgent:
            if self._rolled:
                before, last_left, last_right = self._rolled[-1]
                dt = min(sensed.time - before, self._dt_max)
                distance = left.position - last_left, right.position - last_right
                self._odometry = self._odometer.update(
                    *distance, steer_left.position, steer_right.position, self._elapsed(sensed, before, left, right)
                )
            self._rolled.append((sensed.time, left.position, right.position))
            while len(self._rolled) > 2 and self._rolled[1][0] <= sensed.time - STANDING_TIME:
                self._rolled.popleft()
        if self._charge and sensed.battery_v is not None and not sensed.urgent:
            driven = self._odometry.driven - driven
            self._battery = self._charge.update(sensed.battery_v, sensed.drives, driven, dt)
        standing = self._stands(left, right)
        if left.frames and right.frames and not sensed.urgent:
            self._stood = (left.position, right.position) if standing else (inf, inf)
            self._uncounted = False
        unheard = inf in self._stood and (_is_older(left, UNHEARD_TIME) or _is_older(right, UNHEARD_TIME))
        odometry = self._odometry
        if self._lost or unheard:
            odometry = replace(odometry, lost=True, uncounted=uncounted or unheard)
        return Snapshot(
            sensed=sensed,
            dt=dt,
            pose=self._located(sensed, dt, at_once=standing and last.speed == 0.0, unheard=unheard),
            odometry=odometry,
            standing=standing,
            set_points=last,
            verdict=verdict,
            battery=self._battery,
        )

    def _elapsed(self, sensed: Sensed, before: float, left: DriveFeedback, right: DriveFeedback) -> float:
        """Time between the last measurement of the wheels and this one [s], by their frames: a tick may come late.

        The mean of both wheels, as their distances count: one that falls silent ages while the other one rolls. 0 where
        it is less than half a tick: then the counts are too coarse for a speed. Until both drives were heard, and while
        neither is, the time since the tick at `before` [s of the run].
        """
        last, self._measured = self._measured, None
        if left.age is None or right.age is None:
            return sensed.time - before
        younger = min(left.age, right.age)
        oldest = max(younger, self._stale)  # where both are old the computer stalled, or neither is heard
        self._measured = sensed.time - (min(left.age, oldest) + min(right.age, oldest)) / 2
        if last is None:
            return sensed.time - before
        if self._measured - last < self._dt_max / 4:
            self._measured = last
            if younger > self._stale:
                return sensed.time - before
        return self._measured - last

    def _located(self, sensed: Sensed, dt: float, *, at_once: bool, unheard: bool) -> LocatedPose:
        """The pose; without a localizer that of the odometry. `at_once`: it may jump."""
        localisation, odometry = self._localisation, self._odometry
        if localisation is None:
            return LocatedPose(pose=odometry.pose, lost=self._lost or unheard)
        if not sensed.urgent:
            left, right, *_ = self._by_place(sensed.drives)
            localisation.move(moment(sensed.time, left, right, self._stale), odometry)
        localisation.take(sensed.fixes, sensed.time)
        return localisation.located(sensed.time, dt, at_once=at_once, unheard=unheard, odometry=odometry)

    def as_they_stand(self, sensed: Sensed, last: SetPoints) -> SetPoints:
        """`last`, but with the measured angles while a steering drive is off, and no speed while traction is."""
        left, right, steer_left, steer_right = self._by_place(sensed.drives)
        if steer_left.state is not _ON or steer_right.state is not _ON:
            angle_left = last.steering_left if steer_left.state is _ON else steer_left.position
            angle_right = last.steering_right if steer_right.state is _ON else steer_right.position
            steering = self._ackermann.steering_from_wheel_angles(angle_left, angle_right)
            last = replace(last, steering=steering, steering_left=angle_left, steering_right=angle_right)
        if left.state is not _ON or right.state is not _ON:
            last = replace(last, speed=0.0, speed_left=0.0, speed_right=0.0)
        return last

    def _is_uncounted(self, sensed: Sensed, left: DriveFeedback, right: DriveFeedback) -> bool:
        """Whether a driven wheel may have rolled uncounted, or its position jumped.

        Its count begins anew when its drive starts, and is taken up again when that is configured. From when it was
        heard before until then nobody counts, unless the robot stood and stands where it did.
        """
        if left.boots or right.boots or sensed.results:
            configured = {result.drive for result in sensed.results if result.kind is JobKind.CONFIGURE}
            began = any(drive.boots or drive.name in configured for drive in (left, right))
            self._uncounted = self._uncounted or began
        if left.jumps > 1 or right.jumps > 1:
            return True
        at_left, at_right = self._stood
        rolled = (
            abs(left.position - at_left) > UNCOUNTED_DISTANCE or abs(right.position - at_right) > UNCOUNTED_DISTANCE
        )
        return self._uncounted and rolled

    def _stands(self, left: DriveFeedback, right: DriveFeedback) -> bool:
        if not self._rolled:
            return False
        first, last = self._rolled[0], self._rolled[-1]
        if last[0] - first[0] < 0.9 * STANDING_TIME or _is_older(left, self._stale) or _is_older(right, self._stale):
            return False
        return abs(last[1] - first[1]) <= STANDING_DISTANCE and abs(last[2] - first[2]) <= STANDING_DISTANCE


def _is_older(drive: DriveFeedback, age: float) -> bool:
    """Whether a drive was not heard for longer than `age` [s]."""
    return drive.age is None or drive.age > age
