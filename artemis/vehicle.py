"""The robot as its file describes it: everything that is true of one machine. No default for geometry or identity."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from artemis.config import Config

Positive = Annotated[float, Field(gt=0)]
Unsigned16 = Annotated[int, Field(ge=0, le=0xFFFF)]
Gain = Annotated[int, Field(ge=0, le=32767)]
Pair = Annotated[tuple[float, float], Field(strict=False)]  # YAML knows only lists
PiGains = Annotated[tuple[Gain, Gain], Field(strict=False)]
PidGains = Annotated[tuple[Gain, Gain, Gain], Field(strict=False)]


OPERATING_MODES = {"traction": 3, "steering": -1}
"""Modes of operation (object 0x6060): profile velocity for traction, position for steering."""


class Geometry(Config):
    """Where the wheels are. Kingpins stand `track_m - 2 * scrub_radius_m` apart on the front axle."""

    wheelbase_m: Positive
    track_m: Positive
    """Distance of the front wheels' contact points (and of the rear wheels)."""
    scrub_radius_m: Annotated[float, Field(ge=0)]
    """Contact point outboard of the kingpin."""
    driven_axle: Literal["front", "rear"]

    @property
    def kingpin_distance_m(self) -> float:
        """Distance of the kingpins [m] (thesis equation 3.6)."""
        return self.track_m - 2 * self.scrub_radius_m


class Limits(Config):
    """What the machine may do. Steering rate and wheel speed are per wheel."""

    speed_m_s: Positive
    """Of the virtual front wheel."""
    wheel_speed_m_s: Positive
    acceleration_m_s2: Positive
    deceleration_m_s2: Positive
    """Of a controlled stop."""
    quick_stop_deceleration_m_s2: Positive
    steering_deg: Annotated[float, Field(gt=0, lt=80)]
    """Of the virtual front wheel."""
    steering_rate_wheel_deg_s: Positive


class Potentiometers(Config):
    """One steered wheel. Both potentiometers, angle = slope * (voltage - zero), and the encoder of its motor."""

    zero_v: Pair
    slope_deg_per_v: Pair
    scale: Positive = 1.0
    """True change of the wheel's angle per change that the encoder counts through the gear."""


class SteeringCalibration(Config):
    """Per side."""

    left: Potentiometers
    right: Potentiometers
    disagreement_deg: Positive = 3.0
    """The two potentiometers of a wheel may differ by this much (fault STE-03 beyond)."""


class TractionCalibration(Config):
    """Metres that a wheel rolls per encoder count."""

    left_m_per_count: Positive
    right_m_per_count: Positive


class Calibration(Config):
    """What was measured on this machine."""

    steering: SteeringCalibration
    traction: TractionCalibration


class Motor(Config):
    """Objects 0x6402, 0x6410."""

    type: Literal["dc", "ec_sine", "ec_block"]
    pole_pairs: Annotated[int, Field(ge=1, le=255)]
    continuous_current_ma: Unsigned16
    output_current_ma: Annotated[int, Field(ge=1, le=0xFFFF)]
    thermal_time_constant_s: Annotated[float, Field(ge=0.1, le=540)]
    max_speed_rpm: Annotated[int, Field(ge=1, le=25000)]


class Sensor(Config):
    """Object 0x2210. `counts_per_turn` of the motor shaft: 4 x pulses, or 6 x pole pairs with halls only."""

    type: Literal["encoder_3_channel", "encoder_2_channel", "hall"]
    counts_per_turn: Annotated[int, Field(ge=6, le=30000)]


class Gains(Config):
    """Regulator gains, objects 0x60F6 (PI), 0x60F9 (PI), 0x60FB (PID)."""

    current: PiGains
    velocity: PiGains
    position: PidGains

    @property
    def numbers(self) -> tuple[int, ...]:
        """In the order of the objects: current P, I; velocity P, I; position P, I, D."""
        return (*self.current, *self.velocity, *self.position)


class Drive(Config):
    """One EPOS node."""

    node_id: Annotated[int, Field(ge=1, le=126)]
    role: Literal["traction", "steering"]
    side: Literal["left", "right"]
    mirrored: bool
    """A positive count turns the wheel backwards (traction) or to the right (steering)."""
    hardware_version: Unsigned16
    """Expected 0x2003:2 with its last digit masked: 0x6010 is an EPOS 24/1, 0x6210 an EPOS 24/5."""
    min_firmware: Annotated[int, Field(ge=0x2030, le=0xFFFF)] = 0x2032
    """Lowest software version 0x2003:1; before 0x2030 the heartbeat consumer does not exist."""
    serial_number: int | None = None
    motor: Motor
    sensor: Sensor
    gear_ratio: Positive
    """Motor turns per wheel turn."""
    gains: Gains | None = None
    following_error_counts: Annotated[int, Field(ge=1, le=0xFFFFFFFF)] = 2000


class RobotFile(Config):
    """A whole robot file."""

    robot: str
    geometry: Geometry
    limits: Limits
    calibration: Calibration
    drives: Annotated[dict[str, Drive], Field(min_length=1)]
    bitrate: Literal[1000000, 800000, 500000, 250000, 125000, 50000, 20000] = 1000000
    host_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    """The identifier of the host's heartbeat is 0x700 plus this."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        ids = [drive.node_id for drive in self.drives.values()] + [self.host_node_id]
        if len(set(ids)) != len(ids):
            raise ValueError("two nodes (or a node and host_node_id) share an id")
        places = sorted((drive.role, drive.side) for drive in self.drives.values())
        expected = [("steering", "left"), ("steering", "right"), ("traction", "left"), ("traction", "right")]
        if places != expected:
            raise ValueError("drives must be one traction and one steering drive on each side")
        if self.geometry.kingpin_distance_m < 0:
            raise ValueError("scrub_radius_m is more than half of track_m")
        return self

    def drive_at(self, role: str, side: str) -> tuple[str, Drive]:
        """Name and description of the drive with this role and side."""
        return next((n, d) for n, d in self.drives.items() if (d.role, d.side) == (role, side))

    @property
    def places(self) -> tuple[int, ...]:
        """Where traction left, traction right, steering left, steering right stand in the order of the drives."""
        names = list(self.drives)
        places = [(role, side) for role in ("traction", "steering") for side in ("left", "right")]
        return tuple(names.index(self.drive_at(role, side)[0]) for role, side in places)

    def metres_per_count(self, side: str) -> float:
        """Distance of a driven wheel per count [m]."""
        traction = self.calibration.traction
        return traction.left_m_per_count if side == "left" else traction.right_m_per_count

    def potentiometers(self, side: str) -> Potentiometers:
        """Potentiometer calibration of one side."""
        return self.calibration.steering.left if side == "left" else self.calibration.steering.right
