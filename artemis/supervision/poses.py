"""What the supervisor measures of a localizer at every tick: how sure it is, and whether its times can be true."""

from __future__ import annotations

from collections import deque

from artemis.motion.localisation import KEPT
from artemis.supervision.measures import Reading
from artemis.values import Mode, Request, Sensed

FIXES = 10
"""So many of the last fixes are looked at for impossible times."""
_BY_POSE = (Mode.FOLLOW, Mode.ACT)
_STOPPED = (Mode.QUICKSTOP, Mode.FAULT)


class PoseMeasures:
    """Of all fixes. They matter where the robot drives by its pose, and while it stands because of them."""

    def __init__(self, tick: float) -> None:
        """`tick`: period of the scheduled ticks [s]."""
        self._tick = tick
        self._newest, self._doubt, self._quality = 0.0, 0.0, 1.0
        self._wrong: deque[bool] = deque(maxlen=FIXES)
        self._stopped = False
        """The robot was stopped for it, and no person has looked since."""

    def read(self, sensed: Sensed, mode: Mode) -> list[Reading]:
        """Readings, where the robot is in that mode."""
        for fix in sensed.fixes:
            self._wrong.append(not sensed.time - KEPT <= fix.time <= sensed.time + self._tick)
            if fix.time >= self._newest:
                self._newest, self._doubt, self._quality = min(fix.time, sensed.time), fix.doubt, fix.quality
        self._stopped = self._stopped and mode in _STOPPED and Request.ACKNOWLEDGE not in sensed.requests
        if mode not in _BY_POSE and not self._stopped:
            return []
        readings: list[Reading] = []
        if self._doubt > 0.0:
            self._stopped = self._stopped or self._doubt >= 1.0
            words = f"doubt {self._doubt:.2f}, {100 * self._quality:.0f} % of what it sees fits the map"
            readings.append(("LOC-03", "", self._doubt, words))
        if wrong := self._wrong.count(True):
            readings.append(("LOC-05", "", float(wrong), f"{wrong} of {len(self._wrong)} fixes"))
        return readings
