"""What a tick pays for all its observers, at 50 Hz: each time for a processor that has slept meanwhile."""

from __future__ import annotations

from statistics import median
from threading import Event
from typing import ClassVar

from artemis.clock import stopwatch
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.plugins.observing import Beside, Observation
from artemis.testing.observers import ObserverContract
from artemis.values import Tick

from .measure import Row, microseconds, middle_and_tail

OBSERVERS, PERIOD = 3, 0.02


class Idle:
    """Does nothing with what it sees."""

    Config: ClassVar[type[Config]] = Config

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None: ...

    def take_problems(self) -> list[tuple[str, str, str]]:
        return []

    def close(self) -> None: ...


def rows() -> list[Row]:
    """The row of the table."""
    contract = ObserverContract()
    contract.duration = 6.0
    observers = [Observation("idle", Idle(), threaded=True) for _ in range(OBSERVERS)]
    woken: list[Beside[Tick]] = [Beside("woken", lambda tick: None, threaded=True) for _ in range(OBSERVERS)]
    ours: list[float] = []
    peers: list[float] = []
    never, deadline = Event(), stopwatch()
    for tick in contract.ticks():
        for number, times in ((0, ours), (1, peers)):  # half a tick between them: both begin after a sleep
            deadline += PERIOD / 2
            never.wait(max(0.0, deadline - stopwatch()))
            begun = stopwatch()
            if number:
                for beside in woken:
                    beside.put(tick)
            else:
                for observer in observers:
                    observer.see(tick, (), tick.snapshot.time)
                    observer.take_problems()
            times.append(stopwatch() - begun)
    for observer in observers:
        observer.close()
    for beside in woken:
        beside.close()
    wake = median(peers)
    return [
        Row(
            name=f"{OBSERVERS} observers at 50 Hz: what a tick hands over",
            measured=middle_and_tail(ours),
            budget="<= 30 us",
            held=median(ours) <= 30e-6,
            peer=f"waking {OBSERVERS} threads: {microseconds(wake)} ({median(ours) / wake:.2f} x)",
        )
    ]
