"""Faults in words: what artemis did about one, and what a person can do. For the live view and the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from artemis.recording.journal import Entry
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Kind, Row
from artemis.values import JobKind, Severity

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


def explained(entries: Sequence[Entry]) -> list[tuple[str, str, str, str, str]]:
    """Each fault once, in the order they came: run time [s], how often and what, where to look, what was done, next."""
    faults = [entry for entry in entries if entry.kind == "fault"]
    times = Counter(entry.text for entry in faults)
    rows = []
    for entry in {entry.text: entry for entry in reversed(faults)}.values():
        row = ROWS.get(entry.text.split(" ", 1)[0])
        if row is not None:
            severity = Severity[entry.data["severity"]] if "severity" in entry.data else row.severity
            what = entry.text + (f" ({times[entry.text]} times)" if times[entry.text] > 1 else "")
            then = next_step(row, severity, entry.data.get("recovery") == Kind.NEVER.value)
            rows.append((f"{entry.time:.2f}", what, row.advice, DID.get(severity, ""), then))
    return rows[::-1]


def histories(entries: Sequence[Entry]) -> list[str]:
    """The drives' own error histories, as last read: drive, and codes with their meaning."""
    found: dict[str, str] = {}
    for entry in entries:
        job = f"{JobKind.READ_HISTORY.value} "
        drive, told, codes = entry.text.removeprefix(job).partition(": done: ")
        if entry.kind == "result" and entry.text.startswith(job) and told:
            found[drive] = f"{drive}: {codes}"
    return list(found.values())
