"""`artemis sim`: the simulated robot on a real bus, in real time."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable
from math import degrees
from pathlib import Path

from artemis import clock
from artemis.devices.can_bus import CanBus, check_bus_words
from artemis.devices.multicast import place_of
from artemis.errors import ConfigError, DeviceLost
from artemis.mapping.map_file import read_map
from artemis.mission.loading import load_model
from artemis.sim.grid import MapGrid
from artemis.sim.lms100_server import serve_lms100
from artemis.sim.scanners import mount_scanners
from artemis.sim.scenery import Scenery
from artemis.sim.server import serve
from artemis.sim.world import PlantParameters, World
from artemis.vehicle import RobotFile
from artemis.yaml_file import scalar


def simulate(
    robot: Path,
    interface: str,
    channel: str,
    options: list[str],
    seed: int,
    true: Path | None,
    scanners: list[str],
    around: Path | None,
) -> None:
    """Serve the drives of the robot file, and those `scanners` (NAME=HOST:PORT), until SIGINT or SIGTERM.

    Raises:
        ConfigError: a file, the back end or one of its words is wrong.
        DeviceLost: the bus or a port cannot be opened, or is gone.
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
    try:
        scenery, grid = (None, None) if around is None else scenery_from(around)
    except ConfigError as error:
        problems += error.problems
    if problems:
        raise ConfigError(problems)
    places = scanner_places(described, scanners)

    def mount(world: World) -> None:
        mount_scanners(described, world, scenery, grid, seed=seed, start=world.time)

    clock.run(_serve(described, machine, words, seed, mount, places), simulated=False)


def scanner_places(robot: RobotFile, given: list[str]) -> dict[str, tuple[str, int]]:
    """Where each scanner that is to be served takes connections: host and port by its name in the robot file.

    Raises:
        ConfigError: the robot has no such scanner, one is given twice, or it is no host and port.
    """
    found: dict[str, tuple[str, int]] = {}
    problems = []
    for text in given:
        name, equals, place = text.rpartition("=")
        host, _, port = place.rpartition(":")
        if not equals:
            name = next(iter(robot.scanners), "") if len(robot.scanners) < 2 else ""
        if not host or not (port.isdecimal() and int(port) < 1 << 16):
            problems.append(f"--scanner {text}: write host and port, as 127.0.0.1:2111")
        elif not robot.scanners:
            problems.append(f"--scanner {text}: the robot file has no scanners")
        elif name not in robot.scanners:
            problems.append(f"--scanner {text}: write which one, as {'='.join((next(iter(robot.scanners)), place))}")
        elif name in found:
            problems.append(f"--scanner {text}: {name} is given already")
        else:
            found[name] = host, int(port)
    if problems:
        raise ConfigError(problems)
    return found


def scenery_from(path: Path) -> tuple[Scenery, MapGrid | None]:
    """What a file says that scanners see, with the map that it names beside it.

    Raises:
        ConfigError: everything that is wrong in it.
    """
    scenery = load_model(path, Scenery)
    if scenery.map_file is None:
        return scenery, None
    return scenery, MapGrid(read_map(path.parent / scenery.map_file))


def _words(interface: str, channel: str, options: list[str]) -> dict[str, object]:
    """The words as they would stand behind `bus:` in a mission."""
    words: dict[str, object] = {"interface": interface, "channel": _value("--channel", channel)}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals:
            raise ConfigError(f"--option {option}: write an option of the interface and its value, as hop_limit=0")
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


async def _serve(
    robot: RobotFile,
    true: PlantParameters,
    words: dict[str, object],
    seed: int,
    mount: Callable[[World], None],
    places: dict[str, tuple[str, int]],
) -> None:
    loop = asyncio.get_running_loop()
    bus = CanBus(words)
    world = World(robot, true, seed=seed, start=loop.time())
    mount(world)
    servers = []
    for name, (host, port) in places.items():
        try:
            servers.append(await serve_lms100(world.scanners[name].device, host, port))
        except OSError as error:
            bus.close()
            raise DeviceLost(name, f"{host}:{port}: {error.strerror or error}") from error
        host, port = servers[-1].sockets[0].getsockname()[:2]
        sys.stdout.write(f"{name}: an LMS100 on {host}:{port}\n")
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
        for server in servers:
            server.close()
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
