"""What a laser scanner measures in one turn, as bytes: a thousand numbers cost little more than one to record."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from msgspec import Struct

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Condition(IntEnum):
    """What a scanner says of itself."""

    WELL = 0
    DIRTY = 1  # it still sees, but its window wants to be cleaned
    FAULTY = 2  # what it measures cannot be trusted


class Scan(Struct, frozen=True, kw_only=True, gc=False):
    """One scan, seen from the scanner: angles count counter-clockwise from its x axis, seen from above."""

    source: str
    """The scanner's name."""
    time: float
    """Run time of the first beam [s]; of a scan that began before the run it is negative."""
    beam_time: float = 0.0  # between two neighbouring beams [s]; a simulated scanner measures all of them at once
    start_angle: float  # of the first beam [rad]
    increment: float  # from one beam to the next [rad]; negative: the scanner turns clockwise
    ranges: bytes
    """Of each beam its distance as unsigned 16-bit integer, low byte first [mm]. 0: no return."""
    intensities: bytes = b""
    """Likewise how strong each return was, in the scanner's own unit. Empty: it does not say."""
    counter: int = 0  # by the scanner: a scan whose number is not the next one lost others, one with the same is frozen
    status: int = 0  # as the scanner reports it, in its own bits; 0: well
    condition: Condition = Condition.WELL  # what that means
    garbled: int = 0  # telegrams that came since the scan before, and could not be read

    @property
    def millimetres(self) -> NDArray[np.uint16]:
        """The ranges as a read-only view, one per beam [mm]. 0: no return."""
        return _numbers(self.ranges)

    @property
    def strengths(self) -> NDArray[np.uint16]:
        """The intensities as a read-only view, one per beam or none at all."""
        return _numbers(self.intensities)


def _numbers(packed: bytes) -> NDArray[np.uint16]:
    import numpy as np

    return np.frombuffer(packed, "<u2")
