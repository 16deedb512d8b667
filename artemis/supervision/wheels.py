"""What the wheels do, against what was asked of them and against each other: the measures of motion."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import degrees
from operator import itemgetter

from artemis.drive_states import POWERED, DriveState, Goal
from artemis.motion.ackermann import Ackermann
from artemis.motion.perception import stale_age
from artemis.scan import Clearance
from artemis.supervision.measures import Reading
from artemis.supervision.steered import SteeredWheelMonitor
from artemis.values import Action, DriveFeedback, Sensed, SetPoints, Wish
from artemis.vehicle import RobotFile

SPEED_TIME, SLIP_TIME = 0.04, 0.2
"""A wheel's speed is its distance over this time [s]: halls are too coarse for less (0.2 mm a count)."""
ANSWER_TIME = 0.2
"""What was commanded in this time [s] may still be on its way to the wheel."""
TRAIL_TIME = 0.1
"""A wheel that is slowed down is this far behind its command at most [s]."""
RAMP_DELAY = 0.1
"""A drive begins its quick stop within this time [s]."""
COASTING = 0.2
"""Least deceleration of the robot with its drives off [m/s²]; gears and tyres brake more."""
RELATIVE = 0.2
"""A runaway is faster than commanded by this part, or by the row's limit if that is more."""
AT_REST, MOVING, FAST, STILL = 0.02, 0.05, 0.1, 0.03
"""Rolling speeds [m/s]: at rest after braking, moving, clearly moving, not moving."""
CREEPING = 0.01
"""A robot that shall stand and rolls on faster than this [m/s] does not come to rest by itself."""
ASTRAY = 0.2
"""Distance from the path that is worth a look [m]."""
QUICK = 0.35
"""Wheels that are steered faster than this [rad/s] say little about slip."""
PROGRESS = 0.01
"""A robot on its way along a path gets further by this [m] within the row's time."""


_ON, _ENABLED, _QUICK_STOPPED, _RUN = DriveState.OPERATION_ENABLE, Goal.ENABLED, Goal.QUICK_STOPPED, Action.RUN

Drives = tuple[DriveFeedback, DriveFeedback, DriveFeedback, DriveFeedback]
"""Traction left, right, steering left, right; one in the middle stands for both sides."""


class Wheels:
    """Remembers the last moments of the driven wheels and what was asked of them.

    Attributes:
        speed: of the faster driven wheel [m/s], without sign.
    """

    _speeds: tuple[float, float]
    """Of the driven wheels (left, right) in this tick [m/s]."""

    def __init__(self, robot: RobotFile, tick: float, blind: bool = False) -> None:
        """`blind`: the calibration of the potentiometers means nothing."""
        self._limits, self._stale = robot.limits, stale_age(tick)
        self._car = Ackermann(robot.geometry)
        steered = [SteeredWheelMonitor(robot, side, blind) for side in robot.sides("steering")]
        self._steered = steered[0], steered[-1]
        """Left and right; one monitor where one motor steers."""
        self._is_pair = len(steered) == 2
        self._by_place = itemgetter(*robot.places)
        self._rolled_at = list[float]()
        """Times of the following [s]."""
        self._rolled = list[float](), list[float]()
        """Distances of the left and of the right wheel [m]."""
        self._asked_at = list[float]()
        """Times of the following [s]."""
        self._asked = list[float](), list[float]()
        """Speeds of the left and of the right wheel [m/s]."""
        self._asked_most = list[float]()
        """Speed of the faster one [m/s], without sign."""
        self._planned = 0.0
        self._ramp_from = 0.0
        self._braking = False
        self._driven = False
        self._stops = False
        self.speed = 0.0
        self._mark: float | None = None
        self._arrived = False

    def plan_from_here(self) -> None:
        """The present speed is where the next ramp begins."""
        self._planned = self.speed

    def read(self, sensed: Sensed, last: Wish, points: SetPoints, stops: bool) -> list[Reading]:
        """Readings of this tick; `points` left the gate in the last one, `stops`: the robot shall come to rest."""
        for result in sensed.results:
            for wheel in self._steered:
                wheel.learn(result)
        drives: Drives = self._by_place(sensed.drives)
        stale = [drive.age is None or drive.age > self._stale for drive in drives]
        if not last.exchange or stale[0] or stale[1]:
            for column in (self._rolled_at, *self._rolled):
                column.clear()
            self.speed = 0.0
            return []
        self._look(sensed.time, drives, last, points, stops)
        readings = self._traction(drives, stops)
        if last.supervised:
            readings += self._slip(drives)
            turns, (left, right) = last.steering is _ENABLED, self._steered
            if not stale[2]:
                readings += left.read(drives[2], points.steering_left, turns)
            if self._is_pair and not stale[3]:
                readings += right.read(drives[3], points.steering_right, turns)
            if self._is_pair:
                readings += self._pair(drives, last)
            readings += self._wished(last, points.clearance)
        return readings

    # ------------------------------------------------------------------------------------------ driven wheels

    def _look(self, now: float, drives: Drives, last: Wish, points: SetPoints, stops: bool) -> None:
        times, lefts, rights = self._rolled_at, *self._rolled
        dt = now - times[-1] if times else 0.0
        times.append(now)
        lefts.append(drives[0].position)
        rights.append(drives[1].position)
        while len(times) > 1 and times[1] <= now - SLIP_TIME:
            del times[0], lefts[0], rights[0]
        self._speeds = left, right = self._over(SPEED_TIME)
        self.speed = max(abs(left), abs(right))
        driven = last.command.action is _RUN and last.traction is _ENABLED
        left, right = (points.speed_left, points.speed_right) if driven else (0.0, 0.0)
        times, lefts, rights, most = self._asked_at, *self._asked, self._asked_most
        times.append(now)
        lefts.append(left)
        rights.append(right)
        most.append(max(abs(left), abs(right)))
        while times[0] < now - ANSWER_TIME:
            del times[0], lefts[0], rights[0], most[0]
        if driven:
            self._planned = max(most)
        elif self._driven or (stops and not self._stops):  # it may roll though nobody drove it
            self._ramp_from, self._planned = now + RAMP_DELAY, max(self._planned, self.speed)
            self._braking = self._planned > MOVING
        elif now > self._ramp_from:
            brakes = last.traction is _QUICK_STOPPED and any(drive.state in POWERED for drive in drives[:2])
            ramp = self._limits.quick_stop_deceleration_m_s2 if brakes else COASTING
            self._planned = max(0.0, self._planned - ramp * dt)
        self._braking = self._braking and not driven and self.speed > AT_REST
        self._driven, self._stops = driven, stops

    def _over(self, time: float) -> tuple[float, float]:
        """Speeds (left, right) over about the last `time` [s]."""
        times, (lefts, rights) = self._rolled_at, self._rolled
        then = max(bisect_right(times, times[-1] - 0.99 * time) - 1, 0)
        span = times[-1] - times[then]
        if span <= 0.0:
            return 0.0, 0.0
        return (lefts[-1] - lefts[then]) / span, (rights[-1] - rights[then]) / span

    def _traction(self, drives: Drives, stops: bool) -> list[Reading]:
        readings: list[Reading] = []
        left, right, steered_left, steered_right = drives
        if self._planned == 0.0 and not self._braking:
            scrub = self._car.scrub_radius * max(abs(steered_left.velocity), abs(steered_right.velocity))
            least = (
                MOVING if scrub > CREEPING else CREEPING
            )  # wheels that are steered at standstill roll, by about that
            if self.speed - scrub > least:
                readings.append(("RUN-02", "", self.speed - scrub, f"{self.speed:.2f} m/s"))
        if stops or not self._driven:
            excess = self._braked_speed(drives) - self._planned
            if excess > MOVING and (self._driven or self._braking):
                words = f"{excess + self._planned:.2f} m/s, {self._planned:.2f} planned"
                readings.append(("RUN-03", "", excess, words))
            return readings
        for drive, speed, asked in ((left, self._speeds[0], self._asked[0]), (right, self._speeds[1], self._asked[1])):
            newest = asked[-1]
            if abs(speed - newest) > MOVING:  # else it is not beyond the range of what was asked recently, either
                readings += self._beyond(drive, speed, asked)
            if -STILL < speed < STILL and min(abs(min(asked)), abs(max(asked))) > FAST:
                readings.append(("RUN-04", drive.name, 1.0, f"{speed:+.2f} m/s, commanded {newest:+.2f}"))
        left_on, right_on = left.state is _ON, right.state is _ON
        if left_on != right_on and self.speed > MOVING:
            readings.append(("RUN-06", left.name if left_on else right.name, 1.0, ""))
        return readings

    def _beyond(self, drive: DriveFeedback, speed: float, asked: list[float]) -> list[Reading]:
        """Faster than anything that was commanded in the last `TRAIL_TIME`."""
        trailing = asked[bisect_left(self._asked_at, self._asked_at[-1] - TRAIL_TIME) :]
        low, high = min(trailing), max(trailing)
        beyond = max(speed - max(high, 0.0), min(low, 0.0) - speed)
        if beyond > max(MOVING, RELATIVE * max(-low, high)):
            return [("RUN-01", drive.name, beyond, f"{speed:+.2f} m/s, commanded {asked[-1]:+.2f}")]
        return []

    def _braked_speed(self, drives: Drives) -> float:
        """Of the faster wheel that has a drive to brake it [m/s]; one without rolls until friction stops it."""
        braked = [abs(v) for drive, v in zip(drives[:2], self._speeds, strict=True) if drive.state in POWERED]
        return max(braked, default=self.speed)

    def _slip(self, drives: Drives) -> list[Reading]:
        if self.speed <= FAST or not self._driven:
            return []
        _, _, left, right = drives
        if max(abs(left.velocity), abs(right.velocity)) > QUICK:  # what the wheels rolled belongs to many angles
            return []
        car, (rolled_left, rolled_right) = self._car, self._over(SLIP_TIME)
        ratio_left, ratio_right = car.speed_ratios(car.steering_from_wheel_angles(left.position, right.position))
        speed_left = (rolled_left + car.scrub_radius * left.velocity) / ratio_left
        speed_right = (rolled_right - car.scrub_radius * right.velocity) / ratio_right
        fastest = max(abs(speed_left), abs(speed_right))
        if fastest > FAST and (slip := abs(speed_left - speed_right) / fastest) > RELATIVE:
            return [("RUN-05", "", slip, f"{slip:.0%}")]
        return []

    def _pair(self, drives: Drives, last: Wish) -> list[Reading]:
        """Both wheels stand about one turning point: asked where the robot may drive."""
        _, _, left, right = drives
        if last.traction is _ENABLED and self._steered[0].is_aligned and self._steered[1].is_aligned:
            fits = self._car.wheel_angles(self._car.steering_from_left(left.position))[1]
            if (apart := abs(fits - right.position)) > 0.02:
                words = f"{degrees(left.position):.1f} and {degrees(right.position):.1f} degrees"
                return [("STE-06", "", apart, words)]
        return []

    # ------------------------------------------------------------------------------------------ the wish itself

    def _wished(self, last: Wish, clearance: Clearance | None) -> list[Reading]:
        readings: list[Reading] = []
        command, tracking = last.command, last.tracking
        if command.action is _RUN:
            reach = degrees(abs(command.steering)) / self._limits.steering_deg
            beyond = max(abs(command.speed) / self._limits.speed_m_s, reach) - 1.0
            if beyond > 0.0:
                words = f"{command.speed:+.2f} m/s, {degrees(command.steering):+.0f} degrees"
                readings.append(("RUN-12", "", beyond, words))
        if tracking is None:
            self._arrived = False
        elif abs(tracking.cross_track) <= ASTRAY:
            self._arrived = True
        elif self._arrived:  # a path may begin beside the robot (PTH-05 says how far)
            readings.append(("PTH-06", "", abs(tracking.cross_track), f"{tracking.cross_track:+.2f} m"))
        if tracking is None or abs(command.speed) < MOVING or (clearance and clearance.holds):
            self._mark = None
        elif self._mark is None or abs(tracking.arc_length - self._mark) > PROGRESS:
            self._mark = tracking.arc_length
        else:
            readings.append(("PTH-07", "", 1.0, f"at {self._mark:.2f} m"))
        return readings
