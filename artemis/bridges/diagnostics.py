"""Drives, faults and the mission at a tick, as rows of a diagnostic viewer (diagnostic_msgs)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from artemis.values import DriveFeedback, Severity, Tick
from artemis.vehicle import RobotFile

OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of a DiagnosticStatus."""


def signature(tick: Tick) -> object:
    """Equal for two ticks between which nothing changed that a viewer should know at once."""
    faults = tuple((fault.id, fault.device, fault.severity) for fault in tick.snapshot.verdict.faults)
    states = tuple((drive.state, drive.age is None) for drive in tick.snapshot.sensed.drives)
    return tick.mode, tick.wish.phase, tick.position.step, faults, states


def diagnosis(robot: RobotFile, tick: Tick) -> list[dict[str, Any]]:
    """A row for the robot, one per drive, and one per active fault with its id, device and text."""
    snapshot = tick.snapshot
    severity = snapshot.verdict.severity
    told = {"mode": tick.mode.value, "phase": tick.wish.phase, "step": tick.position.step + 1}
    message = f"{tick.mode.value}: {tick.wish.phase}" if tick.wish.phase else tick.mode.value
    rows = [_row(robot.robot, "robot", _level(severity), message, robot.robot, told)]
    worst: dict[str, Severity] = {}
    for fault in snapshot.verdict.faults:
        worst[fault.device] = max(fault.severity, worst.get(fault.device, Severity.NONE))
    for drive in snapshot.sensed.drives:
        node = f"node {robot.drives[drive.name].node_id}" if drive.name in robot.drives else ""
        level = STALE if drive.age is None else _level(worst.get(drive.name, Severity.NONE))
        rows.append(_row(robot.robot, drive.name, level, drive.state.value, node, _drive(drive)))
    for fault in snapshot.verdict.faults:
        about = {"id": fault.id, "device": fault.device, "severity": fault.severity.name.lower().replace("_", " ")}
        rows.append(
            _row(
                robot.robot,
                " ".join(filter(None, (fault.id, fault.device))),
                _level(fault.severity),
                fault.text,
                fault.device,
                about,
            )
        )
    return rows


def _level(severity: Severity) -> int:
    if severity >= Severity.CONTROLLED_STOP:
        return ERROR
    return WARN if severity > Severity.NONE else OK


def _drive(drive: DriveFeedback) -> Mapping[str, object]:
    temperature = {} if drive.temperature_c is None else {"temperature_C": f"{drive.temperature_c:.1f}"}
    return {
        **temperature,
        "statusword": f"0x{drive.statusword:04X}",
        "position": f"{drive.position:.4f}",
        "velocity": f"{drive.velocity:.4f}",
        "current_A": f"{drive.current:.3f}",
        "age_s": "never received" if drive.age is None else f"{drive.age:.3f}",
    }


def _row(
    robot: str, name: str, level: int, message: str, hardware: str, values: Mapping[str, object]
) -> dict[str, Any]:
    listed = [{"key": key, "value": str(value)} for key, value in values.items()]
    return {"level": level, "name": f"{robot}: {name}", "message": message, "hardware_id": hardware, "values": listed}
