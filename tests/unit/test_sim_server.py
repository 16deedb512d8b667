from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
import yaml

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.errors import DeviceLost
from artemis.sim.server import serve
from artemis.sim.world import World
from artemis.vehicle import Robot

ROBOT_FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"


class FakeNode:
    def __init__(self, answers: dict[int, list[tuple[float, Frame]]] | None = None) -> None:
        self.answers = answers or {}
        self.outbox: list[tuple[float, Frame]] = []
        self.next_due = math.inf
        self.alarm: Frame | None = None
        self.heard: list[tuple[float, Frame]] = []

    def receive(self, frame: Frame, now: float) -> None:
        self.heard.append((now, frame))
        self.outbox += [(now + delay, answer) for delay, answer in self.answers.get(frame.id, [])]

    def advance(self, now: float) -> None:
        if now >= self.next_due and self.alarm is not None:
            self.outbox.append((self.next_due, self.alarm))
            self.next_due = math.inf


class FakeWorld:
    def __init__(self, *nodes: FakeNode) -> None:
        self.nodes = nodes
        self.advanced: list[float] = []

    def advance(self, now: float) -> None:
        self.advanced.append(now)


class FakeBus:
    """The drives' end of a real bus; the test is the other end."""

    def __init__(self) -> None:
        self.sent: list[tuple[float, Frame]] = []
        self.inbox: list[Frame] = []
        self.lost = False
        self.wake: Callable[[], None] = lambda: None

    def arrive(self, frame: Frame) -> None:
        self.inbox.append(frame._replace(time=asyncio.get_running_loop().time()))
        self.wake()

    def send(self, frame: Frame) -> None:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        self.sent.append((asyncio.get_running_loop().time(), frame))

    def receive(self) -> list[Frame]:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        frames, self.inbox = self.inbox, []
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def close(self) -> None:
        self.lost = True


def simulate(main: Coroutine[Any, Any, None]) -> None:
    run(main, simulated=True)


def test_answer_leaves_when_it_is_ready() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode({0x601: [(0.3e-3, Frame(0x581, bytes(8)))]})
        serving = asyncio.create_task(serve(FakeWorld(node), bus, until=0.1))
        await asyncio.sleep(0.0101)
        bus.arrive(Frame(0x601, bytes(8)))
        await serving
        ((time, frame),) = bus.sent
        assert frame.id == 0x581
        assert time == pytest.approx(0.0104)

    simulate(main())


def test_frame_is_heard_at_the_time_it_arrived_even_when_nobody_was_woken() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode()
        serving = asyncio.create_task(serve(FakeWorld(node), bus, until=0.1))
        await asyncio.sleep(0.0105)
        bus.inbox.append(Frame(0x080, time=0.0105))
        await serving
        ((time, frame),) = node.heard
        assert frame.id == 0x080
        assert time == pytest.approx(0.0105)

    simulate(main())


def test_nodes_hear_each_other_but_not_themselves() -> None:
    async def main() -> None:
        bus = FakeBus()
        talker, listener = FakeNode(), FakeNode({0x701: [(0.0, Frame(0x182))]})
        talker.next_due, talker.alarm = 5.5e-3, Frame(0x701, b"\x05")
        await serve(FakeWorld(talker, listener), bus, until=0.02)
        assert [frame.id for _, frame in bus.sent] == [0x701, 0x182]
        assert bus.sent[0][0] == pytest.approx(5.5e-3)
        assert [frame.id for _, frame in talker.heard] == [0x182]
        assert [frame.id for _, frame in listener.heard] == [0x701]

    simulate(main())


def test_world_moves_at_least_every_5_ms_and_without_a_busy_loop() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        await serve(world, FakeBus(), until=1.0)
        steps = [after - before for before, after in zip(world.advanced, world.advanced[1:], strict=False)]
        assert max(steps) <= 5e-3
        assert len(steps) <= 1000

    simulate(main())


@pytest.mark.parametrize("while_sending", [True, False])
def test_lost_bus_ends_the_serving_with_its_error(while_sending: bool) -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode()
        if while_sending:
            node.next_due, node.alarm = 0.0, Frame(0x701, b"\x05")
        asyncio.get_running_loop().call_later(0.01, bus.close)
        with pytest.raises(DeviceLost, match="unplugged"):
            await serve(FakeWorld(node), bus)

    simulate(main())


def test_cancelling_ends_the_serving_and_leaves_no_timer_behind() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        serving = asyncio.create_task(serve(world, FakeBus()))
        await asyncio.sleep(0.1)
        serving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await serving
        count = len(world.advanced)
        await asyncio.sleep(0.1)
        assert len(world.advanced) == count

    simulate(main())


def test_status_is_told_once_a_second() -> None:
    async def main() -> None:
        told: list[float] = []
        loop = asyncio.get_running_loop()
        await serve(FakeWorld(), FakeBus(), until=3.5, status=lambda: told.append(loop.time()))
        assert told == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=5e-3)

    simulate(main())


def test_simulated_robot_boots_and_answers() -> None:
    async def main() -> None:
        bus = FakeBus()
        world = World(Robot.model_validate(yaml.safe_load(ROBOT_FILE.read_text())))
        serving = asyncio.create_task(serve(world, bus, until=0.2))
        await asyncio.sleep(0.1)
        assert [frame[:2] for _, frame in bus.sent] == [(0x701 + node, b"\x00") for node in range(4)]
        bus.arrive(Frame(0x602, bytes.fromhex("40 41 60 00 00 00 00 00")))
        await serving
        assert bus.sent[-1][1][:2] == (0x582, bytes.fromhex("4B 41 60 00 40 01 00 00"))  # Switch On Disabled

    simulate(main())
