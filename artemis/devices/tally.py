"""What happens seldom at a drive's end of the bus, counted between two ticks."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from artemis.values import DriveFeedback


class Tally(Struct):
    """Counted since the last tick."""

    emergencies: list[int] = []
    boots: int = 0
    malformed: int = 0
    disordered: int = 0

    def added_to(self, feedback: DriveFeedback, jumps: int, stray: int) -> DriveFeedback:
        """The feedback with this in it, and what else happens seldom."""
        return replace(
            feedback,
            emergencies=tuple(self.emergencies),
            boots=self.boots,
            malformed=self.malformed,
            disordered=self.disordered,
            jumps=jumps,
            stray=stray,
        )


NOTHING = Tally()
