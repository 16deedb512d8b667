"""From a hand to the wire: a joystick's report through all of a run, in real time, on a computer that is busy.

The run is `app.run_mission` with everything in it: reader thread, plugin, tick, gate, simulated drives on a simulated
wire, recorder thread. Only the device is in memory. What is waited for (bringing up, settling, standing) passes on
virtual time; real time begins before each report and ends with the frame that carries it.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import selectors
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

import yaml

from artemis.app import Parts, run_mission
from artemis.clock import stopwatch
from artemis.devices.can_bus import Frame, Traffic
from artemis.devices.hid.port import HidInfo
from artemis.mission.loading import load_mission
from artemis.plugins.inputs.held import REST
from artemis.plugins.inputs.profiles import profile_named
from artemis.sim.world import World
from artemis.testing.fake_hid import FakeHid
from artemis.values import Mode, Request, Tick
from artemis.vehicle import RobotFile

from .composition import MISSIONS, WatchedBus

QUICK_STOP = 0x0B
"""Controlword (EPOS firmware specification 2010, 8.1.3)."""
STOP_FRAMES, SET_POINTS = range(0x301, 0x305), (0x201, 0x202)
"""RxPDO 2 of all drives; RxPDO 1 of the traction drives."""
JOYSTICK = "logitech-extreme-3d-pro"
CENTRE, WAY = 508, 508
"""Counts of its axes (tests/data/hid)."""
ENABLE, STOP = 1 << 0, 1 << 1
SLOW, FAST = 0.4, 0.6
"""Shares of a push of the stick."""
SETTLED = 0.8
"""After this time a robot drives as fast as is wished [s]."""
LEAD = 0.03
"""At least so long before a report time is real [s]."""
PATIENCE, LONGEST = 1.0, 60.0
"""For a frame, and until it drives [s]."""
PERIOD = 1 / 50
REPORTS = STOPS = 100


@dataclass
class Latencies:
    """From the report of a device to the frame that carries what it says [s]."""

    set_points: list[float] = field(default_factory=list)
    stops: list[float] = field(default_factory=list)


def measure(reports: int = REPORTS, stops: int = STOPS) -> Latencies:
    """Reports and stops at every phase of the tick."""
    hid, device = FakeHid(), profile_named(JOYSTICK).parts[""]
    raw = yaml.safe_load((MISSIONS.parent / "tests/data/hid/logitech_extreme_3d_pro.yaml").read_text())
    info = HidInfo("/dev/hidraw0", device.bus, device.vendor, device.product, "", JOYSTICK, 0)
    hid.plug(info, bytes.fromhex(raw["report_descriptor"]))
    hand = _Hand(hid, reports, stops)
    with (
        _mission() as mission,
        _busy_computer(),
        patch("artemis.plugins.inputs.choosing.InputPorts", lambda sources: hid),
    ):
        loaded = load_mission(mission)
        parts = Parts(machine=lambda: hand.machine(loaded.robot), loop=_PacedLoop)
        outcome = run_mission(loaded, mission, watch=hand.see, operator=hand.begin, parts=parts)
    assert not hand.problem, hand.problem
    assert outcome.interrupted is None
    return hand.found


@contextmanager
def _mission() -> Iterator[Path]:
    """A mission that drives by hand until somebody ends it."""
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as folder:
        path = Path(folder) / "mission.yaml"
        shutil.copy(MISSIONS / "robots/artemis.yaml", folder)
        mission = {
            "mission": "by-hand",
            "robot": "artemis.yaml",
            "bus": "simulation",
            "inputs": {"stick": {"plugin": "gamepad", "profile": JOYSTICK}},
            "steps": [{"teleop": {"input": "stick", "until": {"button": "done"}}}],
        }
        path.write_text(json.dumps(mission))
        yield path


@contextmanager
def _busy_computer() -> Iterator[None]:
    """Other processes compute all the time, one on each core but one."""
    count = max(1, (os.cpu_count() or 1) - 1)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


# ------------------------------------------------------------------------------------------------- two kinds of time


class _PacedSelector(selectors.DefaultSelector):
    """Waits for the next timer, or moves the loop's time there."""

    def __init__(self) -> None:
        super().__init__()
        self._real, self._base, self._since = False, 0.0, 0.0

    def time(self) -> float:
        return self._base + (stopwatch() - self._since if self._real else 0.0)

    def pace(self, *, real: bool) -> None:
        self._base, self._since = self.time(), stopwatch()
        self._real = real

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self._real or timeout is None:
            return super().select(timeout)
        ready = super().select(0)
        self._base += 0.0 if ready else max(timeout, 0.0)
        return ready


class _PacedLoop(asyncio.SelectorEventLoop):
    """A loop whose time is real or virtual, as is said meanwhile; it begins on virtual time."""

    def __init__(self) -> None:
        self._paced = _PacedSelector()
        super().__init__(self._paced)

    def time(self) -> float:
        return self._paced.time()

    def pace(self, *, real: bool) -> None:
        self._paced.pace(real=real)


# ------------------------------------------------------------------------------------------------- the hand


class _Hand:
    """Somebody at the joystick and at the terminal: drives, presses stop, arms again; and whoever watches the bus."""

    def __init__(self, hid: FakeHid, reports: int, stops: int) -> None:
        self.found, self.problem = Latencies(), ""
        self._hid, self._reports, self._stops = hid, reports, stops
        self._dice = random.Random(1)
        self._tick: Tick | None = None
        self._sent_at: float | None = None
        self._seen = asyncio.Event()
        self._set_points: dict[int, bytes] = {}
        self._waits_for_stop = False

    def machine(self, robot: RobotFile) -> tuple[WatchedBus, World]:
        loop = asyncio.get_running_loop()
        world = World(robot, start=loop.time())
        bus = WatchedBus(world, robot.bitrate, loop)
        bus.watch = self._watch
        return bus, world

    def _watch(self, frame: Frame) -> None:
        """Every frame that artemis sends: the first quick stop, or the first set-point that differs."""
        now = stopwatch()
        if frame.id in SET_POINTS:
            carries = not self._waits_for_stop and self._set_points.get(frame.id) != frame.data
            self._set_points[frame.id] = frame.data
        else:
            carries = self._waits_for_stop and frame.id in STOP_FRAMES and frame.data[0] == QUICK_STOP
        if carries and self._sent_at is not None:
            self._take(now - self._sent_at)
            self._seen.set()

    def see(self, tick: Tick, _traffic: Traffic) -> None:
        self._tick = tick

    def begin(self, request: Callable[[Request], None], _typed: object) -> Callable[[], None]:
        """Take the joystick into the hand."""
        task = asyncio.get_running_loop().create_task(self._drive(request))
        return lambda: None if task.done() else self._give_up(task)

    def _give_up(self, task: asyncio.Task[None]) -> None:
        self.problem = f"the run ended automatically: {self._tick}"
        task.cancel()

    async def _drive(self, request: Callable[[Request], None]) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, _PacedLoop)
        pushes = [(FAST if number % 2 else SLOW, ENABLE) for number in range(self._reports)]
        try:
            for push, buttons in [*pushes, *[(FAST, ENABLE | STOP)] * self._stops]:
                if self._tick is None or self._tick.wish.phase != "driving":
                    await self._take_off(loop, request)
                await self._report(loop, push, buttons)
        except TimeoutError:
            self.problem = f"it does not drive: {self._tick}"
        loop.pace(real=False)
        self._send(0.0, 0)
        request(Request.END)

    async def _take_off(self, loop: _PacedLoop, request: Callable[[Request], None]) -> None:
        """From wherever the run is: released, armed where it has to be, enabled, and driving."""
        loop.pace(real=False)
        async with asyncio.timeout(LONGEST):
            while self._tick is None or self._tick.mode is not Mode.TELEOP:
                self._send(0.0, 0)
                if self._tick is not None and self._tick.snapshot.standing:
                    request(Request.ACKNOWLEDGE)
                    request(Request.ARM)
                await asyncio.sleep(0.2)
        await asyncio.sleep(REST + 5 * PERIOD)
        loop.pace(real=True)  # the reader's thread lives in real time
        self._send(0.0, ENABLE)
        await asyncio.sleep(2 * PERIOD)
        self._send(FAST, ENABLE)
        await asyncio.sleep(2 * PERIOD)

    async def _report(self, loop: _PacedLoop, push: float, buttons: int) -> None:
        """One report, and what it takes; one that nothing comes of takes `PATIENCE`."""
        loop.pace(real=False)
        await asyncio.sleep(SETTLED)
        loop.pace(real=True)
        await asyncio.sleep(LEAD + self._dice.uniform(0.0, PERIOD))
        self._waits_for_stop = bool(buttons & STOP)
        self._seen.clear()
        self._sent_at = stopwatch()
        self._send(push, buttons)
        try:
            async with asyncio.timeout(PATIENCE):
                await self._seen.wait()
        except TimeoutError:
            self._take(PATIENCE)

    def _take(self, latency: float) -> None:
        (self.found.stops if self._waits_for_stop else self.found.set_points).append(latency)
        self._sent_at = None

    def _send(self, push: float, buttons: int) -> None:
        """Seven bytes: x and y (10 bits, y to the operator), hat, twist, buttons 1 to 8, slider, buttons 9 to 12."""
        head = CENTRE | round(CENTRE - push * WAY) << 10 | 8 << 20
        self._hid.send(head.to_bytes(3, "little") + bytes((128, buttons, 0, 0)))
