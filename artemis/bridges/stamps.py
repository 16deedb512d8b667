"""When something happened by the clock on the wall, which other programs' messages are stamped with."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

from artemis.clock import wall_date

STEP = 1.0
"""The wall clock was set if it differs by more [s]."""
DRIFT = 1e-5
"""It may lose as much against the run's clock from one tick to the next [s]."""


class Stamps:
    """Wall times of run times. A tick is seen some time after it was: the least that passed is the truth."""

    def __init__(self, wall: Callable[[], datetime] = wall_date) -> None:
        self._wall = wall
        self._offset: float | None = None

    def stamp(self, time: float) -> int:
        """The wall time of a tick that is seen now, at run time `time` [s]; nanoseconds since 1970."""
        offset = self._wall().timestamp() - time
        if self._offset is None or abs(offset - self._offset) > STEP:
            self._offset = offset
        else:
            self._offset = min(offset, self._offset + DRIFT)
        return round((self._offset + time) * 1e9)
