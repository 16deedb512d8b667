"""Mode calibrate: align the wheels again from the potentiometers."""

from __future__ import annotations

from dataclasses import replace

from artemis.states.alignment import align
from artemis.states.mode import ON, Routine, RoutineMode
from artemis.values import Event, Snapshot


class CalibrateMode(RoutineMode):
    """The step `calibrate: {steering: from_potentiometers}`."""

    def routine(self, snapshot: Snapshot) -> Routine:
        """Align, then done."""
        yield from align(self.plan, snapshot)
        self.plan.advance()
        yield replace(ON, event=Event.DONE, phase="aligned")
        while True:
            yield ON
