"""What `artemis doctor` finds, one line each."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Grade(Enum):
    """How bad it is; only a failure changes the exit status."""

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    FAILURE = "FAILURE"


OK, NOTE, WARNING, FAILURE = Grade


@dataclass(frozen=True)
class Finding:
    """One line of the table, and what to do about it."""

    grade: Grade
    what: str
    remedy: str = ""
