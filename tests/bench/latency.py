"""How soon a wish is on the wire."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import ClassVar

from artemis.clock import stopwatch
from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.mission.loading import load_mission
from artemis.robot import Robot
from artemis.values import Mode, OperatorInput, Request, Tick

from .composition import FIGURE_EIGHT, MISSIONS, WatchedBus, watched_run
from .measure import Row, microseconds, milliseconds, percentile

QUICK_STOP = 0x0B
"""Controlword (EPOS firmware specification 2010, 8.1.3)."""
STOP_FRAMES, SET_POINTS = range(0x301, 0x305), (0x201, 0x202)
"""RxPDO 2 of all drives; RxPDO 1 of the traction drives."""
STOPS = 10
REPORTS = 60
REPORT_PERIOD = 0.613
"""Between two reports of the input [s]: the speed has settled, and the ticks are met at every phase."""


@dataclass
class Latencies:
    """From a wish to the frame that carries it [s]."""

    virtual: list[float] = field(default_factory=list)
    """In the run's own time: what waiting for a tick costs."""
    computed: list[float] = field(default_factory=list)
    """On the machine: what computing costs."""


def rows() -> list[Row]:
    """The rows of the table."""
    stops, reports = stop_requests(), input_reports()
    period = 1 / 50
    stop = max(stops.virtual) + percentile(stops.computed, 0.99)
    report = max(reports.virtual) + percentile(reports.computed, 0.99)
    return [
        Row(
            name=f"stop request to quick-stop frame ({len(stops.virtual)} runs)",
            measured=f"{milliseconds(max(stops.virtual))} of waiting + {_computed(stops)}",
            budget="<= 5 ms p99",
            held=stop <= 5e-3,
        ),
        Row(
            name=f"input report to set-point frame ({len(reports.virtual)} reports, 50 Hz)",
            measured=f"<= {milliseconds(max(reports.virtual))} of waiting + {_computed(reports)}",
            budget="<= one tick + 2 ms p99",
            held=report <= period + 2e-3,
        ),
    ]


def _computed(latencies: Latencies) -> str:
    worst = percentile(latencies.computed, 0.99)
    return f"{microseconds(median(latencies.computed))} computed, p99 {microseconds(worst)}"


def stop_requests() -> Latencies:
    """Quick stops in the midst of following, each at another phase of the tick."""
    dice, found, loaded = random.Random(1), Latencies(), load_mission(FIGURE_EIGHT)
    for _ in range(STOPS):
        watched_run(loaded, _stop_once(dice.uniform(0.5, 0.6), found))
    return found


def _stop_once(delay: float, found: Latencies) -> Callable[..., Callable[[Tick], None]]:
    def prepare(robot: Robot, bus: WatchedBus, loop: asyncio.AbstractEventLoop) -> Callable[[Tick], None]:
        asked: list[tuple[float, float]] = []

        def ask() -> None:
            asked.append((loop.time(), stopwatch()))
            robot.request(Request.QUICKSTOP)

        def watch(frame: Frame) -> None:
            if asked and frame.id in STOP_FRAMES and frame.data[0] == QUICK_STOP:
                time, began = asked.pop()
                found.virtual.append(loop.time() - time)
                found.computed.append(stopwatch() - began)

        following: list[float] = []

        def see(tick: Tick) -> None:
            if tick.mode is Mode.FOLLOW and not following:
                following.append(tick.snapshot.time)
                loop.call_later(delay, ask)

        bus.watch = watch
        return see

    return prepare


class _Reports:
    """An input device that changes its mind now and then, and says when it was read."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self) -> None:
        self.speed = 0.0
        self.pressed = self.done = False
        self.read_at = 0.0

    def read(self, now: float) -> OperatorInput:
        self.read_at = stopwatch()
        return OperatorInput(
            source="stick",
            speed=self.speed,
            enabled=self.pressed,
            neutral=not self.pressed,
            requests=(Request.DONE,) if self.done else (),
            age=0.0,
        )

    def close(self) -> None:
        """Nothing to close."""


def input_reports() -> Latencies:
    """Reports between the ticks of a teleoperated run; the first set-point that differs carries one."""
    found, stick = Latencies(), _Reports()

    def prepare(robot: Robot, bus: WatchedBus, loop: asyncio.AbstractEventLoop) -> Callable[[Tick], None]:
        reported: list[float] = []
        last: dict[int, bytes] = {}
        begun = False

        def report(left: int) -> None:
            stick.pressed, stick.done = True, left == 0
            stick.speed = 0.2 if left % 2 else 0.3
            reported[:] = [loop.time()]
            if left:
                loop.call_later(REPORT_PERIOD, report, left - 1)

        def watch(frame: Frame) -> None:
            if frame.id not in SET_POINTS:
                return
            changed = last.get(frame.id) not in (None, frame.data)
            last[frame.id] = frame.data
            if changed and reported:
                found.virtual.append(loop.time() - reported.pop())
                found.computed.append(stopwatch() - stick.read_at)

        def see(tick: Tick) -> None:
            nonlocal begun
            if tick.mode is Mode.TELEOP and not begun:
                begun = True
                loop.call_later(REPORT_PERIOD, report, REPORTS)

        bus.watch = watch
        return see

    watched_run(load_mission(MISSIONS / "teleop_scripted.yaml"), prepare, {"stick": stick})
    return found
