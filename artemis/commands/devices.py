"""`artemis devices`: what is plugged into this computer, and with a mission, which drives answer on its bus."""

from __future__ import annotations

import asyncio
import sys
from contextlib import closing
from pathlib import Path

from artemis import clock
from artemis.devices.can_bus import CanBus, FrameBus, detected_adapters
from artemis.devices.hid.descriptor import Field, is_control
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort
from artemis.devices.inputs import InputPorts, layout_of
from artemis.devices.inventory import NodeReport, ask_nodes
from artemis.errors import ConfigError, DeviceLost, HidError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import BusWords
from artemis.planning import is_simulated
from artemis.plugins.inputs.profiles import all_profiles, find_profile


def show_devices(mission: Path | None) -> None:
    """Print CAN adapters, what somebody may drive with, and the drives on the bus of `mission`.

    Raises:
        ConfigError: the mission is refused.
    """
    loaded = load_mission(mission) if mission is not None else None
    _show_adapters()
    show_inputs(InputPorts())
    if loaded is not None:
        _show_drives(loaded)


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


def _show_drives(loaded: LoadedMission) -> None:
    simulated = is_simulated(loaded)
    _say(f"drives of {loaded.robot.robot}{' (simulated)' * simulated}")
    try:
        nodes = clock.run(_ask(loaded, simulated), simulated=simulated)
    except DeviceLost as error:
        _say(f"  {error}")
        return
    for node in nodes:
        _say(f"  {node.name:{max(len(each.name) for each in nodes)}}  node {node.node_id:3}  {_node(node)}")


async def _ask(loaded: LoadedMission, simulated: bool) -> list[NodeReport]:
    with closing(open_bus(loaded, simulated)) as bus:
        return await ask_nodes(loaded.robot, bus)


def open_bus(loaded: LoadedMission, simulated: bool) -> FrameBus:
    """The mission's bus, or one with simulated drives; needs a running loop.

    Raises:
        DeviceLost: it cannot be opened.
    """
    words = loaded.mission.bus
    if isinstance(words, BusWords) and not simulated:
        return CanBus(words.words)
    from artemis.sim.bus import SimBus
    from artemis.sim.world import World

    loop = asyncio.get_running_loop()
    world = World(loaded.robot, loaded.true_robot, seed=loaded.mission.simulation.seed, start=loop.time())
    return SimBus(world, loaded.robot.bitrate, loop)


def _node(node: NodeReport) -> str:
    if node.problem:
        return node.problem
    history = ", ".join(f"0x{code:04X}" for code in node.history) or "none"
    state = node.nmt.name.lower().replace("_", "-") if node.nmt is not None else "sends no heartbeat"
    identity = f"vendor {node.vendor:08X}, product {node.product:08X}, revision {node.revision:08X}"
    return f"{identity}, serial {node.serial:08X}, type {node.device_type:08X}; {state}; past errors: {history}"


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
