"""The border to foreign code: plugins are asked here, and whatever they do instead of an answer becomes a fault.

The Python exceptions of a plugin are all caught here, each becomes a fault with its text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from typing import ClassVar

from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import Follower, Following, InputDevice
from artemis.values import OperatorInput, Request, Snapshot

LATE = 0.015
"""A plugin has this long for an answer [s]."""
MISSES = 3
"""As many late answers in a row are a fault."""
BAD_SAMPLES, BAD_TIME = 5, 1.0
"""As many samples out of range within this time [s] are a fault."""
RAISED, LATE_INPUT, GARBAGE, OUT_OF_RANGE, LATE_FOLLOWER = "PLG-02", "PLG-03", "PLG-06", "INP-06", "PTH-09"

Problem = tuple[str, str, str]
"""Row of the fault table, plugin, what was seen."""


class Border:
    """Asks the inputs of a run, and measures how long each plugin takes."""

    def __init__(self, inputs: Mapping[str, InputDevice], clock: Callable[[], float]) -> None:
        """`clock` measures the plugins [s]."""
        self._inputs, self._clock = inputs, clock
        self._last: dict[str, tuple[float, OperatorInput]] = {}
        self._late: dict[str, int] = {}
        self._bad: dict[str, list[float]] = {}
        self._problems: list[Problem] = []

    def read(self, now: float) -> tuple[OperatorInput, ...]:
        """The newest sample of each input at run time `now` [s]; those that gave none, or garbage, are missing."""
        return tuple(sample for name in self._inputs if (sample := self._ask(name, now)) is not None)

    def take_problems(self) -> list[Problem]:
        """What plugins did wrong since the last call."""
        problems, self._problems = self._problems, []
        return problems

    def watched(self, follower: Follower) -> Follower:
        """The follower, its time measured."""
        return _WatchedFollower(follower, self._clock, self._judge_time)

    def _ask(self, name: str, now: float) -> OperatorInput | None:
        begun = self._clock()
        try:
            sample = self._inputs[name].read(now)
        except Exception as error:  # noqa: BLE001
            self._problems.append((RAISED, name, repr(error)))
            return None
        self._judge_time(LATE_INPUT, name, self._clock() - begun)
        if not isinstance(sample, OperatorInput):
            self._problems.append((GARBAGE, name, repr(sample)[:80]))
            return None
        if not is_whole_input(sample):
            return self._instead_of(sample, name, now)
        self._last[name] = now, sample
        return sample

    def _instead_of(self, sample: OperatorInput, name: str, now: float) -> OperatorInput | None:
        """The last good sample, grown older; too many bad ones are a fault."""
        bad = self._bad[name] = [time for time in self._bad.get(name, []) if time > now - BAD_TIME] + [now]
        if len(bad) >= BAD_SAMPLES:
            self._problems.append((OUT_OF_RANGE, name, repr(sample)[:200]))
        if name not in self._last:
            return None
        then, last = self._last[name]
        return replace(last, requests=(), age=None if last.age is None else last.age + now - then)

    def _judge_time(self, id: str, name: str, took: float) -> None:
        self._late[name] = self._late.get(name, 0) + 1 if took > LATE else 0
        if self._late[name] >= MISSES:
            self._problems.append((id, name, f"{took * 1000:.0f} ms, {self._late[name]} times in a row"))


class _WatchedFollower:
    """A follower whose answers are timed."""

    Config: ClassVar[type[Config]] = Config

    def __init__(
        self, follower: Follower, clock: Callable[[], float], judge: Callable[[str, str, float], None]
    ) -> None:
        self._follower, self._clock, self._judge = follower, clock, judge

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self._follower.start(path, snapshot)

    def step(self, snapshot: Snapshot) -> Following:
        begun = self._clock()
        try:
            return self._follower.step(snapshot)
        finally:
            self._judge(LATE_FOLLOWER, "follower", self._clock() - begun)


def is_whole_input(sample: OperatorInput) -> bool:
    """Whether a sample's numbers are finite and in range, and its requests and buttons are some."""
    try:
        numbers = (sample.speed, sample.steering, *(() if sample.age is None else (sample.age,)))
        return (
            all(isfinite(number) for number in numbers)
            and all(-1.0 <= axis <= 1.0 for axis in sample.axes)
            and all(isinstance(button, bool) for button in sample.buttons)
            and all(isinstance(request, Request) for request in sample.requests)
            and isinstance(sample.source, str)
        )
    except (TypeError, OverflowError):
        return False


def is_whole_following(answer: object) -> bool:
    """Whether a follower's answer is one, with numbers in it. The gate judges those of the command (RUN-11)."""
    if not isinstance(answer, Following):
        return False
    command, tracking = answer.command, answer.tracking
    try:
        told = (tracking.arc_length, tracking.length, tracking.cross_track, tracking.heading_error)
        finite = [isfinite(number) for number in (*told, command.speed, command.steering)]
    except (AttributeError, TypeError, OverflowError):
        return False
    return all(finite[: len(told)])
