"""The SDO client: reads and writes objects of one node, awaitable (CiA 301 7.2.4; expedited and segmented).

SDO has no sequence numbers, so the client must never take an answer for one that it is not. Four rules see to that:

- An answer counts only if it fits the pending request (kind, object or toggle bit); all others are dropped and counted.
- After a timeout, a cancelled or a broken transfer, answers may still be under way. The client sends an abort and a
  *fence*: a read of a sub-index of 0x1000 that changes every time. A node answers in order (with data or an abort,
  either tells which sub-index it is for), so once the fence is answered, nothing older can come.
- And in case something on the way changed the order, the quiet time after an abort lasts at least one timeout.
- CAN may deliver a frame twice when its last bit is disturbed (ISO 11898-1): the sender repeats it at once. A copy of
  the last answer is dropped; a request whose answer could be mistaken for that copy waits `COPY_TIME` first.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import TypeVar

from artemis.clock import until
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import (
    GENERAL_ERROR,
    LENGTH_MISMATCH,
    SDO_REQUEST,
    SDO_TIMEOUT,
    TOGGLE_NOT_ALTERNATED,
    UNKNOWN_COMMAND,
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
    decode_answer,
    encode_request,
)
from artemis.errors import DeviceLost, DeviceTimeout, ProtocolError

COPY_TIME = 0.002
"""The copy of a disturbed frame is on the bus within this time [s]: a burst of 14 longest frames at 1 Mbit/s."""

MAX_SIZE = 4096
"""Longer objects are not read [bytes]: the longest of a drive are names, and a broken node may send without end. The
transfer is aborted as one whose length does not match (CiA 301 table 22)."""

_FENCE_INDEX = 0x1000
"""Device type, the object that every node has. It has no sub-index but 0, so a fence is answered by an abort."""

_UPLOADED: tuple[type[Expedited | Segmented], ...] = (Expedited, Segmented)
_ACCEPTED = (Accepted,)
_SEGMENT = (Segment,)
_SEGMENT_ACCEPTED = (SegmentAccepted,)

Result = TypeVar("Result")
Wanted = TypeVar("Wanted", bound=Answer)


class SdoClient:
    """Transfers objects from and to one node, one at a time; clients of several nodes work side by side.

    A request that gets no answer is sent again, so a write may reach the node twice. Times are the running loop's.
    """

    def __init__(
        self, name: str, node_id: int, send: Callable[[Frame], None], timeout: float = 0.05, tries: int = 3
    ) -> None:
        """`timeout` [s] is what a node has for each answer, `tries` how often a transfer is begun until it gets one."""
        self.name = name
        self.late_answers = 0
        """Answers that fitted no pending request and were dropped: late, doubled, or meant for another client."""
        self._send = send
        self._request_id = SDO_REQUEST + node_id
        self._timeout = self._patience = timeout
        self._tries = tries
        self._one_at_a_time = asyncio.Lock()
        self._pending: asyncio.Future[Answer] | None = None
        self._wanted: tuple[type, ...] = ()
        self._object = (0, 0)
        self._last: Answer | None = None
        self._last_time = 0.0
        self._in_step = True  # no answer to an earlier request can be under way
        self._fence = 0
        self._asked = self._quiet_until = 0.0

    async def read(self, index: int, subindex: int, size: int = 0) -> bytes:
        """The object's bytes as the node sent them; `size` of them, where it does not tell how many of four count.

        Raises:
            SdoAbort: the node refused, broke the protocol of segments, or has more than `MAX_SIZE`.
            DeviceTimeout: no answer in all tries.
            ProtocolError: an answer that is no SDO frame.
            DeviceLost: the request could not be sent.
        """
        return await self._transfer("read", index, subindex, lambda: self._read(index, subindex, size))

    async def write(self, index: int, subindex: int, data: bytes, patience: float | None = None) -> None:
        """Write the object's bytes; returns when the node has confirmed them. Raises as `read` does.

        `patience` [s] is for what takes a node long, and is not to be asked for twice: one try, with so much time.
        """
        await self._transfer("write", index, subindex, lambda: self._write(index, subindex, data), patience)

    def receive(self, frame: Frame) -> None:
        """Take in a frame on the node's answer identifier, 0x580 + node id."""
        if frame.rtr:
            return
        pending = self._pending
        if pending is None or pending.done():
            self.late_answers += 1
            return
        try:
            answer = decode_answer(frame.data)
        except ProtocolError as error:
            pending.set_exception(ProtocolError(error.problem, device=self.name))
            return
        if not self._fits(answer) or (isinstance(answer, Segment | SegmentAccepted) and answer == self._last):
            self.late_answers += 1
            return
        self._last = answer
        self._last_time = pending.get_loop().time()
        pending.set_result(answer)

    def _fits(self, answer: Answer) -> bool:
        """Whether `answer` can belong to the pending request. Segments do not tell their object."""
        if not isinstance(answer, (Abort, *self._wanted)):
            return False
        return isinstance(answer, Segment | SegmentAccepted) or (answer.index, answer.subindex) == self._object

    async def _transfer(
        self,
        verb: str,
        index: int,
        subindex: int,
        once: Callable[[], Awaitable[Result]],
        patience: float | None = None,
    ) -> Result:
        tries, timeout = (self._tries, self._timeout) if patience is None else (1, patience)
        async with self._one_at_a_time:
            for _ in range(tries):
                self._patience = self._timeout
                if not self._in_step and not await self._fall_in_step():
                    continue
                self._in_step, self._patience = False, timeout
                try:
                    result = await once()
                except TimeoutError:
                    self._give_up(index, subindex, SDO_TIMEOUT)
                except SdoAbort:
                    raise
                except ProtocolError:
                    self._give_up(index, subindex, UNKNOWN_COMMAND)
                    raise
                except (asyncio.CancelledError, DeviceLost):
                    self._give_up(index, subindex, GENERAL_ERROR)
                    raise
                else:
                    self._in_step = True
                    return result
        problem = (
            f"no answer to a {verb} of 0x{index:04X}:{subindex} after {tries} {'try' if tries == 1 else 'tries'} of"
        )
        advice = "is the node powered and the bit rate right?"
        raise DeviceTimeout(self.name, f"{problem} {timeout * 1000:g} ms; {advice}")

    def _give_up(self, index: int, subindex: int, code: int) -> None:
        """Tell the node that this transfer is over, and remember that answers to it may still come."""
        self._quiet_until = max(asyncio.get_running_loop().time(), self._asked + self._patience) + self._patience
        with suppress(DeviceLost):  # whoever sends next will be told
            self._send(Frame(self._request_id, encode_request(Abort(index=index, subindex=subindex, code=code))))

    async def _fall_in_step(self) -> bool:
        """Whether a new fence was answered; when it was, waits for the end of the quiet time."""
        self._fence = self._fence % 255 + 1
        try:
            await self._begin(Upload(index=_FENCE_INDEX, subindex=self._fence), _UPLOADED)
        except SdoAbort:
            self._in_step = False  # as good an answer as any; cancelled in the quiet time, it would be forgotten else
        except TimeoutError:
            return False
        await until(self._quiet_until)
        self._in_step = True
        return True

    async def _read(self, index: int, subindex: int, size: int) -> bytes:
        answer = await self._begin(Upload(index=index, subindex=subindex), _UPLOADED)
        if isinstance(answer, Expedited):
            return answer.data if answer.sized or not size else answer.data[:size]
        data, toggle = b"", False
        shortest, longest = (0, MAX_SIZE) if answer.size is None else (answer.size, answer.size)
        if longest > MAX_SIZE:
            raise self._broken(LENGTH_MISMATCH)
        while True:
            segment = await self._exchange(NextSegment(toggle=toggle), _SEGMENT)
            data += segment.data
            if segment.toggle != toggle:
                raise self._broken(TOGGLE_NOT_ALTERNATED)
            too_short = len(data) < shortest if segment.last else not segment.data
            if too_short or len(data) > longest:
                raise self._broken(LENGTH_MISMATCH)
            if segment.last:
                return data
            toggle = not toggle

    async def _write(self, index: int, subindex: int, data: bytes) -> None:
        if 1 <= len(data) <= 4:
            await self._begin(Expedited(index=index, subindex=subindex, data=data), _ACCEPTED)
            return
        await self._begin(Segmented(index=index, subindex=subindex, size=len(data)), _ACCEPTED)
        toggle = False
        for start in range(0, max(len(data), 1), 7):
            segment = Segment(toggle=toggle, data=data[start : start + 7], last=start + 7 >= len(data))
            accepted = await self._exchange(segment, _SEGMENT_ACCEPTED)
            if accepted.toggle != toggle:
                raise self._broken(TOGGLE_NOT_ALTERNATED)
            toggle = not toggle

    def _broken(self, code: int) -> SdoAbort:
        self._give_up(*self._object, code)
        return SdoAbort(*self._object, code, device=self.name)

    async def _begin(self, request: Upload | Expedited | Segmented, wanted: tuple[type[Wanted], ...]) -> Wanted:
        """Exchange the first frames of a transfer, but not before a copy of the last answer could be mistaken."""
        self._object = (request.index, request.subindex)
        self._wanted = wanted
        if self._last is not None and self._fits(self._last):
            await until(self._last_time + COPY_TIME)
        return await self._exchange(request, wanted)

    async def _exchange(self, request: Request, wanted: tuple[type[Wanted], ...]) -> Wanted:
        """Send a request and wait for its answer; TimeoutError when there is none in time."""
        loop = asyncio.get_running_loop()
        self._wanted, self._asked = wanted, loop.time()
        pending: asyncio.Future[Answer] = loop.create_future()
        self._pending = pending
        timer = loop.call_later(self._patience, _expire, pending)
        try:
            self._send(Frame(self._request_id, encode_request(request)))
            answer = await pending
        finally:
            timer.cancel()
            self._pending = None
        if isinstance(answer, Abort):
            self._in_step = True
            raise SdoAbort(answer.index, answer.subindex, answer.code, device=self.name)
        return answer  # type: ignore[return-value]  # receive() lets nothing else through


def _expire(pending: asyncio.Future[Answer]) -> None:
    if not pending.done():
        pending.set_exception(TimeoutError())
