"""Trouble on the simulated wire."""

from __future__ import annotations

import random

from msgspec.structs import replace

from artemis.devices.can_bus import Frame
from artemis.sim.bus import Disturb


def random_disturbance(seed: int, *, loss: float = 0.0, corruption: float = 0.0, delay: float = 0.0) -> Disturb:
    """Trouble as a bad adapter or driver makes it; the same seed makes the same trouble.

    Args:
        seed: Of the sequence.
        loss: Probability that nobody hears a frame.
        corruption: Probability that one data bit arrives wrong.
        delay: Each frame is late by between 0 and this [s].
    """
    dice = random.Random(seed)

    def disturb(frame: Frame, _now: float) -> tuple[Frame | None, float]:
        late = dice.uniform(0.0, delay)
        if dice.uniform(0.0, 1.0) < loss:
            return None, late
        if frame.data and dice.uniform(0.0, 1.0) < corruption:
            bit = 1 << dice.randrange(8 * len(frame.data))
            wrong = (int.from_bytes(frame.data, "big") ^ bit).to_bytes(len(frame.data), "big")
            return replace(frame, data=wrong), late
        return frame, late

    return disturb
