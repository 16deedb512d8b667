from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
import yaml
from msgspec.structs import replace

from artemis.clock import SimulatedLoop, run
from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState
from artemis.errors import DeviceBusy, DeviceLost
from artemis.sim.server import BURST, LONGEST_GAP, PERIOD, serve
from artemis.sim.wire import frame_bits
from artemis.sim.world import World
from artemis.vehicle import RobotFile

ROBOT_FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
BITRATE = 1_000_000
CLOSE = 1e-9
WATCH, TICK = 0.2, 0.02
HEARTBEAT = Frame(0x77F, b"\x05")


class FakeNode:
    def __init__(self, answers: dict[int, list[tuple[float, Frame]]] | None = None) -> None:
        self.answers = answers or {}
        self.outbox: list[tuple[float, Frame]] = []
        self.next_due = math.inf
        self.hears = range(0x800)
        self.alarm: Frame | None = None
        self.heard: list[tuple[float, Frame]] = []
        self.advanced: list[float] = []
        self.heard_before_alarm: list[Frame] = []

    def receive(self, frame: Frame, now: float) -> None:
        self.heard.append((now, frame))
        self.outbox += [(now + delay, answer) for delay, answer in self.answers.get(frame.id, [])]

    def advance(self, now: float) -> None:
        self.advanced.append(now)
        if now >= self.next_due and self.alarm is not None:
            self.heard_before_alarm = [frame for _, frame in self.heard]
            self.outbox.append((self.next_due, self.alarm))
            self.next_due = math.inf


class FakeWorld:
    def __init__(self, *nodes: FakeNode) -> None:
        self.nodes = nodes
        self.advanced: list[float] = []

    def advance(self, now: float) -> None:
        self.advanced.append(now)


class FakeBus:
    """The drives' end of a real bus; the test is the other end. `at_once`: frames that one `receive` gives out."""

    def __init__(self, at_once: int = 1000) -> None:
        self.error_frames = 0
        self.full = False
        self.at_once = at_once
        self.sent: list[tuple[float, Frame]] = []
        self.inbox: list[Frame] = []
        self.lost = False
        self.wake: Callable[[], None] = lambda: None

    def arrive(self, frame: Frame) -> None:
        self.inbox.append(replace(frame, time=asyncio.get_running_loop().time()))
        self.wake()

    def send(self, frame: Frame) -> None:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        if self.full:
            raise DeviceBusy("CAN", "full")
        self.sent.append((asyncio.get_running_loop().time(), frame))

    def receive(self) -> list[Frame]:
        if self.lost:
            raise DeviceLost("CAN", "unplugged")
        frames, self.inbox = self.inbox[: self.at_once], self.inbox[self.at_once :]
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def close(self) -> None:
        self.lost = True


def simulate(main: Coroutine[Any, Any, None]) -> None:
    run(main, simulated=True)


def hold_up(seconds: float) -> None:
    """The process does nothing for some time."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    loop._selector_with_time.now += seconds


def length(*frames: Frame) -> float:
    """Time that frames need on the wire, one after the other [s]."""
    return sum(frame_bits(frame) for frame in frames) / BITRATE


def test_answer_leaves_when_it_is_ready() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode({0x601: [(0.3e-3, Frame(0x581, bytes(8)))]})
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.0101)
        bus.arrive(Frame(0x601, bytes(8)))
        await serving
        ((time, frame),) = bus.sent
        assert frame.id == 0x581
        assert time == pytest.approx(0.0104 + length(frame))

    simulate(main())


def test_frame_is_heard_at_the_time_it_arrived_even_when_nobody_was_woken() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode()
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.0105)
        bus.inbox.append(Frame(0x080, time=0.0105))
        await serving
        ((time, frame),) = node.heard
        assert frame.id == 0x080
        assert time == pytest.approx(0.0105)

    simulate(main())


def test_timer_runs_out_at_its_own_time_however_late_the_process_is() -> None:
    async def main() -> None:
        node = FakeNode()
        node.next_due, node.alarm = 0.0503, Frame(0x081, bytes(8))
        serving = asyncio.create_task(serve(FakeWorld(node), FakeBus(), BITRATE, until=0.2))
        await asyncio.sleep(0.0402)
        hold_up(0.05)
        await serving
        assert 0.0503 in node.advanced
        assert node.advanced == sorted(node.advanced)

    simulate(main())


def test_frames_that_wait_unread_are_heard_before_the_timers_behind_them() -> None:
    async def main() -> None:
        bus, node = FakeBus(at_once=2), FakeNode()
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.2))
        await asyncio.sleep(0.0402)
        node.next_due, node.alarm = 0.078, Frame(0x081, bytes(8))
        bus.inbox += [Frame(0x77F, b"\x05", time=0.05 + 0.005 * number) for number in range(9)]
        hold_up(0.055)
        await serving
        before = [time for time, _ in node.heard if time < 0.078]
        assert before == pytest.approx([0.05, 0.055, 0.06, 0.065, 0.07, 0.075])
        assert len(node.heard_before_alarm) == len(before)
        assert len(node.heard) == 9

    simulate(main())


def test_frames_that_arrive_without_end_do_not_keep_the_timers_waiting() -> None:
    class Flooded(FakeBus):
        def receive(self) -> list[Frame]:
            return [Frame(0x77F, b"\x05", time=asyncio.get_running_loop().time())]

    async def main() -> None:
        node = FakeNode()
        node.next_due, node.alarm = 0.0105, Frame(0x081, bytes(8))
        await serve(FakeWorld(node), Flooded(), BITRATE, until=0.02)
        assert 0.0105 in node.advanced

    simulate(main())


def test_nodes_send_no_faster_than_the_wire_carries() -> None:
    async def main() -> None:
        answers = [(0.0, Frame(identifier, bytes(8))) for identifier in (0x381, 0x181, 0x281)]
        bus, node, other = FakeBus(), FakeNode({0x080: answers}), FakeNode({0x080: [(0.0, Frame(0x182, bytes(8)))]})
        serving = asyncio.create_task(serve(FakeWorld(node, other), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.0101)
        bus.arrive(Frame(0x080))
        await serving
        left = [frame for _, frame in bus.sent]
        assert [frame.id for frame in left] == [0x181, 0x182, 0x281, 0x381]
        expected = [0.0101 + length(*left[: number + 1]) for number in range(4)]
        assert [time for time, _ in bus.sent] == pytest.approx(expected)

    simulate(main())


def test_frames_that_leave_late_do_not_leave_all_at_once() -> None:
    async def main() -> None:
        answers = [(0.002 + 0.001 * number, Frame(0x181, bytes((number,) * 8))) for number in range(12)]
        bus, node = FakeBus(), FakeNode({0x080: answers})
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.0101)
        bus.arrive(Frame(0x080))
        await asyncio.sleep(0.0005)
        hold_up(0.05)
        await serving
        assert [frame.data[0] for _, frame in bus.sent] == list(range(12))
        times = [time for time, _ in bus.sent]
        assert max(times.count(time) for time in times) <= 5
        assert times[-1] == pytest.approx(0.0606 + length(*(frame for _, frame in bus.sent[1:])) - BURST / BITRATE)

    simulate(main())


def test_nodes_wait_until_a_frame_from_outside_has_left_the_wire() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode({0x601: [(0.0, Frame(0x581, bytes(8)))]})
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.0101)
        bus.arrive(Frame(0x601, bytes(8)))
        await asyncio.sleep(0.0001)
        bus.arrive(Frame(0x602, bytes(8)))
        await serving
        ((time, frame),) = bus.sent
        assert time == pytest.approx(0.0102 + length(frame))

    simulate(main())


def test_frame_that_the_adapter_has_no_room_for_is_lost_and_nothing_else() -> None:
    async def main() -> None:
        bus, node = FakeBus(), FakeNode({0x601: [(0.0, Frame(0x581, bytes(8)))]})
        serving = asyncio.create_task(serve(FakeWorld(node), bus, BITRATE, until=0.1))
        await asyncio.sleep(0.01)
        bus.full = True
        bus.arrive(Frame(0x601, bytes(8)))
        await asyncio.sleep(0.01)
        bus.full = False
        bus.arrive(Frame(0x601, bytes(8)))
        await serving
        assert len(node.heard) == 2
        assert len(bus.sent) == 1

    simulate(main())


def test_nodes_hear_each_other_but_not_themselves() -> None:
    async def main() -> None:
        bus = FakeBus()
        talker, listener = FakeNode(), FakeNode({0x701: [(0.0, Frame(0x182))]})
        talker.next_due, talker.alarm = 5.5e-3, Frame(0x701, b"\x05")
        await serve(FakeWorld(talker, listener), bus, BITRATE, until=0.02)
        assert [frame.id for _, frame in bus.sent] == [0x701, 0x182]
        assert bus.sent[0][0] == pytest.approx(5.5e-3 + length(talker.alarm))
        assert [frame.id for _, frame in talker.heard] == [0x182]
        assert [frame.id for _, frame in listener.heard] == [0x701]

    simulate(main())


def test_world_moves_at_least_every_5_ms_and_without_a_busy_loop() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        await serve(world, FakeBus(), BITRATE, until=1.0)
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
            await serve(FakeWorld(node), bus, BITRATE)

    simulate(main())


def test_cancelling_ends_the_serving_and_leaves_no_timer_behind() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        serving = asyncio.create_task(serve(world, FakeBus(), BITRATE))
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
        await serve(FakeWorld(), FakeBus(), BITRATE, until=3.5, status=lambda: told.append(loop.time()))
        assert told == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=5e-3)

    simulate(main())


def test_simulated_robot_boots_and_answers() -> None:
    async def main() -> None:
        bus = FakeBus()
        world = World(RobotFile.model_validate(yaml.safe_load(ROBOT_FILE.read_text())))
        serving = asyncio.create_task(serve(world, bus, BITRATE, until=0.2))
        await asyncio.sleep(0.1)
        assert [replace(frame, time=0.0) for _, frame in bus.sent] == [
            Frame(0x701 + node, b"\x00") for node in range(4)
        ]
        bus.arrive(Frame(0x602, bytes.fromhex("40 41 60 00 00 00 00 00")))
        await serving
        assert bus.sent[-1][1].data == bytes.fromhex("4B 41 60 00 40 01 00 00")  # Switch On Disabled

    simulate(main())


# ---------------------------------------------------------------------------------------------- watching the host


class Watched:
    """The simulated robot, watching the host's heartbeat, which the test sends or withholds."""

    def __init__(self) -> None:
        self.bus = FakeBus()
        self.loop = asyncio.get_running_loop()
        self.world = World(RobotFile.model_validate(yaml.safe_load(ROBOT_FILE.read_text())), start=self.loop.time())
        self.serving = asyncio.create_task(serve(self.world, self.bus, BITRATE))

    async def begin(self) -> None:
        await asyncio.sleep(0.1)
        for node in self.world.nodes:
            node.poke(0x1016, 1, 0x7F << 16 | round(WATCH * 1000))
        await self.beat(0.5)

    async def beat(self, seconds: float) -> None:
        end = self.loop.time() + seconds
        while self.loop.time() < end - CLOSE:
            self.bus.arrive(HEARTBEAT)
            await asyncio.sleep(TICK)

    def beats_unread(self, *times: float) -> None:
        """Heartbeats that arrive while the process is held up, so many seconds from now."""
        self.bus.inbox += [replace(HEARTBEAT, time=self.loop.time() + time) for time in times]

    @property
    def reports(self) -> list[float]:
        """When a drive's report of a lost heartbeat has left."""
        return [time for time, frame in self.bus.sent if frame.id < 0x100 and frame.data[:2] == b"\x30\x81"]

    @property
    def in_fault(self) -> int:
        return sum(node.state is DriveState.FAULT for node in self.world.nodes)

    def end(self) -> None:
        self.serving.cancel()


def watched(test: Callable[[Watched], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        robot = Watched()
        await robot.begin()
        await test(robot)
        robot.end()

    simulate(main())


def test_silence_of_the_host_is_noticed_when_the_time_is_over() -> None:
    async def test(robot: Watched) -> None:
        last = robot.loop.time() - TICK
        await asyncio.sleep(WATCH - TICK - CLOSE)
        assert robot.in_fault == 0
        await asyncio.sleep(0.002 + 2 * PERIOD)
        assert robot.in_fault == 4
        (first,) = (frame for _, frame in robot.bus.sent if frame.id == 0x081)
        assert min(robot.reports) == pytest.approx(last + WATCH + length(first))

    watched(test)


@pytest.mark.parametrize("seconds", [0.09, 0.19, 0.21, 0.5, 60.0])
def test_nobody_is_missed_while_the_simulation_itself_was_held_up(seconds: float) -> None:
    async def test(robot: Watched) -> None:
        robot.beats_unread(*(TICK * number for number in range(min(round(seconds / TICK), 30))))  # then it runs over
        hold_up(seconds)
        await robot.beat(0.5)
        assert robot.reports == []
        assert robot.in_fault == 0

    watched(test)


def test_heartbeat_that_is_unread_when_the_time_is_over_still_counts() -> None:
    async def test(robot: Watched) -> None:
        await asyncio.sleep(WATCH - TICK - 0.05)
        robot.beats_unread(0.045)
        hold_up(0.09)
        await robot.beat(0.5)
        assert robot.reports == []

    watched(test)


def test_heartbeat_that_came_too_late_does_not_count_even_if_it_is_read_in_time() -> None:
    async def test(robot: Watched) -> None:
        await asyncio.sleep(WATCH - TICK - 0.05)
        robot.beats_unread(0.055, 0.075)
        hold_up(0.09)
        await robot.beat(0.1)
        assert len(robot.reports) == 4
        assert robot.in_fault == 4

    watched(test)


def test_host_that_died_while_the_simulation_was_held_up_is_missed() -> None:
    async def test(robot: Watched) -> None:
        robot.beats_unread(0.0, TICK)
        hold_up(10.0)
        await asyncio.sleep(WATCH - LONGEST_GAP)
        assert robot.in_fault == 0
        await asyncio.sleep(LONGEST_GAP)
        assert robot.in_fault == 4
        assert len(robot.reports) == 4

    watched(test)
