"""A serial line to the first drive, and by that drive's gateway to the others behind it on CAN.

Only objects and NMT commands pass: there is no process data, no heartbeat and no emergency, and the drives cannot watch
a computer on it. So nothing is driven over it; what it carries is the work of `EposJobs`, which knows no other way to a
drive than its objects. One command at a time, for all nodes; one that fails is repeated, after a silence in which the
drive forgets what it was in the middle of.

What goes wrong is counted by its row in the fault table: SER-01 bytes that do not belong there, SER-02 checksum,
SER-03 no answer, SER-04 half an answer, SER-05 port lost.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress

from artemis.clock import until
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import NMT, SDO_TIMEOUT, SdoAbort
from artemis.devices.serial_frames import (
    ANSWER,
    ERROR_SIZE,
    READY,
    REFUSED,
    Epos4Splitter,
    SerialCommand,
    SerialProtocol,
    content_of,
    epos1_body,
    epos1_data,
    epos1_length,
    epos4_frame,
    nmt_command,
    read_command,
    write_command,
)
from artemis.devices.serial_port import SerialPort
from artemis.errors import DeviceError, DeviceLost, DeviceTimeout, ProtocolError

PATIENCE = 0.6
"""The drive has so long for each answer [s]: its own time limit is 0.5 s (object 0x2005, communication guide 6.2.2)."""
SILENCE = 0.55
"""After so long without a byte [s] the drive waits for a new command, whatever it was in the middle of."""
NOISE = 5.0
"""A line that does not fall silent for so long [s] is not a drive's: it is given up."""
TRIES = 3

OUT_OF_STEP, DAMAGED, SILENT, HALF, LOST = "SER-01", "SER-02", "SER-03", "SER-04", "SER-05"

ADVICE = {
    OUT_OF_STEP: "is the baud rate right, and the protocol? does another program use this port?",
    DAMAGED: "cable, shield, ground between computer and drive",
    SILENT: "is the drive powered, the cable crossed, the baud rate right?",
    HALF: "loose plug? did the drive restart?",
    LOST: "is its adapter plugged in?",
}
"""Where to look, as the fault table says it."""


class _Broken(Exception):
    """An exchange failed, and may be repeated."""

    def __init__(self, row: str, problem: str) -> None:
        self.row, self.problem = row, problem
        super().__init__(problem)


class SerialLine:
    """Commands over a serial port, in the order in which they were given; to `Drives` it is a `FrameBus`."""

    def __init__(self, port: SerialPort, protocol: SerialProtocol) -> None:
        self.name = port.name
        self.error_frames = 0
        """As of a `FrameBus`; errors of this line are in `faults`."""
        self.faults: Counter[str] = Counter()
        """What went wrong so far, by row of the fault table; most of it was repeated with success."""
        self.commands = 0
        """Commands that were given so far, repeated ones counted once."""
        self._port, self._protocol = port, protocol
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[SerialCommand, float, int, asyncio.Future[bytes]]] = deque()
        self._worker: asyncio.Task[None] | None = None
        self._arrived = bytearray()
        self._woken = asyncio.Event()
        self._last_byte = self._loop.time()
        self._noisy = False
        """Silence was waited for, and did not come."""
        self._late = False
        """The answer to an earlier try, or to a command that was given up, may come yet."""
        self._lost: DeviceLost | None = None
        port.listen(self._woken.set)

    def objects(self, name: str, node_id: int) -> SerialObjects:
        """The objects of a node on the line, or behind its gateway."""
        return SerialObjects(self, name, node_id, self._protocol)

    async def perform(self, command: SerialCommand, patience: float | None = None) -> bytes:
        """Data of the answer to a command, once those before it are done; empty where there is none.

        `patience` [s] is for what takes the drive long: one try, with so much time.

        Raises:
            DeviceTimeout: no whole answer in all tries.
            ProtocolError: what came was no answer.
            DeviceLost: the port is gone.
        """
        if patience is None:
            return await self._give(command, PATIENCE, TRIES)
        return await self._give(command, max(patience, PATIENCE), 1)

    async def sent(self) -> None:
        """Return once every command that was given is done, or has failed."""
        if self._waiting:
            await asyncio.wait([self._waiting[-1][3]])

    # ------------------------------------------------------------------------------------------ as a FrameBus

    def send(self, frame: Frame) -> None:
        """Queue an NMT command, which is all that passes; as on CAN nobody confirms it.

        Raises:
            ProtocolError: another frame.
            DeviceLost: the port is gone.
        """
        if self._lost is not None:
            raise self._lost
        if frame.id != NMT or frame.rtr or len(frame.data) != 2:
            raise ProtocolError(f"carries objects and NMT commands, not frame 0x{frame.id:03X}", self.name)
        given = self._give(nmt_command(self._protocol, frame.data[1], frame.data[0]), PATIENCE, 1)
        given.add_done_callback(lambda done: done.cancelled() or done.exception())

    def receive(self) -> list[Frame]:
        """Nothing: the drive only answers. Raises DeviceLost: the port is gone."""
        if self._lost is not None:
            raise self._lost
        return []

    def listen(self, wake: Callable[[], None]) -> None:
        """Nothing arrives that nobody asked for."""

    def close(self) -> None:
        """Give the port back; harmless when repeated. What waits is not sent."""
        if self._worker is not None:
            self._worker.cancel()
        self._lose(DeviceLost(self.name, "is closed"))
        self._port.close()

    # ------------------------------------------------------------------------------------------ one after the other

    def _give(self, command: SerialCommand, patience: float, tries: int) -> asyncio.Future[bytes]:
        done: asyncio.Future[bytes] = self._loop.create_future()
        if self._lost is not None:
            done.set_exception(self._lost)
            return done
        self.commands += 1
        self._waiting.append((command, patience, tries, done))
        if self._worker is None:
            self._worker = self._loop.create_task(self._work())
        return done

    async def _work(self) -> None:
        while self._waiting:
            command, patience, tries, done = self._waiting[0]
            try:
                answer = b"" if done.done() else await self._tried(command, patience, tries)
            except DeviceLost as error:
                self._lose(error)
                return
            except DeviceError as error:
                if not done.done():
                    done.set_exception(error)
            else:
                if not done.done():  # who asked may have gone
                    done.set_result(answer)
            self._waiting.popleft()
        self._worker = None

    def _lose(self, error: DeviceLost) -> None:
        if self._lost is None:
            self._lost = error
        for *_, done in self._waiting:
            if not done.done():
                done.set_exception(error)
        self._waiting.clear()
        self._worker = None

    async def _tried(self, command: SerialCommand, patience: float, tries: int) -> bytes:
        once = self._exchange_epos1 if self._protocol is SerialProtocol.EPOS1 else self._exchange_epos4
        broken = _Broken(SILENT, "")
        if self._noisy:
            await self._fall_silent()
        for _ in range(tries):
            try:
                data = await once(command, patience)
                if command.answered and len(data) < ERROR_SIZE:  # a frame of zeros alone has the checksum zero
                    raise _Broken(DAMAGED, "answers without an error code")
                if self._late:
                    await self._nothing_follows()
                return data
            except _Broken as error:
                broken = error
            self.faults[broken.row] += 1
            self._late |= broken.row == SILENT and self._protocol is SerialProtocol.EPOS4
            await self._fall_silent()
        times = f"{tries} tries" if tries > 1 else "one try"
        problem = f"{broken.problem}, {times} ({broken.row}); {ADVICE[broken.row]}"
        if broken.row in (SILENT, HALF):
            raise DeviceTimeout(self.name, problem)
        raise ProtocolError(problem, self.name)

    # ------------------------------------------------------------------------------------------ one exchange

    async def _exchange_epos1(self, command: SerialCommand, patience: float) -> bytes:
        """Operation code, frame and answer, each confirmed by a byte (communication guide 6.2.2)."""
        self._discard()
        self._write(bytes((command.opcode,)))
        if await self._confirmed("its operation code") == REFUSED:
            raise _Broken(OUT_OF_STEP, f"does not take operation code 0x{command.opcode:02X}")
        self._write(epos1_body(command.opcode, command.data))
        if await self._confirmed("a command") == REFUSED:
            raise _Broken(DAMAGED, "received commands with a wrong checksum")
        if not command.answered:
            return b""
        first = await self._bytes(1, patience, "does not answer")
        if first[0] != ANSWER:
            raise _Broken(OUT_OF_STEP, f"begins an answer with 0x{first.hex()}, not 0x{ANSWER:02x}")
        self._write(READY)
        body = await self._bytes(1, PATIENCE, "begins an answer and says no more", HALF)
        body += await self._bytes(epos1_length(body[0]), PATIENCE, "breaks off in an answer", HALF)
        try:
            data = epos1_data(ANSWER, body)
        except ProtocolError as error:
            self._write(REFUSED)
            raise _Broken(DAMAGED, error.problem) from None
        self._write(READY)
        return data

    async def _confirmed(self, what: str) -> bytes:
        byte = await self._bytes(1, PATIENCE, f"does not confirm {what}")
        if byte not in (READY, REFUSED):
            raise _Broken(OUT_OF_STEP, f"confirms {what} with 0x{byte.hex()}")
        return byte

    async def _exchange_epos4(self, command: SerialCommand, patience: float) -> bytes:
        """Request and answer, each one frame (EPOS4 communication guide 2.2)."""
        self._discard()
        splitter, deadline = Epos4Splitter(), self._loop.time() + patience
        self._write(epos4_frame(command.opcode, command.data))
        while True:
            row, problem = (HALF, "breaks off in an answer") if splitter.half else (SILENT, "does not answer")
            byte = await self._bytes(1, deadline - self._loop.time(), problem, row)
            try:
                frame = splitter.feed(byte[0])
            except ProtocolError as error:
                raise _Broken(DAMAGED, error.problem) from None
            if splitter.stray:
                raise _Broken(OUT_OF_STEP, f"sent 0x{byte.hex()} where no frame was")
            if frame is None:
                continue
            if frame[0] != ANSWER:
                raise _Broken(OUT_OF_STEP, f"answers with operation code 0x{frame[0]:02X}")
            return frame[1]

    async def _nothing_follows(self) -> None:
        """Raises _Broken if there is another answer: then the one before may have been a late one.

        An answer of an EPOS4 does not tell what it answers; the first generation confirms each command before.
        """
        try:
            byte = await self._bytes(1, PATIENCE, "")
        except _Broken:
            self._late = False
        else:
            raise _Broken(OUT_OF_STEP, f"goes on with 0x{byte.hex()} after an answer, which was a late one")

    # ------------------------------------------------------------------------------------------ bytes

    def _discard(self) -> None:
        """Throw away what came when nobody waited for anything."""
        self._fill()
        if self._arrived:
            self.faults[OUT_OF_STEP] += 1
            self._arrived.clear()

    async def _fall_silent(self) -> None:
        """Throw bytes away until none has come for so long that the drive waits for a command.

        Raises:
            ProtocolError: there is no end of them.
        """
        self._arrived.clear()
        self._noisy, latest = True, self._loop.time() + NOISE
        while self._loop.time() < self._last_byte + SILENCE:
            if self._loop.time() > latest:
                self.faults[OUT_OF_STEP] += 1
                raise ProtocolError(f"does not fall silent ({OUT_OF_STEP}); {ADVICE[OUT_OF_STEP]}", self.name)
            await until(self._last_byte + SILENCE)
            self._fill()
            self._arrived.clear()
        self._noisy = False

    async def _bytes(self, count: int, patience: float, problem: str, row: str = SILENT) -> bytes:
        """The next so many bytes; some of them at the end of `patience` [s] are half an answer."""
        deadline = self._loop.time() + patience
        while len(self._arrived) < count:
            self._woken.clear()
            self._fill()
            if len(self._arrived) >= count:
                break
            with suppress(TimeoutError):
                async with asyncio.timeout_at(deadline):
                    await self._woken.wait()
                continue
            raise _Broken(HALF if self._arrived else row, problem)
        taken = bytes(self._arrived[:count])
        del self._arrived[:count]
        return taken

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except DeviceLost as error:
            raise self._unplugged(error) from error

    def _unplugged(self, error: DeviceLost) -> DeviceLost:
        self.faults[LOST] += 1
        return DeviceLost(self.name, f"{error.problem} ({LOST}); {ADVICE[LOST]}")

    def _fill(self) -> None:
        try:
            data = self._port.read()
        except DeviceLost as error:
            raise self._unplugged(error) from error
        if data:
            self._arrived += data
            self._last_byte = self._loop.time()


class SerialObjects:
    """Objects of one node over a serial line: there what an `SdoClient` is on a CAN bus. At most four bytes each."""

    def __init__(self, line: SerialLine, name: str, node_id: int, protocol: SerialProtocol) -> None:
        self.name = name
        self.late_answers = 0
        """As of an `ObjectAccess`; the line counts what is wrong on it."""
        self._line, self._node_id, self._protocol = line, node_id, protocol

    async def read(self, index: int, subindex: int, size: int = 0) -> bytes:
        """The object's bytes, `size` of the four that come (0: all). Raises as an `ObjectAccess` does."""
        answer = await self._line.perform(read_command(self._protocol, self._node_id, index, subindex))
        data = self._checked(answer, index, subindex)
        if len(data) < 4 or size > 4:
            raise ProtocolError(f"0x{index:04X}:{subindex}: {len(data)} bytes instead of {max(4, size)}", self.name)
        return data[:size] if size else data

    async def write(self, index: int, subindex: int, data: bytes, patience: float | None = None) -> None:
        """Write the object's bytes; returns when the node has confirmed them. Raises as an `ObjectAccess` does."""
        command = write_command(self._protocol, self._node_id, index, subindex, data)
        self._checked(await self._line.perform(command, patience), index, subindex)

    def receive(self, frame: Frame) -> None:
        """No frame comes over a serial line."""

    def _checked(self, answer: bytes, index: int, subindex: int) -> bytes:
        code, data = content_of(answer)
        if code == SDO_TIMEOUT:
            problem = f"node {self._node_id} does not answer the drive on the serial line, its gateway"
            raise DeviceTimeout(self.name, f"{problem}; is it powered? the CAN cable, node id and bit rate?")
        if code:
            raise SdoAbort(index, subindex, code, device=self.name)
        return data
