"""Faults that a drive reports by itself. Which EMCY code means which is a matter of its family (`artemis.families`)."""

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
_HEARD = Found.EMERGENCY


def _row(name: str, recovery: Recovery, text: str, advice: str) -> Row:
    """Every error of a drive stops all of them, by their own ramps, and leads to `fault`."""
    return Row(name, _HEARD, S1, recovery, text, advice, to_fault=True)


DRIVES: dict[str, Row] = {
    "DRV-01": _row("generic error", K, "unspecified error", "read the error history; switch the drive off and on"),
    "DRV-02": _row(
        "over-current",
        K._replace(final=2, window=_TEN),
        "over-current",
        "blocked wheel, short circuit in the motor cable, or gains too high",
    ),
    "DRV-03": _row(
        "over-voltage",
        K,
        "over-voltage: the robot may have rolled",
        "while braking: lower quick_stop_deceleration_m_s2 in the robot file; else check the supply",
    ),
    "DRV-04": _row(
        "under-voltage",
        K._replace(settle=5.0),
        "supply voltage too low",
        "charge the battery; released emergency stop? fuse?",
    ),
    "DRV-05": _row(
        "logic supply",
        X,
        "supply of its logic or its sensors too low",
        "a short circuit in the encoder or hall cable? its logic supply, where it has one of its own?",
    ),
    "DRV-06": _row(
        "over-temperature",
        K._replace(settle=5 * MINUTE),
        "too hot",
        "wait five minutes; is a wheel dragging?",
    ),
    "DRV-07": _row("internal software", BOOT, "internal software error", "the node is reset and configured again"),
    "DRV-08": _row(
        "software parameter",
        K,
        "rejected a combination of parameters",
        "check motor, sensor and gains in the robot file",
    ),
    "DRV-09": _row(
        "corrupt parameters",
        BOOT,
        "stored parameters were corrupt, its defaults are loaded",
        "gains and motor data are the factory's: restore them with the maker's tool before you continue",
    ),
    "DRV-10": _row("hardware defect", X, "hardware defect, or it did not start up", "switch it off and on; replace it"),
    "DRV-11": _row(
        "position sensor error",
        CAL,
        "encoder position invalid",
        "check the encoder; is counts_per_turn right?",
    ),
    "DRV-12": _row(
        "position sensor breach",
        CAL._replace(final=2),
        "encoder cable or encoder broken",
        "check plug and cable",
    ),
    "DRV-13": _row(
        "encoder index",
        CAL,
        "encoder index missing or stray",
        "check the encoder cable, and counts_per_turn in the robot file",
    ),
    "DRV-14": _row("hall sensor", CAL._replace(final=2), "hall sensor: impossible pattern", "check the hall cable"),
    "DRV-15": _row("hall sensor not found", BOOT, "hall sensor not found", "check the hall cable; the node is reset"),
    "DRV-16": _row("hall angle", CAL, "hall sensor and encoder disagree", "check both cables; is pole_pairs right?"),
    "DRV-17": _row("sensor direction", X, "its main sensor counts against the motor", "swap or invert the sensor"),
    "DRV-18": _row(
        "CAN overrun",
        automatic(1, _TEN),
        "could not follow the CAN traffic",
        "who else sends on this bus? lower tick_hz",
    ),
    "DRV-19": _row(
        "CAN passive",
        Recovery(Kind.ACKNOWLEDGED, reset="communication"),
        "CAN error passive",
        "wiring, termination, bit rate, plug",
    ),
    "DRV-20": _row(
        "lost heartbeat",
        K,
        "lost contact with the computer",
        "did the computer stall? CAN cable? see the journal for late ticks",
    ),
    "DRV-21": _row(
        "COB-ID collision",
        X,
        "two senders on one CAN identifier",
        "two nodes with one node id? a second master?",
    ),
    "DRV-22": _row("CAN bus off", K, "was off the CAN bus", "wiring, termination, bit rate, plug"),
    "DRV-23": _row(
        "CAN queue overrun",
        automatic(1, _TEN),
        "CAN queue overrun",
        "the bus is too busy: lower tick_hz; who else sends?",
    ),
    "DRV-24": _row(
        "PDO length",
        K,
        "bad or short set-point frame",
        "a second master? the node's mapping is written again",
    ),
    "DRV-25": _row(
        "following error",
        K,
        "cannot follow its set-point",
        "is the wheel blocked? is it free to turn? gains, following_error_counts",
    ),
    "DRV-26": _row("limit switch", K, "hit its limit switch", "turn the wheel back by hand"),
    "DRV-27": _row(
        "software position limit",
        K,
        "beyond its software position limit",
        "did the coupling slip? it is aligned again",
    ),
    "DRV-28": _row("overloaded", K, "controller overloaded", "send it less: lower tick_hz"),
    "DRV-29": _row(
        "safe torque off", K, "safe torque off", "who opened the STO inputs, or pressed the emergency stop? close them"
    )._replace(reason="its STO inputs are open when it does not enable"),
    "DRV-30": Row(
        "error reset",
        Found.DESIGN,
        recovery=ITSELF,
        reason="code 0x0000 only says that no error is left; it never leads out of `fault`",
    ),
    "DRV-31": _row("unknown code", K, "unknown error code", "read the firmware's manual; artemis treats it as severe"),
    "DRV-32": _row("malformed EMCY", K, "damaged error message", "CAN wiring; the statusword still shows the fault"),
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
    "DRV-34": _row(
        "power stage protection",
        K._replace(final=2, window=_TEN),
        "its power stage protects itself",
        "short circuit in the motor cable, wiring",
    ),
    "DRV-35": _row(
        "motor too hot",
        K._replace(settle=5 * MINUTE),
        "motor too hot",
        "wait five minutes; is a wheel dragging? continuous_current_ma, thermal_time_constant_s",
    ),
    "DRV-36": _row("absolute encoder", CAL._replace(final=2), "absolute encoder (SSI) error", "check plug and cable"),
    "DRV-37": _row(
        "sensor not configured",
        X,
        "main or commutation sensor missing in its configuration",
        "motor and sensor types in the robot file",
    ),
    "DRV-38": _row(
        "late set-points",
        automatic(1, _TEN),
        "set-points came too late",
        "one drive alone: its cable, its plug; several, or late ticks in the journal: who else needs the processor?",
    ),
    "DRV-39": _row("drive watchdog", BOOT, "its own watchdog expired", "the node is reset and configured again"),
    "DRV-40": _row(
        "controller gain",
        K,
        "its regulator gains do not fit",
        "its gains in the robot file, or those that it has stored; tune it anew",
    ),
    "DRV-41": _row("auto tuning", K, "its auto tuning failed", "another program tunes it: end that first"),
    "DRV-42": _row(
        "extension card", K, "its extension card does not answer", "is it seated? switch the drive off and on"
    ),
}
