"""The world behind the wire: the drives with their motors, the vehicle they move, and the battery that feeds them."""

from __future__ import annotations

import math
import random
from collections import deque
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from artemis.axles import ByHand, Inset, Length
from artemis.battery import HOUR, Battery
from artemis.config import Config, Quantity
from artemis.mounting import Degrees, Mounting, Offset
from artemis.sim.axis import NOMINAL_VOLTAGE, Axis
from artemis.sim.drive_node import simulated_drive
from artemis.sim.epos import SimEpos
from artemis.sim.epos_settings import SimSettings
from artemis.sim.servo import ServoAxis, TrueLoad
from artemis.sim.vehicle import Chassis, Vehicle
from artemis.sim.wheels import DrivenWheel, SteeredWheel, TrueLinkage
from artemis.values import Pose
from artemis.vehicle import RobotFile

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from artemis.sim.scanners import SimScanner

LONGEST_STEP = 5e-3
"""Axes and vehicle move in equal steps of this length or less (a twentieth more, if that saves a step) [s]."""
DISCHARGE = 5e-3
"""Time constant with which an emergency stop empties the drives' capacitors [s]; an assumption."""
GRAVITY = 9.81
"""[m/s²]."""
SLOWLY = 0.05
"""A robot that is slower [m/s] keeps contact with a charger."""
TRAIL = 64
"""Past poses that are kept: one a millisecond at most."""


Scale = Annotated[float, Quantity(0.1, 10.0, "")]
SignedScale = Annotated[float, Quantity(0.1, 10.0, "", signed=True)]  # a potentiometer may be mounted the other way
Scales = Annotated[tuple[SignedScale, SignedScale], Field(strict=False)]  # YAML knows only lists
WheelAngle = Annotated[float, Quantity(-90.0, 90.0, "degrees")]
Resistance = Annotated[float, Quantity(1e-4, 1000.0, "ohms")]


Voltage = Annotated[float, Quantity(1.0, 100.0, "V")]
Watts = Annotated[float, Quantity(0.0, 2000.0, "W")]  # of its own: compiled, the other one is no type in a union


class Charger(Config):
    """Charges the batteries of a robot that stands near: at constant current, then at constant voltage."""

    x_m: float
    y_m: float
    """Place of the rear axle's centre there, in the world's frame."""
    within_m: Annotated[float, Quantity(0.01, 10.0, "m")] = 0.3
    current_a: Annotated[float, Quantity(0.01, 1000.0, "A")] = 5.0
    """Into the batteries, beside what the robot takes meanwhile."""
    up_to_v: Voltage = 27.0
    """At the robot: there the current falls."""


class Supply(Config):
    """Two lead batteries in series and the wires to the drives; braking drives feed back."""

    battery_v: Voltage = 25.0
    """Without load, when the run begins."""
    charger: Charger | None = None
    source_resistance_ohm: Resistance = 0.1
    back_feed_resistance_ohm: Resistance = 0.5
    """Instead of the source resistance while current flows back: the less the battery takes, the higher it is."""
    capacity_scale: Scale = 1.0
    """True capacity of the battery that the robot file describes, as a multiple of it."""
    idle_w: Watts | None = None
    """Truly taken all the time; None: as the battery of the robot file says. Without one: 0."""
    capacitance_f: Annotated[float, Quantity(1e-5, 10.0, "F")] = 0.01
    """Of all drives together."""


class TrueMounting(Config):
    """Where a scanner truly sits; None: as the robot file says."""

    x_m: Offset | None = None
    y_m: Offset | None = None
    heading_deg: Degrees | None = None
    upside_down: bool | None = None


class PlantParameters(Config):
    """What is true of the simulated machine and the software does not know. None: as the robot file says."""

    steering_zero_left_deg: WheelAngle = 0.0
    """True wheel angle where the calibrated potentiometers, or an absolute encoder, say 0."""
    steering_zero_right_deg: WheelAngle = 0.0
    steering_zero_middle_deg: WheelAngle = 0.0
    """Left and right are of steering motors on the sides, middle is of a single one; so are the following."""
    steering_scale_left: Scale = 1.0
    """True change of the wheel angle per count, as a multiple of the robot file's."""
    steering_scale_right: Scale = 1.0
    steering_scale_middle: Scale = 1.0
    backlash_deg: Annotated[float, Quantity(0.0, 30.0, "degrees")] = 0.0
    """Play between each steering motor and its wheel, from end to end, at the wheel; the potentiometers turn with the
    wheel."""
    wheel_scale_left: Scale = 1.0
    """True metres per count, as a multiple of the robot file's."""
    wheel_scale_right: Scale = 1.0
    wheel_scale_middle: Scale = 1.0
    wheelbase_m: Length | None = None
    track_m: Length | None = None
    scrub_radius_m: Inset | None = None
    potentiometer_slopes_left: Scales = (1.0, 1.0)
    """True degrees per volt of both potentiometers, as multiples of the robot file's."""
    potentiometer_slopes_right: Scales = (1.0, 1.0)
    potentiometer_slopes_middle: Scales = (1.0, 1.0)
    potentiometer_noise_v: Annotated[float, Quantity(0.0, 5.0, "V")] = 0.0
    """Standard deviation."""
    encoder_noise_counts: Annotated[float, Quantity(0.0, 1000.0, "counts")] = 0.0
    """Of an absolute encoder at a steered wheel: standard deviation."""
    slip: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    """Share of its distance that a driven wheel loses, on average."""
    start_steering_left_deg: WheelAngle = 7.0
    """True wheel angle at power-up."""
    start_steering_right_deg: WheelAngle = -4.0
    start_steering_middle_deg: WheelAngle = 7.0
    loads: dict[Literal["steering", "traction"], TrueLoad] = {}  # noqa: RUF012 (as `scanners`)
    """What drives truly move; those of a role that is not named are simulated as tuned for their load."""
    x_m: float = 0.0
    """True place of the rear axle's centre at power-up."""
    y_m: float = 0.0
    heading_deg: float = 0.0
    supply: Supply = Supply()
    scanners: dict[str, TrueMounting] = {}  # noqa: RUF012 (pydantic copies it; mypyc takes no Field)
    """By their names in the robot file."""


class World:
    """The powered drives of a true robot; time passes when `advance` says so."""

    def __init__(
        self,
        robot: RobotFile,
        true: PlantParameters | None = None,
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
        true = true or PlantParameters()
        self.time = start
        self.battery_v = true.supply.battery_v
        """Of the batteries without load [V]; 0: their switch is open, as the emergency stop's."""
        self.scanners: dict[str, SimScanner] = {}
        """Those on the robot, by their names in its file."""
        self._battery, supply = robot.battery, true.supply
        self._idle = 0.0
        if robot.battery is not None:
            self._idle = robot.battery.idle_w if supply.idle_w is None else supply.idle_w
        self._true = true
        self._dice = random.Random(seed)
        axes = {
            name: ServoAxis(drive, true.loads[drive.role]) if drive.role in true.loads else Axis(drive)
            for name, drive in robot.drives.items()
        }
        self.nodes = [
            simulated_drive(drive, axes[name], name=name, settings=settings) for name, drive in robot.drives.items()
        ]
        """The drives, in the order of the robot file."""
        self._axes = list(axes.values())
        self._supply_voltage = self.battery_v
        self._slope = 0.0
        self._trail: deque[tuple[float, float, float, float]] | None = None
        self._last_step = LONGEST_STEP
        self._place(robot, true, axes)
        self._divided = None if robot.battery is None or robot.battery.measured is None else robot.battery.measured
        """The voltage divider at an analog input of a drive."""
        self._axis_by_name = axes
        self._feel()
        for node in self.nodes:
            node.power_on(start)

    def mounting(self, name: str, known: Mounting) -> Mounting:
        """How a scanner truly sits that the robot file knows so."""
        true = self._true.scanners.get(name, TrueMounting())
        return known.model_copy(update=true.model_dump(exclude_none=True))

    def _place(self, robot: RobotFile, true: PlantParameters, axes: dict[str, Axis]) -> None:
        self.steered: dict[str, SteeredWheel] = {}
        """By the names of their drives: left and right, or one in the middle."""
        for side in robot.sides("steering"):
            name, _ = robot.drive_at("steering", side)
            by_hand = isinstance(robot.angle_source(side), ByHand)
            self.steered[name] = SteeredWheel(
                robot,
                name,
                axes[name],
                start=math.radians(getattr(true, f"{'steering_zero' if by_hand else 'start_steering'}_{side}_deg")),
                zero_deg=getattr(true, f"steering_zero_{side}_deg"),
                scale=getattr(true, f"steering_scale_{side}"),
                backlash=math.radians(true.backlash_deg),
                slopes=getattr(true, f"potentiometer_slopes_{side}"),
            )
        self.driven: dict[str, DrivenWheel] = {}
        """Likewise."""
        for side in robot.sides("traction"):
            name, _ = robot.drive_at("traction", side)
            self.driven[name] = DrivenWheel(robot, name, axes[name], scale=getattr(true, f"wheel_scale_{side}"))
        steered, driven = list(self.steered.values()), list(self.driven.values())
        self._steering_left, self._steering_right = steered[0], steered[-1]
        self._traction_left, self._traction_right = driven[0], driven[-1]
        self._linkage = TrueLinkage(robot.geometry) if len(self.steered) == 1 else None
        self._drives_one = len(self.driven) == 1
        geometry = robot.geometry
        self.chassis = Chassis(
            wheelbase=true.wheelbase_m or geometry.wheelbase_m,
            track=true.track_m or geometry.track_m,
            scrub_radius=geometry.scrub_radius_m if true.scrub_radius_m is None else true.scrub_radius_m,
            front_driven=geometry.driven_axle == "front",
            front_wheels=geometry.front_wheels,
            differential=geometry.differential,
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
        forward = self._vehicle.distance
        sideways = self._vehicle.turn * self.chassis.wheelbase
        return math.copysign(math.hypot(forward, sideways), forward) / self._last_step

    @property
    def wheel_angles(self) -> tuple[float, float]:
        """True angles of the left and right front wheel [rad], left positive."""
        return self.motor_angles if self._linkage is None else self._linkage.wheels(self._steering_left.angle)

    @property
    def motor_angles(self) -> tuple[float, float]:
        """True angles of what the left and the right steering motor turn [rad]; of a single one its own, twice."""
        return self._steering_left.angle, self._steering_right.angle

    @property
    def supply_voltage(self) -> float:
        """Voltage at the drives [V]."""
        return self._supply_voltage

    def drive(self, name: str) -> SimEpos:
        """The drive of this name in the robot file."""
        return next(node for node in self.nodes if node.name == name)

    @property
    def slope(self) -> float:
        """How steep the ground falls ahead of the robot [rad]; positive pulls it forward."""
        return self._slope

    @slope.setter
    def slope(self, slope: float) -> None:
        self._slope = slope
        for wheel in self.driven.values():
            wheel.push(GRAVITY * math.sin(slope))

    def carry(self, x: float, y: float, heading: float) -> None:
        """Somebody lifts the robot and sets it down `x` [m] ahead, `y` [m] to the left, turned by `heading` [rad]."""
        vehicle = self._vehicle
        cos, sin = math.cos(vehicle.heading), math.sin(vehicle.heading)
        vehicle.x += x * cos - y * sin
        vehicle.y += x * sin + y * cos
        vehicle.heading += heading
        if self._trail is not None:
            self._trail.clear()
            self._trail.append((self.time, vehicle.x, vehicle.y, vehicle.heading))

    def keep_trail(self) -> None:
        """Remember past poses from now on, for `poses_at`."""
        if self._trail is None:
            self._trail = deque([(self.time, self._vehicle.x, self._vehicle.y, self._vehicle.heading)], maxlen=TRAIL)

    def poses_at(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """True x, y [m] and heading [rad] at times [s] of the last moments; the world may lag behind a little."""
        import numpy as np

        assert self._trail is not None
        rows = np.array(self._trail)
        if len(rows) > 1:  # it goes on as it last did
            last, before = rows[-1], rows[max(0, np.searchsorted(rows[:, 0], rows[-1, 0] - LONGEST_STEP) - 1)]
            rows = np.vstack([rows, last + (last - before) * (0.1 / (last[0] - before[0]))])
        return tuple(np.interp(times, rows[:, 0], rows[:, column]) for column in (1, 2, 3))

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
            left, right = self._steering_left.turn(), self._steering_right.turn()
            if self._linkage is not None:
                left, right = self._linkage.wheels(left)
            rolled = self._traction_left.roll()
            self._vehicle.move(left, right, rolled, rolled if self._drives_one else self._traction_right.roll())
        self.time = now
        self._last_step = dt
        if self._trail is not None:
            self._trail.append((now, self._vehicle.x, self._vehicle.y, self._vehicle.heading))
        self._feed(elapsed)
        self._feel()

    def _feel(self) -> None:
        if (divided := self._divided) is not None:
            shown = self._supply_voltage / divided.divider
            self._axis_by_name[divided.drive].analog = (shown, 0.0) if divided.input == 1 else (0.0, shown)
        noise, counts = self._true.potentiometer_noise_v, self._true.encoder_noise_counts
        self._steering_left.feel(self._dice, noise, self.time, counts)
        if self._linkage is None:
            self._steering_right.feel(self._dice, noise, self.time, counts)

    def _charged(self, charger: Charger | None, taken: float) -> float:
        """Current of the charger [A], while the robot takes so much [A]."""
        vehicle = self._vehicle
        if charger is None or abs(vehicle.distance) > SLOWLY * self._last_step:
            return 0.0
        if math.hypot(vehicle.x - charger.x_m, vehicle.y - charger.y_m) > charger.within_m:
            return 0.0
        most = (charger.up_to_v - self.battery_v) / self._true.supply.source_resistance_ohm
        return max(0.0, taken + min(charger.current_a, most))

    def _drain(self, battery: Battery, coulombs: float) -> None:
        """The batteries' voltage without load after something was taken of them [As]: by its curve."""
        capacity = HOUR * battery.capacity_ah * self._true.supply.capacity_scale
        _, slope = battery.voltage_at(battery.charge_at(self.battery_v))
        self.battery_v = max(1.0, self.battery_v - slope * coulombs / capacity)

    def _feed(self, dt: float) -> None:
        """Supply voltage after `dt` at the present load: a source behind a resistance, loading a capacitor."""
        supply = self._true.supply
        power = 0.0
        for axis in self._axes:
            # mA * rpm * V / rpm: torque times speed, the motor constant being nominal voltage per no-load speed
            power += axis.current * axis.velocity / axis.no_load_rpm
        power *= 1e-3 * NOMINAL_VOLTAGE
        power += self._idle
        if self.battery_v:
            current = power / max(self._supply_voltage, 1.0)
            charged = self._charged(supply.charger, current)
            if self._battery is not None:
                self._drain(self._battery, (current - charged) * dt)
            resistance = supply.source_resistance_ohm if current >= 0.0 else supply.back_feed_resistance_ohm
            settled = self.battery_v - current * resistance + charged * supply.source_resistance_ohm
            share = 1.0 - math.exp(-dt / (resistance * supply.capacitance_f))
            self._supply_voltage += (settled - self._supply_voltage) * share
        else:
            square = self._supply_voltage**2 - 2.0 * power * dt / supply.capacitance_f
            self._supply_voltage = math.sqrt(max(0.0, square)) * math.exp(-dt / DISCHARGE)
        for axis in self._axes:
            axis.supply_voltage = self._supply_voltage
