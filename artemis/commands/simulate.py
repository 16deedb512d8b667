"""`artemis sim`: the simulated robot on a real bus, in real time."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

from artemis import clock
from artemis.devices.can_bus import CanBus, check_bus_words
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.sim.server import serve
from artemis.sim.world import TrueRobot, World
from artemis.vehicle import Robot
from artemis.yaml_file import scalar


def simulate(robot: Path, interface: str, channel: str, options: list[str], seed: int, true: Path | None) -> None:
    """Serve the drives of the robot file until SIGINT or SIGTERM.

    Raises:
        ConfigError: a file, the back end or one of its words is wrong.
        DeviceLost: the bus is gone.
    """
    words = _words(interface, channel, options)
    described = load_model(robot, Robot)
    machine = load_model(true, TrueRobot) if true is not None else TrueRobot()
    clock.run(_serve(described, machine, words, seed), simulated=False)


def _words(interface: str, channel: str, options: list[str]) -> dict[str, object]:
    words: dict[str, object] = {"interface": interface, "channel": channel}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals:
            raise ConfigError(f"--option {option}: write a word of the back end and its value, as hop_limit=0")
        words[name] = scalar(value)
    if problems := check_bus_words(words):
        raise ConfigError(problems)
    return words


async def _serve(robot: Robot, true: TrueRobot, words: dict[str, object], seed: int) -> None:
    loop = asyncio.get_running_loop()
    bus = CanBus(words)
    world = World(robot, true, seed=seed, start=loop.time())
    names = ", ".join(f"{node.name} ({node.node_id})" for node in world.nodes)
    serving = asyncio.ensure_future(serve(world, bus))
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, serving.cancel)
    sys.stdout.write(f"{robot.robot}: {names} on {words['interface']} {words['channel']}; Ctrl-C ends\n")
    sys.stdout.flush()
    try:
        await serving
    except asyncio.CancelledError:
        sys.stdout.write("ended\n")
    finally:
        bus.close()
