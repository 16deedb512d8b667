"""A drive as the robot file describes it, and what is wrong with such a description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

from pydantic import Field

from artemis.axles import Side
from artemis.config import Config, Quantity
from artemis.families import FAMILIES, GENERATIONS
from artemis.families.cia402 import (
    COMMANDS,
    ERRORS,
    NO_REACTION,
    OPTIONAL,
    POWER_CUTS,
    Cia402,
    SettingWords,
    family_from,
    is_ours,
)
from artemis.families.family import MAXON, PULSES, TORQUE_CONSTANT, Family
from artemis.families.objects import COMMUNICATION_ERROR
from artemis.yaml_file import KeyPath

Current = Annotated[int, Quantity(20, 65535, "mA")]
Unsigned32 = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]
TorqueConstant = Annotated[float, Quantity(0.1, 10_000.0, "mN·m/A")]
SiGain = Annotated[float, Quantity(0.0, 4294.0, "")]
"""The drive keeps millionths of it in 32 bit."""
CurrentI = Annotated[float, Quantity(0.0, 4_294_000.0, "V/(A·s)")]
Gain = Annotated[int, Field(ge=0, le=32767)]
AnyGain = Annotated[float, Field(ge=0)]
"""Of a drive that is not known yet."""
PiGains = Annotated[tuple[Gain, Gain], Field(strict=False)]
PidGains = Annotated[tuple[Gain, Gain, Gain], Field(strict=False)]
STOPPED = 2
"""Value of 0x1029:1 that ends SDO, too."""
USUAL_LAG_DEG, FACTORY_LAG = 3.0, 2000
"""Following error where the robot file says none: of a steered wheel [degrees], and what drives come with [counts]."""


class Motor(Config):
    """What the drive has to know of its motor."""

    type: Literal["dc", "ec_sine", "ec_block"]
    """dc: with brushes; ec_block: brushless, block commutation, which halls alone allow; ec_sine: brushless, sinusoidal
    commutation (EPOS and EPOS2: with an encoder beside the halls)."""
    pole_pairs: Annotated[int, Field(ge=1, le=255)]
    """Of the rotor; a motor of type dc has 1."""
    continuous_current_ma: Current
    """What the motor stands all the time (data sheet)."""
    output_current_ma: Current
    """Peak current: what the drive gives at most, for a short time."""
    thermal_time_constant_s: Annotated[float, Quantity(0.1, 540.0, "s")]
    """Of the winding (data sheet): says for how long the drive may give the peak current."""
    max_speed_rpm: Annotated[int, Quantity(100, 25000, "rpm")]
    """Highest speed of the motor shaft."""
    torque_constant_mnm_per_a: TorqueConstant | None = None
    """Families that regulate torque need it; the others do not know it."""


class Sensor(Config):
    """On the motor shaft. `counts_per_turn`: 4 x pulses, or 6 x pole pairs with halls only."""

    type: Literal["encoder_3_channel", "encoder_2_channel", "hall"]
    """Encoder with or without an index channel, or the motor's hall sensors alone."""
    counts_per_turn: Annotated[int, Field(ge=6, le=0x7FFFFFFF)]
    """Of the motor shaft: 4 x lines of an encoder, or 6 x pole pairs with halls only."""
    inverted: bool | None = None
    """It counts against the motor, as it is mounted or wired; if left out, the drive keeps what is set in it. Which way
    the wheel turns, `mirrored` says."""


class Gains(Config):
    """Regulator gains without unit, as the EPOS and the EPOS2 have them."""

    current: PiGains
    """P and I."""
    velocity: PiGains
    """P and I."""
    position: PidGains
    """P, I and D."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """In the order of the objects: current P, I; velocity P, I; position P, I, D."""
        return (*self.current, *self.velocity, *self.position)


class SiGains(Config):
    """Regulator gains in SI units, as the EPOS4 has them; angles are of the motor shaft."""

    current: Annotated[tuple[SiGain, CurrentI], Field(strict=False)]
    """P [V/A], I [V/(A·s)]."""
    velocity: Annotated[tuple[SiGain, SiGain], Field(strict=False)]
    """P [A·s/rad], I [A/rad]."""
    position: Annotated[tuple[SiGain, SiGain, SiGain], Field(strict=False)]
    """P [A/rad], I [A/(rad·s)], D [A·s/rad]."""
    observer: bool = False
    """The velocity regulator has an observer, else a low pass: the gains of one do not suit the other. Without gains in
    the robot file the drive keeps its own."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """As the drive has them, in the order of `Gains.numbers`: millionths, and of current I uV/(A·ms)."""
        proportional, integral = self.current
        others = [round(gain * 1e6) for gain in (*self.velocity, *self.position)]
        return (round(proportional * 1e6), round(integral * 1e3), *others)


class Drive(Config):
    """One drive: a node on the bus."""

    family: Literal["epos1", "epos2", "epos4", "cia402"] = "epos1"
    """Which kind of drive it is; several kinds may share a bus."""
    node_id: Annotated[int, Field(ge=1, le=126)]
    """Of the drive on the CAN bus, as it is set there; each has its own, other than `host_node_id`."""
    role: Literal["traction", "steering"]
    """What its motor does: it drives wheels, or steers them."""
    side: Side
    """Which wheel it moves; middle: the only one of its axle, or both by a linkage or a differential."""
    mirrored: bool
    """A positive count turns the wheel backwards (traction) or to the right (steering)."""
    hardware_version: Unsigned32
    """What the drive must be: 0x6010 is an EPOS 24/1, 0x6210 an EPOS 24/5 (the last digit of an EPOS and an EPOS2 does
    not count), 0x6150 an EPOS4 50/5; of another CiA 402 drive its product code."""
    min_firmware: Unsigned32 | None = None
    """Lowest software version; if left out, the one that the family's tables were made for, of cia402 any."""
    serial_number: Unsigned32 | None = None
    """What the drive must be, too: object 0x1018:4, as `artemis devices` shows it; if left out, any."""
    motor: Motor
    sensor: Sensor
    gear_ratio: Annotated[float, Quantity(1.0, 10_000.0, "motor turns per wheel turn")]
    """Motor turns per wheel turn."""
    gains: Gains | None = None
    """Of an EPOS or EPOS2, without unit; if left out, those that the drive has stored."""
    si_gains: SiGains | None = None
    """Of an EPOS4, in SI units; if left out, those that the drive has stored."""
    interpolation: bool = True
    """An EPOS4 moves evenly from one set-point to the next, and reports those that are missing (DRV-38); else it takes
    each at once."""
    following_error_counts: Annotated[int, Field(ge=1, le=0xFFFFFFFF)] | None = None
    """Lag of the motor behind its set-point [counts] beyond which a steering drive stops with a fault (DRV-25); if left
    out, 3 degrees of the wheel."""
    cia402: Cia402 | None = None
    """What the device profile leaves open; for `family: cia402` only."""

    @property
    def set_point(self) -> str:
        """Name of its part of `SetPoints`: rolling speed, or angle; one in the middle has both sides alike."""
        return f"{'speed' if self.role == 'traction' else 'steering'}_{'right' if self.side == 'right' else 'left'}"

    @property
    def lag_counts(self) -> int:
        """Lag behind its set-point beyond which it stops [counts]; of a traction drive, what it comes with."""
        if self.following_error_counts is not None:
            return self.following_error_counts
        usual = min(max(1, round(USUAL_LAG_DEG / 360.0 * self.counts_per_wheel_turn)), 0xFFFFFFFF)
        return FACTORY_LAG if self.role == "traction" else usual

    @property
    def counts_per_wheel_turn(self) -> float:
        """What its sensor counts in one turn of the wheel, through the gear."""
        return self.sensor.counts_per_turn * self.gear_ratio

    @property
    def interpolates(self) -> bool:
        """It is told how often set-points come, and moves evenly from one to the next."""
        return self.tables.interpolates and self.interpolation

    @property
    def tables(self) -> Family:
        """Those of its family."""
        return FAMILIES[self.family] if self.cia402 is None else family_from(self.cia402)

    @property
    def oldest_firmware(self) -> int:
        """Lowest software version that is accepted."""
        return self.tables.usual_firmware if self.min_firmware is None else self.min_firmware

    @property
    def operating_mode(self) -> int:
        """Mode of operation (object 0x6060)."""
        return self.tables.modes[self.role]

    @property
    def known_gains(self) -> Gains | SiGains | None:
        """Regulator gains in the robot file; None: it gives none."""
        return self.gains or self.si_gains

    @property
    def gain_numbers(self) -> tuple[int, ...]:
        """Regulator gains as the drive has them, in the order of its objects; (): the robot file gives none."""
        return () if self.known_gains is None else self.known_gains.numbers


def drive_problems(drive: Drive) -> Iterator[tuple[KeyPath, str]]:
    """What its family needs and is not there, or what it does not know: path of the key, and what is wrong."""
    if (drive.cia402 is None) == (drive.family == "cia402"):
        text = "this key is missing: it says what CiA 402 leaves open"
        other = f"only for `family: cia402`; this drive is {drive.family}"
        yield ("cia402",), text if drive.cia402 is None else other
        return
    yield from _identity(drive)
    yield from _motor(drive)
    yield from _profile(drive)


def _identity(drive: Drive) -> Iterator[tuple[KeyPath, str]]:
    family, version = drive.tables, drive.hardware_version
    if family.vendor == MAXON and family.generation is not None:
        if version > 0xFFFF:
            yield ("hardware_version",), f"expected at most 65535, found {version}"
        elif (other := _generation(version) or family).generation != family.generation:
            text = f"0x{version:04X} is a hardware version of the family {other.name}"
            yield ("hardware_version",), f"{text} ({other.title}), this drive is {family.name}"
        elif _generation(version) is None and _generation(int(str(version), 16)) is not None:
            yield ("hardware_version",), f"{version} is 0x{version:04X}, of no drive that is known: write 0x{version}"
    if drive.oldest_firmware < family.oldest_firmware:
        text = f"expected at least 0x{family.oldest_firmware:04X}, found 0x{drive.oldest_firmware:04X}"
        yield ("min_firmware",), f"{text}: older ones do not watch our heartbeat"


def _generation(version: int) -> Family | None:
    return GENERATIONS.get(version >> 4 & 0xF)


def serial_problem(drives: Mapping[str, Drive], protocol: object, key: str) -> str:
    """Why the first of these drives, by name, is not asked in this protocol on a serial line; empty: it is.

    `key`: what is written before a protocol.
    """
    name, first = next(iter(drives.items()))
    spoken = first.tables.serial_protocol
    if protocol == spoken:
        return ""
    hint = f"write {key} {spoken}" if spoken else "artemis knows no serial protocol of it"
    return f"the line leads to {name} ({first.tables.title}): {hint}"


def _motor(drive: Drive) -> Iterator[tuple[KeyPath, str]]:
    family, motor, sensor = drive.tables, drive.motor, drive.sensor
    wants_torque = any(quantity == TORQUE_CONSTANT for _, quantity in family.configuration)
    if wants_torque != (motor.torque_constant_mnm_per_a is not None):
        text = "this key is missing: of the motor's data sheet" if wants_torque else "has no object for it"
        yield ("motor", "torque_constant_mnm_per_a"), f"{text} ({family.title})"
    if sensor.type == "hall":
        if sensor.counts_per_turn != 6 * motor.pole_pairs:
            text = f"expected 6 x pole_pairs = {6 * motor.pole_pairs} with halls, found {sensor.counts_per_turn}"
            yield ("sensor", "counts_per_turn"), text
    elif sensor.counts_per_turn > family.top_counts:
        text = f"expected at most {family.top_counts}, which is what {family.title} takes of an encoder"
        yield ("sensor", "counts_per_turn"), f"{text}, found {sensor.counts_per_turn}"
    elif sensor.counts_per_turn % 4 and any(quantity == PULSES for _, quantity in family.configuration):
        text = f"expected four times the lines of an encoder ({family.title}), found {sensor.counts_per_turn}"
        yield ("sensor", "counts_per_turn"), text
    if not family.drives(motor.type, sensor.type):
        yield ("sensor", "type"), f"a motor of type {motor.type} cannot be driven with {sensor.type} ({family.title})"
    in_si = family.gains_in_si
    if sensor.inverted is not None and (sensor.type == "hall" or not family.inverted):
        text = "of halls it is not known" if family.inverted else f"not for this drive ({family.title})"
        yield ("sensor", "inverted"), f"{text}: use the maker's own tool"
    if not drive.interpolation and family.name != "epos4":
        own = "`cia402: {interpolation_period: false}`" if drive.cia402 else "it takes each set-point at once anyway"
        yield ("interpolation",), f"not for this drive ({family.title}): {own}"
    for key, given, fits in (
        ("gains", drive.gains, bool(family.gains) and not in_si),
        ("si_gains", drive.si_gains, in_si),
    ):
        if given is not None and not fits:
            other = "si_gains" if in_si else "gains" if family.gains else "the maker's own tool"
            yield (key,), f"not for this drive ({family.title}): use {other}"


def _profile(drive: Drive) -> Iterator[tuple[KeyPath, str]]:
    """Of a drive that is described by the robot file alone."""
    words = drive.cia402
    if words is None:
        return
    if (words.operating_mode == 8) != (drive.role == "steering"):
        fits = "8" if drive.role == "steering" else "3 or 9"
        yield ("cia402", "operating_mode"), f"expected {fits} for {drive.role}, found {words.operating_mode}"
    if words.current is not None and words.current.type.startswith("u"):
        text = f"{words.current.type} has no sign: a motor that feeds back would look like one that takes current; "
        yield ("cia402", "current", "type"), text + "name an object of type i8, i16 or i32, or leave `current` out"
    if words.analog_inputs is not None:
        first, second = [each.units_per_v for each in words.analog_inputs]
        if first != second:
            text = f"expected {first:g}, as of the first one, found {second:g}"
            yield ("cia402", "analog_inputs", 1, "units_per_v"), text
    if words.sto is not None and not words.sto.fits:
        text = f"0x{words.sto.closed:X} has bits that no {words.sto.type} has: the inputs would always count as open"
        yield ("cia402", "sto", "closed"), text
    yield from _option_codes(words)
    yield from _errors(words)
    for number, index in enumerate(words.absent):
        if index not in OPTIONAL:
            known = ", ".join(f"0x{each:04X}" for each in OPTIONAL)
            yield ("cia402", "absent", number), f"expected one of {known}, found 0x{index:04X}"
    yield from _settings(words)
    for pdo in drive.tables.sent[drive.role]:
        if (length := sum(object.type.size for object in pdo)) > 8:
            yield ("cia402",), f"{', '.join(map(str, pdo))} have {length} bytes; a PDO holds 8"


def _settings(words: Cia402) -> Iterator[tuple[KeyPath, str]]:
    """Values of objects that the drive lacks, or that artemis writes, and such as do not fit."""
    for number, given in enumerate(words.settings):
        if is_ours(words, given):
            yield ("cia402", "settings", number), f"{given.object} is written by artemis: leave it out"
        elif given.index in words.absent:
            text = f"{given.object} is one that the drive lacks (`absent`): take it out of one of them"
            yield ("cia402", "settings", number), text
        elif not given.fits:
            yield ("cia402", "settings", number, "value"), f"{given.value} is no {given.type}"
        elif _hides_the_loss(words, given):
            code = f"`abort_connection: {words.option_codes.abort_connection}`"
            text = "the drive does not leave Operational for Pre-Operational when our heartbeat is lost, and with"
            text += f" {code} that is no fault: nothing would show that it watches the heartbeat;"
            if given.value == STOPPED:
                text = "the drive would be Stopped when our heartbeat is lost, where nobody can ask it, and with"
                text += f" {code} that is no fault;"
            text = f"with {given.value} {text}"
            yield ("cia402", "settings", number, "value"), f"{text} write 0 here, or `abort_connection: 1`"


def _hides_the_loss(words: Cia402, given: SettingWords) -> bool:
    """Whether a lost heartbeat would neither be a fault nor end the exchange of process data (COM-30)."""
    stays = (given.index, given.subindex) == (COMMUNICATION_ERROR.index, COMMUNICATION_ERROR.subindex) and given.value
    return bool(stays) and words.option_codes.abort_connection in COMMANDS


def _errors(words: Cia402) -> Iterator[tuple[KeyPath, str]]:
    """Codes that mean something else already, and rows that no drive reports."""
    rows = {row for family in FAMILIES.values() for row in family.errors.values()}
    found: set[int] = set()
    for number, given in enumerate(words.errors):
        at = "cia402", "errors", number
        if given.code in ERRORS:
            yield (*at, "code"), f"0x{given.code:04X} means {ERRORS[given.code]} already (CiA 301, CiA 402)"
        elif given.code in found:
            yield (*at, "code"), f"0x{given.code:04X} is given twice"
        if given.row not in rows:
            yield (*at, "row"), f"{given.row} is no error that a drive reports: see `artemis faults`"
        found.add(given.code)


def _option_codes(words: Cia402) -> Iterator[tuple[KeyPath, str]]:
    """Those with which a wheel would keep turning."""
    if words.option_codes.abort_connection == NO_REACTION.value:
        text = "0 is no reaction: without a heartbeat the drive would keep its last set-point"
        yield ("cia402", "option_codes", "abort_connection"), text
    for key, code in zip(("abort_connection", "quick_stop", "fault_reaction"), POWER_CUTS, strict=True):
        if getattr(words.option_codes, key) == code.value and not words.brake:
            text = f"{code.value} cuts the power: the wheel coasts; choose another reaction, or write `brake: true` "
            text += "where a brake then closes"
            yield ("cia402", "option_codes", key), text
