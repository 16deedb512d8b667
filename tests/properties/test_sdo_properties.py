"""The SDO client on a line that loses, doubles and delays: it may fail, but never gives a wrong answer.

Every request is stamped with the number of its transfer; the node answers with that number. So an answer that reaches
another transfer is seen at once.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field

from hypothesis import example, given
from hypothesis import strategies as st
from sdo_server_side import decode_request, encode_answer

from artemis.clock import run, until
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import (
    Abort,
    Accepted,
    Answer,
    Expedited,
    NextSegment,
    Request,
    SdoAbort,
    Segment,
    SegmentAccepted,
    Segmented,
    Upload,
)
from artemis.devices.sdo import COPY_TIME, SdoClient
from artemis.errors import DeviceTimeout, ProtocolError

EXPEDITED, SEGMENTED, REFUSED = 0x2001, 0x2002, 0x2003


def content(stamp: int, size: int) -> bytes:
    return (stamp.to_bytes(2, "little") * size)[:size]


class Server:
    """A node's SDO server: knows nothing of losses. `stamp` is the number of the transfer that sent the request."""

    def __init__(self) -> None:
        self.reading: bytes | None = None
        self.writing: bytes | None = None
        self.written: list[bytes] = []

    def answer(self, request: Request, stamp: int) -> Answer | None:
        match request:
            case Upload(index=index, subindex=subindex):
                self.reading = self.writing = None
                if index == EXPEDITED:
                    return Expedited(index=index, subindex=subindex, data=content(stamp, 4))
                if index == SEGMENTED:
                    self.reading = content(stamp, 20)
                    return Segmented(index=index, subindex=subindex, size=20)
                return Abort(index=index, subindex=subindex, code=stamp)
            case Expedited(index=index, subindex=subindex, data=data):
                self.reading = self.writing = None
                if index == REFUSED:
                    return Abort(index=index, subindex=subindex, code=stamp)
                self.written.append(data)
                return Accepted(index=index, subindex=subindex)
            case Segmented(index=index, subindex=subindex):
                self.reading, self.writing = None, b""
                return Accepted(index=index, subindex=subindex)
            case NextSegment(toggle=toggle) if self.reading is not None:
                part, self.reading = self.reading[:7], self.reading[7:]
                return Segment(toggle=toggle, data=part, last=not self.reading)
            case Segment(toggle=toggle, data=data, last=last) if self.writing is not None:
                self.writing += data
                if last:
                    self.written.append(self.writing)
                    self.writing = None
                return SegmentAccepted(toggle=toggle)
            case Abort():
                self.reading = self.writing = None
                return None
        return Abort(index=0, subindex=0, code=0x05040001)


@dataclass
class Fate:
    """What happens to one request and its answer. Delays in s."""

    request_lost: bool = False
    answer_lost: bool = False
    delay: float = 0.0
    copy_after: float | None = None


@dataclass
class Line:
    """Carries requests to the server and answers back; unless it `overtakes`, in order, as CAN does."""

    fates: list[Fate]
    overtakes: bool = False
    server: Server = field(default_factory=Server)
    stamp: int = 0
    free: float = 0.0

    def __post_init__(self) -> None:
        self.client = SdoClient("node", 1, self.send)

    def send(self, frame: Frame) -> None:
        fate = self.fates.pop(0) if self.fates else Fate()
        loop = asyncio.get_running_loop()
        if fate.request_lost:
            return
        answer = self.server.answer(decode_request(frame.data), self.stamp)
        if answer is None or fate.answer_lost:
            return
        arrival = loop.time() + fate.delay
        self.free = arrival if self.overtakes else max(self.free, arrival)
        frame = Frame(0x581, encode_answer(answer))
        loop.call_at(self.free, self.client.receive, frame)
        if fate.copy_after is not None:
            self.free += fate.copy_after
            loop.call_at(self.free, self.client.receive, frame)


fates = st.builds(
    Fate,
    request_lost=st.sampled_from([False, False, False, True]),
    answer_lost=st.sampled_from([False, False, False, True]),
    delay=st.sampled_from([0.0, 0.0, 0.0002, 0.001, 0.049, 0.05, 0.051, 0.07, 0.099, 0.12, 0.2, 0.4]),
    copy_after=st.sampled_from([None, None, 0.0, 0.0003, 0.9 * COPY_TIME]),
)
transfers = st.tuples(
    st.sampled_from(["read", "write"]),
    st.sampled_from([EXPEDITED, SEGMENTED, REFUSED]),
    st.sampled_from([None, None, None, 0.0, 0.0001, 0.03, 0.06, 0.11]),
)


async def transfer(line: Line, verb: str, index: int, patience: float | None) -> None:
    """One transfer, perhaps cancelled after `patience`; whatever it claims must be true."""
    stamp, size = line.stamp, 4 if index == EXPEDITED else 20
    refusal: tuple[int, int] | None
    try:
        async with asyncio.timeout(patience):
            if verb == "read":
                data = await line.client.read(index, 0)
                assert index != REFUSED
                assert data == content(stamp, size)
            else:
                mine = content(stamp, 4 if index == REFUSED else size)
                before = len(line.server.written)
                await line.client.write(index, 0, mine)
                assert index != REFUSED
                assert mine in line.server.written[before:]
    except SdoAbort as error:
        refusal = (error.index, error.code)
    except DeviceTimeout:
        return
    except TimeoutError:
        refusal = None
    else:
        return
    assert refusal == (REFUSED, stamp) if refusal else patience is not None


def transfer_all(line: Line, plan: list[tuple[str, int, float | None]]) -> None:
    async def main() -> None:
        for stamp, (verb, index, patience) in enumerate(plan, start=1):
            line.stamp = stamp
            await transfer(line, verb, index, patience)
        line.fates.clear()
        await until(line.free + 1.0)
        line.stamp = 1000
        assert await line.client.read(EXPEDITED, 0) == content(1000, 4)  # a good line again: the client recovered

    run(main(), simulated=True)


@given(st.lists(fates, max_size=40), st.lists(transfers, min_size=1, max_size=12))
@example(  # two fences under way at once: the answer to the first says nothing about requests after it
    [Fate(request_lost=True), Fate(), Fate(delay=0.06), Fate(delay=0.07), Fate(delay=0.12)],
    [("read", EXPEDITED, None), ("read", EXPEDITED, None)],
)
def test_no_transfer_takes_an_answer_that_is_not_its_own(
    line_fates: list[Fate], plan: list[tuple[str, int, float | None]]
) -> None:
    transfer_all(Line(list(line_fates)), plan)


@given(
    st.lists(st.builds(Fate, delay=st.floats(0.0, 0.099), answer_lost=st.booleans()), max_size=30),
    st.lists(transfers, min_size=1, max_size=8),
)
@example(  # the first answer overtaken by those to abort, fence and second try, and due while the next transfer waits
    [Fate(delay=0.09), Fate(), Fate(), Fate(), Fate(delay=0.045)],
    [("read", EXPEDITED, None), ("read", EXPEDITED, None)],
)
@example(  # given up at once: what was asked last may be answered for as long as if it had been waited for
    [Fate(delay=0.0625), Fate(), Fate(), Fate(delay=0.0625)],
    [("read", EXPEDITED, 0.0), ("read", EXPEDITED, None)],
)
@example(  # cancelled while it waits for the end of the quiet time, after a fence that was refused
    [Fate(delay=0.0625), Fate(), Fate(), Fate(answer_lost=True)],
    [("read", REFUSED, 0.06), ("read", REFUSED, None)],
)
def test_nor_when_answers_overtake_each_other_within_two_timeouts(
    line_fates: list[Fate], plan: list[tuple[str, int, float | None]]
) -> None:
    transfer_all(Line(list(line_fates), overtakes=True), plan)


@given(st.lists(st.tuples(st.floats(0.0, 0.08), st.binary(max_size=9)), max_size=20))
def test_any_bytes_from_the_line_end_in_a_device_error_or_an_answer(noise: list[tuple[float, bytes]]) -> None:
    async def main() -> None:
        client = SdoClient("node", 1, lambda _: None)
        for delay, data in noise:
            asyncio.get_running_loop().call_later(delay, client.receive, Frame(0x581, data))
        with suppress(DeviceTimeout, ProtocolError):
            await client.read(EXPEDITED, 0)

    run(main(), simulated=True)
