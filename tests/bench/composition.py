"""A run as `artemis.app` composes it, with every part within reach of a stopwatch."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path as FilePath
from typing import ClassVar

from msgspec.structs import replace

from artemis import clock
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.devices.drive import Drives
from artemis.mission.loading import LoadedMission, load_mission
from artemis.motion.path import Path
from artemis.planning import plan_from
from artemis.plugins.contracts import Follower, Following, InputDevice
from artemis.plugins.guard import PluginGuard
from artemis.recording.journal import Journal
from artemis.recording.mcap_writer import Recorder
from artemis.recording.provenance import Provenance
from artemis.robot import Core, Robot
from artemis.sim.bus import SimBus
from artemis.sim.world import World
from artemis.states.plan import FollowStep, Plan
from artemis.values import Mode, Snapshot, Tick
from artemis.vehicle import RobotFile

MISSIONS = FilePath(__file__).parents[2] / "missions"
FIGURE_EIGHT = MISSIONS / "figure_eight.yaml"
START = datetime(2026, 1, 1, tzinfo=UTC)


@contextmanager
def missions(tick_hz: int = 50) -> Iterator[FilePath]:
    """A copy of the missions in a folder of its own, where runs leave theirs; the figure eight at `tick_hz`."""
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as folder:
        copy = FilePath(folder) / "missions"
        shutil.copytree(MISSIONS, copy, ignore=shutil.ignore_patterns("runs"))
        mission = copy / FIGURE_EIGHT.name
        mission.write_text(mission.read_text() + f"tick_hz: {tick_hz}\n")
        yield mission


class TimedBus(asyncio.AbstractEventLoop):
    """A simulated bus; `spent` is the time [s] that went into it and the world behind it.

    It is also the loop that its bus knows, so that what that does at times of its own passes here.
    """

    def __init__(self, loaded: LoadedMission, loop: asyncio.AbstractEventLoop) -> None:
        self.spent = self._outside = 0.0
        self._loop = loop
        self._bus = SimBus(World(loaded.robot, loaded.true_robot), loaded.robot.bitrate, self)
        self.close = self._bus.close  # type: ignore[method-assign]

    @property
    def error_frames(self) -> int:
        return self._bus.error_frames

    def send(self, frame: Frame) -> None:
        begun = stopwatch()
        self._bus.send(frame)
        self.spent += stopwatch() - begun

    def receive(self) -> list[Frame]:
        begun = stopwatch()
        frames = self._bus.receive()
        self.spent += stopwatch() - begun
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        def timed() -> None:
            begun = stopwatch()
            wake()
            self._outside += stopwatch() - begun

        self._bus.listen(timed)

    def time(self) -> float:
        return self._loop.time()

    def call_at(  # type: ignore[override]  # as a bus calls it
        self, when: float, callback: Callable[..., object], *arguments: object
    ) -> asyncio.TimerHandle:
        def timed() -> None:
            begun, outside = stopwatch(), self._outside
            callback(*arguments)
            self.spent += stopwatch() - begun - (self._outside - outside)

        return self._loop.call_at(when, timed)


class TimedFollower:
    """A follower; `spent` is the time [s] that went into it."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, follower: Follower) -> None:
        self._follower = follower
        self.spent = 0.0

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self._follower.start(path, snapshot)

    def step(self, snapshot: Snapshot) -> Following:
        begun = stopwatch()
        following = self._follower.step(snapshot)
        self.spent += stopwatch() - begun
        return following


class TimedRobot(Robot):
    """Notes what each tick took without bus and follower, and what the simulation took since the tick before.

    After each tick a peer does once what it is compared by: so both find the caches as a run leaves them, and a machine
    that changes its speed changes it for both.
    """

    bus: TimedBus
    followers: list[TimedFollower]

    def time_ticks(self, bus: TimedBus, followers: list[TimedFollower], peer: Callable[[], object]) -> None:
        self.bus, self.followers, self._peer = bus, followers, peer
        self.own: list[float] = []
        self.peer: list[float] = []
        self.simulation: list[float] = []
        self._simulated = 0.0

    def tick(self, now: float, urgent: bool = False) -> Tick:
        elsewhere, begun = self._elsewhere(), stopwatch()
        tick = super().tick(now, urgent)
        took = stopwatch() - begun - (self._elsewhere() - elsewhere)
        if tick.mode is Mode.FOLLOW and not urgent:
            self.own.append(took)
            self.simulation.append(self.bus.spent - self._simulated)
            begun = stopwatch()
            self._peer()
            self.peer.append(stopwatch() - begun)
        self._simulated = self.bus.spent
        return tick

    def _elsewhere(self) -> float:
        return self.bus.spent + sum(follower.spent for follower in self.followers)


def timed_run(mission: FilePath, peer: Callable[[RobotFile], Callable[[], object]]) -> TimedRobot:
    """A whole run on virtual time, recorded, with its stopwatches; `peer` makes what is done beside for a robot."""
    loaded = load_mission(mission)
    plan, followers = _timed(plan_from(loaded))

    async def main() -> TimedRobot:
        loop = asyncio.get_running_loop()
        bus = TimedBus(loaded, loop)  # type: ignore[abstract]  # of a loop it is what a bus needs
        drives = Drives(loaded.robot, bus)
        recorder = recorder_in(mission.parent)
        period = 1 / loaded.mission.tick_hz
        robot = TimedRobot(
            Core(plan, period),
            drives,
            PluginGuard({}, loop.time),
            period,
            lambda tick: recorder.observe(tick, drives.wire.take_traffic()),
        )
        robot.time_ticks(bus, followers, peer(loaded.robot))
        await robot.run()
        recorder.close("done")
        bus.close()
        return robot

    return clock.run(main(), simulated=True)


def _timed(plan: Plan) -> tuple[Plan, list[TimedFollower]]:
    followers: list[TimedFollower] = []

    def wrapped(step: FollowStep) -> FollowStep:
        followers.append(TimedFollower(step.follower))
        return replace(step, follower=followers[-1])

    steps = tuple(wrapped(step) if isinstance(step, FollowStep) else step for step in plan.steps)
    return replace(plan, steps=steps), followers


def recorder_in(folder: FilePath) -> Recorder:
    provenance = Provenance(start=START, mission=b"{}", robot=b"{}", files={})
    journal = Journal(folder / "journal.jsonl")
    return Recorder(folder / "recording.mcap", provenance, threaded=False, journal=journal)


class WatchedBus:
    """A simulated bus; `watch` sees what the host sends."""

    def __init__(self, world: World, bitrate: int, loop: asyncio.AbstractEventLoop) -> None:
        self.watch: Callable[[Frame], None] = lambda frame: None
        bus = SimBus(world, bitrate, loop)
        self.error_frames = bus.error_frames
        self.receive, self.listen, self.close, self._send = bus.receive, bus.listen, bus.close, bus.send

    def send(self, frame: Frame) -> None:
        self.watch(frame)
        self._send(frame)


def watched_run(
    loaded: LoadedMission,
    prepare: Callable[[Robot, WatchedBus, asyncio.AbstractEventLoop], Callable[[Tick], None]],
    inputs: Mapping[str, InputDevice] | None = None,
) -> None:
    """A run on virtual time that is not recorded. `prepare` makes what sees the ticks."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        bus = WatchedBus(World(loaded.robot, loaded.true_robot), loaded.robot.bitrate, loop)
        period = 1 / loaded.mission.tick_hz
        drives = Drives(loaded.robot, bus)

        def observe(tick: Tick) -> None:
            drives.wire.take_traffic()
            see(tick)

        robot = Robot(Core(plan_from(loaded), period), drives, PluginGuard(inputs or {}, loop.time), period, observe)
        see = prepare(robot, bus, loop)
        await robot.run()
        bus.close()

    clock.run(main(), simulated=True)
