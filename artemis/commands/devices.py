"""`artemis devices`: what is plugged into this computer; with a mission, what answers on its bus, and its scanners."""

from __future__ import annotations

import asyncio
import sys
from contextlib import closing
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any

from artemis import clock
from artemis.commands.serial_bus import open_line, told_faults
from artemis.devices.can_bus import CanBus, FrameBus, detected_adapters
from artemis.devices.hid.descriptor import Field, is_control
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort
from artemis.devices.inputs import InputPorts, layout_of
from artemis.devices.inventory import NodeReport, ask_nodes
from artemis.devices.serial_line import SerialLine
from artemis.devices.serial_port import detected_ports
from artemis.errors import ConfigError, DeviceError, DeviceLost, HidError
from artemis.mission.actions import PluginUse
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import BusWords, SerialWords
from artemis.planning import is_simulated, plugin_made, scanners_used, setup_for
from artemis.plugins.contracts import Scanner
from artemis.plugins.inputs.profiles import all_profiles, find_profile
from artemis.plugins.registry import SCANNERS
from artemis.scan import Condition, Scan

SCAN_TIME = 15.0
"""A scanner has so long to its first scan [s]."""


def show_devices(mission: Path | None) -> bool:
    """Print CAN adapters, what somebody may drive with, and the drives on the bus of `mission`; whether that opened.

    Raises:
        ConfigError: the mission is refused.
    """
    loaded = load_mission(mission) if mission is not None else None
    _show_adapters()
    show_inputs(InputPorts())
    if loaded is None:
        return True
    opened = _show_drives(loaded)
    _show_scanners(loaded)
    return opened


def _show_adapters() -> None:
    _say("CAN adapters")
    try:
        found = detected_adapters()
    except DeviceLost as error:
        _say(f"  {error.problem}")
        return
    for words in found:
        _say(f"  bus: {{{', '.join(f'{word}: {value}' for word, value in words.items())}}}")
    if not found:
        _say("  none that python-can can detect; it works with many that it cannot")
    if ports := detected_ports():
        _say("serial ports")
    for path, description in ports:
        _say(f"  bus: {{serial: {path}}}  {description}")


def show_inputs(port: HidPort) -> None:
    """Print every joystick, gamepad and wheel on `port`, with what is known of it or why it cannot be read."""
    _say("inputs")
    try:
        present = [info for info in port.enumerate() if not info.usage or is_control(info.usage)]
    except DeviceLost as error:
        _say(f"  {error.problem}")
        return
    if not sum(_show_input(port, info) for info in present):
        _say("  no joystick, gamepad or wheel")


def _show_input(port: HidPort, info: HidInfo) -> bool:
    """Whether it is something to drive with, as far as can be told."""
    try:
        handle = port.open(info)
        try:
            raw = handle.descriptor()
        finally:
            handle.close()
        descriptor = layout_of(info, raw)
    except (DeviceLost, HidError) as error:
        _say(f"  {info}")
        _say(f"    problem     {error.problem if isinstance(error, DeviceLost) else error}")
        return True
    if not is_control(descriptor.application):
        return False
    identity = Identity.of(info, raw)
    _say(f"  {info}")
    _say(f"    {'descriptor ' if info.source == 'hidraw' else 'capabilities'} {identity.descriptor_hash}")
    _say(f"    fields      {_fields(descriptor.fields)}")
    try:
        profile = find_profile(identity, descriptor, all_profiles())
        known = profile.name if profile is not None else "none; make one: artemis calibrate input"
    except ConfigError as error:
        known = "; ".join(error.problems)
    _say(f"    profile     {known}")
    return True


def _fields(fields: tuple[Field, ...]) -> str:
    """Axes and hats by name, buttons and what has no name of ours by number."""
    named = [field.name for field in fields if not field.name.startswith(("button.", "usage."))]
    for prefix, word in (("button.", "buttons"), ("usage.", "others")):
        if count := sum(field.name.startswith(prefix) for field in fields):
            named.append(f"{count} {word}")
    return ", ".join(named)


# ---------------------------------------------------------------------------------------------- the bus of a mission


def _show_drives(loaded: LoadedMission) -> bool:
    """Whether their bus can be opened."""
    simulated = is_simulated(loaded)
    _say(f"drives of {loaded.robot.robot}{' (simulated)' * simulated}")
    try:
        nodes, trouble = clock.run(_ask(loaded, simulated), simulated=simulated)
    except DeviceLost as error:
        _say(f"  {error}")
        return False
    for node in nodes:
        told = _node(node, loaded.robot.bitrate)
        _say(f"  {node.name:{max(len(each.name) for each in nodes)}}  node {node.node_id:3}  {told}")
    if trouble:
        _say(f"  {trouble}")
    return True


async def _ask(loaded: LoadedMission, simulated: bool) -> tuple[list[NodeReport], str]:
    """What the drives say, and what was wrong on the way."""
    with closing(open_bus(loaded, simulated)) as bus:
        nodes = await ask_nodes(loaded.robot, bus)
        return nodes, told_faults(bus.faults) if isinstance(bus, SerialLine) else ""


def open_bus(loaded: LoadedMission, simulated: bool) -> FrameBus:
    """The mission's bus or serial line, or one with simulated drives; needs a running loop.

    Raises:
        DeviceLost: it cannot be opened.
    """
    words = loaded.mission.bus
    if isinstance(words, SerialWords):
        return open_line(loaded, words, simulated)
    if isinstance(words, BusWords) and not simulated:
        return CanBus(words.words)
    from artemis.sim.bus import SimBus
    from artemis.sim.world import World

    loop = asyncio.get_running_loop()
    world = World(loaded.robot, loaded.true_robot, seed=loaded.mission.simulation.seed, start=loop.time())
    return SimBus(world, loaded.robot.bitrate, loop)


def _show_scanners(loaded: LoadedMission) -> None:
    simulated = is_simulated(loaded)
    if loaded.robot.scanners:
        _say(f"scanners of {loaded.robot.robot}{' (simulated)' * simulated}")
    for name, use in scanners_used(loaded, simulated).items():
        told = clock.run(_first_scan(loaded, name, use, simulated), simulated=simulated)
        where = ", ".join(str(use.options[key]) for key in ("host", "port") if key in use.options)
        _say(f"  {name}  {use.plugin}{f' at {where}' if where else ''}: {told}")


async def _first_scan(loaded: LoadedMission, name: str, use: PluginUse, simulated: bool) -> str:
    """What a scanner first tells, or why it does not."""
    loop, context = asyncio.get_running_loop(), setup_for(loaded, name)
    begun = loop.time()
    if simulated:
        from artemis.sim.scanners import mount_scanners
        from artemis.sim.world import World

        seed = loaded.mission.simulation.seed
        world = World(loaded.robot, loaded.true_robot, seed=seed, start=begun)
        mount_scanners(loaded.robot, world, loaded.scenery, loaded.grid, seed=seed, start=begun)
        context = replace(context, dial=world.scanners[name].device.dial)
    first: asyncio.Future[Scan] = loop.create_future()

    def give(scan: Scan) -> None:
        if not first.done():
            first.set_result(scan)

    scanner: Scanner = plugin_made(SCANNERS, use, context)
    running = asyncio.ensure_future(scanner.run(lambda: loop.time() - begun, give))
    with closing(scanner):
        either: list[asyncio.Future[Any]] = [running, first]
        await asyncio.wait(either, timeout=SCAN_TIME, return_when=asyncio.FIRST_COMPLETED)
        if first.done():
            running.cancel()
            return _scan(first.result())
        if not running.done():
            running.cancel()
            return f"no scan within {SCAN_TIME:g} s"
        error = running.exception()
        return error.problem if isinstance(error, DeviceError) else f"its plugin fails: {error!r}"


def _scan(scan: Scan) -> str:
    beams = len(scan.millimetres)
    first, last = degrees(scan.start_angle), degrees(scan.start_angle + scan.increment * (beams - 1))
    returns = sum(1 for distance in scan.millimetres.tolist() if distance)
    health = "" if scan.condition is Condition.WELL else f"; {scan.condition.name.lower()}, status {scan.status:#06x}"
    return f"{beams} beams from {first:.0f} to {last:.0f} degrees, {returns} of them return{health}"


def _node(node: NodeReport, bitrate: int) -> str:
    """What a drive says of itself, and that it will speak another bit rate than the robot's [bit/s]."""
    if node.problem:
        return node.problem
    history = ", ".join(f"0x{code:04X}" for code in node.history) or "none"
    state = node.nmt.name.lower().replace("_", "-") if node.nmt is not None else node.unheard
    identity = f"vendor 0x{node.vendor:08X}, product 0x{node.product:08X}, revision 0x{node.revision:08X}"
    told = f"{identity}, serial 0x{node.serial:08X}, type 0x{node.device_type:08X}; {state}; past errors: {history}"
    if node.bitrate in (None, bitrate):
        return told
    rate = f"{node.bitrate / 1000:g} kbit/s" if node.bitrate else "whatever bit rate it hears first"
    return f"{told}; switched on again it speaks {rate}"


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
