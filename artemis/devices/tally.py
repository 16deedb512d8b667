"""What happens seldom at a drive's end of the bus, counted between two ticks."""

from __future__ import annotations

from msgspec import Struct


class Tally(Struct):
    """Counted since the last tick."""

    emergencies: list[int] = []
    boots: int = 0
    malformed: int = 0
    disordered: int = 0


NOTHING = Tally()
