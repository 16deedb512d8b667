"""What a drive's end of the bus counts between two ticks."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Tally:
    """Counted since the last tick."""

    emergencies: list[int] = field(default_factory=list)
    boots: int = 0
    frames: int = 0
    malformed: int = 0
    disordered: int = 0
