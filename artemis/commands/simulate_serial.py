"""`artemis sim --serial`: the simulated robot on a serial line, in real time, for any program that opens a port."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

from artemis import clock
from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_port import BAUD_RATES
from artemis.drive_schema import serial_problem
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.loading import load_model
from artemis.sim.serial_drive import serial_drive
from artemis.sim.serial_pty import PseudoTerminal
from artemis.sim.serial_wire import SerialSettings
from artemis.sim.world import PlantParameters, World
from artemis.vehicle import RobotFile


def simulate_serial(robot: Path, protocol: str, baud: int, latency: float, seed: int, true: Path | None) -> None:
    """Serve the first drive of the robot file on a pseudo-terminal, the others behind it, until SIGINT or SIGTERM.

    Args:
        robot: Its file.
        protocol: `epos1` or `epos4`.
        baud: Of the line [bit/s].
        latency: Of the USB adapter [s].
        seed: Of what is random.
        true: File with what is true of the machine.

    Raises:
        ConfigError: a file or an option is wrong.
        DeviceLost: the system has no pseudo-terminal left.
    """
    problems = []
    if protocol not in [each.value for each in SerialProtocol]:
        problems.append(f"--serial {protocol}: write {' or '.join(each.value for each in SerialProtocol)}")
    if baud not in BAUD_RATES:
        problems.append(f"--baud {baud}: an EPOS knows {', '.join(map(str, BAUD_RATES))}")
    if problems:
        raise ConfigError(problems)
    described = load_model(robot, RobotFile)
    if problem := serial_problem(described.drives, protocol, "--serial"):
        raise ConfigError([f"--serial {protocol}: {problem}"])
    machine = load_model(true, PlantParameters) if true is not None else PlantParameters()
    settings = SerialSettings(baud=baud, latency_s=latency)
    clock.run(_serve(described, machine, SerialProtocol(protocol), settings, seed), simulated=False)


async def _serve(
    robot: RobotFile, true: PlantParameters, protocol: SerialProtocol, settings: SerialSettings, seed: int
) -> None:
    loop = asyncio.get_running_loop()
    world = World(robot, true, seed=seed, start=loop.time())
    wire, drive = serial_drive(world, robot.bitrate, protocol, settings)
    try:
        terminal = PseudoTerminal(wire)
    except OSError as error:
        raise DeviceLost("pseudo-terminal", f"cannot be made: {error.strerror}") from error
    first, *others = [f"{node.name} ({node.node_id})" for node in world.nodes]
    sys.stdout.write(f"{robot.robot}: {first} on {terminal.path}, {settings.baud} baud, {protocol.value}; ")
    sys.stdout.write(f"behind it on CAN: {', '.join(others)}; Ctrl-C ends\n")
    sys.stdout.flush()
    ended = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    await ended.wait()
    sys.stdout.write("ended\n")
    terminal.close()
    drive.close()
