"""The decision core with drives that obey, tick by tick."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from core_builders import PERIOD, ROBOT, ObedientDrives, sensed
from msgspec.structs import replace

from artemis.robot import Core
from artemis.states.plan import Plan, Step
from artemis.values import JobResult, Mode, OperatorInput, Sensed, SetPoints, Tick, Wish

REST = OperatorInput(source="stick", age=0.0)
STICK = replace(REST, speed=0.7, steering=0.2, enabled=True, neutral=False)
AHEAD = replace(STICK, steering=0.0)


class Live:
    """A core with obedient drives; every job is done by the next tick."""

    def __init__(self, *steps: Step, **plan: Any) -> None:
        """`plan`: other fields of it."""
        self.core = Core(Plan(**{"robot": ROBOT, "steps": steps, **plan}), PERIOD)
        self.drives = ObedientDrives()
        self.seen: list[Sensed] = []
        self.ticks: list[Tick] = []
        self.time = 0.0
        self.inputs: tuple[OperatorInput, ...] = (REST,)
        self._wish, self._points = Wish(exchange=False, heartbeat=False), SetPoints()

    def tick(self, **changes: Any) -> Tick:
        """The next tick; an urgent one takes no time."""
        results = tuple(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True) for job in self._wish.jobs)
        values = {
            "drives": self.drives.react(self._wish, self._points),
            "results": results,
            "inputs": self.inputs,
            **changes,
        }
        self.seen.append(sensed(self.time, **values))
        tick = self.core.decide(self.seen[-1])
        self._wish, self._points = tick.wish, tick.set_points
        self.ticks.append(tick)
        self.time += PERIOD
        return tick

    def until(self, done: Callable[[Tick], bool] | Mode, longest: float = 30.0, **changes: Any) -> Tick:
        latest = self.time + longest
        while self.time < latest:
            tick = self.tick(**changes)
            if tick.mode is done if isinstance(done, Mode) else done(tick):
                return tick
        raise AssertionError(f"never happened in {longest} s")
