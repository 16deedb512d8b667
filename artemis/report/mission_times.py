"""Where the mission of a run was: how often and how long each step ran, and what it ended with. Holds no ticks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import shorten
from typing import Any

from artemis.progress import DONE, NO_PATH, SHORT, MissionEvent, Position
from artemis.report.mission_boxes import is_list
from artemis.states.modes import RUNNING
from artemis.states.outline import is_beside, numbered
from artemis.states.step_names import name_of
from artemis.states.whereabouts import counts
from artemis.values import Tick
from artemis.yaml_file import dotted

LONGEST_NAME = 30
"""Characters of the present step's."""
_EXPLAINED = (NO_PATH, SHORT)
"""Outcomes with which the phase says why."""
_REASONS = ("ended", "fired", "expired", "end")
"""Events that may end a mission."""


@dataclass(slots=True, kw_only=True)
class StepTime:
    """One step that takes time, over a whole run."""

    path: str
    """Key path in the mission."""
    name: str
    number: int = 0
    """How often it began."""
    began: float | None = None
    """When it first did [s of the run]; None: never, or beside others."""
    time: float = 0.0
    """In which it was the present step and the mission ran [s]; steps beside others have none."""
    outcomes: Counter[str] = field(default_factory=Counter)
    """How often it ended with each."""
    open: str = ""
    """Why it has not ended since it began last; empty: it has."""

    @property
    def left(self) -> str:
        """What it ended with, and how often if that differs."""
        ends = [f"{name} {number}x" if len(self.outcomes) > 1 else name for name, number in self.outcomes.items()]
        return ", ".join([*ends, *([self.open] if self.open else [])])

    @property
    def words(self) -> str:
        """In one line."""
        return " · ".join([f"{self.number}x", *([f"{self.time:.1f} s"] if self.time else []), self.left])


class MissionTimes:
    """Sees every tick of a run once.

    Attributes:
        steps: The mission's steps that take time, by number.
        present: The one that runs now, or ran last; None: none has begun.
        before: The one before it, and why that ended; empty: there was none.
        ended: How the mission ended, if not by doing all of its steps.
    """

    def __init__(self, mission: Mapping[str, Any]) -> None:
        """`mission`: as recorded."""
        self._written, self._position, self._is_list = mission.get("steps"), Position(), is_list(mission)
        found = numbered(self._written)
        self.steps = [StepTime(path=dotted(path), name=name_of(word, body)) for path, word, body in found]
        self._by_path = {step.path: step for step in self.steps}
        self.ended = ""
        self._events: Counter[tuple[str, str]] = Counter()
        self._reason: MissionEvent | None = None
        self._said = self._why = ""
        self.present: StepTime | None = None
        self.before = ""
        self._last = 0.0

    def see(self, tick: Tick) -> None:
        """The next tick."""
        time = tick.snapshot.sensed.time
        self._position = position = tick.position
        runs = tick.mode in RUNNING
        if runs and self.present is not None:
            self.present.time += time - self._last
        self._last, self.ended = time, position.ended
        for event in tick.events:
            self._happened(event)
        if tick.events and tick.wish.outcome:
            self._why = tick.wish.phase if tick.wish.outcome in _EXPLAINED else ""
        if runs or tick.events:
            step = self.steps[position.step] if position.step < len(self.steps) else None
            present = self.present
            if self._is_list and present is not None and present is not step and present.open:
                self._end(present, DONE)  # what lets a list go on is not told
            if step is not None and (not step.open or (step is not self.present and position.done == 0.0)):
                step.number += 1
                step.began = time if step.began is None else step.began
            if step is not None and (not step.open or step is not self.present):
                step.open = "unfinished"
            self.present = step

    def _happened(self, event: MissionEvent) -> None:
        self._events[event.kind, event.place] += 1
        if event.kind == "said":
            self._said = event.text
        if event.kind in _REASONS and event.text != DONE:
            self._reason = event
        step = self._by_path.get(event.place)
        if event.kind == "ended" and step is not None:
            self._end(step, event.text)
        elif event.kind in ("fired", "expired") and not is_beside(event.place):
            if self.present is not None and self.present.open:
                self.present.open = f"interrupted: {event.text}"
                self.before = f"{self.present.name}: {self.present.open}"

    def _end(self, step: StepTime, outcome: str) -> None:
        if step is self.present:
            self.before = f"{step.name}: {outcome}"
        step.number += not step.open  # one beside others
        step.outcomes[outcome] += 1
        step.open = ""

    @property
    def counts(self) -> list[str]:
        """Rounds and attempts around the present step, the outermost first."""
        return counts(self._written, self._position)

    @property
    def here(self) -> str:
        """The present step with its rounds and attempts, how often and how long it ran; empty: none runs."""
        step = self.present
        if step is None or self._position.step >= len(self.steps):
            return ""
        name = shorten(step.name, LONGEST_NAME, placeholder="…")
        return ", ".join([name, *self.counts, f"{step.number}x {step.time:.0f} s"])

    @property
    def ran(self) -> list[StepTime]:
        """Steps that began."""
        return [step for step in self.steps if step.number]

    def began(self) -> dict[str, float]:
        """When steps first began [s of the run], by name; of several with one name the first of the mission."""
        times: dict[str, float] = {}
        for step in self.ran:
            if step.began is not None:
                times.setdefault(step.name, step.began)
        return times

    @property
    def marks(self) -> dict[str, str]:
        """What stands in the mission's picture, by key path."""
        told = {"round": "next round", "retry": "retried", "caught": "caught", "fired": "condition met"}
        told |= {"expired": "time limit reached", "said": "", "end": ""}
        marks: dict[str, str] = {}
        for (kind, path), number in self._events.items():
            if kind in told:
                marks[path] = " · ".join(filter(None, [marks.get(path), f"{told[kind]} {number}x".strip()]))
        return {**marks, **{step.path: step.words for step in self.ran}}

    @property
    def failure(self) -> str:
        """Which outcome ended the mission, and of what; empty: none did."""
        if not self.ended or self._reason is None:
            return ""
        path = self._reason.place
        if self._reason.kind == "end":
            return f"the mission ended itself at {path}" + (f": {self._said}" if self._said else "")
        step = self._by_path.get(path)
        what = f"step “{step.name}” ({path})" if step else f"{path} ({self._reason.text})"
        why = f" ({self._why})" if self._why and self.ended in _EXPLAINED else ""
        return f"{what} ended with {self.ended}{why}, and no try catches that"

    @property
    def remedy(self) -> str:
        """How to catch it; empty: there is nothing to catch."""
        if not self.failure or (self._reason is not None and self._reason.kind == "end"):
            return ""
        name = f'"{self.ended}"' if ":" in self.ended else self.ended
        return f"to continue then, write try: {{steps: [...], catch: {{{name}: [...]}}}} around it"
