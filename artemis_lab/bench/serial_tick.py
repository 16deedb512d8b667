"""How long one tick's process data would take over a serial line: what CAN carries in PDOs, as reads and writes.

A tick reads of each drive the objects of both its TxPDOs, and writes those of its RxPDO, one command after the other:
the line has no other way, nor SYNC. Drives and line are simulated, the drives off.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass

from artemis import clock
from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_line import SerialLine
from artemis.families.epos4 import EPOS4
from artemis.sim.epos_settings import SimSettings
from artemis.sim.serial_drive import serial_drive
from artemis.sim.serial_wire import SerialSettings, SimSerialPort
from artemis.sim.world import World
from artemis.testing.contracts import ROBOT
from artemis.vehicle import RobotFile
from artemis_lab.bench.tables import Grid

BEGIN = 2.5
"""Drives have started, and wait, at this time [s]."""
SLOWEST = 0.04
"""The longest tick that a mission may have [s] (25 Hz)."""
TWO = "traction-left", "steer-left"
ADAPTERS = (0.0, 0.001, 0.016)
"""Timers of USB adapters [s]; 0: a port of the computer's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialTick:
    """One tick of some drives over a line."""

    family: str
    drives: int
    baud: int
    commands: int
    wire: float
    """So long its bytes take [s]."""
    totals: tuple[float, ...]
    """So long it takes altogether [s], by `ADAPTERS`."""


def serial_ticks() -> list[SerialTick]:
    """Of all drives of ARTEMIS, and of two of them; as EPOS of the first generation, and as EPOS4."""
    found = []
    for robot, protocol, bauds in (
        (ROBOT, SerialProtocol.EPOS1, (115200,)),
        (of_epos4(ROBOT), SerialProtocol.EPOS4, (115200, 1_000_000)),
    ):
        for baud in bauds:
            for names in (tuple(robot.drives), TWO):
                measured = [
                    clock.run(
                        _tick(robot, names, protocol, SerialSettings(baud=baud, latency_s=latency)), simulated=True
                    )
                    for latency in ADAPTERS
                ]
                found.append(
                    SerialTick(
                        family=robot.drives[names[0]].tables.title,
                        drives=len(names),
                        baud=baud,
                        commands=measured[0][0],
                        wire=measured[0][1],
                        totals=tuple(total for _, _, total in measured),
                    )
                )
    return found


def of_epos4(robot: RobotFile) -> RobotFile:
    """The robot with drives of that family instead."""
    drives = {
        name: drive.model_copy(update={"family": EPOS4.name, "hardware_version": 0x6150})
        for name, drive in robot.drives.items()
    }
    return robot.model_copy(update={"drives": drives})


async def _tick(
    robot: RobotFile, names: Sequence[str], protocol: SerialProtocol, settings: SerialSettings
) -> tuple[int, float, float]:
    """Commands, time on the wire and time in all [s] of one tick of these drives."""
    loop = asyncio.get_running_loop()
    wire, end = serial_drive(World(robot, settings=SimSettings()), robot.bitrate, protocol, settings)
    line = SerialLine(SimSerialPort(wire), protocol)
    await clock.until(BEGIN)
    begin, before = loop.time(), wire.busy
    for name in names:
        drive = robot.drives[name]
        objects = line.objects(name, drive.node_id)
        for object in (each for pdo in robot.sent(drive) for each in pdo):
            await objects.read(object.index, object.subindex, object.type.size)
        for object in drive.tables.received[drive.role][0]:
            await objects.write(object.index, object.subindex, object.type.encode(0))
    end.close()
    return line.commands, wire.busy - before, loop.time() - begin


def serial_tick_grid(ticks: Sequence[SerialTick]) -> Grid:
    """As a table."""
    cells = [
        (
            f"{tick.drives} {tick.family}, {tick.baud} bit/s",
            str(tick.commands),
            *(f"{1e3 * seconds:.1f} ms" for seconds in (tick.wire, *tick.totals)),
        )
        for tick in ticks
    ]
    head = ("drives", "commands", "wire", "own port", "adapter, 1 ms", "adapter, 16 ms")
    return Grid(title=f"one tick over a serial line (the slowest tick is {1e3 * SLOWEST:g} ms)", head=head, rows=cells)
