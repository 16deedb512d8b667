"""What the robot of a run has: its devices, and the world behind them. Only here real or simulated is picked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from artemis.clock import SimulatedLoop
from artemis.devices.can_bus import CanBus, FrameBus, Traffic
from artemis.devices.device import Actuators, Device, DeviceGroup
from artemis.devices.drive import Drives
from artemis.devices.reopening import ReopeningBus
from artemis.devices.supply import SupplyMeter
from artemis.devices.track_fitter import TrackFitter, TrackUse
from artemis.mission.actions import Follow, Recorded
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.schema import BusWords
from artemis.planning import plugin_made, scanners_used, setup_for
from artemis.plugins.registry import SCANNERS
from artemis.plugins.scanning import ScannerDevice
from artemis.plugins.stated import follower_speed, rounds_corners
from artemis.recording.provenance import ResumePoint
from artemis.values import Pose, Tick

if TYPE_CHECKING:
    from artemis.sim.bus import Surroundings
    from artemis.sim.world import World

Machine = Callable[[], tuple[FrameBus, "World | None"]]
"""Opens the bus on the running loop; with the world behind it, where that is a simulated one."""
Witness = Callable[["World"], "Surroundings"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Equipment:
    """Open on the running loop."""

    devices: Actuators
    """All of them as one."""
    bus: FrameBus
    """That of the CAN drives."""
    traffic: Callable[[], Traffic]
    """Frames on that bus since the last call."""
    world: World | None
    """None: it is the real one."""
    true_pose: Callable[[Tick], Pose | None]
    """Where the robot really is, in the frame of its pose; nobody knows of a real one."""


def opened(
    loaded: LoadedMission,
    resume_point: ResumePoint | None,
    witness: Witness,
    machine: Machine | None,
    sensors: Callable[[], Sequence[Device]],
    *,
    simulated: bool,
    localized: bool,
) -> Equipment:
    """Open what the robot file describes. A new kind of device joins here: drives as `Actuators`, others as sensors.

    Args:
        loaded: The mission.
        resume_point: The run that is resumed: a simulated robot stands where that stopped.
        witness: Puts itself around the simulated world.
        machine: Opens another bus than the mission's.
        sensors: Opens devices that the robot file does not know.
        simulated: Against simulated drives, whatever bus the mission names.
        localized: The true pose counts from the map's origin, not from where the mission begins.

    Raises:
        DeviceLost: the bus cannot be opened.
        ConfigError: a scanner's plugin cannot be made.
    """
    loop, mission = asyncio.get_running_loop(), loaded.mission
    world: World | None
    if machine is not None:
        bus, world = machine()
    elif isinstance(mission.bus, BusWords) and not simulated:
        words = mission.bus.words
        bus, world = ReopeningBus(lambda: CanBus(words), loop.time), None
    else:
        bus, world = _simulated(loaded, localized, resume_point, witness)
    if world is not None and loaded.injector is not None:
        bus = loaded.injector.failing_bus(bus, mission.simulation.seed)
    drives = Drives(loaded.robot, bus, 1 / mission.tick_hz)
    others = [*sensors(), *_scanners(loaded, world, simulated=simulated), *_supply_meters(loaded, drives)]
    actuators: list[Actuators] = [drives]
    if loaded.destinations:
        from artemis.mission.zones import zones_in
        from artemis.route_planning.device import RoutePlanner

        virtual = isinstance(loop, SimulatedLoop)
        actuators.append(RoutePlanner(loaded.robot, loaded.destinations, zones_in, virtual=virtual))
    if uses := _track_uses(loaded):
        actuators.append(TrackFitter(loaded.robot, uses, virtual=isinstance(loop, SimulatedLoop)))
    alone = len(actuators) + len(others) == 1
    return Equipment(
        devices=drives if alone else DeviceGroup(tuple(loaded.robot.drives), actuators, others),
        bus=bus,
        traffic=drives.wire.take_traffic,
        world=world,
        true_pose=_true_pose(loaded, localized, resume_point, world),
    )


def _track_uses(loaded: LoadedMission) -> dict[int, TrackUse]:
    """How steps want what is recorded before them, by their numbers."""
    found = {}
    for number, (_, step) in enumerate(loaded.tree.steps):
        if isinstance(follow := step.action, Follow) and isinstance(follow.path, Recorded):
            plugin, config = plugin_from("artemis.followers", follow.follower)
            found[number] = TrackUse(
                speed=follower_speed(config),
                reserve=rounds_corners(plugin),
                close_within=follow.path.close_within_m,
                round_corners=follow.wanted["round_corners"],
                allow_slowdown=follow.wanted["allow_slowdown"],
            )
    return found


def _supply_meters(loaded: LoadedMission, drives: Drives) -> list[SupplyMeter]:
    """What reads the supply voltage, where it is of use and a drive measures it."""
    source = loaded.robot.supply_source
    if source is None or not (loaded.robot.battery or "battery_v" in loaded.tree.signals):
        return []
    node = next(node for node in drives.nodes if node.name == source.drive)
    return [SupplyMeter(source, node.sdo, lambda: drives.wire.judged)]


def _scanners(loaded: LoadedMission, world: World | None, *, simulated: bool) -> list[ScannerDevice]:
    """The robot's; in a simulated world each meets a simulated device."""
    robot, found = loaded.robot, []
    if world is not None and robot.scanners:
        from artemis.sim.scanners import mount_scanners

        start = asyncio.get_running_loop().time()
        seed = loaded.mission.simulation.seed
        mount_scanners(robot, world, loaded.scenery, loaded.grid, seed=seed, start=start)
    for name, use in scanners_used(loaded, simulated).items():
        context = setup_for(loaded, name)
        if world is not None:
            context = replace(context, dial=world.scanners[name].device.dial)
        scanner = plugin_made(SCANNERS, use, context)
        found.append(ScannerDevice(name, scanner, upside_down=robot.scanners[name].upside_down))
    return found


def _simulated(
    loaded: LoadedMission, localized: bool, resume_point: ResumePoint | None, witness: Witness
) -> tuple[FrameBus, World]:
    from artemis.sim.bus import SimBus
    from artemis.sim.truth import moved_to
    from artemis.sim.world import World

    loop, robot, true = asyncio.get_running_loop(), loaded.robot, loaded.true_robot
    if resume_point is not None:
        true = moved_to(true, _world_origin(loaded, localized), resume_point.true_pose or resume_point.pose)
    world = World(robot, true, seed=loaded.mission.simulation.seed, start=loop.time())
    return SimBus(witness(world), robot.bitrate, loop), world


def _true_pose(
    loaded: LoadedMission, localized: bool, resume_point: ResumePoint | None, world: World | None
) -> Callable[[Tick], Pose | None]:
    if world is None:
        return lambda tick: None
    from artemis.sim.truth import Truth

    origin = _world_origin(loaded, localized) if resume_point else Pose()
    return Truth(world, origin, fixed=localized).pose


def _world_origin(loaded: LoadedMission, localized: bool) -> Pose:
    """Where a simulation's true poses count from: its map, or where the robot stands when a mission begins."""
    from artemis.sim.truth import origin_of

    return Pose() if localized else origin_of(loaded.true_robot)
