"""Which of several operator inputs has the robot, by priority; a lower one begins at rest and at standstill."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from artemis.supervision import catalogue
from artemis.values import Fault, OperatorInput, Request

STALE = 0.15
"""A sample older than this [s] stops the robot: the device is frozen or gone (INP-03)."""


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

    def __init__(self, inputs: int) -> None:
        """Of so many inputs; the controls of all are neutral."""
        self._rested, self._released = [True] * inputs, [True] * inputs
        self._last = 0

    def decide(self, samples: Sequence[OperatorInput], *, standing: bool) -> HandOver:
        """Whose turn it is, from the newest sample of each input; `standing`: the robot stands."""
        active = next((n for n, sample in enumerate(samples) if is_heard(sample) and sample.enabled), None)
        drives = active is not None and self._released[active]
        if active is not None:
            self._last = active
        elif standing:
            self._last = 0
        for n, sample in enumerate(samples):
            if not is_heard(sample) or (active is not None and n > active):
                self._rested[n] = self._released[n] = False
            elif n != active:
                self._rested[n] = self._rested[n] or sample.neutral
                self._released[n] = self._rested[n] and (standing or drives)  # drives: a later one
        return HandOver(active, drives, active is None or self._rested[active], self._last + 1)


def is_heard(sample: OperatorInput) -> bool:
    """Whether a sample is new enough to drive by."""
    return sample.age is not None and sample.age <= STALE


def unheard_fault(sample: OperatorInput) -> Fault:
    """The fault that an input is which is not heard."""
    return catalogue.fault("INP-01" if sample.age is None else "INP-03", sample.source)


def asked(request: Request, samples: Sequence[OperatorInput]) -> bool:
    """Whether one of the inputs asks for it."""
    return any(request in sample.requests for sample in samples)
