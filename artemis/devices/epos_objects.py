"""The configuration of a drive: what its family's tables and the robot file make of it."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

from artemis.axles import AbsoluteEncoder
from artemis.devices.canopen import RXPDO, TXPDO, PdoLayout
from artemis.drive_numbers import DRIVE_RAMP, FASTER, STEERING_RAMP
from artemis.drive_schema import Drive
from artemis.families.family import SYNC_PERIOD, TORQUE_CONSTANT
from artemis.families.objects import MODE_DISPLAY, U8, U32, Object, Setting
from artemis.vehicle import RobotFile

PERIOD = 0.02
"""Of SYNC, where nobody says another [s]: outside of a run there is none."""
UNREADABLE = -1
"""Error code that stands for an emergency frame of the wrong length."""
JITTER = 0.1
"""Two frames that seem to have come at once may be sampled so far apart [s]."""
HOST_WATCH_MS = 200
"""A drive stops by itself when our heartbeat is missing for this long."""
NODE_HEARTBEAT_MS = 100
NOT_VALID = 0x80000000
"""Bit of a PDO's COB-ID: the PDO is switched off."""
FIRST_PDOS = 4
"""So many each way have identifiers by default."""
_NO_RTR = 0x40000000
_ON_SYNC, _AT_ONCE = 1, 255


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
        self.velocity = self.rpm * drive.tables.velocity_scale
        """The drive's units of velocity per m/s or rad/s of the wheel, signed."""
        self.fastest = FASTER * drive.motor.max_speed_rpm / abs(self.rpm)
        """No motor turns the wheel faster [m/s, rad/s]."""


class PdoPlaces:
    """The PDOs of a drive, and where in them stands what; -1: nowhere."""

    def __init__(self, robot: RobotFile, drive: Drive) -> None:
        family = drive.tables
        received, sent = family.received[drive.role], robot.sent(drive)
        self.set_point, self.stop = [PdoLayout([o.type for o in pdo]) for pdo in received]
        self.status, self.details = [PdoLayout([o.type for o in pdo]) for pdo in sent]
        self.early_mode = MODE_DISPLAY in sent[0]
        """TxPDO 1 has the mode, in its third place. The others are places in TxPDO 2."""
        self.velocity = _place(family.velocity, sent[1])
        self.analog = _place(family.analog[0], sent[1]) if family.analog else -1
        """Of the first analog input; the second follows."""
        self.angle_sensor = _place(robot.angle_object(drive), sent[1])
        self.current = _place(family.current, sent[1])
        self.mode = _place(MODE_DISPLAY, sent[1])
        self.per_volt, self.per_ampere = family.analog_scale, family.current_scale


def _place(wanted: Object | None, mapped: tuple[Object, ...]) -> int:
    return mapped.index(wanted) if wanted in mapped else -1


def wrapped(counts: int) -> int:
    """Object 0x6064 is a signed 32-bit counter that wraps."""
    return ((counts + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def quantities(robot: RobotFile, drive: Drive, period: float) -> dict[str, int]:
    """What the tables of a family ask the robot file for, in the drive's units; `period` of SYNC [s].

    What the robot file does not give is not there, and not written.
    """
    motor, sensor, limits, family = drive.motor, drive.sensor, robot.limits, drive.tables
    rpm = abs(Units(robot, drive).rpm)
    if drive.role == "traction":
        ramps = DRIVE_RAMP * rpm, limits.quick_stop_deceleration_m_s2 * rpm
        top = limits.wheel_speed_m_s * rpm
    else:
        ramps = STEERING_RAMP, STEERING_RAMP
        top = motor.max_speed_rpm
    ramp, quick_stop = (round(each * family.acceleration_scale) for each in ramps)
    found = {
        "continuous current": motor.continuous_current_ma,
        "output current": motor.output_current_ma,
        "pole pairs": motor.pole_pairs,
        "motor speed": motor.max_speed_rpm,
        "thermal time": round(motor.thermal_time_constant_s * 10),
        "counts": sensor.counts_per_turn,
        "following error": drive.lag_counts,
        "top velocity": min(family.top_velocity, round(top * family.velocity_scale)),
        "acceleration": ramp,
        "deceleration": ramp,
        "quick-stop deceleration": quick_stop,
        "node heartbeat": NODE_HEARTBEAT_MS,
        "host watch": robot.host_node_id << 16 | HOST_WATCH_MS,
        SYNC_PERIOD: round(period * 1000) if drive.interpolation else 0,
        "mode": drive.operating_mode,
        "axis polarity": 0,
        **{f"gain {number}": gain for number, gain in enumerate(drive.gain_numbers)},
        **{name: table[motor.type, sensor.type] for name, table in family.choices.items()},
    }
    if sensor.type != "hall":
        found["pulses"] = sensor.counts_per_turn // 4
    if motor.torque_constant_mnm_per_a is not None:
        found[TORQUE_CONSTANT] = round(motor.torque_constant_mnm_per_a * 1000)
    source = robot.angle_source(drive.side) if drive.role == "steering" else None
    if isinstance(source, AbsoluteEncoder):
        # the frame has its bits of one turn in byte 1, of several in byte 2; the position those of one turn in byte 0
        found |= {"SSI frame": source.bits << 8, "SSI position": source.bits, "SSI coding": source.coding == "gray"}
        found |= {name: found[name] + more for name, more in family.with_absolute.items()}
    if drive.si_gains is not None and drive.si_gains.observer:
        found |= {name: found[name] + more for name, more in family.observer.items()}
    if sensor.inverted is not None:
        found |= {name: found.get(name, 0) | bit * sensor.inverted for name, bit in family.inverted.items()}
    return found


def own_bits(drive: Drive, quantity: str) -> int:
    """Bits of a quantity that are set in the drive; the others stay as they are."""
    family = drive.tables
    bits = family.own_bits.get(quantity, -1)
    if drive.sensor.inverted is not None:
        bits |= family.inverted.get(quantity, 0)
    return bits if drive.gain_numbers else bits & ~family.regulator_bits.get(quantity, 0)


def observer_of(drive: Drive) -> Setting | None:
    """What the drive has where its velocity regulator has an observer; None: its family knows of none."""
    family = drive.tables
    for object, quantity in family.configuration:
        if isinstance(quantity, str) and quantity in family.observer:
            usual = family.choices[quantity][drive.motor.type, drive.sensor.type]
            return Setting(object, usual + family.observer[quantity], family.regulator_bits[quantity])
    return None


def settings(robot: RobotFile, drive: Drive, period: float) -> Iterator[Setting]:
    """Everything that is configured but the PDOs, in an order that the drive accepts; `period` of SYNC [s]."""
    known = quantities(robot, drive, period)
    for object, value in drive.tables.configuration:
        if not isinstance(value, str):
            yield Setting(object, value)
        elif value in known:
            yield Setting(object, known[value], own_bits(drive, value))


def pdo_settings(robot: RobotFile, drive: Drive) -> Iterator[list[Setting]]:
    """The first PDOs one by one, switched off while their mapping changes (14.20 to 14.31; only in Pre-Operational)."""
    received, sent = drive.tables.received[drive.role], robot.sent(drive)
    first = range(min(FIRST_PDOS, drive.tables.pdos))
    for number in first:
        mapped = received[number] if number < len(received) else ()
        kind = _ON_SYNC if number == 0 else _AT_ONCE
        yield list(_pdo(0x1400 + number, 0x1600 + number, RXPDO[number] + drive.node_id, mapped, kind))
    for number in first:
        mapped = sent[number] if number < len(sent) else ()
        cob_id = _NO_RTR | TXPDO[number] + drive.node_id
        yield list(_pdo(0x1800 + number, 0x1A00 + number, cob_id, mapped, _ON_SYNC))


def more_pdos(drive: Drive) -> Iterator[Object]:
    """COB-IDs of the PDOs that have no identifiers by default (CiA 301, 7.3.3): they are switched off as they are."""
    for communication in (0x1400, 0x1800):
        for number in range(FIRST_PDOS, drive.tables.pdos):
            yield Object(communication + number, 1, U32)


def _pdo(communication: int, mapping: int, cob_id: int, mapped: tuple[Object, ...], kind: int) -> Iterator[Setting]:
    yield Setting(Object(communication, 1, U32), NOT_VALID | cob_id)
    if not mapped:
        return
    yield Setting(Object(communication, 2, U8), kind)
    yield Setting(Object(mapping, 0, U8), 0)
    for number, entry in enumerate(mapped, 1):
        yield Setting(Object(mapping, number, U32), entry.mapping)
    yield Setting(Object(mapping, 0, U8), len(mapped))
    yield Setting(Object(communication, 1, U32), cob_id)
