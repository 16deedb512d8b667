"""`artemis sim`: the simulated robot on a real bus, in real time."""

from __future__ import annotations

import asyncio
import signal
import sys
from math import degrees
from pathlib import Path

from artemis import clock
from artemis.devices.can_bus import CanBus, check_bus_words, place_of
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.sim.server import serve
from artemis.sim.world import PlantParameters, World
from artemis.vehicle import RobotFile
from artemis.yaml_file import scalar


def simulate(robot: Path, interface: str, channel: str, options: list[str], seed: int, true: Path | None) -> None:
    """Serve the drives of the robot file until SIGINT or SIGTERM.

    Raises:
        ConfigError: a file, the back end or one of its words is wrong.
        DeviceLost: the bus cannot be opened, or is gone.
    """
    problems: list[str] = []
    try:
        words = _words(interface, channel, options)
    except ConfigError as error:
        problems += error.problems
    try:
        described = load_model(robot, RobotFile)
    except ConfigError as error:
        problems += error.problems
    try:
        machine = load_model(true, PlantParameters) if true is not None else PlantParameters()
    except ConfigError as error:
        problems += error.problems
    if problems:
        raise ConfigError(problems)
    clock.run(_serve(described, machine, words, seed), simulated=False)


def _words(interface: str, channel: str, options: list[str]) -> dict[str, object]:
    """The words as they would stand behind `bus:` in a mission."""
    words: dict[str, object] = {"interface": interface, "channel": _value("--channel", channel)}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals:
            raise ConfigError(f"--option {option}: write a word of the back end and its value, as hop_limit=0")
        if name in words:
            raise ConfigError(f"--option {option}: {name} is given already")
        words[name] = _value(f"--option {name}", value)
    if problems := check_bus_words(words):
        raise ConfigError(problems)
    return words


def _value(option: str, text: str) -> object:
    try:
        return scalar(text)
    except ConfigError as error:
        raise ConfigError([f"{option}: {problem}" for problem in error.problems]) from None


async def _serve(robot: RobotFile, true: PlantParameters, words: dict[str, object], seed: int) -> None:
    loop = asyncio.get_running_loop()
    bus = CanBus(words)
    world = World(robot, true, seed=seed, start=loop.time())
    names = ", ".join(f"{node.name} ({node.node_id})" for node in world.nodes)
    sys.stdout.write(f"{robot.robot}: {names} on {place_of(words)}; Ctrl-C ends\n")
    sys.stdout.flush()
    terminal = sys.stdout.isatty()
    status = (lambda: _show(world)) if terminal else None
    serving = asyncio.ensure_future(serve(world, bus, robot.bitrate, status=status))
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, serving.cancel)
    try:
        await serving
    except asyncio.CancelledError:
        sys.stdout.write("\nended\n" if terminal else "ended\n")
    finally:
        bus.close()


def _show(world: World) -> None:
    """One changing line: where the simulated robot is, and what its drives do."""
    pose, (left, right) = world.pose, world.wheel_angles
    states = ", ".join(sorted({node.state.value for node in world.nodes}))
    sys.stdout.write(
        f"\r\x1b[2K{world.speed:+.2f} m/s  wheels {degrees(left):+5.1f}° {degrees(right):+5.1f}°  "
        f"x {pose.x:+.2f} m, y {pose.y:+.2f} m, {degrees(pose.heading):+.0f}°  {states}"
    )
    sys.stdout.flush()
