"""The serial line that a mission names, opened for commands that drive nothing; or a simulated one."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_line import SerialLine
from artemis.devices.serial_port import SerialPort, TtyPort
from artemis.mission.loading import LoadedMission
from artemis.mission.schema import SerialWords


def open_line(loaded: LoadedMission, words: SerialWords, simulated: bool) -> SerialLine:
    """The line to the drives of a mission; needs a running loop.

    Raises:
        DeviceLost: its port cannot be opened.
    """
    protocol = SerialProtocol(words.protocol)
    port: SerialPort = simulated_port(loaded, words, protocol) if simulated else TtyPort(words.serial, words.baud)
    return SerialLine(port, protocol)


def simulated_port(loaded: LoadedMission, words: SerialWords, protocol: SerialProtocol) -> SerialPort:
    """A port with simulated drives behind it."""
    from artemis.sim.serial_drive import serial_port
    from artemis.sim.serial_wire import SerialSettings
    from artemis.sim.world import World

    start, seed = asyncio.get_running_loop().time(), loaded.mission.simulation.seed
    world = World(loaded.robot, loaded.true_robot, seed=seed, start=start)
    return serial_port(world, loaded.robot.bitrate, protocol, SerialSettings(baud=words.baud))


def told_faults(faults: Mapping[str, int]) -> str:
    """What went wrong on a line, in a line; empty where nothing did."""
    if not faults:
        return ""
    counted = ", ".join(f"{row} {count} time{'s' * (count > 1)}" for row, count in sorted(faults.items()))
    return f"on the serial line: {counted}; `artemis faults ROW` says where to look"
