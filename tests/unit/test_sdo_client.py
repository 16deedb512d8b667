"""The SDO client against a node whose answers are scripted, on virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from itertools import count

import pytest
from sdo_server_side import decode_request, encode_answer

from artemis.clock import run
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
from artemis.devices.sdo import SdoClient
from artemis.errors import DeviceLost, DeviceTimeout, ProtocolError

Script = Callable[[Request], list[tuple[float, Answer | bytes]]]
STATUSWORD = (0x6041, 0)
READ = Upload(index=0x6041, subindex=0)
FENCE = Upload(index=0x1000, subindex=1)


class Node:
    """Answers each request with what the script gives: pairs of delay [s] and answer. Fences are answered at once."""

    def __init__(self, script: Script, *, tries: int = 3, answers_fences: bool = True) -> None:
        self.requests: list[Request] = []
        self.script = script
        self.answers_fences = answers_fences
        self.client = SdoClient("steer-left", 1, self.take, tries=tries)

    def take(self, frame: Frame) -> None:
        assert frame.id == 0x601
        request = decode_request(frame.data)
        self.requests.append(request)
        if isinstance(request, Abort):
            return
        if isinstance(request, Upload) and request.index == 0x1000:
            refusal = Abort(index=0x1000, subindex=request.subindex, code=0x06090011)
            answers: list[tuple[float, Answer | bytes]] = [(0.0, refusal)] if self.answers_fences else []
        else:
            answers = self.script(request)
        for delay, answer in answers:
            data = answer if isinstance(answer, bytes) else encode_answer(answer)
            asyncio.get_running_loop().call_later(delay, self.client.receive, Frame(0x581, data))


def value(number: int, index: int = 0x6041) -> Expedited:
    return Expedited(index=index, subindex=0, data=bytes((number,)))


def on_virtual_time(main: Coroutine[None, None, None]) -> None:
    run(main, simulated=True)


def now() -> float:
    return asyncio.get_running_loop().time()


def test_small_object_is_read_in_one_exchange() -> None:
    async def main() -> None:
        node = Node(lambda _: [(0.001, Expedited(index=0x6041, subindex=0, data=b"\x40\x01"))])
        assert await node.client.read(*STATUSWORD) == b"\x40\x01"
        assert node.requests == [READ]
        assert now() == pytest.approx(0.001)

    on_virtual_time(main())


@pytest.mark.parametrize(("size", "data"), [(0, b"\x40\x01\x77\x77"), (2, b"\x40\x01"), (4, b"\x40\x01\x77\x77")])
def test_of_an_answer_that_does_not_tell_its_length_the_object_is_taken(size: int, data: bytes) -> None:
    async def main() -> None:
        told = Expedited(index=0x6041, subindex=0, data=b"\x40\x01\x77\x77", sized=False)
        assert await Node(lambda _: [(0.0, told)]).client.read(*STATUSWORD, size) == data
        sized = Expedited(index=0x6041, subindex=0, data=b"\x40\x01\x77\x77")
        assert await Node(lambda _: [(0.0, sized)]).client.read(*STATUSWORD, size) == sized.data, (
            "it is wrong, and told"
        )

    on_virtual_time(main())


def test_large_object_is_read_in_segments() -> None:
    content = b"a string of 20 bytes"
    segments = [content[0:7], content[7:14], content[14:20]]

    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x1009, subindex=0, size=20))]
        assert isinstance(request, NextSegment)
        data = segments.pop(0)
        return [(0.0, Segment(toggle=request.toggle, data=data, last=not segments))]

    async def main() -> None:
        node = Node(script)
        assert await node.client.read(0x1009, 0) == content
        assert node.requests[1:] == [NextSegment(toggle=False), NextSegment(toggle=True), NextSegment(toggle=False)]

    on_virtual_time(main())


def accept(request: Request) -> list[tuple[float, Answer | bytes]]:
    if isinstance(request, Segment):
        return [(0.0, SegmentAccepted(toggle=request.toggle))]
    assert isinstance(request, Expedited | Segmented)
    return [(0.0, Accepted(index=request.index, subindex=request.subindex))]


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_up_to_four_bytes_are_written_in_one_exchange(size: int) -> None:
    async def main() -> None:
        node = Node(accept)
        await node.client.write(0x6040, 0, b"\x0f" * size)
        assert node.requests == [Expedited(index=0x6040, subindex=0, data=b"\x0f" * size)]

    on_virtual_time(main())


@pytest.mark.parametrize(
    ("data", "parts"),
    [
        (b"", [b""]),
        (b"12345", [b"12345"]),
        (b"1234567", [b"1234567"]),
        (b"12345678", [b"1234567", b"8"]),
        (bytes(range(15)), [bytes(range(7)), bytes(range(7, 14)), b"\x0e"]),
    ],
)
def test_other_lengths_are_written_in_segments(data: bytes, parts: list[bytes]) -> None:
    async def main() -> None:
        node = Node(accept)
        await node.client.write(0x2000, 3, data)
        assert node.requests == [
            Segmented(index=0x2000, subindex=3, size=len(data)),
            *(Segment(toggle=bool(n % 2), data=part, last=part is parts[-1]) for n, part in enumerate(parts)),
        ]

    on_virtual_time(main())


def test_refusal_tells_node_object_and_reason() -> None:
    async def main() -> None:
        node = Node(lambda _: [(0.0, Abort(index=0x6040, subindex=0, code=0x08000022))])
        with pytest.raises(SdoAbort, match=r"steer-left: SDO abort 0x08000022 at 0x6040:0: refused in this") as caught:
            await node.client.write(0x6040, 0, b"\x0f\x00")
        assert (caught.value.index, caught.value.subindex, caught.value.code) == (0x6040, 0, 0x08000022)
        assert len(node.requests) == 1  # a refusal is an answer: nothing to retry, nothing to clear up

    on_virtual_time(main())


def test_lost_answer_is_asked_for_again_after_a_fence_and_a_quiet_time() -> None:
    replies: Iterator[list[tuple[float, Answer | bytes]]] = iter([[], [(0.0, value(2))]])

    async def main() -> None:
        node = Node(lambda _: next(replies))
        assert await node.client.read(*STATUSWORD) == b"\x02"
        assert node.requests == [READ, Abort(index=0x6041, subindex=0, code=0x05040000), FENCE, READ]
        assert now() == pytest.approx(0.1)

    on_virtual_time(main())


def test_dead_node_is_reported_after_all_tries() -> None:
    async def main() -> None:
        node = Node(lambda _: [], answers_fences=False)
        with pytest.raises(DeviceTimeout) as caught:
            await node.client.read(*STATUSWORD)
        assert str(caught.value) == (
            "steer-left: no answer to a read of 0x6041:0 after 3 tries of 50 ms; "
            "is the node powered and the bit rate right?"
        )
        assert now() == pytest.approx(0.15)

    on_virtual_time(main())


def test_late_answer_is_dropped_and_counted() -> None:
    replies: Iterator[list[tuple[float, Answer | bytes]]] = iter([[(0.07, value(1))], [(0.0, value(2))]])

    async def main() -> None:
        node = Node(lambda _: next(replies))
        assert await node.client.read(*STATUSWORD) == b"\x02"
        assert node.client.late_answers == 1

    on_virtual_time(main())


def test_late_answer_is_not_taken_by_the_next_transfer_of_the_same_object() -> None:
    replies: Iterator[list[tuple[float, Answer | bytes]]] = iter([[(0.08, value(1))], [(0.01, value(2))]])

    async def main() -> None:
        node = Node(lambda _: next(replies), tries=1)
        with pytest.raises(DeviceTimeout):
            await node.client.read(*STATUSWORD)
        assert await node.client.read(*STATUSWORD) == b"\x02"
        assert node.client.late_answers == 1

    on_virtual_time(main())


def test_node_slower_than_the_timeout_is_never_misread() -> None:
    """It answers everything in order, but each answer takes 120 ms: no quiet time would be long enough."""
    numbers = count()

    class SlowNode(Node):
        free = 0.0

        def take(self, frame: Frame) -> None:
            request = decode_request(frame.data)
            if not isinstance(request, Upload):
                return
            self.free = max(self.free, now()) + 0.12
            answer = Expedited(index=request.index, subindex=request.subindex, data=bytes((next(numbers),)))
            asyncio.get_running_loop().call_at(self.free, self.client.receive, Frame(0x581, encode_answer(answer)))

    async def main() -> None:
        node = SlowNode(lambda _: [])
        for _ in range(5):
            with pytest.raises(DeviceTimeout):
                await node.client.read(*STATUSWORD)
        assert node.client.late_answers > 0

    on_virtual_time(main())


SAVE = Expedited(index=0x1010, subindex=1, data=b"save")


def test_what_takes_a_node_long_is_asked_for_once() -> None:
    async def main() -> None:
        node = Node(lambda _: [(1.9, Accepted(index=0x1010, subindex=1))])
        await node.client.write(0x1010, 1, b"save", patience=2.0)
        assert node.requests == [SAVE]
        assert now() == pytest.approx(1.9)

    on_virtual_time(main())


def test_what_takes_a_node_too_long_is_not_asked_for_again_and_its_late_answer_is_nobodys() -> None:
    def answers(request: Request) -> list[tuple[float, Answer | bytes]]:
        return [(2.1, Accepted(index=0x1010, subindex=1))] if request == SAVE else [(0.0, value(7))]

    async def main() -> None:
        node = Node(answers)
        with pytest.raises(DeviceTimeout, match="after 1 try of 2000 ms"):
            await node.client.write(0x1010, 1, b"save", patience=2.0)
        assert node.requests.count(SAVE) == 1
        assert await node.client.read(*STATUSWORD) == b"\x07"
        assert now() == pytest.approx(4.0), "quiet for as long as it had"
        assert node.client.late_answers == 1

    on_virtual_time(main())


def test_answer_for_another_object_is_dropped_and_counted() -> None:
    async def main() -> None:
        node = Node(
            lambda _: [(0.0, value(1, index=0x6064)), (0.0, Accepted(index=0x6041, subindex=0)), (0.01, value(2))]
        )
        assert await node.client.read(*STATUSWORD) == b"\x02"
        assert node.client.late_answers == 2

    on_virtual_time(main())


def test_unasked_answer_is_counted_and_a_remote_frame_ignored() -> None:
    async def main() -> None:
        node = Node(lambda _: [])
        node.client.receive(Frame(0x581, encode_answer(value(1))))
        node.client.receive(Frame(0x581, b"", rtr=True))
        assert node.client.late_answers == 1

    on_virtual_time(main())


def test_frame_delivered_twice_is_not_the_answer_to_the_next_request() -> None:
    numbers = count()

    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        answer = value(next(numbers))
        return [(0.0002, answer), (0.0010, answer)]

    async def main() -> None:
        node = Node(script)
        assert [(await node.client.read(*STATUSWORD))[0] for _ in range(5)] == [0, 1, 2, 3, 4]

    on_virtual_time(main())


def test_different_objects_are_read_without_pause() -> None:
    async def main() -> None:
        node = Node(
            lambda r: [(0.0, Expedited(index=r.index, subindex=0, data=b"\0"))] if isinstance(r, Upload) else []
        )
        for index in (0x6041, 0x6064, 0x6041, 0x6064):
            await node.client.read(index, 0)
        assert now() == 0.0

    on_virtual_time(main())


def test_segment_delivered_twice_is_dropped() -> None:
    parts = [b"1234567", b"89"]

    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x2004, subindex=0, size=9))] * 2
        assert isinstance(request, NextSegment)
        segment = Segment(toggle=request.toggle, data=parts[request.toggle], last=request.toggle)
        return [(0.0010, segment)] if request.toggle else [(0.0001, segment), (0.0002, segment)]

    async def main() -> None:
        node = Node(script)
        assert await node.client.read(0x2004, 0) == b"123456789"
        assert node.client.late_answers == 2

    on_virtual_time(main())


def test_toggle_bit_that_does_not_alternate_ends_a_read() -> None:
    parts = iter([b"1234567", b"89"])

    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x2004, subindex=0, size=9))]
        return [(0.0, Segment(toggle=False, data=next(parts), last=False))]

    async def main() -> None:
        node = Node(script)
        with pytest.raises(SdoAbort, match="0x05030000 at 0x2004:0: toggle bit"):
            await node.client.read(0x2004, 0)
        assert node.requests[-1] == Abort(index=0x2004, subindex=0, code=0x05030000)

    on_virtual_time(main())


def test_toggle_bit_that_does_not_alternate_ends_a_write() -> None:
    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        return [(0.0, SegmentAccepted(toggle=True))] if isinstance(request, Segment) else accept(request)

    async def main() -> None:
        node = Node(script)
        with pytest.raises(SdoAbort, match="0x05030000"):
            await node.client.write(0x2004, 0, bytes(8))
        assert node.requests[-1] == Abort(index=0x2004, subindex=0, code=0x05030000)

    on_virtual_time(main())


@pytest.mark.parametrize(("size", "data", "last"), [(6, b"12345", True), (4, b"12345", False), (4, b"12345", True)])
def test_length_that_was_not_announced_ends_a_read(size: int, data: bytes, last: bool) -> None:
    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x2004, subindex=0, size=size))]
        return [(0.0, Segment(toggle=False, data=data, last=last))]

    async def main() -> None:
        node = Node(script)
        with pytest.raises(SdoAbort, match="0x06070010"):
            await node.client.read(0x2004, 0)
        assert node.requests[-1] == Abort(index=0x2004, subindex=0, code=0x06070010)

    on_virtual_time(main())


@pytest.mark.parametrize(
    ("size", "data", "segments"),
    [(None, b"1234567", 586), (None, b"1", 4097), (None, b"", 1), (20, b"", 1), (4097, b"1234567", 0)],
)
def test_a_read_without_end_is_given_up(size: int | None, data: bytes, segments: int) -> None:
    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.003, Segmented(index=0x1008, subindex=0, size=size))]
        assert isinstance(request, NextSegment)
        return [(0.003, Segment(toggle=request.toggle, data=data, last=False))]

    async def main() -> None:
        node = Node(script)
        async with asyncio.timeout(60.0):
            with pytest.raises(SdoAbort, match=r"steer-left: SDO abort 0x06070010 at 0x1008:0: .*length"):
                await node.client.read(0x1008, 0)
        assert node.requests[-1] == Abort(index=0x1008, subindex=0, code=0x06070010)
        assert len(node.requests) == 1 + segments + 1

    on_virtual_time(main())


@pytest.mark.parametrize("announced", [True, False])
def test_the_longest_object_is_read(announced: bool) -> None:
    content = bytes(range(256)) * 16
    parts = iter([content[start : start + 7] for start in range(0, 4096, 7)])

    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x1008, subindex=0, size=4096 if announced else None))]
        assert isinstance(request, NextSegment)
        part = next(parts)
        return [(0.0, Segment(toggle=request.toggle, data=part, last=len(part) < 7))]

    async def main() -> None:
        assert await Node(script).client.read(0x1008, 0) == content

    on_virtual_time(main())


def test_length_need_not_be_announced() -> None:
    def script(request: Request) -> list[tuple[float, Answer | bytes]]:
        if isinstance(request, Upload):
            return [(0.0, Segmented(index=0x2004, subindex=0, size=None))]
        return [(0.0, Segment(toggle=False, data=b"12345", last=True))]

    async def main() -> None:
        assert await Node(script).client.read(0x2004, 0) == b"12345"

    on_virtual_time(main())


@pytest.mark.parametrize("data", [b"", b"\x4b\x41\x60\x00\x40\x01\x00", b"\xe0\x41\x60\x00\x40\x01\x00\x00"])
def test_malformed_answer_is_an_error_and_the_next_transfer_works(data: bytes) -> None:
    replies: Iterator[list[tuple[float, Answer | bytes]]] = iter([[(0.0, data)], [(0.0, value(2))]])

    async def main() -> None:
        node = Node(lambda _: next(replies))
        with pytest.raises(ProtocolError, match="steer-left"):
            await node.client.read(*STATUSWORD)
        assert node.requests[-1] == Abort(index=0x6041, subindex=0, code=0x05040001)
        assert await node.client.read(*STATUSWORD) == b"\x02"

    on_virtual_time(main())


def test_cancelled_transfer_leaves_the_client_usable() -> None:
    replies: Iterator[list[tuple[float, Answer | bytes]]] = iter([[(0.03, value(1))], [(0.0, value(2))]])

    async def main() -> None:
        node = Node(lambda _: next(replies))
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await node.client.read(*STATUSWORD)
        assert node.requests == [READ, Abort(index=0x6041, subindex=0, code=0x08000000)]
        assert await node.client.read(*STATUSWORD) == b"\x02"
        assert node.client.late_answers == 1

    on_virtual_time(main())


def test_cancelled_while_waiting_for_its_turn_sends_nothing() -> None:
    async def main() -> None:
        node = Node(lambda _: [(0.02, value(1))])
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(node.client.read(*STATUSWORD))
            second = tasks.create_task(node.client.read(0x6064, 0))
            await asyncio.sleep(0.01)
            second.cancel()
        assert node.requests == [READ]

    on_virtual_time(main())


def test_one_transfer_at_a_time_on_a_node() -> None:
    async def main() -> None:
        node = Node(lambda r: [(0.01, value(r.index & 0xFF, r.index))] if isinstance(r, Upload) else [])
        answers = await asyncio.gather(*(node.client.read(index, 0) for index in (0x6041, 0x6061, 0x6064)))
        assert answers == [b"\x41", b"\x61", b"\x64"]
        assert now() == pytest.approx(0.03)

    on_virtual_time(main())


def test_nodes_answer_side_by_side() -> None:
    async def main() -> None:
        nodes = [Node(lambda _: [(0.01, value(7))]) for _ in range(4)]
        assert await asyncio.gather(*(node.client.read(*STATUSWORD) for node in nodes)) == [b"\x07"] * 4
        assert now() == pytest.approx(0.01)

    on_virtual_time(main())


def test_adapter_that_refuses_a_frame_ends_the_transfer_and_may_come_back() -> None:
    class Unplugged(Node):
        plugged = False

        def take(self, frame: Frame) -> None:
            if not self.plugged:
                raise DeviceLost("CAN", "unplugged")
            super().take(frame)

    async def main() -> None:
        node = Unplugged(lambda _: [(0.0, value(1))])
        with pytest.raises(DeviceLost, match="unplugged"):
            await node.client.read(*STATUSWORD)
        node.plugged = True
        assert await node.client.read(*STATUSWORD) == b"\x01"

    on_virtual_time(main())


def test_works_in_real_time_too() -> None:
    async def main() -> None:
        node = Node(lambda _: [(0.0, value(1))])
        assert await node.client.read(*STATUSWORD) == b"\x01"

    run(main(), simulated=False)
