"""Nodes of the `canopen` package and our drives on one wire."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine, Mapping
from pathlib import Path

from local_epos import LocalEpos, Wire

from artemis.clock import run
from artemis.devices.drive import Drives
from artemis.mission.loading import load_mission
from artemis.values import (
    Job,
    JobKind,
    JobResult,
    LocatedPose,
    Mode,
    Odometry,
    Sensed,
    SetPoints,
    Snapshot,
    Tick,
    Verdict,
    Wish,
)
from artemis.vehicle import RobotFile

ROBOT = load_mission(Path(__file__).parents[2] / "missions" / "figure_eight.yaml").robot
PERIOD = 0.02
STEERING = {"steer-left": math.radians(7.0), "steer-right": math.radians(-4.0)}


class Bench:
    """Four nodes and our drives on one wire; drives take in frames as they come."""

    def __init__(self, robot: RobotFile = ROBOT, kinds: Mapping[str, type[LocalEpos]] | None = None) -> None:
        """`kinds`: what the nodes are, by the families of the robot file; else all are of the first generation."""
        self.wire = Wire()
        self.nodes = {
            name: (kinds or {}).get(drive.family, LocalEpos)(self.wire, robot, drive, angle=STEERING.get(name, 0.0))
            for name, drive in robot.drives.items()
        }
        self.drives = Drives(robot, self.wire)
        self.drives.wire.listen()

    async def perform(self, *kinds: JobKind, value: float = 0.0) -> list[JobResult]:
        """Jobs of each kind for all drives at once, one kind after the other."""
        results: list[JobResult] = []
        for kind in kinds:
            jobs = [Job(id=number, kind=kind, drive=name, value=value) for number, name in enumerate(self.nodes)]
            results += await asyncio.gather(*(self.drives.perform(job) for job in jobs))
        return results

    async def tick(self, wish: Wish, points: SetPoints, count: int = 1) -> None:
        """What a tick writes, and a period's wait."""
        snapshot = Snapshot(
            sensed=Sensed(index=0, time=0.0),
            dt=PERIOD,
            pose=LocatedPose(),
            odometry=Odometry(),
            standing=True,
            set_points=points,
            verdict=Verdict(),
        )
        tick = Tick(snapshot=snapshot, mode=Mode.TELEOP, wish=wish, set_points=points)
        for _ in range(count):
            self.drives.write(tick)
            await asyncio.sleep(PERIOD)
            self.drives.wire.take_in()

    def states(self) -> set[int]:
        return {node.status for node in self.nodes.values()}


def on_virtual_time(main: Coroutine[None, None, None]) -> None:
    run(main, simulated=True)


def refusals(results: list[JobResult]) -> list[str]:
    return [f"{result.kind.value} {result.drive}: {result.detail}" for result in results if not result.ok]
