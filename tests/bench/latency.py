"""How soon a wish is on the wire."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median

from artemis.clock import stopwatch
from artemis.devices.can_bus import Frame
from artemis.mission.loading import load_mission
from artemis.robot import Robot
from artemis.values import Mode, Request, Tick

from . import whole_path
from .composition import FIGURE_EIGHT, WatchedBus, watched_run
from .measure import Row, microseconds, milliseconds, percentile
from .whole_path import QUICK_STOP, STOP_FRAMES

STOPS = 10


@dataclass
class Latencies:
    """From a wish to the frame that carries it [s]."""

    virtual: list[float] = field(default_factory=list)
    """In the run's own time: what waiting for a tick costs."""
    computed: list[float] = field(default_factory=list)
    """On the machine: what computing costs."""


def rows() -> list[Row]:
    """The rows of the table."""
    stops, hand = stop_requests(), whole_path.measure()
    stop = max(stops.virtual) + percentile(stops.computed, 0.99)
    return [
        Row(
            name=f"stop request to quick-stop frame ({len(stops.virtual)} runs)",
            measured=f"{milliseconds(max(stops.virtual))} of waiting + {_computed(stops)}",
            budget="<= 5 ms p99",
            held=stop <= 5e-3,
        ),
        Row(
            name=f"stop button of a HID device to quick-stop frame ({len(hand.stops)} presses, whole path)",
            measured=_middle_and_tail(hand.stops),
            budget="<= 5 ms p99",
            held=percentile(hand.stops, 0.99) <= 5e-3,
        ),
        Row(
            name=f"report of a HID device to set-point frame ({len(hand.set_points)} reports, whole path, 50 Hz)",
            measured=_middle_and_tail(hand.set_points),
            budget="<= one tick + 2 ms p99",
            held=percentile(hand.set_points, 0.99) <= whole_path.PERIOD + 2e-3,
        ),
    ]


def _computed(latencies: Latencies) -> str:
    worst = percentile(latencies.computed, 0.99)
    return f"{microseconds(median(latencies.computed))} computed, p99 {microseconds(worst)}"


def _middle_and_tail(latencies: list[float]) -> str:
    return f"{milliseconds(median(latencies))}, p99 {milliseconds(percentile(latencies, 0.99))}"


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
