from __future__ import annotations

import asyncio
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.sim.bus import SimBus
from artemis.sim.wire import frame_bits


def crc_15(stream: list[int]) -> int:
    crc = 0
    for bit in stream:
        next_bit = bit ^ (crc >> 14)
        crc = (crc << 1) & 0x7FFF
        if next_bit:
            crc ^= 0x4599
    return crc


def bits_one_by_one(frame: Frame) -> int:
    """The standard's own words: build the stream, append the CRC, insert the stuff bits, count."""
    stream = [0] + [frame.id >> i & 1 for i in reversed(range(11))] + [int(frame.rtr), 0, 0]
    stream += [len(frame.data) >> i & 1 for i in reversed(range(4))]
    if not frame.rtr:
        stream += [byte >> i & 1 for byte in frame.data for i in reversed(range(8))]
    crc = crc_15(stream)
    stream += [crc >> i & 1 for i in reversed(range(15))]
    sent: list[int] = []
    run = 0
    for bit in stream:
        run = run + 1 if sent and sent[-1] == bit else 1
        sent.append(bit)
        if run == 5:
            sent.append(1 - bit)
            run = 1
    return len(sent) + 1 + 2 + 7 + 3


data = st.one_of(
    st.binary(max_size=8),
    st.lists(st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x78, 0x87, 0x1F]), max_size=8).map(bytes),
)
frames = st.builds(Frame, id=st.integers(0, 0x7FF), data=data, rtr=st.booleans())


def test_reference_crc_has_the_published_check_value() -> None:
    stream = [byte >> i & 1 for byte in b"123456789" for i in reversed(range(8))]
    assert crc_15(stream) == 0x059E  # CRC-15/CAN in the catalogue of parametrised CRC algorithms


@given(frames)
def test_tables_agree_with_counting_bit_by_bit(frame: Frame) -> None:
    assert frame_bits(frame) == bits_one_by_one(frame)


@given(frames)
def test_length_stays_between_no_stuffing_and_the_worst_case(frame: Frame) -> None:
    n = 0 if frame.rtr else len(frame.data)
    assert 47 + 8 * n <= frame_bits(frame) <= 47 + 8 * n + (33 + 8 * n) // 4


@given(frames)
def test_time_stamp_does_not_change_the_length(frame: Frame) -> None:
    assert frame_bits(replace(frame, time=12.5)) == frame_bits(frame)


class Echo:
    """Answers every frame of the host with one of its own after a while, and ticks now and then."""

    def __init__(self, number: int, delay: float) -> None:
        self.number, self.delay = number, delay
        self.outbox: list[tuple[float, Frame]] = []
        self.next_due = 1e-3 * number
        self.hears = range(0x800)

    def receive(self, frame: Frame, now: float) -> None:
        if frame.id < 0x100:
            self.outbox.append((now + self.delay, Frame(0x180 + 0x10 * self.number + frame.id % 7, frame.data)))

    def advance(self, now: float) -> None:
        if now >= self.next_due:
            self.outbox.append((now, Frame(0x700 + self.number, b"\x05")))
            self.next_due = self.next_due + 2e-3 if self.next_due < 0.02 else math.inf


class Still:
    def __init__(self, delays: list[float]) -> None:
        self.nodes = [Echo(number, delay) for number, delay in enumerate(delays, start=1)]

    def advance(self, now: float) -> None:
        pass


def traffic(delays: list[float], sent: list[tuple[float, Frame]], looks: list[float]) -> list[Frame]:
    """All that the host receives when it sends at some times and looks at others."""

    async def main() -> list[Frame]:
        loop = asyncio.get_running_loop()
        bus = SimBus(Still(delays), 1_000_000, loop)
        received: list[Frame] = []
        for time, frame in sent:
            loop.call_at(time, bus.send, frame)
        for time in looks:
            loop.call_at(time, lambda: received.extend(bus.receive()))
        await asyncio.sleep(0.1)
        return received + bus.receive()

    return run(main(), simulated=True)


times = st.floats(0.0, 0.02)
host_frames = st.builds(Frame, id=st.integers(1, 0xFF), data=st.binary(max_size=8))
# (a loop does not keep the order of timers that are due at the same time)
sendings = st.lists(st.tuples(times, host_frames), max_size=12, unique_by=lambda sending: sending[0])
node_delays = st.lists(st.floats(0.0, 1e-3), min_size=1, max_size=4)


@given(delays=node_delays, sent=sendings, looks=st.lists(times, max_size=12))
def test_what_happens_does_not_depend_on_when_the_host_looks(
    delays: list[float], sent: list[tuple[float, Frame]], looks: list[float]
) -> None:
    seldom, often = traffic(delays, sent, []), traffic(delays, sent, looks)
    assert [replace(frame, time=0.0) for frame in often] == [replace(frame, time=0.0) for frame in seldom]
    assert [frame.time for frame in often] == pytest.approx([frame.time for frame in seldom], abs=1e-8)


@given(delays=node_delays, sent=sendings)
def test_every_frame_arrives_once_and_no_two_share_the_wire(
    delays: list[float], sent: list[tuple[float, Frame]]
) -> None:
    received = traffic(delays, sent, [])
    answers = [frame for frame in received if frame.id < 0x700]
    assert len(answers) == len(sent) * len(delays)
    for before, after in pairwise(received):
        assert after.time - before.time >= frame_bits(after) * 1e-6 - 1e-12
