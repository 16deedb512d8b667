"""The four wheels of the true robot: what a motor's counts make of them, and what their potentiometers show."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from artemis.sim.axis import Axis
from artemis.vehicle import Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class PotentiometerFailure:
    """What is wrong with one potentiometer."""

    since: float = 0.0
    """When it began [s]."""
    offset: float = 0.0
    """[V]."""
    drift: float = 0.0
    """[V/s]."""
    stuck: float | None = None
    """The voltage is this, whatever the angle [V]."""

    def shown(self, voltage: float, now: float) -> float:
        """What it shows instead of `voltage` [V]."""
        if self.stuck is not None:
            return self.stuck
        return voltage + self.offset + self.drift * (now - self.since)


class SteeredWheel:
    """One steered wheel: motor counts to true angle, true angle to potentiometer voltages."""

    def __init__(self, robot: Robot, name: str, axis: Axis, *, start: float, zero_deg: float) -> None:
        """Stand at `start` [rad], left positive; the calibrated potentiometers say 0 at `zero_deg`."""
        drive = robot.drives[name]
        self.failures: dict[int, PotentiometerFailure] = {}
        """By potentiometer: 0 and 1."""
        self._axis = axis
        self._start = start
        counts_per_turn = drive.sensor.counts_per_turn * drive.gear_ratio
        self._coupled = (-1.0 if drive.mirrored else 1.0) * math.tau / counts_per_turn
        self._radians_per_count = self._coupled
        calibration = robot.potentiometers(drive.side)
        self._zero_deg = zero_deg
        self._zero_v = calibration.zero_v
        self._slope_1, self._slope_2 = calibration.slope_deg_per_v

    @property
    def angle(self) -> float:
        """True angle of the wheel [rad], left positive."""
        return self._start + self._axis.position * self._radians_per_count

    def feel(self, dice: random.Random, noise: float, now: float) -> None:
        """Turn the potentiometers' shafts along: `noise` is the standard deviation of each voltage [V]."""
        shown = math.degrees(self.angle) - self._zero_deg
        first = self._zero_v[0] + shown / self._slope_1
        second = self._zero_v[1] + shown / self._slope_2
        if noise:
            first += dice.gauss(0.0, noise)
            second += dice.gauss(0.0, noise)
        if self.failures:
            first, second = (
                self.failures[number].shown(voltage, now) if number in self.failures else voltage
                for number, voltage in enumerate((first, second))
            )
        self._axis.analog = (first, second)

    def freeze(self) -> None:
        """Both potentiometers go on showing what they show now."""
        self.failures = {number: PotentiometerFailure(stuck=volt) for number, volt in enumerate(self._axis.analog)}

    def slip_coupling(self, angle: float) -> None:
        """The wheel turns by `angle` [rad] and its motor does not."""
        self._start += angle

    def couple(self, coupled: bool) -> None:
        """The motor turns the wheel, or turns without it."""
        angle = self.angle
        self._radians_per_count = self._coupled if coupled else 0.0
        self._start = angle - self._axis.position * self._radians_per_count


class DrivenWheel:
    """One driven wheel: motor counts to true way."""

    def __init__(self, robot: Robot, name: str, axis: Axis, *, scale: float) -> None:
        """`scale`: true metres per count as a multiple of the robot file's."""
        drive = robot.drives[name]
        self._axis = axis
        self._gripping = (-scale if drive.mirrored else scale) * robot.metres_per_count(drive.side)
        self._metres_per_count = self._gripping
        self._position = axis.position

    def roll(self) -> float:
        """What the wheel has rolled since the last call [m], forward positive."""
        position = self._axis.position
        way = (position - self._position) * self._metres_per_count
        self._position = position
        return way

    def spin(self, slip: float) -> None:
        """Turn faster than the ground goes by: this share of what it turns is lost; 0: grips again."""
        self._axis.fail(gain=1.0 / (1.0 - slip))
        self._metres_per_count = self._gripping * (1.0 - slip)

    def push(self, acceleration: float) -> None:
        """The ground pushes: what the robot would accelerate forward by without friction [m/s²]."""
        rpm = 60.0 / (self._gripping * self._axis.counts_per_turn)
        self._axis.load_current = -self._axis.load.inertia * acceleration * rpm
