"""What fits into the objects of a drive: numbers in its own units, of which a fine encoder makes large ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, cos, degrees, radians, sin

from artemis.axles import AnyAngleSource, Geometry, HardStop, Potentiometers
from artemis.drive_schema import Drive
from artemis.families.objects import ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION
from artemis.linkage import MeasuredLinkage
from artemis.yaml_file import KeyPath

DRIVE_RAMP = 5.0
"""Ramp inside the traction drives [m/s²]. The gate shapes speeds; the drive only has to follow it."""
STEERING_RAMP = 10000
"""Factory default of 0x6083 to 0x6085 [rpm/s]."""
LIMIT_MARGIN = radians(3.0)
"""A drive refuses set-points so far beyond what the gate lets its wheel turn [rad]."""
FASTER = 1.5
"""No motor turns faster than this times its highest speed."""
SILENCE = 0.5
"""The position counter may run through half of its range within no less [s]: it could overflow unnoticed between two
messages."""
HIGHEST, COUNTER = 0x7FFFFFFF, 1 << 32
"""Of a signed number of 32 bit, as velocities and positions are; so many different positions there are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Commanded:
    """What a robot file asks of one drive, at the motor's shaft."""

    top_rpm: float
    """Highest velocity that is commanded, or allowed."""
    ramp_rpm_s: float
    quick_stop_rpm_s: float
    travel_deg: float = 0.0
    """From one end of its position limits to the other [degrees of the wheel]; 0: it has none."""
    travel_counts: float = 0.0
    """The same as it counts."""


def asked_of_traction(drive: Drive, metres_per_count: float, speed: float, quick_stop: float) -> Commanded:
    """For a highest speed [m/s] of its wheel, and a quick stop [m/s²]."""
    rpm = 60.0 / metres_per_count / drive.sensor.counts_per_turn
    return Commanded(top_rpm=speed * rpm, ramp_rpm_s=DRIVE_RAMP * rpm, quick_stop_rpm_s=quick_stop * rpm)


def asked_of_steering(drive: Drive, geometry: Geometry, steering_deg: float, source: AnyAngleSource) -> Commanded:
    """For a largest angle of the virtual front wheel, and what tells its own angle."""
    travel = _travel_deg(geometry, steering_deg, source)
    counts = drive.counts_per_wheel_turn / source.scale / 360.0 * travel
    ramp, top = STEERING_RAMP, drive.motor.max_speed_rpm
    return Commanded(top_rpm=top, ramp_rpm_s=ramp, quick_stop_rpm_s=ramp, travel_deg=travel, travel_counts=counts)


def misfits(drive: Drive, asked: Commanded) -> Iterator[tuple[KeyPath, str]]:
    """What does not fit into an object of the drive, or would be nothing in it: path of the key, and why."""
    family = drive.tables
    yield from _velocities_and_ramps(drive, asked)
    rpm, counts = drive.motor.max_speed_rpm, drive.sensor.counts_per_turn
    most = int(COUNTER / 2 / SILENCE / (FASTER * rpm / 60.0))
    if counts > most:
        text = f"at {rpm} rpm (max_speed_rpm) its 32-bit position counter would overflow in less than a second"
        yield ("sensor", "counts_per_turn"), f"{text}: expected at most {most}, found {counts}"
    if asked.travel_counts > HIGHEST:
        text = f"from lock to lock, {asked.travel_deg:.0f} degrees of the wheel, {family.title} would count"
        text += (
            f" {asked.travel_counts:.4g} (gear_ratio {drive.gear_ratio:g}); its positions have 32 bit: expected at most"
        )
        most = int(counts * HIGHEST / asked.travel_counts)
        yield ("sensor", "counts_per_turn"), f"{text} {most}, found {counts}"


def _velocities_and_ramps(drive: Drive, asked: Commanded) -> Iterator[tuple[KeyPath, str]]:
    """Only drives that choose their units have such as do not fit."""
    family = drive.tables
    fastest = max(asked.top_rpm, drive.motor.max_speed_rpm)
    speeds = (asked.top_rpm, fastest), family.velocity_scale, HIGHEST
    ramps = tuple(_ramps(drive, asked)), family.acceleration_scale, COUNTER - 1
    for (numbers, scale, highest), unit, key, objects in (
        (speeds, "rpm", "velocity_units_per_rpm", "0x60FF, 0x606C and 0x607F hold"),
        (ramps, "rpm/s", "acceleration_units_per_rpm_s", "0x6083 to 0x6085 hold"),
    ):
        wrong = [number for number in numbers if not 1 <= round(number * scale) <= highest]
        if wrong:
            text = f"{wrong[0]:.5g} {unit} would be {round(wrong[0] * scale)} units; {objects} 1 to {highest}"
            yield ("cia402", key) if drive.cia402 is not None else ("gear_ratio",), text


def _ramps(drive: Drive, asked: Commanded) -> Iterator[float]:
    """Those for which the drive has an object."""
    absent = drive.cia402.absent if drive.cia402 is not None else ()
    if any(object.index not in absent for object in (ACCELERATION, DECELERATION)):
        yield asked.ramp_rpm_s
    if QUICK_STOP_DECELERATION.index not in absent:
        yield asked.quick_stop_rpm_s


def _travel_deg(geometry: Geometry, steering_deg: float, source: AnyAngleSource) -> float:
    """From one end of a steering drive's position limits to the other [degrees], at most."""
    steering = radians(steering_deg)
    if isinstance(geometry.linkage, tuple):
        linkage = MeasuredLinkage(geometry)
        ends = linkage.motor(steering), linkage.motor(-steering)
    else:
        s, c = sin(steering), cos(steering)
        offset = geometry.steered_kingpin_distance_m / (2.0 * geometry.wheelbase_m) * s
        ends = atan2(s, c - offset), atan2(s, c + offset)
    left, right = (abs(degrees(end)) for end in ends)
    if isinstance(source, HardStop):
        stop = abs(source.stop_deg)
        left, right = max(left, stop), max(right, (source.travel_deg or 2.0 * stop) - stop)
    return left + right + 2.0 * degrees(LIMIT_MARGIN)


def voltage_problems(known: Potentiometers, steering_deg: float, drive: Drive) -> Iterator[tuple[KeyPath, str]]:
    """Potentiometers show every angle, and the drive's analog inputs read what they show."""
    supply, family = known.supply_v, drive.tables
    if family.analog and supply > family.top_analog_v:
        reads = f"the analog inputs of this drive ({family.title}) read up to {family.top_analog_v:.3g} V"
        yield ("supply_v",), f"{reads}, found {supply:g} V"
    for number, (zero, slope) in enumerate(zip(known.zero_v, known.slope_deg_per_v, strict=True)):
        swing = steering_deg / abs(slope)
        if zero - swing < 0.0 or zero + swing > supply:
            yield (
                ("slope_deg_per_v", number),
                f"at +-{steering_deg:g} degrees (limits.steering_deg) the potentiometer would show "
                f"{zero - swing:.3g} and {zero + swing:.3g} V; between its ends are 0 to {supply:g} V (supply_v)",
            )
