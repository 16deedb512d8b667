"""The EPOS4, in the cyclic synchronous modes of CiA 402.

Sources: the maker's EDS of the EPOS4 Module 50/5, firmware 0x0170 (objects, types, defaults); EPOS4 Communication Guide
rel8759 (CAN, NMT); the maker's note "EPOS4 and ROS 2", 2024 (PDOs, homing); the library EposLib, which quotes the EPOS4
Firmware Specification of 2026 (states, option codes, classes of errors, fields of the SSI encoder's objects); public
tables of its errors. Units are increments, rpm and rpm/s of the motor shaft, mA and ms; gains are SI.

Inferred, not read in a document of the maker: the control structure of a motor with halls alone; that 0x60E4:2 shows
what an SSI encoder counts when no regulator uses it, and begins at its absolute position; that bits 0 and 1 of 0x3202
are the STO inputs, 1 where they have their voltage.
"""

from __future__ import annotations

from artemis.families.family import (
    CIA402_MASK,
    CIA402_STATES,
    ENCODERS,
    MAXON,
    STEERING,
    SYNC_PERIOD,
    TORQUE_CONSTANT,
    TRACTION,
    Bits,
    Family,
    GainScale,
    OptionCode,
    for_motors,
)
from artemis.families.objects import (
    ABORT_CONNECTION,
    ACCELERATION,
    COMMUNICATION_ERROR,
    CONSUMER_HEARTBEAT,
    CONTROLWORD,
    DECELERATION,
    DIGITAL_INPUTS,
    FAULT_REACTION,
    FOLLOWING_ERROR,
    I16,
    I32,
    INTERPOLATION_TIME,
    LIMIT_OFF,
    MODE,
    MODE_DISPLAY,
    MOTOR_TYPE,
    OFFSETS,
    OTHER_CONSUMER_HEARTBEAT,
    POSITION,
    POSITION_LIMITS,
    PRODUCER_HEARTBEAT,
    PRODUCT,
    PROFILE_TYPE,
    QUICK_STOP_DECELERATION,
    QUICK_STOP_OPTION,
    REVISION,
    STATUSWORD,
    TARGET_POSITION,
    TARGET_VELOCITY,
    TOP_MOTOR_SPEED,
    TOP_PROFILE_VELOCITY,
    U8,
    U16,
    U32,
    Object,
    Setting,
)

ANALOG = Object(0x3160, 1, I16), Object(0x3160, 2, I16)
VELOCITY_AVERAGED = Object(0x30D3, 1, I32)
CURRENT_AVERAGED = Object(0x30D1, 1, I32)
SECOND_SENSOR = Object(0x60E4, 2, I32)
VELOCITY_UNIT, RPM = Object(0x60A9, 0, U32), 0x00B44700
SENSORS, CONTROL_STRUCTURE, COMMUTATION, AXIS, RESOLUTION = (Object(0x3000, number, U32) for number in range(1, 6))
GAINS = tuple(
    Object(regulator, number, U32)
    for regulator, number in (
        (0x30A0, 1),
        (0x30A0, 2),
        (0x30A2, 1),
        (0x30A2, 2),
        (0x30A1, 1),
        (0x30A1, 2),
        (0x30A1, 3),
    )
)

_EC = ("ec_sine", "ec_block")
CHOICES = {
    "motor type": for_motors({"dc": 1, "ec_sine": 10, "ec_block": 11}),
    # 0x3000:1: byte 0 digital encoder 1, byte 2 halls; :2: its fifth digit is the main sensor; :3: of the commutation
    "sensors": {
        **{("dc", encoder): 0x00000001 for encoder in ENCODERS},
        **{(motor, encoder): 0x00100001 for motor in _EC for encoder in ENCODERS},
        **{(motor, "hall"): 0x00100000 for motor in _EC},
    },
    "control structure": {
        **{(motor, encoder): 0x00010111 for motor in ("dc", *_EC) for encoder in ENCODERS},
        **{(motor, "hall"): 0x00030111 for motor in _EC},
    },
    "commutation": {
        **{("dc", encoder): 0x00 for encoder in ENCODERS},
        **{(motor, encoder): 0x31 for motor in _EC for encoder in ENCODERS},
        **{(motor, "hall"): 0x30 for motor in _EC},
    },
    "encoder type": {
        (motor, encoder): kind for motor in ("dc", *_EC) for kind, encoder in ((1, ENCODERS[0]), (0, ENCODERS[1]))
    }
    | {(motor, "hall"): 1 for motor in _EC},
}

ERRORS = {
    0x1000: "DRV-01",
    0x2310: "DRV-02",
    0x2320: "DRV-34",
    0x3210: "DRV-03",
    0x3220: "DRV-04",
    0x4210: "DRV-06",
    0x4380: "DRV-35",
    0x5113: "DRV-05",
    0x6080: "DRV-42",
    0x6081: "DRV-42",
    0x6320: "DRV-08",
    0x6380: "DRV-09",
    0x7320: "DRV-11",
    0x7380: "DRV-12",
    0x7381: "DRV-13",
    0x7382: "DRV-13",
    0x7388: "DRV-14",
    0x7389: "DRV-15",
    0x738A: "DRV-16",
    0x738C: "DRV-36",
    0x738D: "DRV-36",
    0x7390: "DRV-37",
    0x7391: "DRV-37",
    0x7392: "DRV-17",
    0x8110: "DRV-18",
    0x8111: "DRV-18",
    0x8120: "DRV-19",
    0x8130: "DRV-20",
    0x8150: "DRV-21",
    0x81FD: "DRV-22",
    0x81FE: "DRV-23",
    0x81FF: "DRV-23",
    0x8210: "DRV-24",
    0x8250: "DRV-38",
    0x8611: "DRV-25",
    0x8A80: "DRV-26",
    0x8A81: "DRV-26",
    0x8A82: "DRV-27",
    0x8A88: "DRV-29",
    0x8A8A: "DRV-29",
    0x8A8B: "DRV-29",
    0xFF01: "DRV-28",
    0xFF02: "DRV-39",
    0xFF0B: "DRV-28",
    0xFF10: "DRV-40",
    **dict.fromkeys(range(0x1080, 0x1089), "DRV-10"),
    **dict.fromkeys((0x1090, 0x5280, 0x5281, 0x5282, 0x5480, 0x5481, 0x5482, 0x5483), "DRV-10"),
    **dict.fromkeys(range(0x6180, 0x61F1), "DRV-07"),
    **dict.fromkeys(range(0xFF11, 0xFF25), "DRV-41"),
}

EPOS4 = Family(
    name="epos4",
    title="EPOS4",
    serial_protocol="epos4",
    vendor=MAXON,
    generation=5,
    hardware=Bits(object=PRODUCT, shift=16),
    hardware_mask=0xFFFF,
    firmware=Bits(object=REVISION, shift=16),
    oldest_firmware=0,
    usual_firmware=0x0170,
    witness=VELOCITY_UNIT,
    mask=CIA402_MASK,
    states=CIA402_STATES,
    modes={TRACTION: 9, STEERING: 8},
    set_points={TRACTION: TARGET_VELOCITY, STEERING: TARGET_POSITION},
    received={
        TRACTION: ((CONTROLWORD, TARGET_VELOCITY), (CONTROLWORD,)),
        STEERING: ((CONTROLWORD, TARGET_POSITION), (CONTROLWORD,)),
    },
    sent={
        TRACTION: ((STATUSWORD, POSITION, MODE_DISPLAY), (VELOCITY_AVERAGED, CURRENT_AVERAGED)),
        STEERING: ((STATUSWORD, POSITION, MODE_DISPLAY), (*ANALOG, CURRENT_AVERAGED)),
    },
    velocity=VELOCITY_AVERAGED,
    current=CURRENT_AVERAGED,
    analog=ANALOG,
    absolute=SECOND_SENSOR,
    inputs=DIGITAL_INPUTS,
    supply=Object(0x2200, 1, U16),  # in 0.1 V; no PDO takes it
    sto=Setting(Object(0x3202, 1, U8), 0x03),
    temperature=Object(0x3201, 1, I16),  # of the power stage, in 0.1 °C; no PDO takes it
    top_analog_v=10.0,
    analog_step=20.0 / 4096,  # -10 to 10 V in 12 bit (hardware reference of the 50/5)
    configuration=(
        (MOTOR_TYPE, "motor type"),
        (Object(0x3001, 1, U32), "continuous current"),
        (Object(0x3001, 2, U32), "output current"),
        (Object(0x3001, 3, U8), "pole pairs"),
        (Object(0x3001, 4, U16), "thermal time"),
        (Object(0x3001, 5, U32), TORQUE_CONSTANT),
        (Object(0x3010, 1, U32), "pulses"),
        (Object(0x3010, 2, U16), "encoder type"),
        (Object(0x3012, 2, U32), "SSI frame"),
        (Object(0x3012, 3, U16), "SSI coding"),
        (Object(0x3012, 0xB, U32), "SSI position"),
        (SENSORS, "sensors"),
        (CONTROL_STRUCTURE, "control structure"),
        (COMMUTATION, "commutation"),
        (AXIS, "axis polarity"),
        *((gain, f"gain {number}") for number, gain in enumerate(GAINS)),
        (VELOCITY_UNIT, RPM),
        (FOLLOWING_ERROR, "following error"),
        *zip(POSITION_LIMITS, LIMIT_OFF, strict=True),
        (TOP_MOTOR_SPEED, "top velocity"),
        (TOP_PROFILE_VELOCITY, "top velocity"),
        (ACCELERATION, "acceleration"),
        (DECELERATION, "deceleration"),
        (QUICK_STOP_DECELERATION, "quick-stop deceleration"),
        (PROFILE_TYPE, 0),  # trapezoidal: it knows no other
        (PRODUCER_HEARTBEAT, "node heartbeat"),
        (OTHER_CONSUMER_HEARTBEAT, 0),
        (CONSUMER_HEARTBEAT, "host watch"),
        (INTERPOLATION_TIME, SYNC_PERIOD),
        (MODE, "mode"),
    ),
    choices=CHOICES,
    with_absolute={"sensors": 0x00000300},  # byte 1: SSI absolute encoder
    own_bits={"encoder type": 0x0F, "axis polarity": 0x01},
    regulator_bits={"control structure": 0xF0},  # its second digit: 1 is PI with a low pass, 2 PI with an observer
    observer={"control structure": 0x10},
    inverted={"encoder type": 0x10},
    cleared=OFFSETS,
    option_codes=(
        OptionCode(setting=Setting(COMMUNICATION_ERROR, 1), name="NMT state after a communication error: as before"),
        OptionCode(setting=Setting(ABORT_CONNECTION, 3), name="reaction to a lost connection: quick-stop ramp"),
        OptionCode(setting=Setting(QUICK_STOP_OPTION, 6), name="quick stop: its own ramp, then held"),
        OptionCode(setting=Setting(FAULT_REACTION, 2), name="reaction to a fault: quick-stop ramp"),
    ),
    checks=((RESOLUTION, "counts", "increments of the main sensor per motor turn"),),
    gains=GAINS,
    # the EDS gives microunits, and microvolts per ampere and millisecond; 2.5 kHz: hardware reference of the 50/5
    gain_scale=GainScale(units=(1e-6, 1e-3, *(1e-6,) * 5), largest=4_294_000_000, period=0.4e-3),
    memory=tuple(Object(0x210C, number, I32) for number in range(1, 5)),
    moves_valid_pdos=False,
    top_counts=4 * 2_500_000,
    errors=ERRORS,
    resets={
        0x8120: "communication",
        0x8130: "communication",
        **dict.fromkeys((*range(0x5480, 0x5484), *range(0x6180, 0x61F1), 0x6380, 0x7389, 0xFF02), "node"),
    },
    bit_rate=Object(0x2001, 0, U8),
    bit_rates={0: 1_000_000, 1: 800_000, 2: 500_000, 3: 250_000, 4: 125_000, 6: 50_000, 7: 20_000, 9: 0},
    reset_time=2.0,
    state_time=1.5,
    still_rpm=30.0,  # its own window of standstill, object 0x30E0:1
)
