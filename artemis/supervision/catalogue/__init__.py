"""The fault table. Every fault is one row, in `drives`, `communication`, `motion`, `inputs`, ..., `serial`."""

from __future__ import annotations

from collections.abc import Mapping

from artemis.errors import writable
from artemis.supervision.catalogue.communication import COMMUNICATION
from artemis.supervision.catalogue.drives import DRIVES
from artemis.supervision.catalogue.host import HOST
from artemis.supervision.catalogue.inputs import INPUTS
from artemis.supervision.catalogue.motion import MOTION
from artemis.supervision.catalogue.row import Row
from artemis.supervision.catalogue.serial import SERIAL
from artemis.supervision.catalogue.surroundings import SURROUNDINGS
from artemis.values import Fault, Severity

ROWS: dict[str, Row] = {**DRIVES, **COMMUNICATION, **MOTION, **INPUTS, **SURROUNDINGS, **HOST, **SERIAL}
"""Every row by its id."""

UNKNOWN_CODE, DAMAGED_EMERGENCY = "DRV-31", "DRV-32"
POWER_LOST = "DRV-04", "DRV-29"
"""Of a power stage that has nothing to work with: under-voltage, and open safe torque off."""


def fault(id: str, device: str = "", detail: str = "", severity: Severity | None = None) -> Fault:
    """The fault of row `id` for `device`, with what was seen in `detail`; `severity`: of a milder stage."""
    row = ROWS[id]
    severity = row.severity if severity is None else severity
    who = f"{device}: " if device else ""
    what = f" ({writable(detail)})" if detail else ""
    return Fault(
        id=id,
        severity=severity,
        text=f"{who}{row.text or row.name}{what}",
        device=device,
        to_fault=row.to_fault and severity >= row.severity,
    )


def emergency(device: str, code: int, errors: Mapping[int, str]) -> Fault:
    """The fault that an EMCY error code of a drive stands for; a negative code: the message was damaged.

    Args:
        device: Name of the drive.
        code: What it sent.
        errors: Its family's rows by code; one that is not there is UNKNOWN_CODE, never ignored.
    """
    if code < 0:
        return fault(DAMAGED_EMERGENCY, device)
    return fault(errors.get(code, UNKNOWN_CODE), device, f"EMCY 0x{code:04X}")
