"""How much time counts between the set-points of one tick and those of the next."""

from __future__ import annotations

from collections import deque

from artemis.values import Snapshot

ORDINARY, LIKE = 0.002, 5
"""A tick is held up whose set-points are sent later than those of one of so many before it, by more than this [s]."""


class Pace:
    """Remembers how long the last ticks took to send their set-points. Deterministic."""

    def __init__(self) -> None:
        self._began, self._took = 0.0, deque([0.0], maxlen=LIKE)

    def since_sent(self, snapshot: Snapshot) -> float:
        """Time that the gate may count [s], at most `snapshot.dt`.

        Set-points that were held up have just been sent: those of a tick right after them are hardly further on.
        Where every tick takes as long, this one will, too.
        """
        sensed = snapshot.sensed
        if not sensed.urgent:
            self._took.append(max(0.0, sensed.sent - self._began))
            self._began = sensed.time
        return min(snapshot.dt, sensed.time - sensed.sent + min(self._took) + ORDINARY)
