"""Plays one routine of a mode, with drives that obey at once and jobs that give what the test says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from core_builders import ObedientDrives, Player
from msgspec.structs import replace

from artemis.states.mode import OFF, Routine, RoutineMode
from artemis.states.plan import Shared
from artemis.values import Fault, Job, JobKind, JobResult, Snapshot, Wish

OVER = "over"
"""Phase of the wishes after a routine has ended."""


class _OneRoutine(RoutineMode):
    """Mode of a routine that a test makes, which returns the last snapshot that it saw."""

    def __init__(self, shared: Shared, make: Callable[[Shared, Snapshot], Routine]) -> None:
        super().__init__(shared)
        self._make = make

    def routine(self, snapshot: Snapshot) -> Routine:
        returned = yield from self._make(self.shared, snapshot)
        assert returned is self._seen
        while True:
            yield replace(OFF, phase=OVER)

    def step(self, snapshot: Snapshot) -> Wish:
        self._seen = snapshot
        return super().step(snapshot)


class RoutinePlayer(Player):
    """A player of one routine; `told` are the values of jobs, by kind and drive, `faults` those of refused ones."""

    def __init__(
        self, shared: Shared, make: Callable[[Shared, Snapshot], Routine], drives: ObedientDrives | None = None
    ) -> None:
        self.drives = drives or ObedientDrives()
        super().__init__(_OneRoutine(shared, make), self.drives.react)
        self.told: dict[tuple[JobKind, str], tuple[int, ...]] = {}
        self.results: list[JobResult] = []

    def _perform(self, job: Job) -> JobResult:
        result = replace(super()._perform(job), values=self.told.get((job.kind, job.drive), ()))
        self.results.append(result)
        return result

    def play(self, *, longest: float = 60.0, **once: Any) -> Fault | None:  # noqa: ANN401
        """To the end of the routine, or to its fault; that fault."""
        return self.until(lambda wish: wish.fault is not None or wish.phase == OVER, longest=longest).fault

    @property
    def phases(self) -> list[str]:
        """Each once, in their order."""
        return list(dict.fromkeys(wish.phase for wish in self.wishes))

    @property
    def kinds(self) -> list[tuple[JobKind, str]]:
        return [(job.kind, job.drive) for job in self.jobs]


def calm(wish: Wish) -> tuple[float, float]:
    """Speed and steering that a wish commands."""
    return wish.command.speed, wish.command.steering
