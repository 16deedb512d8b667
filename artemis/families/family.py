"""What a drive family is: tables that say how a drive of it is found, set up, commanded and understood. Pure data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from artemis.drive_states import DriveState
from artemis.families.objects import LOST_HEARTBEAT, POSITION_LIMITS, Object, ObjectType, Setting

Errors = Mapping[str, Mapping[int, str]]
"""By drive: rows of the fault table by EMCY error code."""
TRACTION, STEERING = "traction", "steering"
MOTORS = ("dc", "ec_sine", "ec_block")
ENCODERS = ("encoder_3_channel", "encoder_2_channel")
SENSORS = (*ENCODERS, "hall")
MAXON = 0x000000FB
SYNC_PERIOD, TORQUE_CONSTANT, PULSES = "SYNC period", "torque constant", "pulses"
"""Quantities that a family may need."""
HOME_INPUT = 1 << 2
"""Home switch among the digital inputs: bit 2 of 0x60FD (CiA 402); maxon numbers the functions of 0x2071 alike."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bits:
    """A number that stands in an object: its bits from `shift` on."""

    object: Object
    shift: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OptionCode:
    """A value that says what the drive does by itself, and what it is called where the drive does not keep it."""

    setting: Setting
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GainScale:
    """What the numbers of a family's gains mean."""

    units: tuple[float, ...]
    """Of each, in the order of `Family.gains`: V/A, V/(A·s); A·s/rad, A/rad; A/rad, A/(rad·s), A·s/rad, where angles
    are of the motor's shaft."""
    largest: int
    period: float
    """Of the velocity and position regulators [s]."""

    @property
    def velocity(self) -> tuple[float, ...]:
        """Units of P and I of the velocity regulator, whose output is the demanded current."""
        return self.units[2:4]

    @property
    def position(self) -> tuple[float, ...]:
        """Units of P, I and D of the position regulator, likewise."""
        return self.units[4:]


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """Everything in which drives differ, but for what the robot file says of one of them."""

    name: str
    """As in the robot file."""
    title: str
    """For people."""

    # ------------------------------------------------------------------------------------------ identity
    vendor: int
    generation: int | None
    """Second-last hexadecimal digit of a maxon hardware version; None: not one of maxon's."""
    hardware: Bits
    """What the robot file's `hardware_version` is compared with."""
    hardware_mask: int
    firmware: Bits
    oldest_firmware: int
    """Below it something is missing that artemis needs; a robot file cannot ask for less."""
    usual_firmware: int
    """What the robot file asks for where it says nothing."""
    witness: Object | None = None
    """Only drives of this family have it: asked for where the hardware version tells no generation."""

    # ------------------------------------------------------------------------------------------ device states
    mask: int
    """Bits of the statusword that tell the device state."""
    states: Mapping[int, DriveState]

    # ------------------------------------------------------------------------------------------ process data, by role
    modes: Mapping[str, int]
    """Modes of operation (object 0x6060)."""
    set_points: Mapping[str, Object]
    """The object that carries a drive's set-point in its operating mode."""
    received: Mapping[str, tuple[tuple[Object, ...], ...]]
    """RxPDO 1 (taken over at SYNC) and 2 (at once: stop frames); 3 and 4 are switched off."""
    sent: Mapping[str, tuple[tuple[Object, ...], ...]]
    """TxPDO 1 (statusword, position, perhaps the mode) and 2, both sampled at SYNC; 3 and 4 are switched off."""
    pdos: int = 4
    """So many it has each way."""
    velocity: Object
    current: Object | None
    analog: tuple[Object, ...]
    absolute: Object | None = None
    """What an absolute encoder shows, counts of its turn; None: the family has no input for one that is known here."""
    inputs: Object | None = None
    """Digital inputs by their functions, the home switch at `HOME_INPUT`."""
    supply: Object | None = None
    """Its supply voltage, where it measures that."""
    sto: Setting | None = None
    """Its inputs for safe torque off, and the bits that are set while they have their voltage: else it stays off."""
    supply_scale: float = 10.0
    """Units of `supply` per volt."""
    temperature: Object | None = None
    """Of its power stage, where it measures that."""
    temperature_scale: float = 10.0
    """Units of `temperature` per degree Celsius."""
    velocity_scale: float = 1.0
    """Units of velocities per rpm of the motor shaft."""
    acceleration_scale: float = 1.0
    """Units of accelerations per rpm/s."""
    current_scale: float = 1000.0
    """Units of `current` per ampere."""
    analog_scale: float = 1000.0
    """Units of `analog` per volt."""
    top_analog_v: float = 5.0
    """Highest voltage that its analog inputs read [V]."""
    analog_step: float | None = None
    """Step of the converter behind `analog` [V]: the alignment looks for edges between steps; None: it averages."""

    # ------------------------------------------------------------------------------------------ configuration
    configuration: tuple[tuple[Object, int | str], ...]
    """Objects in an order that the drive accepts, each with its value or the name of a quantity of the robot file."""
    choices: Mapping[str, Mapping[tuple[str, str], int]]
    """Quantities that follow from the types of motor and sensor; a pair that is not there cannot be driven."""
    with_absolute: Mapping[str, int] = field(default_factory=dict)
    """What is added to a quantity where an absolute encoder is connected."""
    own_bits: Mapping[str, int] = field(default_factory=dict)
    """Bits of a quantity that artemis sets; the others stay as the drive has them. Of one that is not named, all."""
    regulator_bits: Mapping[str, int] = field(default_factory=dict)
    """Bits that belong to the regulators' gains: they stay as they are where the robot file gives none."""
    observer: Mapping[str, int] = field(default_factory=dict)
    """What is added to a quantity where the velocity regulator has an observer."""
    inverted: Mapping[str, int] = field(default_factory=dict)
    """Bits that say that the sensor counts against the motor: they stay where the robot file says nothing of it."""
    cleared: tuple[Object, ...] = ()
    """Objects that a drive adds to its set-points, or that turn it around, where it has them: 0."""
    option_codes: tuple[OptionCode, ...] = ()
    forbidden: tuple[tuple[Setting, str], ...] = ()
    """Values that a drive which has the object must not have, and what they mean."""
    checks: tuple[tuple[Object, str, str], ...] = ()
    """What must be found once all that was written: object, name of the quantity, what it is called."""
    gains: tuple[Object, ...] = ()
    """Of the regulators: current P, I; velocity P, I; position P, I, D."""
    gain_scale: GainScale | None = None
    """None: not known, or it has no such gains."""
    memory: tuple[Object, ...] = ()
    """Four numbers of the user's own, which the drive keeps."""
    serial_protocol: str | None = None
    """Whose frames it speaks on a serial line: the mission's word for `bus.protocol`; None: not known."""
    moves_valid_pdos: bool = True
    """A PDO's identifier may be changed together with switching it off; else it is switched off first."""
    top_velocity: int = 0x7FFFFFFF
    """Largest profile velocity that it takes [units]."""
    top_counts: int = 0x7FFFFFFF
    """Most counts of an encoder per turn of the motor's shaft."""

    # ------------------------------------------------------------------------------------------ faults and time
    errors: Mapping[int, str]
    """EMCY error code -> row of the fault table."""
    resets: Mapping[int, str]
    """Error code -> NMT reset without which a drive stays in fault."""
    bit_rate: Object | None
    """A code for what it speaks once it is switched on again."""
    bit_rates: Mapping[int, int]
    """Its codes -> bit/s; 0: what it hears."""
    reset_time: float = 1.0
    """A node that was reset answers again after this time [s]."""
    state_time: float = 0.5
    """Longest wait for a device state [s]."""
    still_rpm: float = 0.0
    """A motor shaft that is slower than this stands, or one of which the sensor tells a count more or less [rpm]."""

    def state(self, statusword: int) -> DriveState:
        """The device state that a statusword (0x6041) tells; UNKNOWN for a pattern that the family does not have."""
        return self.states.get(statusword & self.mask, DriveState.UNKNOWN)

    @property
    def forgets(self) -> bool:
        """After a lost heartbeat it goes on only with its communication reset and configured again."""
        return LOST_HEARTBEAT in self.resets

    @property
    def gains_in_si(self) -> bool:
        """Its gains are in SI units in the robot file; else numbers without unit, as the drive has them."""
        return any(gain.type is ObjectType.U32 for gain in self.gains)

    def told_gains(self, numbers: Sequence[int], first: int = 0) -> tuple[float, ...]:
        """Gains, from place `first` on, that the drive has as these numbers, as the robot file has them."""
        if not self.gains_in_si or self.gain_scale is None:
            return tuple(numbers)
        units = self.gain_scale.units[first : first + len(numbers)]
        return tuple(round(number * unit, 6) for number, unit in zip(numbers, units, strict=True))

    @property
    def limits_position(self) -> bool:
        """It refuses positions beyond its own limits."""
        return any(object == POSITION_LIMITS[0] for object, _ in self.configuration)

    @property
    def interpolates(self) -> bool:
        """It is told how often set-points come."""
        return any(quantity == SYNC_PERIOD for _, quantity in self.configuration)

    def drives(self, motor: str, sensor: str) -> bool:
        """Whether a motor of this type can be driven with a sensor of that type."""
        return all((motor, sensor) in table for table in self.choices.values())


def for_motors(numbers: Mapping[str, int]) -> dict[tuple[str, str], int]:
    """A quantity that follows from the motor alone."""
    return {(motor, sensor): number for motor, number in numbers.items() for sensor in SENSORS}


def for_sensors(numbers: Mapping[str, int]) -> dict[tuple[str, str], int]:
    """A quantity that follows from the sensor alone."""
    return {(motor, sensor): number for sensor, number in numbers.items() for motor in MOTORS}


CIA402_MASK = 0x6F
"""Statusword bits 6, 5 and 3..0 (CiA 402, 6.3)."""
CIA402_STATES = {
    pattern | bit_5: state
    for pattern, state, either in (
        (0x00, DriveState.NOT_READY, True),
        (0x40, DriveState.SWITCH_ON_DISABLED, True),
        (0x21, DriveState.READY, False),
        (0x23, DriveState.SWITCHED_ON, False),
        (0x27, DriveState.OPERATION_ENABLE, False),
        (0x07, DriveState.QUICK_STOP_ACTIVE, False),
        (0x0F, DriveState.FAULT_REACTION_ENABLED, True),
        (0x08, DriveState.FAULT, True),
    )
    for bit_5 in ((0x00, 0x20) if either else (0x00,))
}
"""Patterns of the device profile; bit 5 tells nothing in four of the states. A fault reaction may be under power."""
