"""An observer beside the ticks: slow, hanging, raising or lying, it delays none of them and is told of once."""

from __future__ import annotations

import sys
from threading import Event, get_ident
from types import FrameType
from typing import Any, ClassVar

import pytest
import synthetic_run

from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.plugins.observing import Observation
from artemis.values import Tick

CALLS = 13
"""Of functions, for an observer in a tick: to hand over, and to ask for problems."""
TICKS = [observed.tick for observed, _ in zip(synthetic_run.run(), range(20), strict=False)]


class Watcher:
    """Writes down what is asked of it, and by which thread."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self) -> None:
        self.seen: list[int] = []
        self.threads: set[int] = set()
        self.closed = 0
        self.problems: list[Any] = []

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        self.threads.add(get_ident())
        self.seen.append(tick.snapshot.sensed.index)

    def take_problems(self) -> list[tuple[str, str, str]]:
        self.threads.add(get_ident())
        problems, self.problems = self.problems, []
        return problems

    def close(self) -> None:
        self.threads.add(get_ident())
        self.closed += 1


class Stalled(Watcher):
    """Waits in its first tick until it may go on."""

    def __init__(self) -> None:
        super().__init__()
        self.stalled, self.goes_on = Event(), Event()

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        self.stalled.set()
        self.goes_on.wait()
        super().see(tick, traffic, now)


class Raising(Watcher):
    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        super().see(tick, traffic, now)
        if len(self.seen) == 3:
            raise SystemExit("enough")


def show(observation: Observation, ticks: list[Tick]) -> list[tuple[str, str, str]]:
    problems = []
    for tick in ticks:
        observation.see(tick, (), tick.snapshot.time)
        problems += observation.take_problems()
    return problems


def test_on_virtual_time_every_tick_is_seen_at_once() -> None:
    watcher = Watcher()
    observation = Observation("page", watcher, threaded=False, bound=1)
    for count, tick in enumerate(TICKS, 1):
        observation.see(tick, (), 0.0)
        assert len(watcher.seen) == count
    observation.close()
    observation.close()
    assert watcher.seen == list(range(20))
    assert (watcher.closed, watcher.threads) == (1, {get_ident()})
    assert observation.take_problems() == []


def test_in_real_time_one_thread_of_its_own_sees_all_ticks_in_order_and_closes() -> None:
    watcher = Watcher()
    observation = Observation("page", watcher, threaded=True)
    show(observation, TICKS)
    observation.close()
    assert (watcher.seen, watcher.closed) == (list(range(20)), 1)
    assert len(watcher.threads) == 1
    assert get_ident() not in watcher.threads


def test_a_slow_observer_delays_no_tick_and_what_it_misses_is_counted_and_said_once() -> None:
    watcher = Stalled()
    observation = Observation("page", watcher, threaded=True, bound=5)
    show(observation, TICKS[:1])
    watcher.stalled.wait()
    told = show(observation, TICKS[1:])  # they return, although nothing goes on in the thread
    assert watcher.seen == []
    assert told == [("PLG-03", "page", "it misses ticks, from tick 1 on")]
    assert observation.dropped == 14
    watcher.goes_on.set()
    while not watcher.seen[1:]:  # one has been taken from the queue
        pass
    observation.close()
    assert watcher.seen == [0, *range(15, 20)], "the newest are kept"
    assert observation.take_problems() == [("PLG-03", "page", "14 ticks were not seen, the first is 1")]


def test_a_tick_that_makes_room_for_the_end_is_told_by_its_index() -> None:
    watcher = Stalled()
    observation = Observation("page", watcher, threaded=True, bound=2, patience=0.0)
    show(observation, TICKS[:1])
    watcher.stalled.wait()
    assert show(observation, TICKS[1:3]) == []
    observation.close()
    assert observation.take_problems() == [
        ("PLG-03", "page", "it does not end"),
        ("PLG-03", "page", "1 tick was not seen: it is 1"),
    ]
    watcher.goes_on.set()


def test_a_tick_wakes_nobody_and_makes_few_calls() -> None:
    observers = [Observation("page", Watcher(), threaded=True) for _ in range(3)]
    calls: list[str] = []

    def count(frame: FrameType, event: str, argument: object) -> None:
        calls.append(getattr(argument, "__name__", frame.f_code.co_name))

    sys.setprofile(count)
    for observer in observers:
        observer.see(TICKS[0], (), 0.0)
        observer.take_problems()
    sys.setprofile(None)
    for observer in observers:
        observer.close()
    assert "notify" not in calls
    assert len(calls) <= 3 * CALLS, calls


def test_an_observer_that_hangs_is_left_behind() -> None:
    watcher = Stalled()
    observation = Observation("page", watcher, threaded=True, patience=0.0)
    show(observation, TICKS)
    observation.close()
    assert observation.take_problems() == [("PLG-03", "page", "it does not end")]
    watcher.goes_on.set()


@pytest.mark.parametrize("threaded", [False, True])
def test_an_observer_that_raises_is_stopped_and_told_of_once(threaded: bool) -> None:
    watcher = Raising()
    observation = Observation("page", watcher, threaded=threaded)
    told = show(observation, TICKS)
    observation.close()
    told += observation.take_problems()
    ((id, name, seen),) = told
    assert (id, name) == ("PLG-02", "page")
    assert seen.startswith("SystemExit('enough') at test_observing.py:")
    assert (watcher.seen, watcher.closed) == ([0, 1, 2], 1)


def test_an_observer_that_raises_when_it_is_closed_is_told_of() -> None:
    class Clinging(Watcher):
        def close(self) -> None:
            raise OSError("no")

    observation = Observation("page", Clinging(), threaded=True)
    observation.close()
    ((id, name, seen),) = observation.take_problems()
    assert (id, name) == ("PLG-02", "page")
    assert seen.startswith("OSError('no') at test_observing.py:")


@pytest.mark.parametrize("problem", [None, ("DSK-05", "other", "full"), ("DSK-05", "page"), (5, "page", "full")])
def test_a_problem_that_is_none_is_garbage(problem: object) -> None:
    watcher = Watcher()
    watcher.problems = [("DSK-05", "page", "full"), problem]
    told = show(Observation("page", watcher, threaded=False), TICKS[:2])
    assert told == [("DSK-05", "page", "full"), ("PLG-06", "page", repr(problem))]
