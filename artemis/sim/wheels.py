"""The wheels of the true robot: what a motor's counts make of them, and what shows their angles."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from artemis.axles import AbsoluteEncoder, Geometry, HardStop, HomeSwitch, Potentiometers
from artemis.sim.axis import Axis
from artemis.vehicle import RobotFile


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

    def __init__(
        self,
        robot: RobotFile,
        name: str,
        axis: Axis,
        *,
        start: float,
        zero_deg: float,
        scale: float = 1.0,
        backlash: float = 0.0,
        slopes: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        """Stand at rest.

        Args:
            robot: What the software knows.
            name: The wheel's drive in the robot file.
            axis: Its motor.
            start: True angle of the wheel [rad], left positive.
            zero_deg: True angle at which what is calibrated says 0; so far off is a stop, a switch, a hand, too.
            scale: True angle per count as a multiple of the robot file's.
            backlash: Angle between the ends of the play between motor and wheel [rad]; it begins in the middle.
            slopes: True degrees per volt of both potentiometers as multiples of the robot file's.
        """
        drive = robot.drives[name]
        self.failures: dict[int, PotentiometerFailure] = {}
        """By potentiometer: 0 and 1."""
        self._axis = axis
        self._start = start
        counts_per_turn = drive.counts_per_wheel_turn
        source = robot.angle_source(drive.side)
        scale *= source.scale
        self._coupled = (-scale if drive.mirrored else scale) * math.tau / counts_per_turn
        self._radians_per_count = self._coupled
        self._half_play = 0.5 * backlash
        self.angle = start
        """True angle of the wheel [rad], left positive."""
        self._zero_deg = zero_deg
        self._zero_v, known, self._supply = (0.0, 0.0), (math.inf, math.inf), 5.0
        if isinstance(source, Potentiometers):
            self._zero_v, known, self._supply = source.zero_v, source.slope_deg_per_v, source.supply_v
        self._slope_1, self._slope_2 = (a * b for a, b in zip(known, slopes, strict=True))
        self.encoder = source if isinstance(source, AbsoluteEncoder) else None
        """Absolute encoder at the wheel; None: there is none, or nobody reads it any more."""
        self._switch = source if isinstance(source, HomeSwitch) else None
        self.stops = _stops(source, math.radians(zero_deg)) if isinstance(source, HardStop) else None
        """Where it is held to both sides [rad], right and left; None: nowhere."""
        self._held = False

    def turn(self) -> float:
        """Let the motor take the wheel along once the play is taken up: the angle [rad]."""
        angle = self._start + self._axis.position * self._radians_per_count
        if self._half_play:
            angle = min(max(self.angle, angle - self._half_play), angle + self._half_play)
        self.angle = angle
        if self.stops is not None:
            self._meet(angle, *self.stops)
        return angle

    def _meet(self, angle: float, low: float, high: float) -> None:
        """Nothing turns beyond a stop, and the motor is held there as long as it is regulated to go on."""
        axis, end, outwards = self._axis, *((high, self._coupled) if angle >= high else (low, -self._coupled))
        at_end = angle >= high or angle <= low
        held = at_end and axis.lag * outwards > 0.0
        if held is not self._held:
            self._held = held
            axis.fail(blocked=held)
        if at_end:
            self.angle = end
            axis.position = (end - self._start) / self._coupled
            if axis.velocity * outwards > 0.0:
                axis.velocity = 0.0

    def feel(self, dice: random.Random, noise: float, now: float, counts: float = 0.0) -> None:
        """Turn the sensors along: `noise` is the standard deviation of each voltage [V], `counts` of an encoder."""
        shown = math.degrees(self.angle) - self._zero_deg
        if self._switch is not None:
            beyond = shown >= self._switch.switch_deg
            self._axis.home = beyond is (self._switch.on_side == "left")
        known = self.encoder
        self._axis.encoder = None if known is None else (_counted(known, shown, dice, counts), known.bits)
        first = self._zero_v[0] + shown / self._slope_1
        second = self._zero_v[1] + shown / self._slope_2
        if noise:
            first += dice.gauss(0.0, noise)
            second += dice.gauss(0.0, noise)
        if not (0.0 <= first <= self._supply and 0.0 <= second <= self._supply):
            first, second = (max(0.0, min(self._supply, voltage)) for voltage in (first, second))
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
        self.angle += angle
        self.turn()

    def couple(self, coupled: bool) -> None:
        """The motor turns the wheel, or turns without it."""
        angle = self.turn()
        self._radians_per_count = self._coupled if coupled else 0.0
        self._start = angle - self._axis.position * self._radians_per_count
        self.turn()


def _stops(source: HardStop, zero: float) -> tuple[float, float]:
    """Where the motor is held to both sides [rad]: as far to the other, if the robot file does not say how far."""
    known = math.radians(source.stop_deg)
    travel = 2.0 * abs(known) if source.travel_deg is None else math.radians(source.travel_deg)
    right = known if known < 0.0 else known - travel
    return zero + right, zero + right + travel


def _counted(encoder: AbsoluteEncoder, shown: float, dice: random.Random, noise: float) -> int:
    """What the encoder counts of its turn where it should show an angle of the wheel [degrees]."""
    turned = encoder.zero_deg - shown if encoder.mirrored else encoder.zero_deg + shown
    counts = turned / 360.0 * (1 << encoder.bits)
    return round(dice.gauss(counts, noise) if noise else counts) % (1 << encoder.bits)


class TrueLinkage:
    """What one steering motor makes of the front wheels."""

    def __init__(self, geometry: Geometry) -> None:
        """As the robot's file describes it; without a linkage the motor turns the only front wheel."""
        self._half = geometry.kingpin_distance_m / (2.0 * geometry.wheelbase_m)
        table = geometry.linkage if isinstance(geometry.linkage, tuple) else ()
        self._rows = [(row.motor_deg, row.left_deg, row.right_deg) for row in table]

    def wheels(self, angle: float) -> tuple[float, float]:
        """Angles of the left and right front wheel for the motor's, all [rad], left positive."""
        if self._rows:
            return self._measured(math.degrees(angle))
        s, c = math.sin(angle), math.cos(angle)
        return math.atan2(s, c - self._half * s), math.atan2(s, c + self._half * s)

    def _measured(self, motor: float) -> tuple[float, float]:
        """On the lines between the rows of the table; `motor` in degrees."""
        row = 0
        while row < len(self._rows) - 2 and motor > self._rows[row + 1][0]:
            row += 1
        (begin, left, right), (end, next_left, next_right) = self._rows[row], self._rows[row + 1]
        share = (motor - begin) / (end - begin)
        return math.radians(left + share * (next_left - left)), math.radians(right + share * (next_right - right))


class DrivenWheel:
    """One driven wheel, or two behind a differential: motor counts to true distance."""

    def __init__(self, robot: RobotFile, name: str, axis: Axis, *, scale: float) -> None:
        """`scale`: true metres per count as a multiple of the robot file's."""
        drive = robot.drives[name]
        self._axis = axis
        self._gripping = (-scale if drive.mirrored else scale) * robot.metres_per_count(drive.side)
        self._metres_per_count = self._gripping
        self._position = axis.position

    def roll(self) -> float:
        """What the wheel has rolled since the last call [m], forward positive."""
        position = self._axis.position
        distance = (position - self._position) * self._metres_per_count
        self._position = position
        return distance

    def spin(self, slip: float) -> None:
        """Turn faster than the ground goes by: this share of what it turns is lost; 0: grips again."""
        self._axis.fail(gain=1.0 / (1.0 - slip))
        self._metres_per_count = self._gripping * (1.0 - slip)

    def push(self, acceleration: float) -> None:
        """The ground pushes: what the robot would accelerate forward by without friction [m/s²]."""
        rpm = 60.0 / (self._gripping * self._axis.counts_per_turn)
        self._axis.load_current = -self._axis.load.inertia * acceleration * rpm
