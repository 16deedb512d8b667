"""What a simulated drive does with the commands of its serial line: to itself, or as a gateway on its CAN bus."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from artemis.devices.can_bus import Frame
from artemis.devices.serial_frames import OPCODES, SerialProtocol, SerialService, place_of_object
from artemis.drive_states import Nmt
from artemis.sim.bus import SimBus
from artemis.sim.epos import SimEpos

NMT_ID, SDO_ANSWER, SDO_REQUEST = 0x000, 0x580, 0x600
SDO_TIME_OUT, WRONG_LENGTH = 0x05040000, 0x06070010
ABORT = 0x80
MEANINGLESS = b"\x5a\xc3\x5a\xc3"
"""Fills the four bytes of an answer behind a shorter object: what a drive sends there means nothing (6.3.1)."""


class Gateway:
    """The drive on the line, and through it the nodes on its bus: one command at a time, one SDO transfer for each."""

    def __init__(self, node: SimEpos, bus: SimBus, protocol: SerialProtocol, node_time: float) -> None:
        """`bus`: its host is the controller of `node` (`speaker`). A node has `node_time` [s] to answer."""
        self._node, self._bus, self._node_time = node, bus, node_time
        self._loop = asyncio.get_running_loop()
        self._protocol = protocol
        self._services = {opcode: service for service, opcode in OPCODES[protocol].items()}
        self._asked = 0
        self._pending: asyncio.Future[bytes] | None = None
        bus.listen(self._hear)

    @property
    def awake(self) -> bool:
        """Whether the drive has power and has started."""
        return self._node.nmt not in (None, Nmt.INITIALISING)

    def knows(self, opcode: int) -> bool:
        """Whether there is such a command. Those for segments, LSS and remote frames are not simulated."""
        return opcode in self._services

    async def perform(self, opcode: int, data: bytes) -> bytes | None:
        """Data of the answer to a known command; None: it has none."""
        match self._services[opcode]:
            case SerialService.NMT:
                self._command(data[0], data[2])
                return None if self._protocol is SerialProtocol.EPOS1 else bytes(4)
            case SerialService.SEND_CAN:
                length = min(8, int.from_bytes(data[2:4], "little"))
                self._bus.send(Frame(int.from_bytes(data[:2], "little") & 0x7FF, data[4 : 4 + length]))
                return None
            case SerialService.READ:
                code, content = await self._transfer(b"\x40", data[:4])
                return code.to_bytes(4, "little") + content + MEANINGLESS[len(content) :]
            case SerialService.WRITE:  # how long the object is, nobody told
                code, _ = await self._transfer(b"\x22", data[:4], data[4:8])
                return code.to_bytes(4, "little")

    def _command(self, node_id: int, command: int) -> None:
        frame = Frame(NMT_ID, bytes((command, node_id)))
        if node_id != self._node.node_id:
            self._bus.send(frame)
        if node_id in (0, self._node.node_id):
            self._bus.settle()
            self._node.receive(frame, self._loop.time())
            self._bus.settle()

    async def _transfer(self, command: bytes, place: bytes, data: bytes = bytes(4)) -> tuple[int, bytes]:
        """Abort code, or 0 and what was read."""
        node_id, index, subindex = place_of_object(self._protocol, place)
        request = command + index.to_bytes(2, "little") + bytes((subindex,)) + data
        own = node_id in (0, self._node.node_id)
        answer = await (self._ask_itself(request) if own else self._ask(node_id, request))
        if answer is None:
            return SDO_TIME_OUT, b""
        if answer[0] == ABORT:
            return int.from_bytes(answer[4:8], "little"), b""
        if answer[0] & 0xE0 == 0x40:
            if not answer[0] & 0x02:  # in segments
                return WRONG_LENGTH, b""
            return 0, answer[4 : 8 - (answer[0] >> 2 & 3)]
        return 0, b""

    async def _ask_itself(self, request: bytes) -> bytes | None:
        """Its own objects: what it would answer by CAN, when it would, but not on the bus."""
        node, now = self._node, self._loop.time()
        self._bus.settle()
        node.receive(Frame(SDO_REQUEST + node.node_id, request), now)
        answers = [entry for entry in node.outbox if entry[1].id == SDO_ANSWER + node.node_id]
        for entry in answers:
            node.outbox.remove(entry)
        self._bus.settle()
        if not answers:
            await asyncio.sleep(self._node_time)
            return None
        ready, frame = answers[-1]
        await asyncio.sleep(max(0.0, ready - now))
        return frame.data

    async def _ask(self, node_id: int, request: bytes) -> bytes | None:
        self._asked, self._pending = SDO_ANSWER + node_id, self._loop.create_future()
        self._bus.send(Frame(SDO_REQUEST + node_id, request))
        try:
            with suppress(TimeoutError):
                async with asyncio.timeout(self._node_time):
                    return await self._pending
        finally:
            self._pending = None
        abort = bytes((ABORT,)) + request[1:4] + SDO_TIME_OUT.to_bytes(4, "little")
        self._bus.send(Frame(SDO_REQUEST + node_id, abort))
        return None

    def _hear(self) -> None:
        for frame in self._bus.receive():
            pending = self._pending
            if frame.id == self._asked and len(frame.data) == 8 and pending is not None and not pending.done():
                pending.set_result(frame.data)
