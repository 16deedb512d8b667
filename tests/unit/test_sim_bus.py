from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from disturbance import random_disturbance
from msgspec.structs import replace

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.errors import DeviceLost
from artemis.sim.bus import Disturb, SimBus, is_urgent
from artemis.sim.wire import frame_bits

MICROSECOND = 1e-6


class FakeNode:
    """Answers identifiers as told, after a delay; has one timer that sends a frame."""

    def __init__(self, answers: dict[int, list[tuple[float, Frame]]] | None = None) -> None:
        self.answers = answers or {}
        self.outbox: list[tuple[float, Frame]] = []
        self.next_due = math.inf
        self.hears = range(0x800)
        self.alarm: Frame | None = None
        self.heard: list[tuple[float, Frame]] = []
        self.advanced: list[float] = []

    def receive(self, frame: Frame, now: float) -> None:
        self.heard.append((now, frame))
        self.outbox += [(now + delay, answer) for delay, answer in self.answers.get(frame.id, [])]

    def advance(self, now: float) -> None:
        self.advanced.append(now)
        if now >= self.next_due:
            assert self.alarm is not None
            self.outbox.append((self.next_due, self.alarm))
            self.next_due = math.inf


class FakeWorld:
    def __init__(self, *nodes: FakeNode) -> None:
        self.nodes = nodes
        self.advanced: list[float] = []
        self.trouble: Callable[[float], None] = lambda now: None

    def advance(self, now: float) -> None:
        self.advanced.append(now)
        self.trouble(now)


def wire_time(*frames: Frame) -> float:
    return sum(map(frame_bits, frames)) * MICROSECOND


def simulate(main: Coroutine[Any, Any, None]) -> None:
    run(main, simulated=True)


def make_bus(world: FakeWorld, *, disturb: Disturb | None = None, patrol_s: float = 0.01) -> SimBus:
    return SimBus(world, 1_000_000, asyncio.get_running_loop(), disturb=disturb, patrol_s=patrol_s)


SDO_REQUEST = Frame(0x601, bytes.fromhex("4041600000000000"))
SDO_ANSWER = Frame(0x581, bytes.fromhex("4b41600040010000"))
SYNC = Frame(0x080)


def test_frame_is_heard_when_its_last_bit_is_over() -> None:
    async def main() -> None:
        node = FakeNode()
        bus = make_bus(FakeWorld(node))
        bus.send(SYNC)
        assert bus.receive() == []
        assert node.heard == []
        await asyncio.sleep(1e-3)
        bus.receive()
        ((time, heard),) = node.heard
        assert heard == SYNC
        assert time == pytest.approx(51 * MICROSECOND)

    simulate(main())


def test_lower_bit_rate_makes_frames_longer() -> None:
    async def main() -> None:
        node = FakeNode()
        bus = SimBus(FakeWorld(node), 125_000, asyncio.get_running_loop())
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        bus.receive()
        assert node.heard[0][0] == pytest.approx(8 * 51 * MICROSECOND)

    simulate(main())


def test_request_and_answer_take_the_wire_and_the_nodes_time() -> None:
    async def main() -> None:
        bus = make_bus(FakeWorld(FakeNode({0x601: [(300e-6, SDO_ANSWER)]})))
        bus.send(SDO_REQUEST)
        await asyncio.sleep(1e-3)
        (answer,) = bus.receive()
        assert replace(answer, time=0.0) == SDO_ANSWER
        assert answer.time == pytest.approx(300e-6 + wire_time(SDO_REQUEST, SDO_ANSWER))

    simulate(main())


def test_lowest_identifier_wins_the_wire() -> None:
    async def main() -> None:
        answers = [Frame(0x281, b"a"), Frame(0x183, b"b"), Frame(0x082, b"c")]
        bus = make_bus(FakeWorld(*(FakeNode({0x080: [(0.0, answer)]}) for answer in answers)))
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        assert [frame.id for frame in bus.receive()] == [0x082, 0x183, 0x281]

    simulate(main())


def test_late_frame_cannot_interrupt_one_on_the_wire() -> None:
    async def main() -> None:
        first, urgent = Frame(0x481, bytes(8)), Frame(0x081, bytes(8))
        nodes = FakeNode({0x080: [(0.0, first)]}), FakeNode({0x080: [(1e-6, urgent)]})
        bus = make_bus(FakeWorld(*nodes))
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        assert [frame.id for frame in bus.receive()] == [0x481, 0x081]

    simulate(main())


def test_data_frame_beats_the_remote_frame_of_the_same_identifier() -> None:
    async def main() -> None:
        nodes = FakeNode({0x080: [(0.0, Frame(0x701, rtr=True))]}), FakeNode({0x080: [(0.0, Frame(0x701, b"\x05"))]})
        bus = make_bus(FakeWorld(*nodes))
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        assert [frame.rtr for frame in bus.receive()] == [False, True]

    simulate(main())


def test_hosts_own_frames_keep_their_order_and_never_come_back() -> None:
    async def main() -> None:
        node = FakeNode()
        bus = make_bus(FakeWorld(node))
        sent = [Frame(0x201, bytes(6)), Frame(0x202, bytes(6)), SYNC]
        for frame in sent:
            bus.send(frame)
        await asyncio.sleep(1e-3)
        assert bus.receive() == []
        assert [frame for _, frame in node.heard] == sent
        assert node.heard[-1][0] == pytest.approx(wire_time(*sent))

    simulate(main())


def test_nodes_hear_each_other_but_not_themselves() -> None:
    async def main() -> None:
        talker, listener = FakeNode({0x080: [(0.0, Frame(0x181, b"x"))]}), FakeNode()
        bus = make_bus(FakeWorld(talker, listener))
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        bus.receive()
        assert [frame.id for _, frame in talker.heard] == [0x080]
        assert [frame.id for _, frame in listener.heard] == [0x080, 0x181]

    simulate(main())


def test_timers_and_frames_happen_in_the_order_of_time() -> None:
    async def main() -> None:
        node = FakeNode({0x080: [(0.0, Frame(0x181))]})
        node.next_due, node.alarm = 2e-3, Frame(0x701, b"\x05")
        bus = make_bus(FakeWorld(node))
        await asyncio.sleep(4e-3)
        bus.send(SYNC)
        await asyncio.sleep(4e-3)
        frames = bus.receive()
        assert [frame.id for frame in frames] == [0x701, 0x181]
        assert frames[0].time == pytest.approx(2e-3 + wire_time(Frame(0x701, b"\x05")))

    simulate(main())


def test_host_is_woken_for_an_answer_when_it_arrives_and_not_before() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        bus = make_bus(FakeWorld(FakeNode({0x601: [(300e-6, SDO_ANSWER)]})))
        woken: list[float] = []
        bus.listen(lambda: woken.append(loop.time()))
        bus.send(SDO_REQUEST)
        await asyncio.sleep(0.1)
        assert woken == [pytest.approx(300e-6 + wire_time(SDO_REQUEST, SDO_ANSWER))]

    simulate(main())


def test_host_is_not_woken_for_process_data_and_heartbeats() -> None:
    async def main() -> None:
        node = FakeNode({0x080: [(0.0, Frame(0x181, bytes(6))), (0.0, Frame(0x701, b"\x05"))]})
        bus = make_bus(FakeWorld(node))
        woken: list[None] = []
        bus.listen(lambda: woken.append(None))
        bus.send(SYNC)
        await asyncio.sleep(0.1)
        assert woken == []
        assert len(bus.receive()) == 2

    simulate(main())


def test_emergency_from_inside_a_drive_wakes_the_host_within_the_patrol() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        node = FakeNode()
        world = FakeWorld(node)

        def trouble(now: float) -> None:
            if now >= 0.0502 and not node.heard and not node.outbox:
                node.outbox.append((now, Frame(0x081, bytes(8))))
                world.trouble = lambda now: None

        world.trouble = trouble
        bus = make_bus(world)
        arrived: list[float] = []
        bus.listen(lambda: arrived.append(loop.time()))
        await asyncio.sleep(0.1)
        assert len(arrived) == 1
        assert 0.0502 < arrived[0] <= 0.0502 + 0.0101

    simulate(main())


def test_answer_that_surfaces_while_sending_still_wakes_the_host() -> None:
    async def main() -> None:
        bus = make_bus(FakeWorld(FakeNode({0x601: [(0.0, SDO_ANSWER)]})))
        bus.send(SDO_REQUEST)
        await asyncio.sleep(1e-3)
        bus.send(SYNC)  # nobody has listened or received so far
        woken: list[None] = []
        bus.listen(lambda: woken.append(None))
        await asyncio.sleep(1e-3)
        assert woken == [None]

    simulate(main())


def test_world_is_up_to_date_when_a_sync_is_heard() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        bus = make_bus(world)
        await asyncio.sleep(5e-3)
        bus.send(SYNC)
        await asyncio.sleep(1e-3)
        bus.receive()
        assert world.advanced[-1] == pytest.approx(5e-3 + 51 * MICROSECOND)

    simulate(main())


def test_idle_bus_lets_the_world_move_only_on_patrol() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        bus = make_bus(world, patrol_s=0.02)
        bus.listen(lambda: None)
        await asyncio.sleep(0.205)
        assert world.advanced == pytest.approx([0.02 * k for k in range(1, 11)], abs=1e-6)

    simulate(main())


def test_closed_bus_schedules_nothing() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode())
        bus = make_bus(world)
        bus.listen(lambda: None)
        bus.close()
        bus.close()
        await asyncio.sleep(0.1)
        assert world.advanced == []

    simulate(main())


def test_what_was_sent_still_leaves_when_the_bus_is_closed() -> None:
    async def main() -> None:
        node = FakeNode({0x080: [(0.0, SDO_ANSWER)]})
        bus = make_bus(FakeWorld(node))
        for frame in (SYNC, SDO_REQUEST):
            bus.send(frame)
        bus.close()
        assert [frame for _, frame in node.heard] == [SYNC, SDO_REQUEST]
        assert node.heard[-1][0] < 1e-3

    simulate(main())


def test_load_of_the_bus_is_counted() -> None:
    async def main() -> None:
        bus = make_bus(FakeWorld(FakeNode({0x601: [(0.0, SDO_ANSWER)]})))
        bus.send(SDO_REQUEST)
        await asyncio.sleep(1e-3)
        bus.receive()
        assert (bus.frames, bus.bits) == (2, 123 + 121)
        assert bus.busy == pytest.approx(244 * MICROSECOND)

    simulate(main())


def test_bus_off_takes_the_host_off_and_leaves_the_nodes() -> None:
    async def main() -> None:
        node = FakeNode({0x601: [(0.0, SDO_ANSWER)]})
        listener = FakeNode()
        bus = make_bus(FakeWorld(node, listener))
        bus.send(SYNC)
        bus.bus_off = True
        with pytest.raises(DeviceLost, match="bus off"):
            bus.send(SDO_REQUEST)
        with pytest.raises(DeviceLost, match="bus off"):
            bus.receive()
        node.next_due, node.alarm = 2e-3, Frame(0x701, b"\x05")
        bus.listen(lambda: None)
        await asyncio.sleep(0.05)
        assert [frame.id for _, frame in listener.heard] == [0x080, 0x701], "the SYNC was on the wire already"
        bus.bus_off = False
        assert bus.receive() == []
        bus.send(SDO_REQUEST)
        await asyncio.sleep(0.01)
        assert [frame.id for frame in bus.receive()] == [0x581]

    simulate(main())


def test_injected_trouble_loses_changes_and_delays_frames() -> None:
    def disturb(frame: Frame, now: float) -> tuple[Frame | None, float]:
        if frame.id == 0x181:
            return None, 0.0
        if frame.id == 0x182:
            return replace(frame, data=b"!"), 0.0
        return frame, 5e-3 if frame.id == 0x183 else 0.0

    async def main() -> None:
        answers = [(0.0, Frame(0x181, b"x")), (0.0, Frame(0x182, b"x")), (0.0, Frame(0x183, b"x"))]
        bus = make_bus(FakeWorld(FakeNode({0x080: answers})), disturb=disturb)
        bus.send(SYNC)
        await asyncio.sleep(4e-3)
        assert [(frame.id, frame.data) for frame in bus.receive()] == [(0x182, b"!")]
        await asyncio.sleep(4e-3)
        assert [(frame.id, frame.data) for frame in bus.receive()] == [(0x183, b"x")]
        assert bus.frames == 4  # what nobody hears was on the wire all the same

    simulate(main())


def test_lost_request_leaves_the_loop_alone() -> None:
    async def main() -> None:
        world = FakeWorld(FakeNode({0x601: [(0.0, SDO_ANSWER)]}))
        bus = make_bus(world, disturb=lambda frame, now: (None, 0.0))
        bus.listen(lambda: None)
        bus.send(SDO_REQUEST)
        await asyncio.sleep(1.0)
        assert bus.receive() == []
        assert len(world.advanced) == pytest.approx(100, abs=2)  # patrols only

    simulate(main())


def test_random_trouble_repeats_with_its_seed() -> None:
    frames = [Frame(0x181 + k % 4, bytes([k] * 8)) for k in range(200)]

    def outcome(seed: int) -> list[tuple[Frame | None, float]]:
        disturb = random_disturbance(seed, loss=0.2, corruption=0.2, delay=1e-3)
        return [disturb(frame, 0.0) for frame in frames]

    first = outcome(1)
    assert first == outcome(1)
    assert first != outcome(2)
    lost = sum(heard is None for heard, _ in first)
    wrong = sum(heard is not None and heard.data != frame.data for (heard, _), frame in zip(first, frames, strict=True))
    assert 20 < lost < 60
    assert 15 < wrong < 55
    assert all(0.0 <= late <= 1e-3 for _, late in first)


@pytest.mark.parametrize(
    ("frame", "urgent"),
    [
        (Frame(0x000, b"\x01\x00"), True),
        (Frame(0x080), False),
        (Frame(0x081, bytes(8)), True),
        (Frame(0x181, bytes(8)), False),
        (Frame(0x501, bytes(8)), False),
        (SDO_ANSWER, True),
        (SDO_REQUEST, True),
        (Frame(0x701, b"\x00"), True),
        (Frame(0x701, b"\x05"), False),
        (Frame(0x701, rtr=True), False),
    ],
)
def test_urgent_is_all_but_process_data_sync_and_heartbeats(frame: Frame, urgent: bool) -> None:
    assert is_urgent(frame) is urgent
