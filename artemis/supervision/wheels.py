"""What the wheels do, against what was asked of them and against each other: the measures of motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import degrees
from typing import NamedTuple

from artemis.motion.ackermann import Ackermann
from artemis.motion.perception import stale_age
from artemis.motion.potentiometers import is_at_a_rail, wheel_angles
from artemis.supervision.measures import Reading
from artemis.values import POWERED, Action, DriveFeedback, DriveState, Goal, JobKind, Sensed, SetPoints, Wish
from artemis.vehicle import Robot

SPEED_TIME, SLIP_TIME = 0.04, 0.2
"""A wheel's speed is its way over this time [s]: halls are too coarse for less (0.2 mm a count)."""
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
ASTRAY = 0.2
"""Distance from the path that is worth a look [m]."""
QUICK = 0.35
"""Wheels that are steered faster than this [rad/s] say little about slip."""
PROGRESS = 0.01
"""A robot on its way along a path gets further by this [m] within the row's time."""


class _Moment(NamedTuple):
    time: float
    left: float
    right: float


class Wheels:
    """Remembers the last moments of the driven wheels and what was asked of them."""

    def __init__(self, robot: Robot, tick: float, blind: bool = False) -> None:
        """`blind`: the calibration of the potentiometers means nothing."""
        self._robot, self._stale, self._blind = robot, stale_age(tick), blind
        self._car = Ackermann(robot.geometry)
        self._places = robot.places
        self._moments: deque[_Moment] = deque()
        self._asked: deque[tuple[float, float, float]] = deque()
        self._planned = 0.0
        self._ramp_from = 0.0
        self._braking = False
        self._driven = False
        self._stops = False
        self._speeds = (0.0, 0.0)
        self._referenced: set[str] = set()
        self._pot_changes: dict[tuple[str, int], tuple[float, float]] = {}
        self._mark: float | None = None
        self._arrived = False

    @property
    def speed(self) -> float:
        """Of the faster driven wheel [m/s], without sign."""
        return max(abs(self._speeds[0]), abs(self._speeds[1]))

    def plan_from_here(self) -> None:
        """The present speed is where the next ramp begins."""
        self._planned = self.speed

    def read(self, sensed: Sensed, last: Wish, points: SetPoints, stops: bool) -> Iterator[Reading]:
        """Readings of this tick; `points` left the gate in the last one, `stops`: the robot shall come to rest."""
        for result in sensed.results:
            if result.kind is JobKind.REFERENCE and result.ok:
                self._referenced.add(result.drive)
                self._pot_changes = {key: seen for key, seen in self._pot_changes.items() if key[0] != result.drive}
            elif result.kind is JobKind.CONFIGURE:
                self._referenced.discard(result.drive)
        drives = [sensed.drives[place] for place in self._places]
        if not last.exchange or any(drive.age is None or drive.age > self._stale for drive in drives[:2]):
            self._moments.clear()
            self._speeds = (0.0, 0.0)
            return
        self._look(sensed.time, drives, last, points, stops)
        yield from self._traction(drives, stops)
        if last.supervised:
            yield from self._slip(drives)
            for drive in drives[2:]:
                yield from self._steering(drive, last, points)
            yield from self._pair(drives, last)
            yield from self._wished(last)

    # ------------------------------------------------------------------------------------------ driven wheels

    def _look(self, now: float, drives: list[DriveFeedback], last: Wish, points: SetPoints, stops: bool) -> None:
        moments = self._moments
        dt = now - moments[-1].time if moments else 0.0
        moments.append(_Moment(now, drives[0].position, drives[1].position))
        while len(moments) > 1 and moments[1].time <= now - SLIP_TIME:
            moments.popleft()
        self._speeds = self._over(SPEED_TIME)
        driven = last.command.action is Action.RUN and last.traction is Goal.ENABLED
        self._asked.append((now, points.speed_left, points.speed_right) if driven else (now, 0.0, 0.0))
        while self._asked[0][0] < now - ANSWER_TIME:
            self._asked.popleft()
        if driven:
            self._planned = max(max(abs(left), abs(right)) for _, left, right in self._asked)
        elif self._driven or (stops and not self._stops):  # it may roll though nobody drove it
            self._ramp_from, self._planned = now + RAMP_DELAY, max(self._planned, self.speed)
            self._braking = self._planned > MOVING
        elif now > self._ramp_from:
            brakes = last.traction is Goal.QUICK_STOPPED and any(drive.state in POWERED for drive in drives[:2])
            ramp = self._robot.limits.quick_stop_deceleration_m_s2 if brakes else COASTING
            self._planned = max(0.0, self._planned - ramp * dt)
        self._braking = self._braking and not driven and self.speed > AT_REST
        self._driven, self._stops = driven, stops

    def _over(self, time: float) -> tuple[float, float]:
        """Speeds (left, right) over about the last `time` [s]."""
        newest = self._moments[-1]
        oldest = next((m for m in reversed(self._moments) if newest.time - m.time >= 0.99 * time), self._moments[0])
        span = newest.time - oldest.time
        if span <= 0.0:
            return 0.0, 0.0
        return (newest.left - oldest.left) / span, (newest.right - oldest.right) / span

    def _traction(self, drives: list[DriveFeedback], stops: bool) -> Iterator[Reading]:
        scrub = self._car.scrub_radius * max(abs(drive.velocity) for drive in drives[2:])
        still = self._planned == 0.0 and not self._braking
        if still and self.speed - scrub > MOVING:  # wheels that are steered at standstill roll
            yield "RUN-02", "", self.speed - scrub, f"{self.speed:.2f} m/s"
        if stops or not self._driven:
            excess = self._braked_speed(drives) - self._planned
            if excess > MOVING and (self._driven or self._braking):
                yield "RUN-03", "", excess, f"{excess + self._planned:.2f} m/s, {self._planned:.2f} planned"
            return
        for side, (drive, speed) in enumerate(zip(drives[:2], self._speeds, strict=True), 1):
            asked = [moment[side] for moment in self._asked]
            recent = [moment[side] for moment in self._asked if moment[0] >= self._asked[-1][0] - TRAIL_TIME]
            low, high = min(recent), max(recent)
            beyond = max(speed - max(high, 0.0), min(low, 0.0) - speed)
            if beyond > max(MOVING, RELATIVE * max(-low, high)):
                yield "RUN-01", drive.name, beyond, f"{speed:+.2f} m/s, commanded {asked[-1]:+.2f}"
            if min(abs(min(asked)), abs(max(asked))) > FAST and abs(speed) < STILL:
                yield "RUN-04", drive.name, 1.0, f"{speed:+.2f} m/s, commanded {asked[-1]:+.2f}"
        on = [drive.name for drive in drives[:2] if drive.state is DriveState.OPERATION_ENABLE]
        if len(on) == 1 and self.speed > MOVING:
            yield "RUN-06", on[0], 1.0, ""

    def _braked_speed(self, drives: list[DriveFeedback]) -> float:
        """Of the faster wheel that has a drive to brake it [m/s]; one without rolls until friction stops it."""
        braked = [abs(v) for drive, v in zip(drives[:2], self._speeds, strict=True) if drive.state in POWERED]
        return max(braked, default=self.speed)

    def _slip(self, drives: list[DriveFeedback]) -> Iterator[Reading]:
        if self.speed <= FAST or not self._driven:
            return
        rates = drives[2].velocity, drives[3].velocity
        if max(abs(rates[0]), abs(rates[1])) > QUICK:  # what the wheels rolled belongs to many angles
            return
        steering = self._car.steering_from_wheel_angles(drives[2].position, drives[3].position)
        scrub = self._car.wheel_speeds(0.0, steering, *rates)
        rolled = self._over(SLIP_TIME)
        speeds = [
            (wheel - own) / ratio
            for wheel, own, ratio in zip(rolled, scrub, self._car.speed_ratios(steering), strict=True)
        ]
        fastest = max(abs(speeds[0]), abs(speeds[1]))
        if fastest > FAST and (slip := abs(speeds[0] - speeds[1]) / fastest) > RELATIVE:
            yield "RUN-05", "", slip, f"{slip:.0%}"

    # ------------------------------------------------------------------------------------------ steered wheels

    def _steering(self, drive: DriveFeedback, last: Wish, points: SetPoints) -> Iterator[Reading]:
        name, described = drive.name, self._robot.drives[drive.name]
        if drive.age is None or drive.age > self._stale:
            return
        target = points.steering_left if described.side == "left" else points.steering_right
        error = abs(target - drive.position)
        if last.steering is Goal.ENABLED and drive.state is DriveState.OPERATION_ENABLE and error > 0.02:
            yield "STE-01", name, error, f"{degrees(error):.1f} degrees"
        load = abs(drive.current) * 1000.0 / described.motor.output_current_ma
        if load > 0.5:
            yield "STE-02", name, load, f"{drive.current:+.2f} A"
        if is_at_a_rail(drive.potentiometers):
            yield "STE-04", name, 1.0, "{:.2f} V and {:.2f} V".format(*drive.potentiometers)
            return
        if not self._blind:
            yield from self._potentiometers(drive)
        if name in self._referenced:
            yield from self._frozen(drive)

    def _potentiometers(self, drive: DriveFeedback) -> Iterator[Reading]:
        calibration = self._robot.potentiometers(self._robot.drives[drive.name].side)
        first, second = wheel_angles(drive.potentiometers, calibration)
        apart = degrees(abs(first - second)) / self._robot.calibration.steering.disagreement_deg
        if apart > 0.5:
            yield "STE-03", drive.name, apart, f"{degrees(first):.1f} and {degrees(second):.1f} degrees"
        if drive.name in self._referenced:
            away = abs((first + second) / 2.0 - drive.position)
            if away > 0.02:
                yield "STE-05", drive.name, away, f"{degrees(away):.1f} degrees"

    def _frozen(self, drive: DriveFeedback) -> Iterator[Reading]:
        for number, volt in enumerate(drive.potentiometers):
            seen = self._pot_changes.get((drive.name, number))
            if seen is None or seen[0] != volt:
                self._pot_changes[drive.name, number] = volt, drive.position
            elif (turned := abs(drive.position - seen[1])) > 0.05:
                yield "STE-07", drive.name, turned, f"{volt:.2f} V over {degrees(turned):.0f} degrees"

    def _pair(self, drives: list[DriveFeedback], last: Wish) -> Iterator[Reading]:
        """Both wheels stand about one turning point: asked where the robot may drive."""
        left, right = drives[2], drives[3]
        if last.traction is Goal.ENABLED and left.name in self._referenced and right.name in self._referenced:
            fits = self._car.wheel_angles(self._car.steering_from_left(left.position))[1]
            if (apart := abs(fits - right.position)) > 0.02:
                yield "STE-06", "", apart, f"{degrees(left.position):.1f} and {degrees(right.position):.1f} degrees"

    # ------------------------------------------------------------------------------------------ the wish itself

    def _wished(self, last: Wish) -> Iterator[Reading]:
        command, limits = last.command, self._robot.limits
        if command.action is Action.RUN:
            reach = degrees(abs(command.steering)) / limits.steering_deg
            beyond = max(abs(command.speed) / limits.speed_m_s, reach) - 1.0
            if beyond > 0.0:
                yield "RUN-12", "", beyond, f"{command.speed:+.2f} m/s, {degrees(command.steering):+.0f} degrees"
        tracking = last.tracking
        if tracking is None:
            self._arrived = False
        elif abs(tracking.cross_track) <= ASTRAY:
            self._arrived = True
        elif self._arrived:  # a path may begin beside the robot (PTH-05 says how far)
            yield "PTH-06", "", abs(tracking.cross_track), f"{tracking.cross_track:+.2f} m"
        if tracking is None or abs(command.speed) < MOVING:
            self._mark = None
        elif self._mark is None or abs(tracking.arc_length - self._mark) > PROGRESS:
            self._mark = tracking.arc_length
        else:
            yield "PTH-07", "", 1.0, f"at {self._mark:.2f} m"
