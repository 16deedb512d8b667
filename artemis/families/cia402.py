"""Any other drive of the device profile CiA 402 on CANopen: what the profile leaves open, the robot file says.

Sources: CiA 402 (states, modes, option codes, units); what drivers of several makers' drives have to be told
(`ros-industrial/ros2_canopen`, and the threads about it).
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Literal

from pydantic import Field

from artemis.config import Config, Quantity
from artemis.families.family import (
    CIA402_MASK,
    CIA402_STATES,
    STEERING,
    SYNC_PERIOD,
    TRACTION,
    Bits,
    Family,
    OptionCode,
)
from artemis.families.objects import (
    ABORT_CONNECTION,
    ACCELERATION,
    CONSUMER_HEARTBEAT,
    CONTROLWORD,
    DECELERATION,
    DIGITAL_INPUTS,
    FAULT_REACTION,
    FOLLOWING_ERROR,
    INTERPOLATION_EXPONENT,
    INTERPOLATION_TIME,
    LIMIT_OFF,
    LOST_HEARTBEAT,
    MODE,
    MODE_DISPLAY,
    OFFSETS,
    POLARITY,
    POSITION,
    POSITION_LIMITS,
    PRODUCER_HEARTBEAT,
    PRODUCT,
    QUICK_STOP_DECELERATION,
    QUICK_STOP_OPTION,
    REVISION,
    STATUSWORD,
    STORE,
    TARGET_POSITION,
    TARGET_VELOCITY,
    TOP_PROFILE_VELOCITY,
    VELOCITY,
    Object,
    ObjectType,
    Setting,
)

PROFILE_VELOCITY = 3
"""Mode of operation."""
Unsigned32 = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]
OptionValue = Annotated[int, Field(ge=-128, le=127)]
Scale = Annotated[float, Quantity(1e-6, 1e9, "")]


class ObjectWords(Config):
    """An object of the drive."""

    index: Annotated[int, Field(ge=0x1000, le=0xFFFF)]
    """Of the object in the drive's object dictionary, such as 0x6078."""
    subindex: Annotated[int, Field(ge=0, le=255)] = 0
    """Of the object."""
    type: Literal["u8", "u16", "u32", "i8", "i16", "i32"]
    """Integer without (u) or with (i) sign, of so many bits."""

    @property
    def object(self) -> Object:
        """As the driver knows it."""
        return Object(self.index, self.subindex, ObjectType[self.type.upper()])


class SettingWords(ObjectWords):
    """A value that the drive must have before it is enabled."""

    value: int
    """A whole number that fits the type."""

    @property
    def fits(self) -> bool:
        """Whether the value is one of its type."""
        size, signed = 8 * self.object.type.size, self.type.startswith("i")
        return -(1 << size - 1) <= self.value < 1 << size - 1 if signed else 0 <= self.value < 1 << size


class CurrentWords(ObjectWords):
    """The motor current with its sign, an object of type i8 to i32 that can be mapped into a PDO."""

    units_per_a: Scale
    """What the object shows per ampere."""


class AnalogWords(ObjectWords):
    """One analog input, an object that can be mapped into a PDO."""

    units_per_v: Scale
    """What the object shows per volt at the input; the same of both inputs."""

    @property
    def highest(self) -> float:
        """Largest voltage that the object can show [V]."""
        return float((1 << 8 * self.object.type.size - self.type.startswith("i")) - 1) / self.units_per_v


class SupplyWords(ObjectWords):
    """The supply voltage, an object that is read by SDO."""

    units_per_v: Scale
    """What the object shows per volt."""


class TemperatureWords(ObjectWords):
    """The temperature of the power stage, an object that is read by SDO."""

    units_per_degree: Scale
    """What the object shows per degree Celsius."""


class StoWords(ObjectWords):
    """The inputs for safe torque off, an object that is read by SDO."""

    closed: Annotated[int, Field(ge=1, le=0xFFFFFFFF)]
    """Its bits that are all set while the inputs have their voltage."""

    @property
    def fits(self) -> bool:
        """Whether the object has all of these bits."""
        return not self.closed >> 8 * self.object.type.size


class ErrorWords(Config):
    """An error code of the maker's own, and the row of the fault table that it means."""

    code: Annotated[int, Field(ge=1, le=0xFFFF)]
    """EMCY error code, as the drive sends it."""
    row: str
    """Id in the fault table, such as DRV-11: one that drives report."""


class OptionCodes(Config):
    """What the drive does by itself. A code that is left out stays; one that lets a wheel go on is refused."""

    abort_connection: OptionValue | None = None
    """0x6007: our heartbeat is lost. Not 0, which is no action; 2 only with a `brake`: it cuts the power, and the wheel
    would coast. A drive that has such a code in it is refused."""
    quick_stop: OptionValue | None = None
    """0x605A: what it does for a quick stop. 0 only with a `brake`: it cuts the power, and the wheel would coast."""
    fault_reaction: OptionValue | None = None
    """0x605E: what it does in a fault. 0 only with a `brake`, likewise."""


class Cia402(Config):
    """What CiA 402 leaves open. `hardware_version` is the product code 0x1018:2, `min_firmware` the revision :3."""

    vendor_id: Unsigned32
    """Object 0x1018:1."""
    operating_mode: Literal[3, 8, 9]
    """Traction: profile velocity (3) or cyclic synchronous velocity (9); steering: cyclic synchronous position (8)."""
    velocity_units_per_rpm: Scale
    """Of 0x60FF, 0x606C and 0x607F; rpm of the motor shaft."""
    acceleration_units_per_rpm_s: Scale
    """Of 0x6083 to 0x6085."""
    current: CurrentWords | None = None
    """The object that shows the motor current; if left out, nobody measures it."""
    analog_inputs: Annotated[tuple[AnalogWords, AnalogWords], Field(strict=False)] | None = None
    """Both potentiometers of a steered wheel."""
    absolute_encoder: ObjectWords | None = None
    """Instead of them what an absolute encoder shows, counts of its turn: an object that can be mapped into a PDO."""
    pdos: Annotated[int, Field(ge=2, le=512)] = 4
    """So many process data objects it has each way: what artemis does not use of them is switched off."""
    supply: SupplyWords | None = None
    """The object that shows its supply voltage, such as 0x6079; if left out, it measures none."""
    temperature: TemperatureWords | None = None
    """The object that shows the temperature of its power stage; if left out, it measures none."""
    sto: StoWords | None = None
    """The object that shows why a drive stays off whose inputs for safe torque off are open."""
    option_codes: OptionCodes = OptionCodes()
    brake: bool = False
    """A brake closes by itself where the power is cut: only then may option codes cut it while the wheel turns."""
    settings: Annotated[tuple[SettingWords, ...], Field(strict=False)] = ()
    """Written after everything else, in this order."""
    absent: Annotated[tuple[Annotated[int, Field(ge=0, le=0xFFFF)], ...], Field(strict=False)] = ()
    """Objects that the drive does not have: following error, position limits, highest speed, its own ramps."""
    errors: Annotated[tuple[ErrorWords, ...], Field(strict=False)] = ()
    """What it tells beside the codes of CiA 301 and 402."""
    reset_after_lost_heartbeat: bool = False
    """A fault reset is refused until its communication was reset."""
    interpolation_period: bool = True
    """It has object 0x60C2, which is given the SYNC period in the cyclic modes."""
    reset_time_s: Annotated[float, Quantity(0.05, 30.0, "s")] = 2.0
    """A node that was reset answers again after it."""
    state_time_s: Annotated[float, Quantity(0.05, 30.0, "s")] = 1.5
    """Longest time for a change of state, and from being told to until it is enabled: above 1 s COM-03 waits for it."""


OPTIONAL = (0x6065, 0x607D, 0x607F, 0x6083, 0x6084, 0x6085)
"""Objects that a drive may lack."""
ERRORS = {
    0x1000: "DRV-01",
    0x2310: "DRV-02",
    0x3210: "DRV-03",
    0x3220: "DRV-04",
    0x4210: "DRV-06",
    0x4310: "DRV-06",
    0x5113: "DRV-05",
    0x6100: "DRV-07",
    0x6320: "DRV-08",
    0x7320: "DRV-11",
    0x8110: "DRV-18",
    0x8120: "DRV-19",
    0x8130: "DRV-20",
    0x8150: "DRV-21",
    0x8210: "DRV-24",
    0x8611: "DRV-25",
}
"""Codes that CiA 301 and CiA 402 give a meaning."""


NO_REACTION = Setting(ABORT_CONNECTION, 0)
"""The drive goes on with its last set-point when our heartbeat is lost."""
POWER_CUTS = (Setting(ABORT_CONNECTION, 2), Setting(QUICK_STOP_OPTION, 0), Setting(FAULT_REACTION, 0))
"""The drive cuts its power and the wheel coasts (CiA 402, option codes): without a brake that is no stop."""
COMMANDS = 2, 3
"""Values of 0x6007 that make a lost heartbeat a command (disable voltage, quick stop), not a fault."""
_OPTIONS = (ABORT_CONNECTION, QUICK_STOP_OPTION, FAULT_REACTION)
_OURS = frozenset(
    object.index
    for object in (CONSUMER_HEARTBEAT, STORE, CONTROLWORD, TARGET_POSITION, TARGET_VELOCITY, *OFFSETS, *_OPTIONS)
)
_PDOS = range(0x1400, 0x1C00)


def is_ours(words: Cia402, given: ObjectWords) -> bool:
    """Whether artemis itself writes the object: what a robot file sets must not undo a watchdog, or a mapping."""
    own = {(object.index, object.subindex) for object, _ in _own_configuration(words)}
    return given.index in _OURS or given.index in _PDOS or (given.index, given.subindex) in own


@cache
def family_from(words: Cia402) -> Family:
    """The family of one drive that is described so."""
    set_points = {TRACTION: TARGET_VELOCITY, STEERING: TARGET_POSITION}
    current = words.current.object if words.current else None
    analog = tuple(each.object for each in words.analog_inputs or ())
    more = (current,) if current else ()
    return Family(
        name="cia402",
        title="CiA 402 drive",
        vendor=words.vendor_id,
        generation=None,
        hardware=Bits(object=PRODUCT),
        hardware_mask=0xFFFFFFFF,
        firmware=Bits(object=REVISION),
        oldest_firmware=0,
        usual_firmware=0,
        mask=CIA402_MASK,
        states=CIA402_STATES,
        modes=dict.fromkeys(set_points, words.operating_mode),
        set_points=set_points,
        received={role: ((CONTROLWORD, target), (CONTROLWORD,)) for role, target in set_points.items()},
        sent={
            TRACTION: ((STATUSWORD, POSITION, MODE_DISPLAY), (VELOCITY, *more)),
            STEERING: ((STATUSWORD, POSITION, MODE_DISPLAY), (*analog, *more) or (VELOCITY,)),
        },
        pdos=words.pdos,
        velocity=VELOCITY,
        current=current,
        analog=analog,
        absolute=words.absolute_encoder.object if words.absolute_encoder else None,
        inputs=DIGITAL_INPUTS,
        supply=words.supply.object if words.supply else None,
        supply_scale=words.supply.units_per_v if words.supply else 1.0,
        temperature=words.temperature.object if words.temperature else None,
        temperature_scale=words.temperature.units_per_degree if words.temperature else 1.0,
        sto=Setting(words.sto.object, words.sto.closed) if words.sto else None,
        velocity_scale=words.velocity_units_per_rpm,
        acceleration_scale=words.acceleration_units_per_rpm_s,
        current_scale=words.current.units_per_a if words.current else 1.0,
        top_analog_v=min((each.highest for each in words.analog_inputs or ()), default=0.0),
        analog_scale=words.analog_inputs[0].units_per_v if words.analog_inputs else 1.0,
        configuration=(*_own_configuration(words), *((each.object, each.value) for each in words.settings)),
        choices={},
        cleared=OFFSETS if any(each.index == POLARITY.index for each in words.settings) else (*OFFSETS, POLARITY),
        option_codes=_option_codes(words.option_codes),
        forbidden=(
            (NO_REACTION, "no reaction to a lost connection"),
            *((cut, "cuts the power: without a brake the wheel coasts") for cut in POWER_CUTS if not words.brake),
        ),
        moves_valid_pdos=False,
        errors={**ERRORS, **{each.code: each.row for each in words.errors}},
        resets={LOST_HEARTBEAT: "communication"} if words.reset_after_lost_heartbeat else {},
        bit_rate=None,
        bit_rates={},
        reset_time=words.reset_time_s,
        state_time=words.state_time_s,
        still_rpm=1.0,  # a fine encoder tells many counts of a shaft that stands
    )


def _own_configuration(words: Cia402) -> tuple[tuple[Object, int | str], ...]:
    interpolates = words.interpolation_period and words.operating_mode != PROFILE_VELOCITY
    interpolation = ((INTERPOLATION_EXPONENT, -3), (INTERPOLATION_TIME, SYNC_PERIOD)) if interpolates else ()
    usual: tuple[tuple[Object, int | str], ...] = (
        (FOLLOWING_ERROR, "following error"),
        *zip(POSITION_LIMITS, LIMIT_OFF, strict=True),
        (TOP_PROFILE_VELOCITY, "top velocity"),
        (ACCELERATION, "acceleration"),
        (DECELERATION, "deceleration"),
        (QUICK_STOP_DECELERATION, "quick-stop deceleration"),
    )
    return (
        *((object, value) for object, value in usual if object.index not in words.absent),
        (PRODUCER_HEARTBEAT, "node heartbeat"),
        (CONSUMER_HEARTBEAT, "host watch"),
        *interpolation,
        (MODE, "mode"),
    )


def _option_codes(words: OptionCodes) -> tuple[OptionCode, ...]:
    return tuple(
        OptionCode(setting=Setting(object, value), name=name)
        for object, value, name in (
            (ABORT_CONNECTION, words.abort_connection, "reaction to a lost connection"),
            (QUICK_STOP_OPTION, words.quick_stop, "quick stop"),
            (FAULT_REACTION, words.fault_reaction, "reaction to a fault"),
        )
        if value is not None
    )
