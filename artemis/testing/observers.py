"""What every observer must do, as tests, like those in `artemis.testing.contracts`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory

from artemis.clock import stopwatch
from artemis.plugins.contracts import Observer, PluginContext
from artemis.plugins.registry import OBSERVERS
from artemis.supervision.catalogue import ROWS
from artemis.testing.contracts import NAME, PERIOD, PluginContract
from artemis.values import (
    LocatedPose,
    Mode,
    Odometry,
    Pose,
    Sensed,
    SetPoints,
    Snapshot,
    Tick,
    Tracking,
    Verdict,
    Wish,
)

SPEED = 0.2
"""Of the run that is shown [m/s]."""


class ObserverContract(PluginContract):
    """An observer: inherit, set `plugin`, and `options` and `files` if it has any."""

    group = OBSERVERS
    duration: float = 20.0
    """So long is the run that it sees [s], of run time: nothing waits for it."""
    folder: FilePath | None = None
    """Of the run; set while there is one."""

    def given(self) -> PluginContext:
        """What a new observer may know: the run's folder, too."""
        return replace(super().given(), run=self.folder)

    @contextmanager
    def made(self) -> Iterator[Observer]:
        """An observer in a new run's folder, closed afterwards."""
        with TemporaryDirectory() as folder:
            self.folder = FilePath(folder)
            observer: Observer = self.make()
            try:
                yield observer
            finally:
                observer.close()

    def ticks(self) -> Iterator[Tick]:
        """A robot that drives along the x axis; at first it is told nothing of a path."""
        for index in range(round(self.duration / PERIOD)):
            distance, time = SPEED * index * PERIOD, index * PERIOD
            snapshot = Snapshot(
                sensed=Sensed(index=index, time=time),
                dt=PERIOD if index else 0.0,
                odometry=Odometry(pose=Pose(x=distance), speed=SPEED, distance=distance),
                pose=LocatedPose(pose=Pose(x=distance)),
                standing=False,
                set_points=SetPoints(speed=SPEED),
                verdict=Verdict(),
            )
            tracking = (
                Tracking(arc_length=distance, length=SPEED * self.duration, cross_track=0.0) if time > 1.0 else None
            )
            wish = Wish(phase="following", tracking=tracking)
            yield Tick(snapshot=snapshot, mode=Mode.FOLLOW, wish=wish, set_points=SetPoints(speed=SPEED))

    def test_sees_a_run(self) -> None:
        """It sees all of it without raising, and its problems are rows of the fault table, under its name."""
        with self.made() as observer:
            for tick in self.ticks():
                observer.see(tick, (), tick.snapshot.time)
                for problem in observer.take_problems():
                    id, name, words = problem
                    assert id in ROWS, f"take_problems() gave {problem!r}: no such row of the fault table (PLG-06)"
                    assert name == NAME, f"take_problems() gave {problem!r}, not context.name (PLG-06)"
                    assert isinstance(words, str), f"take_problems() gave {problem!r} (PLG-06)"

    def test_keeps_up(self) -> None:
        """In the mean a tick takes it less than half the time between two: else it misses ticks."""
        with self.made() as observer:
            ticks = list(self.ticks())
            begun = stopwatch()
            for tick in ticks:
                observer.see(tick, (), tick.snapshot.time)
            took = (stopwatch() - begun) / len(ticks)
        assert took <= PERIOD / 2, f"see() takes {took * 1000:.1f} ms, {PERIOD / 2 * 1000:.0f} are allowed (PLG-03)"

    def test_close_is_harmless(self) -> None:
        """Before the first tick, after it, and twice."""
        for seen in (0, 1):
            with self.made() as observer:
                for tick, _ in zip(self.ticks(), range(seen), strict=False):
                    observer.see(tick, (), tick.snapshot.time)
                observer.close()
