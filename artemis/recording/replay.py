"""Replay: feed what was sensed to a new decision core, and compare every command with the recorded one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import differences
from artemis.robot import Core


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """Result of a replay."""

    ticks: int
    """Ticks that were recomputed."""
    difference: str | None
    """The first tick that differs, and where; None: all are equal, bit for bit."""


def replay(recording: Recording, core: Core) -> Replayed:
    """Recompute the ticks of `recording`, up to the first that is missing, with `core`, made from the same mission."""
    number = 0
    for number, recorded in enumerate(islice(recording.ticks(), recording.number_before_gap), 1):
        if found := differences(recorded, core.decide(recorded.snapshot.sensed)):
            return Replayed(ticks=number, difference=f"tick {number - 1} differs: {'; '.join(found)}")
    return Replayed(ticks=number, difference=None)
