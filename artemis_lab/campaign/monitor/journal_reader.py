"""The journal of a run as somebody reads it who knows only how its lines look."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

STOPPING = ("CONTROLLED_STOP", "QUICK_STOP", "OFF")
"""Severities that stop the robot."""


class JournalLine(NamedTuple):
    """One entry."""

    sequence: int
    time: float
    """Run time [s]."""
    kind: str
    text: str
    data: dict[str, Any]

    @property
    def stops(self) -> bool:
        """A fault that stops the robot."""
        return self.kind == "fault" and self.data["severity"] in STOPPING


class ReadJournal:
    """Every line, and what is wrong with the file itself."""

    def __init__(self, path: Path) -> None:
        self.lines: list[JournalLine] = []
        self.problems: list[str] = []
        content = path.read_bytes().rstrip(b"\0")  # room that a killed run had not used yet
        for number, raw in enumerate(content.splitlines(), 1):
            entry, mark, checksum = raw.rpartition(b',"crc32":')
            if not mark or checksum != b"%d}" % zlib.crc32(entry):
                self.problems.append(f"line {number} has no valid checksum")
                continue
            line = json.loads(entry + b"}")
            self.lines.append(JournalLine(line["sequence"], line["time_s"], line["kind"], line["text"], line["data"]))
        self._modes = [(line.time, str(line.data["to"])) for line in self.of("mode")]

    def of(self, *kinds: str) -> Iterator[JournalLine]:
        """The lines of some kinds."""
        return (line for line in self.lines if line.kind in kinds)

    @property
    def modes(self) -> list[tuple[float, str]]:
        """When [s] which mode began."""
        return self._modes

    def modes_between(self, begin: float, end: float) -> set[str]:
        """Every mode that there was in this time [s]."""
        found, before = set(), "init"
        for time, mode in self._modes:
            if time > end:
                break
            if time > begin:
                found.add(before)
            before = mode
        return found | {before}

    def mode_at(self, time: float) -> str:
        """The mode at a run time [s]."""
        return next((mode for begin, mode in reversed(self._modes) if begin <= time), "init")

    def phase_before(self, time: float) -> str:
        """The phase that had begun last before a run time [s]; empty: none."""
        return next((line.text for line in reversed(self.lines) if line.kind == "phase" and line.time < time), "")

    def next_mode(self, after: float, *modes: str) -> float | None:
        """When one of the modes begins next [s]; None: never."""
        return next((time for time, mode in self._modes if time > after and mode in modes), None)
