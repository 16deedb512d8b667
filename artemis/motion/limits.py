"""The gate: every command passes here, once, on its way to the drives."""

from __future__ import annotations

from math import inf, isfinite, radians

from artemis.motion.ackermann import Ackermann
from artemis.values import Action, DriveCommand, SetPoints
from artemis.vehicle import RobotFile

SHORTEST_STEP, LONGEST_STEP = 1e-6, 1.5
"""Below the first [s] no time has passed: differences of angles over it would be rounding errors. The second, in
periods: what set-points catch up at once is braked hard, and feeds back more than the batteries may take."""

_RUN = Action.RUN


class Gate:
    """Makes of a command what the machine may do next. Pure: the same arguments give the same set-points.

    Whatever the commands, these hold from tick to tick, once they hold: speed of the virtual wheel and of each driven
    wheel, acceleration and deceleration, steering angle, and each wheel's steering rate. Only a quick stop jumps.
    """

    def __init__(self, robot: RobotFile, period: float) -> None:
        """Take the limits from the robot's file. `period`: between two steps [s]."""
        limits = robot.limits
        self._ackermann, self._period = Ackermann(robot.geometry), period
        self._speed = limits.speed_m_s
        self._wheel_speed = limits.wheel_speed_m_s
        self._acceleration = limits.acceleration_m_s2
        self._deceleration = limits.deceleration_m_s2
        self._steering = radians(limits.steering_deg)
        self._rate = radians(limits.steering_rate_wheel_deg_s)
        if self._rate * self._ackermann.scrub_radius > self._wheel_speed:  # a wheel steered at standstill rolls
            self._rate = self._wheel_speed / self._ackermann.scrub_radius

    def limit(
        self, command: DriveCommand, last: SetPoints, dt: float, ceiling: float = inf, stop: bool = False
    ) -> SetPoints:
        """Set-points that follow `last` after `dt` [s] and come as near to `command` as the limits allow.

        Args:
            command: The wish. A quick stop or disable means speed 0 at once; numbers that are not finite mean `stop`.
            last: What left the gate before, or the wheels as they stand (speed 0).
            dt: Time since `last` was made [s].
            ceiling: A lower limit of the virtual wheel's speed, either way [m/s].
            stop: Controlled stop: slow down to standstill, wheels held.
        """
        if command.action is not _RUN:
            return _set_points(0.0, last.steering, (0.0, 0.0), (last.steering_left, last.steering_right))
        dt = min(max(0.0, dt), LONGEST_STEP * self._period)
        if dt < SHORTEST_STEP:
            return last
        if stop or not is_sane(command):
            return self._brake(last, dt)
        steering, left, right, paired = self._steer(command.steering, last, self._rate * dt)
        lasts = max(dt, self._period)  # a step that follows a late one comes early, but its wheels turn until the next
        rates = (left - last.steering_left) / lasts, (right - last.steering_right) / lasts
        ratios = self._ackermann.speed_ratios(steering)
        top = self._top_speed(ratios, rates) if paired else 0.0
        if abs(last.speed) - self._deceleration * dt > top:
            return self._brake(last, dt)  # slow down first, then steer
        top = max(0.0, min(ceiling, self._speed, top))
        speed = self._ramp(last.speed, _clamp(command.speed, -top, top), dt)
        return _set_points(speed, steering, self._ackermann.rolling_speeds(speed, ratios, *rates), (left, right))

    def _brake(self, last: SetPoints, dt: float) -> SetPoints:
        """One step of the controlled stop: as slow as the deceleration allows, wheels held."""
        speed = self._ramp(last.speed, 0.0, dt)
        speeds = self._ackermann.wheel_speeds(speed, last.steering)
        return _set_points(speed, last.steering, speeds, (last.steering_left, last.steering_right))

    def _steer(self, target: float, last: SetPoints, step: float) -> tuple[float, float, float, bool]:
        """Virtual, left and right angle towards `target`, no wheel turning by more than `step`; are they a pair?

        Each wheel's reach bounds the virtual wheel; within both bounds the wheels stay a pair. Where the bounds
        contradict each other (wheels as power-up found them) each wheel goes towards its own place.
        """
        car, left, right = self._ackermann, last.steering_left, last.steering_right
        target = _clamp(target, -self._steering, self._steering)
        target_left, target_right = car.wheel_angles(target)
        if max(abs(target_left - left), abs(target_right - right)) < 0.999 * step:  # whatever was rounded
            return target, target_left, target_right, True
        low = max(car.steering_from_left(left - step), car.steering_from_right(right - step))
        high = min(car.steering_from_left(left + step), car.steering_from_right(right + step))
        if low <= high:
            steering = _clamp(target, low, high)
            return steering, *car.wheel_angles(steering), True
        left, right = _clamp(target_left, left - step, left + step), _clamp(target_right, right - step, right + step)
        return car.steering_from_wheel_angles(left, right), left, right, False

    def _top_speed(self, ratios: tuple[float, float], rates: tuple[float, float]) -> float:
        """Speed of the virtual wheel at which the faster wheel, rolling and steered, reaches its limit."""
        roll = self._ackermann.scrub_radius * max(abs(rates[0]), abs(rates[1]))
        return max(0.0, self._wheel_speed - roll) / max(abs(ratios[0]), abs(ratios[1]))

    def _ramp(self, speed: float, target: float, dt: float) -> float:
        """One step from `speed` towards `target`; a change of direction first comes to a halt."""
        target = 0.0 if speed * target < 0.0 else target
        step = (self._acceleration if abs(target) > abs(speed) else self._deceleration) * dt
        return _clamp(target, speed - step, speed + step)


def is_sane(command: DriveCommand) -> bool:
    """Whether the numbers of a RUN command are finite; the others' numbers are not used."""
    return command.action is not _RUN or (isfinite(command.speed) and isfinite(command.steering))


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _set_points(speed: float, steering: float, speeds: tuple[float, float], angles: tuple[float, float]) -> SetPoints:
    return SetPoints(
        speed=speed,
        steering=steering,
        speed_left=speeds[0],
        speed_right=speeds[1],
        steering_left=angles[0],
        steering_right=angles[1],
    )
