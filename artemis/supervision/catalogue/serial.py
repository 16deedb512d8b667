"""Faults of a serial line to the drives: of commands that configure and diagnose, as nothing is driven over it."""

from __future__ import annotations

from artemis.supervision.catalogue.row import ITSELF, Found, Row

_REPEATED = "what was sent is repeated twice at most, after a silence that ends what the drive was in the middle of"


def _row(name: str, text: str, advice: str, reason: str = _REPEATED) -> Row:
    return Row(name, Found.COMMAND, recovery=ITSELF, text=text, advice=advice, within=0.0, reason=reason)


SERIAL: dict[str, Row] = {
    "SER-01": _row(
        "serial bytes out of step",
        "sends bytes that do not belong there",
        "is the baud rate right, and the protocol? does another program use this port?",
    ),
    "SER-02": _row(
        "serial checksum wrong",
        "serial line damages what passes",
        "cable, shield, ground between computer and drive",
        "what was sent is repeated twice at most; the drive executes nothing that was damaged",
    ),
    "SER-03": _row(
        "no serial answer",
        "does not answer on the serial line",
        "is the drive powered, the cable crossed, the baud rate right?",
    ),
    "SER-04": _row(
        "half a serial answer", "breaks off in an answer on the serial line", "loose plug? did the drive restart?"
    ),
    "SER-05": _row("serial port lost", "serial port lost", "is its adapter plugged in?", "those that wait end with it"),
}
