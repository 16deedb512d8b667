"""Replay: feed what was sensed to a new mind, and compare every command with the recorded one."""

from __future__ import annotations

from dataclasses import dataclass

from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import tick_record
from artemis.robot import Core


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """Result of a replay."""

    ticks: int
    """Ticks that were recomputed."""
    difference: str | None
    """The first tick that differs, and where; None: all are equal, bit for bit."""


def replay(recording: Recording, core: Core) -> Replayed:
    """Recompute the ticks of `recording` with `core`, made from the same mission."""
    number = 0
    for number, recorded in enumerate(recording.ticks(), 1):
        tick = core.decide(recorded.sensed)
        again = tick_record(tick, recorded.record.true_pose, recorded.record.late_s)
        if again != recorded.raw:
            return Replayed(ticks=number, difference=_difference(number - 1, recorded.raw, again))
    return Replayed(ticks=number, difference=None)


def _difference(index: int, recorded: bytes, again: bytes) -> str:
    place = next((i for i, (a, b) in enumerate(zip(recorded, again, strict=False)) if a != b), len(recorded))
    begin = max(0, place - 60)
    was, now = recorded[begin : place + 40].decode(), again[begin : place + 40].decode()
    return f"tick {index} differs: recorded ...{was}... recomputed ...{now}..."
