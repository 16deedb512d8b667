"""Objects of the first-generation EPOS, and what a robot file makes of them: the configuration as data.

Source of indices, types and units: EPOS firmware specification, April 2010, chapters 13 and 14. Drive units are counts
(quadcounts), rpm and rpm/s of the motor shaft, mA and ms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

from artemis.devices.canopen import RXPDO, TXPDO, ObjectType
from artemis.vehicle import OPERATING_MODES, Drive, RobotFile

U8, U16, U32, I8, I16, I32 = (
    ObjectType.U8,
    ObjectType.U16,
    ObjectType.U32,
    ObjectType.I8,
    ObjectType.I16,
    ObjectType.I32,
)


@dataclass(frozen=True, slots=True)
class Object:
    """One entry of the object dictionary."""

    index: int
    subindex: int
    type: ObjectType

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex}"

    @property
    def mapping(self) -> int:
        """Its PDO mapping entry."""
        return self.index << 16 | self.subindex << 8 | self.type.size * 8


class Setting(NamedTuple):
    """A value that an object must have."""

    object: Object
    value: int


ERROR_COUNT = Object(0x1003, 0, U8)
STORE = Object(0x1010, 1, U32)
CONSUMER_HEARTBEAT = Object(0x1016, 1, U32)
VENDOR = Object(0x1018, 1, U32)
SERIAL_NUMBER = Object(0x1018, 4, U32)
SOFTWARE_VERSION = Object(0x2003, 1, U16)
HARDWARE_VERSION = Object(0x2003, 2, U16)
MEMORY = tuple(Object(0x200C, number, I32) for number in range(1, 5))
"""Custom persistent memory: four numbers of the user's own, kept with `STORE`."""
POSITION_SETTING = Object(0x2062, 0, I32)
ANALOG_1, ANALOG_2 = Object(0x207C, 1, I16), Object(0x207C, 2, I16)
VELOCITY_AVERAGED = Object(0x2028, 0, I32)
CONTROLWORD = Object(0x6040, 0, U16)
STATUSWORD = Object(0x6041, 0, U16)
MODE = Object(0x6060, 0, I8)
MODE_DISPLAY = Object(0x6061, 0, I8)
POSITION = Object(0x6064, 0, I32)
CURRENT = Object(0x6078, 0, I16)
POSITION_LIMITS = Object(0x607D, 1, I32), Object(0x607D, 2, I32)
TARGET_VELOCITY = Object(0x60FF, 0, I32)
GAINS = tuple(
    Object(0x60F6 + regulator, number, I16)
    for regulator, number in ((0, 1), (0, 2), (3, 1), (3, 2), (5, 1), (5, 2), (5, 3))
)
"""Of the regulators: current P, I; velocity P, I; position P, I, D."""

SAVE = 0x65766173
"""Signature that `STORE` wants: the letters "save" (CiA 301 7.5.2.13)."""
MAXON = 0x000000FB
UNREADABLE = -1
"""Error code that stands for an emergency frame of the wrong length."""
LIMIT_OFF = (-0x80000000, 0x7FFFFFFF)
"""Values of 0x607D that switch the position limits off (14.74)."""
JITTER = 0.1
"""Two frames that seem to have come at once may be sampled so far apart [s]."""
HOST_WATCH_MS = 200
"""A drive stops by itself when our heartbeat is missing for this long."""
NODE_HEARTBEAT_MS = 100
DRIVE_RAMP = 5.0
"""Ramp inside the traction drives [m/s²]. The gate shapes speeds; the drive only has to follow it."""
MAX_PROFILE_VELOCITY = 25000
STEERING_RAMP = 10000
"""Factory default of 0x6083 to 0x6085 [rpm/s]."""

_MOTOR_TYPES = {"dc": 1, "ec_sine": 10, "ec_block": 11}
_SENSOR_TYPES = {"encoder_3_channel": 1, "encoder_2_channel": 2, "hall": 3}
_NOT_VALID = 0x80000000
_NO_RTR = 0x40000000
_ON_SYNC, _AT_ONCE = 1, 255

SET_POINT = {"traction": TARGET_VELOCITY, "steering": POSITION_SETTING}
"""The object that carries a drive's set-point in its operating mode."""
RECEIVED: dict[str, tuple[tuple[Object, ...], ...]] = {
    role: ((CONTROLWORD, set_point), (CONTROLWORD,)) for role, set_point in SET_POINT.items()
}
"""RxPDO 1 (taken over at SYNC) and 2 (at once: stop frames); 3 and 4 are switched off."""
SENT: dict[str, tuple[tuple[Object, ...], ...]] = {
    "traction": ((STATUSWORD, POSITION), (VELOCITY_AVERAGED, CURRENT, MODE_DISPLAY)),
    "steering": ((STATUSWORD, POSITION), (ANALOG_1, ANALOG_2, CURRENT, MODE_DISPLAY)),
}
"""TxPDO 1 and 2, both sampled at SYNC; 3 and 4 are switched off."""


class Units:
    """Between SI at the wheel and counts and rpm at the motor, for one drive. The one place that knows `mirrored`."""

    def __init__(self, robot: RobotFile, drive: Drive) -> None:
        counts = drive.sensor.counts_per_turn
        if drive.role == "traction":
            per_unit = 1 / robot.metres_per_count(drive.side)
        else:
            per_unit = counts * drive.gear_ratio / (2 * pi) / robot.angle_source(drive.side).scale
        self.counts = -per_unit if drive.mirrored else per_unit
        """Counts per metre (traction) or radian (steering) of the wheel, signed."""
        self.rpm = self.counts * 60 / counts
        """Motor rpm per m/s or rad/s of the wheel, signed; also rpm/s per m/s² or rad/s²."""
        self._fastest = 1.5 * drive.motor.max_speed_rpm / abs(self.rpm)

    def farthest(self, elapsed: float) -> float:
        """Distance [m] or angle [rad] that no motor can pass in `elapsed` [s], and the jitter of a bus besides."""
        return self._fastest * (elapsed + JITTER)


def wrapped(counts: int) -> int:
    """Object 0x6064 is a signed 32-bit counter that wraps."""
    return ((counts + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def settings(robot: RobotFile, drive: Drive) -> Iterator[Setting]:
    """Everything that is configured but the PDOs, in an order that the drive accepts."""
    motor, sensor, limits = drive.motor, drive.sensor, robot.limits
    yield Setting(Object(0x6402, 0, U16), _MOTOR_TYPES[motor.type])  # before the sensor: halls alone need type 11
    yield Setting(Object(0x6410, 1, U16), motor.continuous_current_ma)
    yield Setting(Object(0x6410, 2, U16), motor.output_current_ma)
    yield Setting(Object(0x6410, 3, U8), motor.pole_pairs)
    yield Setting(Object(0x6410, 4, U16), motor.max_speed_rpm)
    yield Setting(Object(0x6410, 5, U16), round(motor.thermal_time_constant_s * 10))
    if sensor.type != "hall":
        yield Setting(Object(0x2210, 1, U16), sensor.counts_per_turn // 4)
    yield Setting(Object(0x2210, 2, U16), _SENSOR_TYPES[sensor.type])
    yield from _gains(drive)
    yield Setting(Object(0x6065, 0, U32), drive.following_error_counts)
    yield from (Setting(o, v) for o, v in zip(POSITION_LIMITS, LIMIT_OFF, strict=True))
    if drive.role == "traction":
        rpm = abs(Units(robot, drive).rpm)
        ramps = DRIVE_RAMP * rpm, DRIVE_RAMP * rpm, limits.quick_stop_deceleration_m_s2 * rpm
        top = limits.wheel_speed_m_s * rpm
    else:
        ramps = STEERING_RAMP, STEERING_RAMP, STEERING_RAMP
        top = motor.max_speed_rpm
    yield Setting(Object(0x607F, 0, U32), min(MAX_PROFILE_VELOCITY, round(top)))
    for index, ramp in zip((0x6083, 0x6084, 0x6085), ramps, strict=True):
        yield Setting(Object(index, 0, U32), round(ramp))
    yield Setting(Object(0x6086, 0, I16), 0)  # trapezoidal
    yield Setting(Object(0x100C, 0, U16), 0)  # no node guarding: heartbeats instead
    yield Setting(Object(0x100D, 0, U8), 0)
    yield Setting(Object(0x1017, 0, U16), NODE_HEARTBEAT_MS)
    yield Setting(Object(0x1016, 2, U32), 0)
    yield Setting(CONSUMER_HEARTBEAT, robot.host_node_id << 16 | HOST_WATCH_MS)
    yield Setting(MODE, OPERATING_MODES[drive.role])


def _gains(drive: Drive) -> Iterator[Setting]:
    gains = drive.gains
    if gains is not None:
        yield from map(Setting, GAINS, gains.numbers)


def pdo_settings(drive: Drive) -> Iterator[list[Setting]]:
    """The PDOs one by one, each switched off while its mapping changes (14.20 to 14.31; only in Pre-Operational)."""
    received, sent = RECEIVED[drive.role], SENT[drive.role]
    for number in range(4):
        mapped = received[number] if number < len(received) else ()
        kind = _ON_SYNC if number == 0 else _AT_ONCE
        yield list(_pdo(0x1400 + number, 0x1600 + number, RXPDO[number] + drive.node_id, mapped, kind))
    for number in range(4):
        mapped = sent[number] if number < len(sent) else ()
        cob_id = _NO_RTR | TXPDO[number] + drive.node_id
        yield list(_pdo(0x1800 + number, 0x1A00 + number, cob_id, mapped, _ON_SYNC))


def _pdo(communication: int, mapping: int, cob_id: int, mapped: tuple[Object, ...], kind: int) -> Iterator[Setting]:
    yield Setting(Object(communication, 1, U32), _NOT_VALID | cob_id)
    if not mapped:
        return
    yield Setting(Object(communication, 2, U8), kind)
    yield Setting(Object(mapping, 0, U8), 0)
    for number, entry in enumerate(mapped, 1):
        yield Setting(Object(mapping, number, U32), entry.mapping)
    yield Setting(Object(mapping, 0, U8), len(mapped))
    yield Setting(Object(communication, 1, U32), cob_id)
