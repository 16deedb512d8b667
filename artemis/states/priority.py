"""Which of several operator inputs has the robot, by priority; a lower one begins at rest and at standstill."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from artemis.plugins.stated import STALE
from artemis.supervision import catalogue
from artemis.values import Fault, OperatorInput, Request


class HandOver(NamedTuple):
    """Who has the robot in a tick. Inputs are numbered in the order of their priority."""

    active: int | None
    """The first whose enable button is held."""
    drives: bool
    """Its press counts."""
    rested: bool
    """Its controls were neutral since another one had the robot, or since it was lost."""
    needed: int
    """So many, from the first on, have to be heard: up to the one that is active, or was before the robot stands."""


class Priority:
    """Which of several inputs has the robot: the first that is active, also while a later one drives.

    A later one may only begin at standstill, with all its controls neutral since the one before it was released. Who
    released the enable button in motion begins again at standstill, too (INP-09).
    """

    def __init__(self, released: Sequence[bool], stale: Sequence[float] = ()) -> None:
        """Of inputs whose samples count until they are `stale` [s]; of each, whether its controls were seen at rest."""
        self._stale = tuple(stale) or (STALE,) * len(released)
        self._rested, self._released = list(released), list(released)
        self._last = 0

    def decide(self, samples: Sequence[OperatorInput], *, standing: bool) -> HandOver:
        """Whose turn it is, from the newest sample of each input; `standing`: the robot stands."""
        heard = [is_heard(sample, stale) for sample, stale in zip(samples, self._stale, strict=True)]
        active = next((n for n, sample in enumerate(samples) if heard[n] and sample.enabled), None)
        drives = active is not None and self._released[active]
        if active is not None:
            self._last = active
        elif standing:
            self._last = 0
        for n, sample in enumerate(samples):
            if not heard[n] or (active is not None and n > active):
                self._rested[n] = self._released[n] = False
            elif n != active:
                self._rested[n] = self._rested[n] or sample.neutral
                self._released[n] = self._rested[n] and (standing or drives)  # drives: a later one
        return HandOver(active, drives, active is None or self._rested[active], self._last + 1)

    def unheard(self, samples: Sequence[OperatorInput]) -> list[Fault]:
        """The faults that those are which are not heard."""
        pairs = zip(samples, self._stale, strict=True)
        return [unheard_fault(sample) for sample, stale in pairs if not is_heard(sample, stale)]


def is_heard(sample: OperatorInput, stale: float = STALE) -> bool:
    """Whether a sample is new enough to drive by."""
    return sample.age is not None and sample.age <= stale


def heard(names: Sequence[str], stale: Sequence[float], samples: Iterable[OperatorInput]) -> frozenset[str]:
    """Those of some inputs, with their limits [s] or the limit of devices, whose samples are new enough to drive by."""
    limits = dict(zip(names, stale or (STALE,) * len(names), strict=True))
    return frozenset(it.source for it in samples if it.source in limits and is_heard(it, limits[it.source]))


def unheard_fault(sample: OperatorInput) -> Fault:
    """The fault that an input is which is not heard."""
    return catalogue.fault("INP-01" if sample.age is None else "INP-03", sample.source)


def asked(request: Request, samples: Sequence[OperatorInput]) -> bool:
    """Whether one of the inputs asks for it."""
    return any(request in sample.requests for sample in samples)
