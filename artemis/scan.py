"""What a laser scanner measures in one turn, and how fast the robot may drive for what the scanners see."""

from __future__ import annotations

from enum import IntEnum
from math import inf
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


class Scan(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
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


class ObstacleRules(Struct, frozen=True, kw_only=True, gc=False):
    """What the robot does about obstacles in one of the mission's steps."""

    mode: str = "off"  # stop; slow: it creeps instead of stopping; off: they are ignored
    margin: float = 0.08  # the outline counts as so much larger on every side [m]
    clear: float = 0.05  # it stops so far before contact of that [m]
    blocked_after: float = 30.0  # a step of the mission waits no longer for a free path [s]
    free_after: float = 1.0  # it drives on once the path was free for so long [s]
    unseen_reverse: bool = False  # it may drive backwards over ground that it has not seen


USUAL = ObstacleRules()
"""A robot that keeps more distance than by these looks so much farther."""


class Clearance(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """What the scanners leave to the robot on the arcs that it may drive now."""

    speed: float = inf  # of the virtual wheel, from which it still stops in time [m/s]
    distance: float = inf  # that it may drive [m]
    blocked: float = 0.0  # how long it has stood for an obstacle [s]; 0: it does not
    unseen: bool = False  # it stands because the ground was not seen
    no_scan: bool = False  # it stands because a scanner has given no scan yet, or none for too long

    @property
    def holds(self) -> bool:
        """Whether the robot stands for it."""
        return self.blocked > 0.0 or self.no_scan


def _numbers(packed: bytes) -> NDArray[np.uint16]:
    import numpy as np

    return np.frombuffer(packed, "<u2")
