"""The border to foreign code: plugins are asked here, and whatever they do instead of an answer becomes a fault.

The Python exceptions of a plugin are all caught here, each becomes a fault with its text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from typing import ClassVar, TypeGuard

from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.motion.path import Path
from artemis.plugins.contracts import Follower, Following, InputDevice
from artemis.values import OperatorInput, Request, Snapshot

LATE = 0.015
"""A plugin has this long for an answer [s]."""
MISSES = 3
"""As many late answers in a row are a fault."""
BAD_SAMPLES, BAD_TIME = 5, 1.0
"""As many samples out of range within this time [s] are a fault."""
LOST, OUT_OF_RANGE = "INP-01", "INP-06"
RAISED, LATE_INPUT, GARBAGE, LATE_FOLLOWER = "PLG-02", "PLG-03", "PLG-06", "PTH-09"

Problem = tuple[str, str, str]
"""Row of the fault table, plugin, what was seen."""


class Border:
    """Asks the inputs of a run, and measures how long each plugin takes."""

    def __init__(self, inputs: Mapping[str, InputDevice], clock: Callable[[], float]) -> None:
        """`clock` measures the plugins [s]."""
        self.inputs, self._clock = inputs, clock
        self._last: dict[str, tuple[float, OperatorInput]] = {}
        self._late: dict[tuple[str, str], int] = {}
        self._bad: dict[str, list[float]] = {}
        self._problems: list[Problem] = []

    def read(self, now: float) -> tuple[OperatorInput, ...]:
        """The newest sample of each input at run time `now` [s]; those that gave none, or garbage, are missing."""
        return tuple(sample for name in self.inputs if (sample := self._ask(name, now)) is not None)

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
            sample = self.inputs[name].read(now)
        except DeviceLost as error:
            self._problems.append((LOST, name, error.problem))
            return None
        except Exception as error:  # noqa: BLE001
            self._problems.append((RAISED, name, repr(error)))
            return None
        self._judge_time(LATE_INPUT, name, self._clock() - begun)
        if not is_whole_input(sample):
            self._problems.append((GARBAGE, name, repr(sample)[:80]))
            return None
        if not is_in_range(sample):
            return self._instead_of(sample, name, now)
        self._last[name] = now, sample
        return sample

    def _instead_of(self, sample: OperatorInput, name: str, now: float) -> OperatorInput:
        """The last good sample, grown older; too many bad ones are a fault. A stop is obeyed whatever comes with it."""
        bad = self._bad[name] = [time for time in self._bad.get(name, []) if time > now - BAD_TIME] + [now]
        if len(bad) >= BAD_SAMPLES:
            self._problems.append((OUT_OF_RANGE, name, repr(sample)[:200]))
        stops = tuple(request for request in sample.requests if request is Request.QUICKSTOP)
        then, last = self._last.get(name, (now, OperatorInput(source=name)))
        return replace(last, requests=stops, age=None if last.age is None else last.age + now - then)

    def _judge_time(self, id: str, name: str, took: float) -> None:
        late = self._late[id, name] = self._late.get((id, name), 0) + 1 if took > LATE else 0
        if late >= MISSES:
            self._problems.append((id, name, f"{took * 1000:.0f} ms, {late} times in a row"))


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


def is_whole_input(answer: object) -> TypeGuard[OperatorInput]:
    """Whether an input's answer is a sample, with numbers, buttons and requests in it."""
    if not isinstance(answer, OperatorInput):
        return False
    numbers = (answer.speed, answer.steering, 0.0 if answer.age is None else answer.age)
    flags = (answer.enabled, answer.neutral)
    parts = ((answer.axes, (int, float)), (answer.buttons, bool), (flags, bool), (answer.requests, Request))
    return (
        all(isinstance(number, int | float) for number in numbers)
        and all(isinstance(found, tuple) and all(isinstance(part, kind) for part in found) for found, kind in parts)
        and isinstance(answer.source, str)
    )


def is_in_range(sample: OperatorInput) -> bool:
    """Whether a sample's numbers are finite, and its axes between -1 and 1."""
    try:
        numbers = (sample.speed, sample.steering, 0.0 if sample.age is None else sample.age)
        return all(map(isfinite, numbers)) and all(-1.0 <= axis <= 1.0 for axis in sample.axes)
    except OverflowError:  # a whole number too large for a float
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
