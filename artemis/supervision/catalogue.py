"""The fault table: one row a line, with id, reaction and words for the operator. Every fault is a row here."""

from __future__ import annotations

from typing import NamedTuple

from artemis.values import Fault, Severity

_WARN, _S2, _S1 = Severity.WARN, Severity.CONTROLLED_STOP, Severity.QUICK_STOP


class Row(NamedTuple):
    """One fault: reaction, whether it leads to the mode `fault` (else `quickstop`), and the operator's text."""

    severity: Severity
    to_fault: bool
    text: str


ROWS: dict[str, Row] = {
    # drives: EMCY codes of the first generation (firmware specification 2010, 12.2)
    "DRV-01": Row(_S1, True, "unspecified error"),
    "DRV-02": Row(_S1, True, "over-current: blocked wheel, short circuit or gains too high"),
    "DRV-03": Row(_S1, True, "over-voltage while braking: the robot may have rolled"),
    "DRV-04": Row(_S1, True, "supply voltage too low: battery, or emergency stop pressed"),
    "DRV-05": Row(_S1, True, "5 V sensor supply overloaded: check the encoder cable"),
    "DRV-06": Row(_S1, True, "too hot: wait five minutes"),
    "DRV-07": Row(_S1, True, "internal software error"),
    "DRV-08": Row(_S1, True, "rejected a combination of parameters"),
    "DRV-11": Row(_S1, True, "encoder position invalid"),
    "DRV-12": Row(_S1, True, "encoder cable or encoder broken"),
    "DRV-13": Row(_S1, True, "encoder index missing or stray"),
    "DRV-14": Row(_S1, True, "hall sensor: impossible pattern"),
    "DRV-15": Row(_S1, True, "hall sensor not found"),
    "DRV-16": Row(_S1, True, "hall sensor and encoder disagree"),
    "DRV-18": Row(_S1, True, "could not follow the CAN traffic"),
    "DRV-19": Row(_S1, True, "CAN error passive: wiring, bit rate, plug"),
    "DRV-20": Row(_S1, True, "lost contact with the computer"),
    "DRV-21": Row(_S1, True, "two senders on one CAN identifier"),
    "DRV-22": Row(_S1, True, "was off the CAN bus"),
    "DRV-23": Row(_S1, True, "CAN queue overrun: load too high"),
    "DRV-24": Row(_S1, True, "bad or short set-point frame"),
    "DRV-25": Row(_S1, True, "cannot follow its set-point: blocked?"),
    "DRV-26": Row(_S1, True, "hit its limit switch"),
    "DRV-27": Row(_S1, True, "beyond its software position limit"),
    "DRV-28": Row(_S1, True, "controller overloaded"),
    "DRV-99": Row(_S1, True, "unknown error code"),
    # communication and drive state
    "COM-01": Row(_S1, True, "in fault, the reason was not heard"),
    "COM-02": Row(_S1, True, "switched itself off"),
    "COM-03": Row(_S1, True, "does not enable"),
    "COM-04": Row(_S1, True, "is in the wrong operating mode"),
    "COM-05": Row(_S1, True, "sent a statusword that means nothing"),
    "COM-08": Row(_S1, True, "could not be brought up"),
    "COM-11": Row(_S1, True, "feedback lost"),
    "COM-22": Row(_S1, True, "CAN adapter lost"),
    "COM-26": Row(_S1, True, "restarted by itself (power dip?)"),
    "COM-27": Row(_S1, True, "left the NMT state Operational"),
    "COM-28": Row(_S1, True, "heartbeat lost"),
    "COM-30": Row(_S1, True, "does not watch the computer's heartbeat"),
    "COM-34": Row(_S1, True, "could not be released: it may report a lost heartbeat now"),
    # motion
    "RUN-11": Row(_S2, False, "asked for a command that is not a number"),
    "STE-01": Row(_S1, True, "wheel does not reach its angle"),
    "STE-03": Row(_S1, True, "potentiometers of one wheel disagree"),
    "STE-04": Row(_S1, True, "potentiometer open or shorted"),
    "STE-05": Row(_S1, True, "potentiometers and encoder disagree"),
    # inputs, path, plugins, host
    "INP-03": Row(_S2, False, "input frozen or lost"),
    "PTH-05": Row(_S2, False, "start pose too far from the path"),
    "PTH-06": Row(_S2, False, "off the path"),
    "PLG-02": Row(_S2, False, "plugin raised an error"),
    "PLG-06": Row(_S2, False, "plugin returned garbage"),
    "SYS-01": Row(_S2, False, "control loop late"),
}

EMERGENCIES: dict[int, str] = {
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
"""EMCY error code -> row. A code that is not here is DRV-99, never ignored."""


def fault(id: str, device: str = "", detail: str = "") -> Fault:
    """The fault of row `id` for `device`, with what was seen in `detail`."""
    row = ROWS[id]
    who = f"{device}: " if device else ""
    what = f" ({detail})" if detail else ""
    return Fault(id=id, severity=row.severity, text=f"{who}{row.text}{what}", device=device, to_fault=row.to_fault)


def emergency(device: str, code: int) -> Fault:
    """The fault that an EMCY error code of a drive stands for."""
    return fault(EMERGENCIES.get(code, "DRV-99"), device, f"EMCY 0x{code:04X}")
