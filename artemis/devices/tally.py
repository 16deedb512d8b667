"""What a drive's end of the bus counts between two ticks."""

from __future__ import annotations

from msgspec import Struct


class Tally(Struct):
    """Counted since the last tick."""

    emergencies: list[int] = []
    boots: int = 0
    frames: int = 0
    malformed: int = 0
    disordered: int = 0
