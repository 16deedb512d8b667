"""Faults that a drive reports by itself: EMCY codes of the first generation (firmware specification 2010, 12.2)."""

from __future__ import annotations

from artemis.supervision.catalogue.row import (
    BOOT,
    CAL,
    ITSELF,
    MINUTE,
    S1,
    Found,
    K,
    Kind,
    Recovery,
    Row,
    Threshold,
    X,
    automatic,
)

_TEN = 10 * MINUTE
_HEARD, _EPOS4 = Found.EMERGENCY, "the code exists on the EPOS4 only"


def _row(name: str, codes: tuple[int, ...], recovery: Recovery, text: str, advice: str) -> Row:
    """Every error of a drive stops all of them, by their own ramps, and leads to `fault`."""
    return Row(name, _HEARD, S1, recovery, text, advice, to_fault=True, codes=codes)


def _absent(name: str) -> Row:
    return Row(name, Found.ABSENT, S1, K, reason=_EPOS4)


DRIVES: dict[str, Row] = {
    "DRV-01": _row(
        "generic error", (0x1000,), K, "unspecified error", "read the error history; switch the drive off and on"
    ),
    "DRV-02": _row(
        "over-current",
        (0x2310,),
        K._replace(final=2, window=_TEN),
        "over-current",
        "blocked wheel, short circuit in the motor cable, or gains too high",
    ),
    "DRV-03": _row(
        "over-voltage",
        (0x3210,),
        K,
        "over-voltage: the robot may have rolled",
        "while braking: lower quick_stop_deceleration_m_s2 in the robot file; else check the supply",
    ),
    "DRV-04": _row(
        "under-voltage",
        (0x3220,),
        K._replace(settle=5.0),
        "supply voltage too low",
        "charge the battery; released emergency stop? fuse?",
    ),
    "DRV-05": _row(
        "logic supply",
        (0x5113,),
        X,
        "5 V sensor supply overloaded",
        "check encoder and hall cables for a short circuit",
    ),
    "DRV-06": _row(
        "over-temperature",
        (0x4210,),
        K._replace(settle=5 * MINUTE),
        "too hot",
        "wait five minutes; is a wheel dragging?",
    ),
    "DRV-07": _row(
        "internal software", (0x6100,), BOOT, "internal software error", "the node is reset and configured again"
    ),
    "DRV-08": _row(
        "software parameter",
        (0x6320,),
        K,
        "rejected a combination of parameters",
        "check motor, sensor and gains in the robot file",
    ),
    "DRV-09": _absent("corrupt parameters"),
    "DRV-10": _absent("hardware defect"),
    "DRV-11": _row(
        "position sensor error",
        (0x7320,),
        CAL,
        "encoder position invalid",
        "check the encoder; is counts_per_turn right?",
    ),
    "DRV-12": _row(
        "position sensor breach",
        (0xFF0A,),
        CAL._replace(final=2),
        "encoder cable or encoder broken",
        "check plug and cable",
    ),
    "DRV-13": _row(
        "encoder index",
        (0xFF02, 0xFF03),
        CAL,
        "encoder index missing or stray",
        "check the encoder cable, and counts_per_turn in the robot file",
    ),
    "DRV-14": _row(
        "hall sensor", (0xFF01,), CAL._replace(final=2), "hall sensor: impossible pattern", "check the hall cable"
    ),
    "DRV-15": _row(
        "hall sensor not found", (0xFF04,), BOOT, "hall sensor not found", "check the hall cable; the node is reset"
    ),
    "DRV-16": _row(
        "hall angle", (0xFF08,), CAL, "hall sensor and encoder disagree", "check both cables; is pole_pairs right?"
    ),
    "DRV-17": _absent("sensor direction"),
    "DRV-18": _row(
        "CAN overrun",
        (0x8110, 0x8111),
        automatic(1, _TEN),
        "could not follow the CAN traffic",
        "who else sends on this bus? lower tick_hz",
    ),
    "DRV-19": _row(
        "CAN passive",
        (0x8120,),
        Recovery(Kind.ACKNOWLEDGED, reset="communication"),
        "CAN error passive",
        "wiring, termination, bit rate, plug",
    ),
    "DRV-20": _row(
        "lost heartbeat",
        (0x8130,),
        K,
        "lost contact with the computer",
        "did the computer stall? CAN cable? see the journal for late ticks",
    ),
    "DRV-21": _row(
        "COB-ID collision",
        (0x8150,),
        X,
        "two senders on one CAN identifier",
        "two nodes with one node id? a second master?",
    ),
    "DRV-22": _row("CAN bus off", (0x81FD,), K, "was off the CAN bus", "wiring, termination, bit rate, plug"),
    "DRV-23": _row(
        "CAN queue overrun",
        (0x81FE, 0x81FF),
        automatic(1, _TEN),
        "CAN queue overrun",
        "the bus is too busy: lower tick_hz; who else sends?",
    ),
    "DRV-24": _row(
        "PDO length",
        (0x8210,),
        K,
        "bad or short set-point frame",
        "a second master? the node's mapping is written again",
    ),
    "DRV-25": _row(
        "following error",
        (0x8611,),
        K,
        "cannot follow its set-point",
        "is the wheel blocked? is it free to turn? gains, following_error_counts",
    ),
    "DRV-26": _row("limit switch", (0xFF06, 0xFF07), K, "hit its limit switch", "turn the wheel back by hand"),
    "DRV-27": _row(
        "software position limit",
        (0xFF09,),
        K,
        "beyond its software position limit",
        "did the coupling slip? it is aligned again",
    ),
    "DRV-28": _row("overloaded", (0xFF0B,), K, "controller overloaded", "send it less: lower tick_hz"),
    "DRV-29": Row("safe torque off", Found.ABSENT, S1, K, reason="the input exists on the EPOS4 only"),
    "DRV-30": Row(
        "error reset",
        Found.DESIGN,
        recovery=ITSELF,
        reason="code 0x0000 only says that no error is left; it never leads out of `fault`",
    ),
    "DRV-31": _row(
        "unknown code", (), K, "unknown error code", "read the firmware's manual; artemis treats it as severe"
    ),
    "DRV-32": _row(
        "malformed EMCY", (), K, "damaged error message", "CAN wiring; the statusword still shows the fault"
    ),
    "DRV-33": Row(
        "EMCY storm",
        Found.MEASURED,
        S1,
        K,
        "reports errors without end",
        "read the error history; the first of them counts",
        to_fault=True,
        within=1.0,
        of="EMCY messages in a second",
        stages=(Threshold(S1, 20.0),),
    ),
}
