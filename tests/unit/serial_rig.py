"""A serial line with simulated drives behind it, on virtual time: a rig for tests."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from core_builders import ROBOT

from artemis.clock import run
from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_line import SerialLine, SerialObjects
from artemis.sim.epos_settings import SimSettings
from artemis.sim.serial_drive import SerialDrive, serial_drive
from artemis.sim.serial_wire import SerialSettings, SerialWire, SimSerialPort
from artemis.sim.world import PlantParameters, World
from artemis_lab.injections.damaged_serial import DamagedSerialPort

FIRST, BEHIND = 1, 3
"""Nodes: the one on the line, and one behind it."""
STRAIGHT = PlantParameters(start_steering_left_deg=0.0, start_steering_right_deg=0.0)


class SerialRig:
    """Powered drives, the first of them on a line, and our end of it."""

    def __init__(self, protocol: SerialProtocol, settings: SerialSettings, drives: SimSettings | None) -> None:
        self.loop = asyncio.get_running_loop()
        self.world = World(ROBOT, STRAIGHT, start=self.loop.time(), settings=drives)
        self.wire: SerialWire
        self.drive: SerialDrive
        self.wire, self.drive = serial_drive(self.world, ROBOT.bitrate, protocol, settings)
        self.bare = SimSerialPort(self.wire)
        self.port = DamagedSerialPort(self.bare)
        self.line = SerialLine(self.port, protocol)

    def objects(self, node_id: int) -> SerialObjects:
        """Access to a node's objects."""
        return self.line.objects(f"node {node_id}", node_id)


def on_line(
    test: Callable[[SerialRig], Awaitable[None]],
    protocol: SerialProtocol = SerialProtocol.EPOS1,
    settings: SerialSettings | None = None,
    drives: SimSettings | None = None,
) -> None:
    """Do a test once the drives have started."""

    async def main() -> None:
        rig = SerialRig(protocol, settings or SerialSettings(), drives)
        await asyncio.sleep(0.2)
        await test(rig)
        rig.line.close()

    run(main(), simulated=True)
