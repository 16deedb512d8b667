"""Faults in words: what artemis did about one, and what a person can do. For the live view and the page."""

from __future__ import annotations

from collections.abc import Sequence

from artemis.recording.journal import Entry
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Kind, Row
from artemis.values import Fault, JobKind, Severity

DID = {
    Severity.WARN: "nothing: the run continues",
    Severity.LIMIT: "limits the speed",
    Severity.CONTROLLED_STOP: "controlled stop, drives stay on",
    Severity.QUICK_STOP: "quick stop by the drives, then off",
    Severity.OFF: "drives off: the robot can roll",
}
"""What artemis does, by severity."""
_MEND = "fix the cause, acknowledge, arm"
_NEXT = {
    Kind.ITSELF: "clears when the cause is gone",
    Kind.AUTOMATIC: f"artemis recovers automatically when the cause is gone; if that does not help: {_MEND}",
    Kind.ACKNOWLEDGED: _MEND,
    Kind.CALIBRATED: f"{_MEND}; the wheels are aligned again",
    Kind.CONFIGURED: f"{_MEND}; the drive is reset and configured again",
}
NEVER = "not in this run: fix the cause, then continue with --resume"


def next_step(row: Row, severity: Severity, final: bool) -> str:
    """What the operator has to do about a fault; `final`: it came once too often."""
    if severity is Severity.WARN and row.recovery.kind is not Kind.ITSELF:
        return "fix the cause before the next run"
    return NEVER if final else _NEXT.get(row.recovery.kind, NEVER)


def explained_now(fault: Fault) -> dict[str, str]:
    """Of a fault that is there: where to `look`, what `artemis` does, and what comes `next`."""
    row = ROWS[fault.id]
    then = next_step(row, fault.severity, fault.final)
    return {"look": row.advice, "artemis": DID.get(fault.severity, ""), "next": then}


def by_fault(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The faults of a run by row and device, in the order they came first: `LAS-03 front`."""
    found: dict[str, list[Entry]] = {}
    for entry in entries:
        if entry.kind == "fault":
            id, _, text = entry.text.partition(" ")
            device = entry.data.get("device", text.partition(": ")[0] if ": " in text else "")
            found.setdefault(f"{id} {device}".rstrip(), []).append(entry)
    return found


def explained(entries: Sequence[Entry]) -> list[tuple[str, str, str, str, str]]:
    """Each fault of a device once, as it was worst, in the order they came first.

    Run time of the first [s], what and how often, where to look, what was done, next.
    """
    rows = []
    for name, times in by_fault(entries).items():
        row = ROWS.get(name.partition(" ")[0])
        if row is not None:
            final, severity, text = max((_graded(entry, row) for entry in times), key=lambda graded: graded[:2])
            what = text + (f" ({len(times)} times)" if len(times) > 1 else "")
            then = next_step(row, severity, final)
            rows.append((f"{times[0].time:.2f}", what, row.advice, DID.get(severity, ""), then))
    return rows


def _graded(entry: Entry, row: Row) -> tuple[bool, Severity, str]:
    """Whether a fault came once too often, how severe it was, and its words."""
    severity = Severity[entry.data["severity"]] if "severity" in entry.data else row.severity
    return entry.data.get("recovery") == Kind.NEVER.value, severity, entry.text


def histories(entries: Sequence[Entry]) -> list[str]:
    """The drives' own error histories, as last read: drive, and codes with their meaning."""
    found: dict[str, str] = {}
    for entry in entries:
        job = f"{JobKind.READ_HISTORY.value} "
        drive, told, codes = entry.text.removeprefix(job).partition(": done: ")
        if entry.kind == "result" and entry.text.startswith(job) and told:
            found[drive] = f"{drive}: {codes}"
    return list(found.values())
