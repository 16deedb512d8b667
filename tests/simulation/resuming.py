"""What tests of `--resume` share: short runs that end halfway, and what is left of them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rig import CALIBRATE, follow, straight, write_mission

from artemis import app
from artemis.devices.can_bus import FrameBus, Traffic
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.recording.journal import Entry, read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import ResumePoint
from artemis.recording.schemas import TickRecord
from artemis.sim.bus import SimBus
from artemis.sim.world import PlantParameters, World
from artemis.values import Mode, Request, Tick

FAR, HALF, LONGEST = 1.5, 0.75, 120.0
STEPS = [CALIBRATE, follow(0.4)]


@dataclass
class Done:
    """A run, and what it left behind."""

    outcome: app.Outcome
    ticks: list[Tick] = field(default_factory=list)
    told: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        return self.outcome.run.path

    @property
    def recorded(self) -> list[TickRecord]:
        return list(Recording(self.folder).ticks())

    @property
    def journal(self) -> tuple[Entry, ...]:
        return read_journal(self.outcome.run.journal).entries

    def following(self) -> list[Tick]:
        return [tick for tick in self.ticks if tick.mode is Mode.FOLLOW and tick.wish.tracking]

    def arc_lengths(self) -> list[float]:
        return [tick.wish.tracking.arc_length for tick in self.following() if tick.wish.tracking]


def run(
    mission: Path,
    resume: Path | None = None,
    until: Callable[[Tick], bool] = lambda tick: False,
    *,
    simulate: bool = False,
    parts: app.Parts | None = None,
) -> Done:
    """Run a mission, or go on with a run of it; somebody ends it in order after the tick that is `until`."""
    loaded, ticks, told = load_mission(mission), list[Tick](), list[str]()
    asked: list[Callable[[Request], None]] = []

    def operator(request: Callable[[Request], None], typed: object) -> Callable[[], None]:
        asked.append(request)
        return lambda: None

    def watch(tick: Tick, traffic: Traffic) -> None:
        assert tick.snapshot.time < LONGEST
        ticks.append(tick)
        if asked and until(tick):
            asyncio.get_running_loop().call_soon(asked.pop(), Request.END)

    found = resume_point(mission, resume, simulate) if resume else None
    outcome = app.run_mission(
        loaded,
        mission,
        simulate=simulate,
        watch=watch,
        operator=operator,
        tell=told.append,
        resume_point=found,
        parts=parts,
    )
    return Done(outcome, ticks, told)


def of_a_robot(mission: Path) -> Callable[[], tuple[FrameBus, None]]:
    """The bus of a mission's robot, where drives answer and nobody knows where it truly stands."""
    robot = load_mission(mission).robot

    def machine() -> tuple[FrameBus, None]:
        loop = asyncio.get_running_loop()
        return SimBus(World(robot, PlantParameters(), seed=1, start=loop.time()), robot.bitrate, loop), None

    return machine


def driven(metres: float) -> Callable[[Tick], bool]:
    return lambda tick: bool(tick.wish.tracking and tick.wish.tracking.arc_length >= metres)


def waited(seconds: float) -> Callable[[Tick], bool]:
    return lambda tick: tick.mode is Mode.READY and tick.position.done >= seconds


def line(folder: Path) -> Path:
    return write_mission(folder, STEPS, {"line.csv": straight(FAR)})


def resume_point(mission: Path, run: Path, simulate: bool = False) -> ResumePoint:
    return app.resume_point_of(load_mission(mission), mission, run, simulate)[0]


def refused(mission: Path, run: Path, simulate: bool = False) -> str:
    """Why; empty if it is not."""
    try:
        resume_point(mission, run, simulate)
    except ConfigError as error:
        return str(error)
    return ""
