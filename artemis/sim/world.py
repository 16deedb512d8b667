"""The world behind the wire: four drives with their motors, the vehicle they move, and the battery that feeds them."""

from __future__ import annotations

import math
import random
from typing import Annotated

from pydantic import Field

from artemis.config import Config
from artemis.sim.axis import NOMINAL_VOLTAGE, Axis
from artemis.sim.epos import SimEpos, SimSettings
from artemis.sim.vehicle import Chassis, Vehicle
from artemis.values import Pose
from artemis.vehicle import Positive, Robot

LONGEST_STEP = 5e-3
"""Axes and vehicle move in equal steps of this length or less (a twentieth more, if that saves a step) [s]."""


class Supply(Config):
    """Two lead batteries in series and the wires to the drives; braking drives feed back."""

    battery_v: Positive = 25.0
    """Without load."""
    source_resistance_ohm: Positive = 0.1
    back_feed_resistance_ohm: Positive = 0.5
    """Instead of the source resistance while current flows back: the less the battery takes, the higher it is."""
    capacitance_f: Positive = 0.01
    """Of all drives together."""


class TrueRobot(Config):
    """What is true of the simulated machine and the software does not know. None: as the robot file says."""

    steering_zero_left_deg: float = 0.0
    """True wheel angle where the calibrated potentiometers say 0."""
    steering_zero_right_deg: float = 0.0
    wheel_scale_left: Positive = 1.0
    """True metres per count, as a multiple of the robot file's."""
    wheel_scale_right: Positive = 1.0
    wheelbase_m: Positive | None = None
    track_m: Positive | None = None
    scrub_radius_m: Annotated[float, Field(ge=0)] | None = None
    potentiometer_noise_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation."""
    slip: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    """Share of its way that a driven wheel loses, on average."""
    start_steering_left_deg: float = 7.0
    """True wheel angle at power-up."""
    start_steering_right_deg: float = -4.0
    x_m: float = 0.0
    """True place of the rear axle's centre at power-up."""
    y_m: float = 0.0
    heading_deg: float = 0.0
    supply: Supply = Supply()


class _Steering:
    """One steered wheel: motor counts to true angle, true angle to potentiometer voltages."""

    def __init__(self, robot: Robot, side: str, axis: Axis, *, start_deg: float, zero_deg: float) -> None:
        _, drive = robot.drive_at("steering", side)
        self._axis = axis
        self._start = math.radians(start_deg)
        counts_per_turn = drive.sensor.counts_per_turn * drive.gear_ratio
        self._radians_per_count = (-1.0 if drive.mirrored else 1.0) * math.tau / counts_per_turn
        calibration = robot.potentiometers(side)
        self._zero_deg = zero_deg
        self._zero_v = calibration.zero_v
        self._slope_1, self._slope_2 = calibration.slope_deg_per_v

    @property
    def angle(self) -> float:
        """True angle of the wheel [rad], left positive."""
        return self._start + self._axis.position * self._radians_per_count

    def feel(self, dice: random.Random, noise: float) -> None:
        """Turn the potentiometers' shafts along: `noise` is the standard deviation of each voltage [V]."""
        shown = math.degrees(self.angle) - self._zero_deg
        first = self._zero_v[0] + shown / self._slope_1
        second = self._zero_v[1] + shown / self._slope_2
        if noise:
            first += dice.gauss(0.0, noise)
            second += dice.gauss(0.0, noise)
        self._axis.analog = (first, second)


class _Traction:
    """One driven wheel: motor counts to true way."""

    def __init__(self, robot: Robot, side: str, axis: Axis, *, scale: float) -> None:
        _, drive = robot.drive_at("traction", side)
        self._axis = axis
        self._metres_per_count = (-scale if drive.mirrored else scale) * robot.metres_per_count(side)
        self._position = axis.position

    def roll(self) -> float:
        """What the wheel has rolled since the last call [m], forward positive."""
        position = self._axis.position
        way = (position - self._position) * self._metres_per_count
        self._position = position
        return way


class World:
    """Four powered drives on a true robot; time passes when `advance` says so."""

    def __init__(
        self,
        robot: Robot,
        true: TrueRobot | None = None,
        *,
        seed: int = 1,
        start: float = 0.0,
        settings: SimSettings | None = None,
    ) -> None:
        """Power everything on.

        Args:
            robot: What the software knows.
            true: Where the machine differs from it.
            seed: Of all that is random: slip and potentiometer noise.
            start: Time of power-on [s].
            settings: How the drives behave.
        """
        true = true or TrueRobot()
        self.time = start
        self._true = true
        self._dice = random.Random(seed)
        axes = {name: Axis(drive) for name, drive in robot.drives.items()}
        self.nodes = [SimEpos(drive, axes[name], name=name, settings=settings) for name, drive in robot.drives.items()]
        """The drives, in the order of the robot file."""
        self._axes = list(axes.values())
        self._supply_voltage = true.supply.battery_v
        self._last_step = LONGEST_STEP
        self._place(robot, true, axes)
        self._feel()
        for node in self.nodes:
            node.power_on(start)

    def _place(self, robot: Robot, true: TrueRobot, axes: dict[str, Axis]) -> None:
        def axis(role: str, side: str) -> Axis:
            return axes[robot.drive_at(role, side)[0]]

        starts = (true.start_steering_left_deg, true.start_steering_right_deg)
        zeros = (true.steering_zero_left_deg, true.steering_zero_right_deg)
        scales = (true.wheel_scale_left, true.wheel_scale_right)
        self._steering_left, self._steering_right = (
            _Steering(robot, side, axis("steering", side), start_deg=begin, zero_deg=zero)
            for side, begin, zero in zip(("left", "right"), starts, zeros, strict=True)
        )
        self._traction_left, self._traction_right = (
            _Traction(robot, side, axis("traction", side), scale=scale)
            for side, scale in zip(("left", "right"), scales, strict=True)
        )
        geometry = robot.geometry
        self.chassis = Chassis(
            wheelbase=true.wheelbase_m or geometry.wheelbase_m,
            track=true.track_m or geometry.track_m,
            scrub_radius=geometry.scrub_radius_m if true.scrub_radius_m is None else true.scrub_radius_m,
            front_driven=geometry.driven_axle == "front",
        )
        self._vehicle = Vehicle(
            self.chassis,
            steering=self.wheel_angles,
            pose=(true.x_m, true.y_m, math.radians(true.heading_deg)),
            slip=true.slip,
            dice=self._dice,
        )

    @property
    def pose(self) -> Pose:
        """True place of the rear axle's centre [m] and heading [rad, not wrapped]."""
        return Pose(x=self._vehicle.x, y=self._vehicle.y, heading=self._vehicle.heading)

    @property
    def speed(self) -> float:
        """True speed of the virtual front wheel [m/s], forward positive."""
        forward = self._vehicle.way
        sideways = self._vehicle.turn * self.chassis.wheelbase
        return math.copysign(math.hypot(forward, sideways), forward) / self._last_step

    @property
    def wheel_angles(self) -> tuple[float, float]:
        """True angles of the left and right front wheel [rad], left positive."""
        return self._steering_left.angle, self._steering_right.angle

    @property
    def supply_voltage(self) -> float:
        """Voltage at the drives [V]."""
        return self._supply_voltage

    def advance(self, now: float) -> None:
        """Let time pass until `now` [s]; an earlier time changes nothing."""
        elapsed = now - self.time
        if elapsed <= 0.0:
            return
        steps = max(1, math.ceil(elapsed / LONGEST_STEP - 0.05))
        dt = elapsed / steps
        for _ in range(steps):
            for axis in self._axes:
                axis.step(dt)
            self._vehicle.move(
                self._steering_left.angle,
                self._steering_right.angle,
                self._traction_left.roll(),
                self._traction_right.roll(),
            )
        self.time = now
        self._last_step = dt
        self._feed(elapsed)
        self._feel()

    def _feel(self) -> None:
        noise = self._true.potentiometer_noise_v
        self._steering_left.feel(self._dice, noise)
        self._steering_right.feel(self._dice, noise)

    def _feed(self, dt: float) -> None:
        """Supply voltage after `dt` at the present load: a source behind a resistance, loading a capacitor."""
        supply = self._true.supply
        power = 0.0
        for axis in self._axes:
            # mA * rpm * V / rpm: torque times speed, the motor constant being nominal voltage per no-load speed
            power += axis.current * axis.velocity / axis.no_load_rpm
        current = 1e-3 * NOMINAL_VOLTAGE * power / max(self._supply_voltage, 1.0)
        resistance = supply.source_resistance_ohm if current >= 0.0 else supply.back_feed_resistance_ohm
        settled = supply.battery_v - current * resistance
        share = 1.0 - math.exp(-dt / (resistance * supply.capacitance_f))
        self._supply_voltage += (settled - self._supply_voltage) * share
        for axis in self._axes:
            axis.supply_voltage = self._supply_voltage
