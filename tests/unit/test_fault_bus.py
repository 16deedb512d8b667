"""FaultBus: what is asked for happens to the frames, no more, and the same for the same seed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from msgspec.structs import replace

from artemis.clock import run, until
from artemis.devices.can_bus import Frame
from artemis.errors import DeviceBusy, DeviceLost
from artemis_lab.injections.fault_bus import PROCESS_DATA, TX_PDO_1, Direction, FaultBus, Rule


class Inner:
    """The bus within: takes what is sent, gives what lies in `arrived`."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.error_frames = 2
        self.sent: list[tuple[float, Frame]] = []
        self.arrived: list[Frame] = []
        self.wake: Callable[[], None] = lambda: None
        self.closed = self.full = False

    def send(self, frame: Frame) -> None:
        if self.full:
            raise DeviceBusy("CAN", "full")
        self.sent.append((self.loop.time(), frame))

    def receive(self) -> list[Frame]:
        frames, self.arrived = self.arrived, []
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def close(self) -> None:
        self.closed = True


class Wire:
    """A FaultBus on an inner bus, and what its host hears."""

    def __init__(self, seed: int = 0) -> None:
        self.inner = Inner()
        self.bus = FaultBus(self.inner, seed=seed)
        self.woken: list[float] = []
        self.bus.listen(lambda: self.woken.append(self.inner.loop.time()))

    @property
    def now(self) -> float:
        return self.inner.loop.time()

    def hear(self, *frames: Frame) -> list[Frame]:
        """What the host gets when these arrive now; each bears the present time."""
        self.inner.arrived += [replace(frame, time=self.now) for frame in frames]
        return self.bus.receive()

    def on_wire(self) -> list[Frame]:
        return [frame for _, frame in self.inner.sent]


def simulate(main: Callable[[Wire], Coroutine[Any, Any, None]], seed: int = 0) -> None:
    async def inside() -> None:
        await main(Wire(seed))

    run(inside(), simulated=True)


def status(node: int, value: int = 0) -> Frame:
    return Frame(0x180 + node, bytes((value, 1, 2, 3)))


def bare(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, time=0.0) for frame in frames]


# ---------------------------------------------------------------------------------------------- which frames


def test_frames_pass_untouched_without_rules() -> None:
    async def main(wire: Wire) -> None:
        await asyncio.sleep(1.0)
        frames = [status(node) for node in range(1, 5)]
        assert wire.hear(*frames) == [replace(frame, time=1.0) for frame in frames]
        for frame in frames:
            wire.bus.send(frame)
        assert wire.on_wire() == frames

    simulate(main)


IDS = (0x080, 0x181, 0x182, 0x200, 0x281, 0x581, 0x701)
RULES = {
    "identifiers": (Rule(ids=TX_PDO_1, drop=True), [0x080, 0x200, 0x281, 0x581, 0x701]),
    "node": (Rule(node=1, drop=True), [0x080, 0x182, 0x200]),
    "both": (Rule(ids=PROCESS_DATA, node=1, drop=True), [0x080, 0x182, 0x200, 0x581, 0x701]),
    "from the host": (Rule(direction=Direction.FROM_HOST, drop=True), list(IDS)),
    "count": (Rule(count=2, drop=True), [0x182, 0x200, 0x281, 0x581, 0x701]),
}


@pytest.mark.parametrize("name", RULES)
def test_rule_hits_what_it_names_and_nothing_else(name: str) -> None:
    rule, passing = RULES[name]

    async def main(wire: Wire) -> None:
        wire.bus.add(rule)
        heard = wire.hear(*(Frame(id) for id in IDS))
        assert [frame.id for frame in heard] == passing

    simulate(main)


def test_rule_for_one_direction_leaves_the_other_alone() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(direction=Direction.FROM_HOST, drop=True))
        wire.bus.send(Frame(0x201, b"\1"))
        assert wire.on_wire() == []
        wire.bus.add(Rule(direction=Direction.TO_HOST, drop=True))
        assert wire.hear(status(1)) == []

    simulate(main)


def test_rule_ends_after_its_duration_and_when_removed() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(duration=0.1, drop=True))
        await asyncio.sleep(0.099)
        assert wire.hear(status(1)) == []
        await asyncio.sleep(0.001)
        assert len(wire.hear(status(1))) == 1
        rule = wire.bus.add(Rule(drop=True))
        assert wire.hear(status(1)) == []
        wire.bus.remove(rule)
        wire.bus.remove(rule)
        assert len(wire.hear(status(1))) == 1

    simulate(main)


def test_first_rule_that_hits_decides() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(node=1, copies=1))
        wire.bus.add(Rule(drop=True))
        assert [frame.id for frame in wire.hear(status(1), status(2))] == [0x181, 0x181]

    simulate(main)


def hit_by(seed: int) -> list[int]:
    """Which of 400 frames a rule of probability 0.25 drops."""
    found: list[int] = []

    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(probability=0.25, drop=True))
        found.extend(n for n in range(400) if not wire.hear(status(1)))

    simulate(main, seed)
    return found


def test_probability_is_kept_and_repeats_with_its_seed() -> None:
    assert 70 <= len(hit_by(1)) <= 130
    assert hit_by(1) == hit_by(1) != hit_by(2)


# ---------------------------------------------------------------------------------------------- what becomes of them


def test_copies_come_at_once() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(copies=2))
        assert bare(wire.hear(status(1))) == [status(1)] * 3
        wire.bus.send(Frame(0x201, b"\1"))
        assert wire.on_wire() == [Frame(0x201, b"\1")] * 3

    simulate(main)


def test_delayed_frames_come_late_with_the_time_at_which_they_were_on_the_bus() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(node=1, delay=0.05))
        assert [frame.id for frame in wire.hear(status(1), status(2))] == [0x182]
        await asyncio.sleep(0.04)
        assert wire.bus.receive() == []
        await asyncio.sleep(0.01)
        assert wire.bus.receive() == [replace(status(1), time=0.0)]
        wire.bus.send(Frame(0x201, b"\1"))
        assert wire.inner.sent == []
        await asyncio.sleep(0.06)
        ((time, frame),) = wire.inner.sent
        assert time == pytest.approx(0.1)
        assert frame == Frame(0x201, b"\1")
        assert wire.woken == []  # process data wakes nobody

    simulate(main)


def test_delayed_urgent_frame_wakes_when_it_comes() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(delay=0.05))
        assert wire.hear(Frame(0x081, bytes(8))) == []
        await asyncio.sleep(0.2)
        assert wire.woken == [pytest.approx(0.05)]
        assert bare(wire.bus.receive()) == [Frame(0x081, bytes(8))]

    simulate(main)


def test_overtaken_frame_comes_behind_and_keeps_its_time() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(node=1, count=1, behind=2))
        first = wire.hear(status(1), status(2))
        assert [frame.id for frame in first] == [0x182]
        await asyncio.sleep(0.02)
        assert wire.hear(status(1, 9)) == [replace(status(1, 9), time=0.02), replace(status(1), time=0.0)]
        wire.bus.add(Rule(ids=range(0x201, 0x202), direction=Direction.FROM_HOST, count=1, behind=1))
        for id in (0x201, 0x202, 0x203):
            wire.bus.send(Frame(id))
        assert [frame.id for frame in wire.on_wire()] == [0x202, 0x201, 0x203]

    simulate(main)


@pytest.mark.parametrize("bits", [1, 2, 5, 32, 40])
def test_so_many_bits_are_wrong(bits: int) -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(flip=bits))
        (frame,) = wire.hear(status(1))
        wrong = int.from_bytes(frame.data, "big") ^ int.from_bytes(status(1).data, "big")
        assert wrong.bit_count() == min(bits, 32)
        assert frame.id == 0x181
        assert wire.hear(Frame(0x080))[0].data == b""

    simulate(main, seed=bits)


def test_length_and_identifier_are_changed() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(count=1, length=2))
        wire.bus.add(Rule(count=1, length=6))
        wire.bus.add(Rule(id=0x7FF))
        data = [(frame.id, frame.data) for frame in wire.hear(*[status(1)] * 3)]
        assert data == [(0x181, b"\0\1"), (0x181, b"\0\1\2\3\0\0"), (0x7FF, status(1).data)]

    simulate(main)


# ---------------------------------------------------------------------------------------------- the bus itself


def test_injected_frame_reaches_host_and_nodes_and_wakes() -> None:
    async def main(wire: Wire) -> None:
        await asyncio.sleep(0.5)
        frame = Frame(0x000, b"\x80\1")
        wire.bus.inject(frame)
        assert wire.on_wire() == [frame]
        await asyncio.sleep(0)
        assert wire.woken == [0.5]
        assert wire.bus.receive() == [replace(frame, time=0.5)]
        wire.bus.inject(frame, to_nodes=False)
        assert len(wire.inner.sent) == 1
        assert len(wire.bus.receive()) == 1
        wire.bus.inject(frame, to_host=False)
        assert len(wire.inner.sent) == 2
        assert wire.bus.receive() == []

    simulate(main)


def test_error_frames_add_up() -> None:
    async def main(wire: Wire) -> None:
        assert wire.bus.error_frames == 2
        wire.bus.add_error_frames()
        wire.bus.add_error_frames(3)
        assert wire.bus.error_frames == 6

    simulate(main)


def test_refused_sends_are_counted_and_their_frames_lost() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.fail_send(DeviceBusy("CAN", "transmit buffer full"), 2)
        for _ in range(2):
            with pytest.raises(DeviceBusy, match="transmit buffer full"):
                wire.bus.send(Frame(0x201))
        wire.bus.send(Frame(0x202))
        assert wire.on_wire() == [Frame(0x202)]
        wire.bus.fail_send(RuntimeError("for ever"), None)
        for _ in range(5):
            with pytest.raises(RuntimeError):
                wire.bus.send(Frame(0x203))

    simulate(main)


def test_failing_receive_wakes_and_frames_wait() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.fail_receive(DeviceLost("CAN", "read"), 1)
        await asyncio.sleep(0)
        assert len(wire.woken) == 1
        with pytest.raises(DeviceLost, match="read"):
            wire.hear(status(1))
        assert bare(wire.bus.receive()) == [status(1)]

    simulate(main)


def test_lost_adapter_raises_tells_and_comes_back_empty() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(node=2, delay=0.01))
        wire.bus.send(Frame(0x202))
        wire.hear(status(2))
        wire.bus.lose("unplugged")
        await asyncio.sleep(0)
        assert len(wire.woken) == 1
        wire.inner.wake()  # no word comes through an adapter that is gone
        assert len(wire.woken) == 1
        for call in (wire.bus.receive, lambda: wire.bus.send(Frame(0x201))):
            with pytest.raises(DeviceLost, match="unplugged"):
                call()
        wire.bus.inject(Frame(0x000))
        wire.inner.arrived.append(status(3))
        await asyncio.sleep(0.02)
        assert wire.on_wire() == [Frame(0x000)]  # what others say, the nodes hear
        wire.bus.restore()
        assert bare(wire.hear(status(1))) == [status(1)]

    simulate(main)


def test_late_frame_that_nobody_takes_is_only_lost() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.add(Rule(delay=0.01))
        wire.bus.send(Frame(0x201))
        wire.inner.full = True
        await until(0.02)
        assert wire.inner.sent == []

    simulate(main)


def test_close_closes_and_wakes_nobody_any_more() -> None:
    async def main(wire: Wire) -> None:
        wire.bus.close()
        assert wire.inner.closed
        wire.inner.wake()
        wire.bus.inject(Frame(0x000))
        wire.bus.lose("gone")
        await asyncio.sleep(0)
        assert wire.woken == []

    simulate(main)
