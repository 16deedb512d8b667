"""`artemis faults`: the fault table, for people: all of it, or single rows."""

from __future__ import annotations

import sys
from math import inf
from pathlib import Path

from artemis.errors import ConfigError
from artemis.families import FAMILIES
from artemis.families.cia402 import ERRORS
from artemis.mission.loading import load_model
from artemis.mission.problems import nearest
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import SHORT, Found, Kind, Recovery, Row, Threshold
from artemis.values import Severity
from artemis.vehicle import RobotFile

SECTIONS = {
    "DRV": "What a drive reports by itself",
    "COM": "Drive states and the CAN bus",
    "SER": "Serial line",
    "RUN": "Motion",
    "STE": "Steering",
    "CAL": "Calibration",
    "INP": "Inputs",
    "NET": "Inputs over a network",
    "LAS": "Laser scanner",
    "LOC": "Localisation",
    "PTH": "Paths",
    "MIS": "Mission files",
    "PLG": "Plugins",
    "SYS": "Computer and process",
    "DSK": "Disk",
    "PWR": "Battery",
    "EST": "Emergency stop",
    "OPR": "Operator",
}
STO = "DRV-29"
"""Found by asking the drive, too."""
LATE_SET_POINTS = "DRV-38"
_NOTHING = "-"
_KNOWN = {**{name: family.errors for name, family in FAMILIES.items()}, "cia402": ERRORS}
"""Rows by error code, by family."""


def show_faults(ids: list[str], markdown: bool, robot_file: Path | None = None) -> None:
    """Print the rows `ids`, or one line for each row of the table; `markdown`: the documentation's page.

    With a robot file, rows for which the robot lacks something say so.

    Raises:
        ConfigError: there is no such row, or the robot file is refused.
    """
    robot = None if robot_file is None else load_model(robot_file, RobotFile)
    wanted = [id.upper() for id in ids]
    if unknown := [id for id in wanted if id not in ROWS]:
        raise ConfigError([f"no such fault: {id}{nearest(id, ROWS, 'faults')}" for id in unknown])
    if markdown:
        sys.stdout.write(page())
    elif wanted:
        sys.stdout.write("\n".join(_described(id, ROWS[id]) + _missed(id, robot, "  ") for id in wanted))
    else:
        for id, row in ROWS.items():
            sys.stdout.write(f"{id}  {_reaction(row):12}  {row.name}\n{_missed(id, robot, ' ' * 22)}")


def _missed(id: str, robot: RobotFile | None, indent: str) -> str:
    """A line for a row that is never noticed on this robot."""
    if robot is None:
        return ""
    never, row = f"{indent}never noticed on {robot.robot}", ROWS[id]
    if row.is_missed_by(robot):
        return f"{never}: it needs {row.needs.value}\n"
    tables = [drive.tables for drive in robot.drives.values()]
    asked = id == STO and any(family.sto is not None for family in tables)
    reporting = [drive for drive in robot.drives.values() if id in drive.tables.errors.values()]
    if _codes(id) and not asked and not reporting:
        return f"{never}: none of its drives reports it\n"
    if id == LATE_SET_POINTS and not any(drive.interpolation for drive in reporting):
        return f"{never}: its drives take each set-point at once (interpolation: false)\n"
    return ""


def page() -> str:
    """The fault table as a page of the documentation."""
    lines = []
    for prefix, title in SECTIONS.items():
        lines += [f"## {title}", "", "| fault | noticed | within | reaction | recovery | the operator reads |"]
        lines.append("|---|---|---|---|---|---|")
        for id, row in ROWS.items():
            if id.startswith(prefix):
                cells = (
                    f"**{id}** {row.name}",
                    _noticed(id, row),
                    _within(row),
                    _reaction(row),
                    _recovery(row),
                    _words(row),
                )
                lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def _described(id: str, row: Row) -> str:
    lines = [
        f"{id}  {row.name}",
        f"  says      {_words(row)}",
        f"  noticed   {_noticed(id, row)}; within {_within(row)}",
        f"  reaction  {_reaction(row)}",
        f"  recovery  {_recovery(row)}",
    ]
    return "\n".join(lines) + "\n"


def _noticed(id: str, row: Row) -> str:
    return _detected(id, row) + (f"; needs {row.needs.value}" if row.needs.value else "")


def _detected(id: str, row: Row) -> str:
    if row.found is Found.ELSEWHERE:
        return f"shows as {', '.join(row.shows_as)}: {row.reason}"
    return _how(id, row) + (f"; may show as {', '.join(row.shows_as)}" if row.shows_as else "")


def _how(id: str, row: Row) -> str:
    match row.found:
        case Found.EMERGENCY if codes := _codes(id):
            return f"{row.found.value} {codes}{f', or {row.reason}' if row.reason else ''}"
        case Found.DESIGN:
            return row.reason
        case Found.MEASURED if row.of:
            return f"{row.of}: {'; '.join(_limit(stage, row) for stage in row.stages)}"
    return f"{row.found.value}: {row.reason}" if row.reason else row.found.value


def _codes(id: str) -> str:
    """Error codes that mean this row; where not every family has them, with those that do."""
    families: dict[int, list[str]] = {}
    for name, errors in _KNOWN.items():
        for code, row in errors.items():
            if row == id:
                families.setdefault(code, []).append(name)
    told: dict[str, list[int]] = {}
    for code, names in families.items():
        whose = "" if len(names) == len(_KNOWN) else f" ({', '.join(names)})"
        told.setdefault(whose, []).append(code)
    return ", ".join(f"{_listed(codes)}{whose}" for whose, codes in told.items())


def _listed(codes: list[int]) -> str:
    """Codes in their order; three or more in a row as a range."""
    rows: list[list[int]] = []
    for code in sorted(codes):
        if rows and code == rows[-1][-1] + 1:
            rows[-1].append(code)
        else:
            rows.append([code])
    words = [
        [f"0x{row[0]:04X} to 0x{row[-1]:04X}"] if len(row) > 2 else [f"0x{code:04X}" for code in row] for row in rows
    ]
    return ", ".join(word for row in words for word in row)


def _limit(stage: Threshold, row: Row) -> str:
    above = f"above {stage.over:.3g}" if stage.over else "at any"
    what = f"{above} for {stage.hold:.3g} s" if stage.hold else above
    return f"{what}: {SHORT[stage.severity]}" if len(row.stages) > 1 else what


def _within(row: Row) -> str:
    if row.found in (Found.ABSENT, Found.DESIGN, Found.COMMAND):
        return _NOTHING
    if not row.within:
        return "before motion"
    return f"{row.within:.3g} s" if row.within >= 1.0 else f"{row.within * 1000:.0f} ms"


def _reaction(row: Row) -> str:
    if row.found is Found.LOADING:
        return "refused"
    if row.severity is Severity.NONE:
        return _NOTHING
    if row.found is Found.ABSENT:
        return SHORT[row.severity]
    leads = "" if row.severity < Severity.CONTROLLED_STOP else " → fault" if row.to_fault else " → quickstop"
    return SHORT[row.severity] + leads


def _recovery(row: Row) -> str:
    recovery = row.recovery
    if row.found is Found.LOADING:
        return "fix the file"
    words = recovery.kind.value
    if recovery.kind is Kind.AUTOMATIC:
        unless = f", not beside {', '.join(recovery.unless)}" if recovery.unless else ""
        words += f", {recovery.times} in {_span(recovery)}{unless}, then acknowledge"
    if recovery.reset and recovery.kind is not Kind.CONFIGURED:
        words += f", after NMT reset {recovery.reset}"
    if recovery.final:
        words += f"; not in this run after {recovery.final} in {_span(recovery)}"
    if recovery.settle > 1.0:
        words += f"; once gone for {recovery.settle:g} s"
    return words


def _span(recovery: Recovery) -> str:
    return "a run" if recovery.window == inf else f"{recovery.window / 60:g} min"


def _words(row: Row) -> str:
    return f"{row.text} ({row.advice})" if row.advice else row.text or _NOTHING
