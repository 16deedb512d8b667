"""Drives outside of a run: gains are read, numbers are stored for ever."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from core_builders import ROBOT
from epos_jobs_rig import STRAIGHT

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.devices.memory import LISTEN, read_gains, store
from artemis.errors import DeviceError, DeviceLost, WrongDevice
from artemis.families.epos1 import EPOS1
from artemis.sim.bus import SimBus
from artemis.sim.epos_failures import Speech
from artemis.sim.world import World
from artemis.states import mode
from artemis.supervision import catalogue
from artemis.values import JobKind

FACTORY = (400, 120, 400, 120, 150, 10, 200)
NEW = (1, 2, 3, 4, 5, 6, 32767)
LEFT, RIGHT = "steer-left", "steer-right"
HEARTBEAT, SET_POINT = Frame(0x700 + ROBOT.host_node_id, b"\x05"), Frame(0x203, bytes(6))


class Shared(SimBus):
    """A simulated bus on which somebody else may send, too."""

    def __init__(self, world: World) -> None:
        self.sent: list[Frame] = []
        self.foreign: list[Frame] = []
        super().__init__(world, 1_000_000, asyncio.get_running_loop())

    def send(self, frame: Frame) -> None:
        self.sent.append(frame)
        super().send(frame)

    def receive(self) -> list[Frame]:
        frames = super().receive() + self.foreign
        self.foreign.clear()
        return frames


Talk = Callable[[World, Shared], Awaitable[None]]


def on_the_bus(talk: Talk) -> None:
    async def main() -> None:
        world = World(ROBOT, STRAIGHT, start=asyncio.get_running_loop().time())
        bus = Shared(world)
        await asyncio.sleep(0.1)
        await talk(world, bus)

    run(main(), simulated=True)


async def store_gains(bus: Shared, *drives: str, told: Callable[[str], None] = lambda name: None) -> None:
    await store(ROBOT, bus, JobKind.WRITE_GAINS, dict.fromkeys(drives, NEW), told)


def test_gains_are_read_as_they_are_found() -> None:
    async def talk(world: World, bus: Shared) -> None:
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
    async def talk(world: World, bus: Shared) -> None:
        drive, told = world.drive(LEFT), list[str]()
        drive.poke(0x607D, 1, -1000)
        await store_gains(bus, LEFT, told=told.append)
        assert told == [LEFT]
        drive.power_on(asyncio.get_running_loop().time())
        await asyncio.sleep(0.1)
        found = await read_gains(ROBOT, bus)
        assert found[LEFT] == NEW
        assert found[RIGHT] == FACTORY
        assert drive.read(0x607D, 1) == -(1 << 31)

    on_the_bus(talk)


def test_a_stored_calibration_outlasts_the_power() -> None:
    async def talk(world: World, bus: Shared) -> None:
        numbers = {LEFT: tuple(range(1, len(EPOS1.memory) + 1)), RIGHT: tuple(range(-len(EPOS1.memory), 0))}
        told: list[str] = []
        await store(ROBOT, bus, JobKind.WRITE_CALIBRATION, numbers, told.append)
        assert told == [LEFT, RIGHT]
        for name, kept in numbers.items():
            drive = world.drive(name)
            drive.power_on(asyncio.get_running_loop().time())
            await asyncio.sleep(0.1)
            assert [drive.read(each.index, each.subindex) for each in EPOS1.memory] == [
                number % 2**32 for number in kept
            ]

    on_the_bus(talk)


def test_a_drive_that_is_another_one_stops_the_storing() -> None:
    async def talk(world: World, bus: Shared) -> None:
        told: list[str] = []
        world.drive(RIGHT).failures.misreport(0x1018, 1, lambda _: 1)
        with pytest.raises(WrongDevice, match="not maxon"):
            await store_gains(bus, LEFT, RIGHT, told=told.append)
        assert told == [LEFT]
        assert (await read_gains(ROBOT, bus))[RIGHT] == FACTORY

    on_the_bus(talk)


# ---------------------------------------------------------------------------------------------- somebody else


@pytest.mark.parametrize(
    ("frames", "id"), [([HEARTBEAT], "COM-18"), ([SET_POINT, HEARTBEAT], "COM-18"), ([SET_POINT], "COM-17")]
)
@pytest.mark.parametrize("after", [0.0, LISTEN - 0.01])
def test_drives_that_somebody_else_has_are_sent_nothing(frames: list[Frame], id: str, after: float) -> None:
    async def talk(_: World, bus: Shared) -> None:
        asyncio.get_running_loop().call_later(after, bus.foreign.extend, frames)
        with pytest.raises(DeviceError, match=rf"^steer-left: was sent nothing: {catalogue.ROWS[id].text} \({id}\)"):
            await store_gains(bus, LEFT, RIGHT)
        assert bus.sent == []

    on_the_bus(talk)


def test_somebody_who_comes_later_gets_the_drives_that_are_left() -> None:
    async def talk(world: World, bus: Shared) -> None:
        with pytest.raises(DeviceError, match="steer-right: was sent nothing: another artemis"):
            await store_gains(bus, LEFT, RIGHT, told=lambda _: bus.foreign.append(HEARTBEAT))
        assert {frame.id for frame in bus.sent} == {0x000, 0x603}
        found = await read_gains(ROBOT, bus)
        assert (found[LEFT], found[RIGHT]) == (NEW, FACTORY)

    on_the_bus(talk)


def test_a_bus_that_is_lost_is_no_silence() -> None:
    async def talk(_: World, bus: Shared) -> None:
        asyncio.get_running_loop().call_later(0.1, setattr, bus, "bus_off", True)
        with pytest.raises(DeviceLost):
            await store_gains(bus, LEFT)
        assert bus.sent == []

    on_the_bus(talk)


def test_it_listens_as_long_as_a_run() -> None:
    assert LISTEN == mode.LISTEN
