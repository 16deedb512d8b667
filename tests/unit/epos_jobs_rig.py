"""The simulated drives on the simulated wire, and the jobs of one drive: a rig for tests of the jobs."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from core_builders import ROBOT
from sdo_server_side import decode_request

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import Expedited, encode_request
from artemis.devices.drive import Drives
from artemis.devices.epos_jobs import EposJobs
from artemis.errors import ProtocolError
from artemis.sim.bus import SimBus
from artemis.sim.epos import SimEpos
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters, World
from artemis.vehicle import RobotFile

WATCH = 127 << 16 | 200
"""Object 0x1016:1: our node, 200 ms."""
LEFT, RIGHT, STEER_LEFT, STEER_RIGHT = "traction-left", "traction-right", "steer-left", "steer-right"
PER_DEGREE = 2000 * 946 / 360
STRAIGHT = PlantParameters(start_steering_left_deg=0.0, start_steering_right_deg=0.0)


class Rig:
    """A powered robot, our side of its bus, and the jobs of one drive."""

    def __init__(self, name: str, robot: RobotFile, settings: SimSettings | None) -> None:
        loop = asyncio.get_running_loop()
        self.world = World(ROBOT, STRAIGHT, start=loop.time(), settings=settings)
        self.bus = SimBus(self.world, 1_000_000, loop)
        self.drives = Drives(robot, self.bus)
        self.drives.wire.listen()
        self.epos = next(node for node in self.drives.nodes if node.name == name)
        self.jobs = EposJobs(self.epos)
        self.node: SimEpos = next(node for node in self.world.nodes if node.name == name)

    def writes(self) -> list[tuple[int, int, bytes]]:
        """SDO writes to the drive since the last call: index, sub-index, data."""
        requests = []
        for ours, frame in self.drives.wire.take_traffic():
            if ours and frame.id == 0x600 + self.node.node_id:
                requests.append(decode_request(frame.data))
        return [(each.index, each.subindex, each.data) for each in requests if isinstance(each, Expedited)]

    def watch_power(self) -> list[float]:
        """Motor speeds [rpm] whenever we order the power off, as a list that grows."""
        speeds: list[float] = []
        send = self.bus.send

        def spy(frame: Frame) -> None:
            try:
                request = decode_request(frame.data) if frame.id == 0x600 + self.node.node_id else None
            except ProtocolError:
                request = None
            if isinstance(request, Expedited) and (request.index, request.data) == (0x6040, b"\0\0"):
                speeds.append(abs(self.node.axis.velocity))
            send(frame)

        self.bus.send = spy  # type: ignore[method-assign]
        return speeds

    async def spin(self, rpm: int) -> None:
        """Have the drive turn, as a host did that is gone."""
        for index, size, value in ((0x6060, 1, 3), (0x6040, 2, 6), (0x6040, 2, 15), (0x60FF, 4, rpm), (0x6040, 2, 15)):
            request = Expedited(index=index, subindex=0, data=value.to_bytes(size, "little", signed=True))
            self.bus.send(Frame(0x600 + self.node.node_id, encode_request(request)))
            await asyncio.sleep(0.05)
        await asyncio.sleep(1.0)
        assert abs(self.node.axis.velocity) == pytest.approx(abs(rpm), rel=0.01)


def on(
    name: str, test: Callable[[Rig], Awaitable[None]], *, robot: RobotFile = ROBOT, settings: SimSettings | None = None
) -> None:
    async def main() -> None:
        rig = Rig(name, robot, settings)
        await asyncio.sleep(0.1)  # boot
        await test(rig)
        rig.bus.close()

    run(main(), simulated=True)


def changed(name: str, **drive: object) -> RobotFile:
    """The robot file with another description of one drive."""
    return ROBOT.model_copy(update={"drives": {**ROBOT.drives, name: ROBOT.drives[name].model_copy(update=drive)}})


def has(rig: Rig, index: int, sub: int = 0) -> Any:  # noqa: ANN401
    return rig.node.read(index, sub)


async def bring_up(rig: Rig) -> None:
    await rig.jobs.secure(0.0)
    await rig.jobs.configure()
    await asyncio.sleep(0.001)
