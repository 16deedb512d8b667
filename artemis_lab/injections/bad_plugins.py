"""Inputs, followers and behaviours that pass through what they wrap, until they are told to misbehave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from typing import Any, ClassVar, TypeVar

from msgspec.structs import replace

from artemis.clock import stall
from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import Acting, Behaviour, Follower, Following, InputDevice, Localizer, SeesTicks, State
from artemis.values import DriveCommand, OperatorInput, PoseFix, Snapshot, Tick

Answer = TypeVar("Answer")

InputBehaviour = Callable[[OperatorInput, float], Any]
"""What a device answers instead of a sample, at run time [s]; it may raise."""
FollowerBehaviour = Callable[[Any, float], Any]
"""What a follower, or the behaviour of a step, answers instead, at run time [s]; it may raise."""
LocalizerBehaviour = Callable[[PoseFix], Sequence[PoseFix]]
"""What a localizer tells instead of a fix."""
Agenda = Sequence[tuple[float, FollowerBehaviour | None]]
"""Run times [s] in their order, and how to behave from then on; None: as what is wrapped."""


class BadInput:
    """An input device around another."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, device: InputDevice) -> None:
        self._device = device
        self._behaviour: InputBehaviour | None = None

    def misbehave(self, behaviour: InputBehaviour | None) -> None:
        """Answer as `behaviour` says from now on; None: as the device."""
        self._behaviour = behaviour

    def read(self, now: float) -> OperatorInput:
        """The device's sample, or what the behaviour makes of it."""
        sample = self._device.read(now)
        answer: OperatorInput = sample if self._behaviour is None else self._behaviour(sample, now)
        return answer

    def close(self) -> None:
        """Close the device."""
        self._device.close()


class _BadDriver:
    """What it does wrong it does at run times, so that a replay does the same."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, agenda: Agenda) -> None:
        self._agenda = list(agenda)
        self._behaviour: FollowerBehaviour | None = None

    def misbehave(self, behaviour: FollowerBehaviour | None) -> None:
        """Answer as `behaviour` says from now on; None: as what is wrapped."""
        self._behaviour = behaviour

    def _altered(self, answer: Answer, now: float) -> Answer:
        """The answer, or what the behaviour makes of it."""
        while self._agenda and self._agenda[0][0] <= now:
            self._behaviour = self._agenda.pop(0)[1]
        altered: Answer = answer if self._behaviour is None else self._behaviour(answer, now)
        return altered


class BadFollower(_BadDriver):
    """A follower around another."""

    def __init__(self, follower: Follower, agenda: Agenda = ()) -> None:
        super().__init__(agenda)
        self._follower = follower

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Start the follower."""
        self._follower.start(path, snapshot)

    def step(self, snapshot: Snapshot) -> Following:
        """The follower's answer, or what is made of it."""
        return self._altered(self._follower.step(snapshot), snapshot.time)


class BadBehaviour(_BadDriver):
    """The behaviour of a step around another."""

    def __init__(self, behaviour: Behaviour, agenda: Agenda = ()) -> None:
        super().__init__(agenda)
        self._wrapped = behaviour

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        """Start the behaviour."""
        self._wrapped.start(snapshot, state)

    def step(self, snapshot: Snapshot) -> Acting:
        """The behaviour's answer, or what is made of it."""
        return self._altered(self._wrapped.step(snapshot), snapshot.time)


class BadLocalizer:
    """A localizer around another, which sees the ticks if that wants to."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._behaviour: LocalizerBehaviour | None = None

    def misbehave(self, behaviour: LocalizerBehaviour | None) -> None:
        """Tell of each fix what `behaviour` makes of it from now on; None: as the localizer."""
        self._behaviour = behaviour

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """The localizer's fixes, or what the behaviour makes of them."""
        fixes, behaviour = self._localizer.fixes(now), self._behaviour
        return fixes if behaviour is None else tuple(each for fix in fixes for each in behaviour(fix))

    def see(self, tick: Tick) -> str:
        """Let the localizer see."""
        return self._localizer.see(tick) if isinstance(self._localizer, SeesTicks) else ""

    def close(self) -> None:
        """Close the localizer."""
        self._localizer.close()


# ---------------------------------------------------------------------------------------------- of both


def raises(error: Exception) -> Callable[[object, float], Any]:
    """Raise this at every call."""

    def behave(_answer: object, _now: float) -> Any:  # noqa: ANN401 (never returns)
        raise error

    return behave


def returns(answer: object) -> Callable[[object, float], Any]:
    """Return this, whatever it is."""
    return lambda _answer, _now: answer


def is_late(seconds: float, times: int) -> Callable[[Answer, float], Answer]:
    """Take so long for the next `times` answers [s]."""
    calls = count()

    def behave(answer: Answer, _now: float) -> Answer:
        if next(calls) < times:
            stall(seconds)
        return answer

    return behave


def leaks(size: int) -> Callable[[Answer, float], Answer]:
    """Keep so many bytes more at every call."""
    kept: list[bytearray] = []

    def behave(answer: Answer, _now: float) -> Answer:
        kept.append(bytearray(size))
        return answer

    return behave


# ---------------------------------------------------------------------------------------------- of input devices


def freezes() -> InputBehaviour:
    """No new sample: the present one grows older."""
    held: list[tuple[OperatorInput, float]] = []

    def behave(sample: OperatorInput, now: float) -> OperatorInput:
        if not held:
            held.append((replace(sample, requests=()), now))
        last, since = held[0]
        return replace(last, age=None if last.age is None else last.age + now - since)

    return behave


def becomes(**changes: Any) -> InputBehaviour:  # noqa: ANN401 (values of any field)
    """Every sample, with some of its fields changed."""
    return lambda sample, _now: replace(sample, **changes)


def jumps(speed: float) -> InputBehaviour:
    """Both axes change from one stop to the other at every sample, the wish with them [m/s]."""
    signs = count()

    def behave(sample: OperatorInput, _now: float) -> OperatorInput:
        sign = 1.0 if next(signs) % 2 else -1.0
        axes = tuple(sign for _ in sample.axes)
        return replace(sample, speed=sign * speed, axes=axes, enabled=True, neutral=False, age=0.0)

    return behave


# ---------------------------------------------------------------------------------------------- of what drives


def holds_command() -> FollowerBehaviour:
    """The present command for ever, and never an end."""
    held: list[DriveCommand | None] = []

    def behave(answer: Following | Acting, _now: float) -> Following | Acting:
        if not held:
            held.append(answer.command)
        unfinished: dict[str, Any] = {"outcome": None} if isinstance(answer, Acting) else {"finished": False}
        return replace(answer, command=held[0], **unfinished)

    return behave


def commands(speed: float, steering: float) -> FollowerBehaviour:
    """This speed [m/s] and angle [rad] of the virtual front wheel, whatever they are."""
    return lambda following, _now: replace(following, command=DriveCommand(speed=speed, steering=steering))
