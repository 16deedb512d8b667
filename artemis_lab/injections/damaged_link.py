"""A network between an operator and his robot that damages what passes: frames by chance, or the connection itself.

`DamagedLine` is pure, one direction with times given; `DamagingProxy` puts two of them into a real TCP connection.
"""

from __future__ import annotations

import asyncio
import random
from collections import deque
from contextlib import suppress
from dataclasses import dataclass

from artemis.bridges.operator.frames import MOST_FROM_ROBOT, Splitter, framed

HANDSHAKE = 2
"""So many frames of each direction pass whole: without them there is no session to damage."""


@dataclass(slots=True, kw_only=True)
class LinkDamage:
    """What is done to the frames of one direction; may be changed while they pass."""

    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Each frame takes up to so much longer; none overtakes another."""
    loss: float = 0.0
    """Share of the frames that disappear."""
    duplicate: float = 0.0
    """Share that comes twice."""
    reorder: float = 0.0
    """Share that changes places with the next."""
    forge: float = 0.0
    """Share of which one bit is another."""
    replay: int = 0
    """So many of the frames that passed are sent once more, now; counts down."""
    rubbish: bytes = b""
    """Is put between two frames, once."""
    cut: bool = False
    """Nothing passes, and nobody is told: a half-open connection."""
    stall: bool = False
    """Everything waits, and passes at once when this ends."""


class DamagedLine:
    """One direction of a link."""

    def __init__(self, damage: LinkDamage, seed: int) -> None:
        """Nothing has passed yet."""
        self.damage, self._random = damage, random.Random(seed)
        self._splitter = Splitter(MOST_FROM_ROBOT)
        self._passed: deque[bytes] = deque(maxlen=50)
        self._held: bytes | None = None
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._count, self._latest = 0, 0.0

    def feed(self, data: bytes, now: float) -> None:
        """Take what is sent at `now` [s]."""
        for body in self._splitter.feed(data):
            self._count += 1
            frame = framed(body)
            if self._count <= HANDSHAKE:
                self._send(frame, now)
            elif not self.damage.cut:
                self._damage(frame, now)

    def take(self, now: float) -> bytes:
        """What has arrived by `now` [s]."""
        damage, arrived = self.damage, bytearray()
        if damage.stall:
            return b""
        while self._waiting and self._waiting[0][0] <= now:
            arrived += self._waiting.popleft()[1]
        if damage.replay and self._passed and not damage.cut:
            arrived += b"".join(list(self._passed)[-damage.replay :])
            damage.replay = 0
        if damage.rubbish:
            arrived += damage.rubbish
            damage.rubbish = b""
        return bytes(arrived)

    def _damage(self, frame: bytes, now: float) -> None:
        damage, drawn = self.damage, self._random.random
        if drawn() < damage.loss:
            return
        if drawn() < damage.forge:
            place = self._random.randrange(2, len(frame))
            frame = frame[:place] + bytes((frame[place] ^ 1 << self._random.randrange(8),)) + frame[place + 1 :]
        if self._held is None and drawn() < damage.reorder:
            self._held = frame
            return
        self._send(frame, now)
        if drawn() < damage.duplicate:
            self._send(frame, now)
        if self._held is not None:
            self._send(self._held, now)
            self._held = None

    def _send(self, frame: bytes, now: float) -> None:
        late = self.damage.delay_s + self.damage.jitter_s * self._random.random()
        self._latest = max(now + late, self._latest)
        self._waiting.append((self._latest, frame))
        self._passed.append(frame)


class DamagingProxy:
    """Listens on loopback, and passes each connection on to a robot with damage in both directions."""

    def __init__(self, port: int, seed: int = 1, every: float = 0.002) -> None:
        """Of the robot on this computer; looks for what has arrived `every` so often [s]."""
        self.to_robot, self.to_operator = LinkDamage(), LinkDamage()
        self.port = 0
        """Where it listens, once begun."""
        self._robot, self._seed, self._every = port, seed, every
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def begin(self) -> None:
        """Listen."""
        self._server = await asyncio.start_server(self._connected, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Cut every connection."""
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            there, back = await asyncio.open_connection("127.0.0.1", self._robot)
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(self._pass(reader, back, DamagedLine(self.to_robot, self._seed)))
                    group.create_task(self._pass(there, writer, DamagedLine(self.to_operator, self._seed + 1)))
            finally:
                back.transport.abort()
        except* (OSError, _EndedError):
            pass
        finally:
            writer.transport.abort()
            self._tasks.discard(task)

    async def _pass(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, line: DamagedLine) -> None:
        loop = asyncio.get_running_loop()
        reading = asyncio.ensure_future(source.read(65536))
        try:
            while True:
                await asyncio.wait({reading}, timeout=self._every)
                if reading.done():
                    if not (data := reading.result()):
                        sink.write(line.take(loop.time()))
                        await sink.drain()
                        raise _EndedError
                    line.feed(data, loop.time())
                    reading = asyncio.ensure_future(source.read(65536))
                if arrived := line.take(loop.time()):
                    sink.write(arrived)
        finally:
            reading.cancel()
            with suppress(asyncio.CancelledError, OSError):
                await reading


class _EndedError(Exception):
    """One side has closed its connection."""
