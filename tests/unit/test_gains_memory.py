"""Gains of drives outside of a run: read, and stored for ever."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from core_builders import ROBOT
from epos_jobs_rig import STRAIGHT

from artemis.clock import run
from artemis.devices.gains_memory import read_gains, store_gains
from artemis.errors import WrongDevice
from artemis.sim.bus import SimBus
from artemis.sim.epos_failures import Speech
from artemis.sim.world import World

FACTORY = (400, 120, 400, 120, 150, 10, 200)
NEW = (1, 2, 3, 4, 5, 6, 32767)
LEFT, RIGHT = "steer-left", "steer-right"
Talk = Callable[[World, SimBus], Awaitable[None]]


def on_the_bus(talk: Talk) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        world = World(ROBOT, STRAIGHT, start=loop.time())
        bus = SimBus(world, 1_000_000, loop)
        await asyncio.sleep(0.1)
        await talk(world, bus)

    run(main(), simulated=True)


def test_gains_are_read_as_they_are_found() -> None:
    async def talk(world: World, bus: SimBus) -> None:
        world.drive(LEFT).poke(0x60FB, 1, 77)
        world.drive(RIGHT).failures.impede(Speech.SDO)
        found = await read_gains(ROBOT, bus)
        assert list(found) == list(ROBOT.drives)
        assert found["traction-left"] == FACTORY
        assert found[LEFT] == (400, 120, 400, 120, 77, 10, 200)
        assert isinstance(found[RIGHT], str)
        assert "no answer" in found[RIGHT]

    on_the_bus(talk)


def test_stored_gains_outlast_the_power_and_position_limits_do_not_count_from_another_zero() -> None:
    async def talk(world: World, bus: SimBus) -> None:
        drive, told = world.drive(LEFT), list[str]()
        drive.poke(0x607D, 1, -1000)
        await store_gains(ROBOT, bus, {LEFT: NEW}, told.append)
        assert told == [LEFT]
        drive.power_on(asyncio.get_running_loop().time())
        await asyncio.sleep(0.1)
        found = await read_gains(ROBOT, bus)
        assert found[LEFT] == NEW
        assert found[RIGHT] == FACTORY
        assert drive.read(0x607D, 1) == -(1 << 31)

    on_the_bus(talk)


def test_a_drive_that_is_another_one_stops_the_storing() -> None:
    async def talk(world: World, bus: SimBus) -> None:
        told: list[str] = []
        world.drive(RIGHT).failures.misreport(0x1018, 1, lambda _: 1)
        with pytest.raises(WrongDevice, match="not maxon"):
            await store_gains(ROBOT, bus, {LEFT: NEW, RIGHT: NEW}, told.append)
        assert told == [LEFT]
        assert (await read_gains(ROBOT, bus))[RIGHT] == FACTORY

    on_the_bus(talk)
