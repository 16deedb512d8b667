"""Goals and initial poses that inputs gave, as entries of a journal: who gave which, and whether a goal counts."""

from __future__ import annotations

from collections.abc import Iterator

from artemis.recording.journal import Entry, Level
from artemis.states.goto import place_words
from artemis.values import OperatorInput, Pose, Tick


class AskedPoses:
    """Tells each once, however often it is given again."""

    def __init__(self) -> None:
        self._told: dict[tuple[str, str], Pose] = {}

    def entries(self, tick: Tick, sample: OperatorInput) -> Iterator[Entry]:
        """Those of one input that are new in a tick. A goal that counts is an event of the mission."""
        if (goal := sample.goal) is not None and self._is_new("goal", sample.source, goal):
            text = f"{place_words(goal)} (by {sample.source})"
            if not any(event.kind == "goal" and event.text == text for event in tick.events):
                words = f"goal {text}: ignored, no step asks for it now"
                yield Entry(time=tick.snapshot.time, kind="goal", text=words, level=Level.WARNING)
        if (initial := sample.initial_pose) is not None and self._is_new("pose", sample.source, initial.pose):
            text = f"initial pose {place_words(initial.pose)} (by {sample.source})"
            yield Entry(time=tick.snapshot.time, kind="pose", text=text)

    def _is_new(self, kind: str, source: str, pose: Pose) -> bool:
        known, self._told[kind, source] = self._told.get((kind, source)), pose
        return known != pose
