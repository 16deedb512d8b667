"""How soon a wish is on the wire."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import ClassVar
from unittest.mock import patch

import yaml

from artemis.clock import stopwatch
from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.devices.hid.port import HidInfo
from artemis.mission.loading import load_mission
from artemis.plugins.contracts import Setup
from artemis.plugins.inputs.gamepad import GamepadConfig, GamepadInput
from artemis.plugins.inputs.profiles import profile_named
from artemis.robot import Robot
from artemis.testing.fake_hid import FakeHid
from artemis.values import Mode, OperatorInput, Request, Tick

from .composition import FIGURE_EIGHT, MISSIONS, WatchedBus, watched_run
from .measure import Row, microseconds, milliseconds, percentile

QUICK_STOP = 0x0B
"""Controlword (EPOS firmware specification 2010, 8.1.3)."""
STOP_FRAMES, SET_POINTS = range(0x301, 0x305), (0x201, 0x202)
"""RxPDO 2 of all drives; RxPDO 1 of the traction drives."""
STOPS = 10
REPORTS = 60
PRESSES = 300
JOYSTICK = "logitech-extreme-3d-pro"
AT_REST, STOP_PRESSED = bytes.fromhex("fcf18780009900"), bytes.fromhex("fcf18780029900")
"""Reports of it; the first was captured (tests/data/hid)."""
DESCRIPTOR = bytes.fromhex(
    yaml.safe_load((MISSIONS.parent / "tests/data/hid/logitech_extreme_3d_pro.yaml").read_text())["report_descriptor"]
)
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
    stops, buttons, reports = stop_requests(), stop_buttons(), input_reports()
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
            name=f"stop button of a HID device to stop request ({len(buttons)} presses, its own thread)",
            measured=f"{microseconds(median(buttons))}, p99 {microseconds(percentile(buttons, 0.99))}",
            budget="<= 5 ms p99 with the row above",
            held=stop + percentile(buttons, 0.99) <= 5e-3,
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


def stop_buttons() -> list[float]:
    """From a joystick's report to its waking the loop, through the reader's thread, on the machine [s]."""
    hid, profile = FakeHid(), profile_named(JOYSTICK)
    device = profile.device
    hid.plug(HidInfo("/dev/hidraw0", device.bus, device.vendor, device.product, "", JOYSTICK, 0), DESCRIPTOR)

    async def press() -> list[float]:
        loop, took = asyncio.get_running_loop(), list[float]()
        woken = asyncio.Event()

        def wake() -> None:
            loop.call_soon_threadsafe(woken.set)

        setup = Setup(name="stick", robot=load_mission(FIGURE_EIGHT).robot, folder=MISSIONS, wake=wake)
        with patch("artemis.plugins.inputs.gamepad.Hidraw", lambda: hid):
            plugin = GamepadInput(GamepadConfig(profile=JOYSTICK), setup)
        hid.send(AT_REST)
        for _ in range(PRESSES):
            woken.clear()
            begun = stopwatch()
            hid.send(STOP_PRESSED)
            await woken.wait()
            took.append(stopwatch() - begun)
            hid.send(AT_REST)
        plugin.close()
        return took[1:]  # the first waits until the device is found

    return asyncio.run(press())


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
