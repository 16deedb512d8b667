"""What the simulated wire sees: bring-up of the drives, and whole runs faster than real time."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path
from time import process_time

from artemis import clock
from artemis.app import run_mission
from artemis.build import kind_of_build
from artemis.clock import stopwatch
from artemis.devices.can_bus import Frame
from artemis.devices.drive import Drives
from artemis.mission.loading import LoadedMission, load_mission, load_model
from artemis.sim.bus import SimBus
from artemis.sim.epos_settings import SimSettings
from artemis.sim.wire import frame_bits
from artemis.sim.world import World
from artemis.values import Job, JobKind
from artemis.vehicle import RobotFile

from .composition import FIGURE_EIGHT, missions
from .measure import Row, milliseconds

SDO_ANSWERS, SDO_REQUESTS, AFTER_SDO = 0x580, 0x600, 0x680
BOOTED = 0.3
"""Seconds after power-up until every drive waits in Pre-Operational: an EPOS4 takes 0.2 s."""
ROBOTS = ("artemis", "artemis_epos4", "artemis_cia402")
"""ARTEMIS with drives of one family each."""
WIRE_TIMES = 1.15
"""Drives that answer at once are configured in no more than so many times what their frames take."""
SLOW = 0.005
"""Answer time of slow drives [s]."""
RUNS = 3
HEADLESS = {50: (60, 100), 30: (90, 150)}
"""How many times faster than real time a run has to be at so many ticks a second: plain, and compiled."""


def rows() -> list[Row]:
    """The rows of the table."""
    robot = load_mission(FIGURE_EIGHT).robot
    everyone = list(robot.drives)
    four, _, _ = configure(robot, everyone, answer_time=SLOW)
    one = max(configure(robot, [name], answer_time=SLOW)[0] for name in everyone)
    return [
        *(_configured(name) for name in ROBOTS),
        Row(
            name=f"the same, drives that take {SLOW * 1e3:.0f} ms: four at once against the slowest one alone",
            measured=f"{milliseconds(four)}, {four / one:.2f} x",
            budget="overlap: far less than 4 x",
            held=four <= 1.5 * one,
        ),
        *(_headless(tick_hz, *budgets) for tick_hz, budgets in HEADLESS.items()),
        _process(),
    ]


def _configured(name: str) -> Row:
    robot = robot_named(name)
    took, wire, frames = configure(robot, list(robot.drives), answer_time=0.0)
    return Row(
        name=f"configuration of four drives that answer at once, 1 Mbit/s, {name}.yaml",
        measured=f"{milliseconds(took)} for {frames} frames, {took / wire:.3f} x their wire time",
        budget=f"<= {WIRE_TIMES} x",
        held=took <= WIRE_TIMES * wire,
    )


def robot_named(name: str) -> RobotFile:
    """A robot file of `missions`."""
    return load_model(FIGURE_EIGHT.parent / "robots" / f"{name}.yaml", RobotFile)


class _Listening:
    """A simulated bus that keeps the SDO frames both ways, with their times: sent, or arrived."""

    def __init__(self, world: World, bitrate: int, loop: asyncio.AbstractEventLoop) -> None:
        self.requests: list[tuple[float, Frame]] = []
        self.answers: list[Frame] = []
        self._clock, self._bus = loop.time, SimBus(world, bitrate, loop)
        self.error_frames = self._bus.error_frames
        self.listen, self.close = self._bus.listen, self._bus.close

    def send(self, frame: Frame) -> None:
        if SDO_REQUESTS <= frame.id < AFTER_SDO:
            self.requests.append((self._clock(), frame))
        self._bus.send(frame)

    def receive(self) -> list[Frame]:
        frames = self._bus.receive()
        self.answers += [frame for frame in frames if SDO_ANSWERS <= frame.id < SDO_REQUESTS]
        return frames


def configure(robot: RobotFile, names: list[str], *, answer_time: float) -> tuple[float, float, int]:
    """Configure drives at once: virtual time from the first SDO request to the last answer, wire time [s], frames."""

    async def main() -> tuple[float, float, int]:
        loop = asyncio.get_running_loop()
        world = World(robot, settings=SimSettings(answer_time_s=answer_time))
        bus = _Listening(world, robot.bitrate, loop)
        drives = Drives(robot, bus)
        drives.wire.listen()
        await asyncio.sleep(BOOTED)
        for kind in (JobKind.SECURE, JobKind.CONFIGURE):
            bus.requests, bus.answers = [], []
            jobs = [Job(id=number, kind=kind, drive=name) for number, name in enumerate(names)]
            for result in await asyncio.gather(*(drives.perform(job) for job in jobs)):
                assert result.ok, result
        frames = [frame for _, frame in bus.requests] + bus.answers
        took = max(frame.time for frame in bus.answers) - bus.requests[0][0]
        bus.close()
        return took, sum(map(frame_bits, frames)) / robot.bitrate, len(frames)

    return clock.run(main(), simulated=True)


def _headless(tick_hz: int, plain: int, compiled: int) -> Row:
    """The best of some runs, on the wall and in processor time: what else a machine does is not part of it."""
    budget = compiled if kind_of_build() == "compiled" else plain
    with missions(tick_hz) as mission:
        loaded = load_mission(mission)
        speeds = sorted(_speeds(loaded, mission) for _ in range(RUNS))
    of_processor, on_wall = speeds[-1]
    return Row(
        name=f"headless figure eight at {tick_hz} Hz, frame by frame, recorded (best of {RUNS})",
        measured=f"{on_wall:.0f} x real time, {of_processor:.0f} x by processor time",
        budget=f">= {budget} x on one core",
        held=of_processor >= budget,
    )


def _speeds(loaded: LoadedMission, mission: Path) -> tuple[float, float]:
    """Run time as a multiple of the processor's and of the wall's."""
    before = process_time()
    outcome = run_mission(loaded, mission)
    took = process_time() - before
    assert not outcome.failed
    return outcome.duration / took, outcome.duration / outcome.elapsed


def _process() -> Row:
    """The command as people call it: interpreter, imports, run, report."""
    with missions() as mission:
        begun = stopwatch()
        subprocess.run(
            [sys.executable, "-m", "artemis", "run", str(mission)], check=True, capture_output=True, timeout=60
        )
        took = stopwatch() - begun
    return Row(
        name="the whole process `artemis run missions/figure_eight.yaml`, report included", measured=f"{took:.1f} s"
    )
