"""The first-generation EPOS.

Source: EPOS firmware specification, April 2010: chapters 13 and 14 (objects, units), 8.1 (states), 12.2 (errors). Units
are counts (quadcounts), rpm and rpm/s of the motor shaft, mA and ms. It is not a generic CiA 402 drive: bits 8 and 14
of the statusword belong to the state, Refresh and Measure Init exist, it has no option codes.
"""

from __future__ import annotations

from artemis.drive_states import DriveState
from artemis.families.family import MAXON, SENSORS, STEERING, TRACTION, Bits, Family, GainScale, for_motors, for_sensors
from artemis.families.objects import (
    ACCELERATION,
    CONSUMER_HEARTBEAT,
    CONTROLWORD,
    DECELERATION,
    FOLLOWING_ERROR,
    I16,
    I32,
    LIMIT_OFF,
    MODE,
    MODE_DISPLAY,
    MOTOR_TYPE,
    OTHER_CONSUMER_HEARTBEAT,
    POSITION,
    POSITION_LIMITS,
    PRODUCER_HEARTBEAT,
    PROFILE_TYPE,
    QUICK_STOP_DECELERATION,
    STATUSWORD,
    TARGET_VELOCITY,
    TOP_PROFILE_VELOCITY,
    U8,
    U16,
    Object,
)

POSITION_SETTING = Object(0x2062, 0, I32)
ANALOG = Object(0x207C, 1, I16), Object(0x207C, 2, I16)
VELOCITY_AVERAGED = Object(0x2028, 0, I32)
CURRENT = Object(0x6078, 0, I16)
INPUTS = Object(0x2071, 1, U16)
PULSES = Object(0x2210, 1, U16)
GAINS = tuple(
    Object(0x60F6 + regulator, number, I16)
    for regulator, number in ((0, 1), (0, 2), (3, 1), (3, 2), (5, 1), (5, 2), (5, 3))
)

STATES = {
    0x0000: DriveState.START,
    0x0100: DriveState.NOT_READY,
    0x0140: DriveState.SWITCH_ON_DISABLED,
    0x0121: DriveState.READY,
    0x0123: DriveState.SWITCHED_ON,
    0x4123: DriveState.REFRESH,
    0x4133: DriveState.MEASURE_INIT,
    0x0137: DriveState.OPERATION_ENABLE,
    0x0117: DriveState.QUICK_STOP_ACTIVE,
    0x010F: DriveState.FAULT_REACTION_DISABLED,
    0x011F: DriveState.FAULT_REACTION_ENABLED,
    0x0108: DriveState.FAULT,
}
"""Statusword bits 14, 8 and 6..0 (table 1 of the specification)."""

ERRORS = {
    0x1000: "DRV-01",
    0x2310: "DRV-02",
    0x3210: "DRV-03",
    0x3220: "DRV-04",
    0x5113: "DRV-05",
    0x4210: "DRV-06",
    0x6100: "DRV-07",
    0x6320: "DRV-08",
    0x7320: "DRV-11",
    0xFF0A: "DRV-12",
    0xFF02: "DRV-13",
    0xFF03: "DRV-13",
    0xFF01: "DRV-14",
    0xFF04: "DRV-15",
    0xFF08: "DRV-16",
    0x8110: "DRV-18",
    0x8111: "DRV-18",
    0x8120: "DRV-19",
    0x8130: "DRV-20",
    0x8150: "DRV-21",
    0x81FD: "DRV-22",
    0x81FE: "DRV-23",
    0x81FF: "DRV-23",
    0x8210: "DRV-24",
    0x8611: "DRV-25",
    0xFF06: "DRV-26",
    0xFF07: "DRV-26",
    0xFF09: "DRV-27",
    0xFF0B: "DRV-28",
}

GAIN_SCALE = GainScale(
    units=(1.0 / 256.0, 1e4 / 256.0, 20e-6, 5e-3, 10e-3, 78e-3, 80e-6),
    largest=32767,
    period=1e-3,  # hardware reference
)
"""As the EPOS2 is documented (maxon, EPOS2 Application Notes Collection 2014, 9.3.2 and 9.3.3; of the current, by the
numbers of its example in 9.5). The EPOS's own documents name no units. What speaks for these: the gains with which both
leave the factory (150, 10, 200 of the position) are in these units those of the EPOS4, whose EDS gives SI units.
"""


def configuration(pulses: Object) -> tuple[tuple[Object, int | str], ...]:
    """Everything that is written but the PDOs; `pulses`: the encoder's, of which later generations have more."""
    return (
        (MOTOR_TYPE, "motor type"),  # before the sensor: halls alone need type 11
        (Object(0x6410, 1, U16), "continuous current"),
        (Object(0x6410, 2, U16), "output current"),
        (Object(0x6410, 3, U8), "pole pairs"),
        (Object(0x6410, 4, U16), "motor speed"),
        (Object(0x6410, 5, U16), "thermal time"),
        (pulses, "pulses"),
        (Object(0x2210, 2, U16), "sensor type"),
        (Object(0x2210, 4, U16), "sensor polarity"),
        *((gain, f"gain {number}") for number, gain in enumerate(GAINS)),
        (FOLLOWING_ERROR, "following error"),
        *zip(POSITION_LIMITS, LIMIT_OFF, strict=True),
        (TOP_PROFILE_VELOCITY, "top velocity"),
        (ACCELERATION, "acceleration"),
        (DECELERATION, "deceleration"),
        (QUICK_STOP_DECELERATION, "quick-stop deceleration"),
        (PROFILE_TYPE, 0),  # trapezoidal
        (Object(0x100C, 0, U16), 0),  # no node guarding: heartbeats instead
        (Object(0x100D, 0, U8), 0),
        (PRODUCER_HEARTBEAT, "node heartbeat"),
        (OTHER_CONSUMER_HEARTBEAT, 0),
        (CONSUMER_HEARTBEAT, "host watch"),
        (MODE, "mode"),
    )


EPOS1 = Family(
    name="epos1",
    title="EPOS",
    serial_protocol="epos1",
    vendor=MAXON,
    generation=1,
    hardware=Bits(object=Object(0x2003, 2, U16)),
    hardware_mask=0xFFF0,
    firmware=Bits(object=Object(0x2003, 1, U16)),
    oldest_firmware=0x2030,  # the consumer of heartbeats
    usual_firmware=0x2032,
    mask=0x417F,
    states=STATES,
    modes={TRACTION: 3, STEERING: -1},
    set_points={TRACTION: TARGET_VELOCITY, STEERING: POSITION_SETTING},
    received={
        TRACTION: ((CONTROLWORD, TARGET_VELOCITY), (CONTROLWORD,)),
        STEERING: ((CONTROLWORD, POSITION_SETTING), (CONTROLWORD,)),
    },
    sent={
        TRACTION: ((STATUSWORD, POSITION), (VELOCITY_AVERAGED, CURRENT, MODE_DISPLAY)),
        STEERING: ((STATUSWORD, POSITION), (*ANALOG, CURRENT, MODE_DISPLAY)),
    },
    velocity=VELOCITY_AVERAGED,
    current=CURRENT,
    analog=ANALOG,
    inputs=INPUTS,
    configuration=configuration(PULSES),
    choices={
        "motor type": for_motors({"dc": 1, "ec_sine": 10, "ec_block": 11}),
        "sensor type": for_sensors(dict(zip(SENSORS, (1, 2, 3), strict=True))),
    },
    own_bits={"sensor polarity": 0x00},
    inverted={"sensor polarity": 0x01},
    gains=GAINS,
    gain_scale=GAIN_SCALE,
    memory=tuple(Object(0x200C, number, I32) for number in range(1, 5)),
    top_velocity=25000,
    top_counts=4 * 7500,
    errors=ERRORS,
    resets={0x6100: "node", 0x8120: "communication", 0xFF04: "node"},
    bit_rate=Object(0x2001, 0, U16),
    bit_rates={0: 1_000_000, 1: 800_000, 2: 500_000, 3: 250_000, 4: 125_000, 5: 50_000, 6: 20_000},
)
