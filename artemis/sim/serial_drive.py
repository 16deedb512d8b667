"""The drive's end of a simulated serial line: the bytes of the first generation's protocol, and of the EPOS4's."""

from __future__ import annotations

import asyncio

from artemis.devices.serial_frames import (
    ANSWER,
    READY,
    REFUSED,
    Epos4Splitter,
    SerialProtocol,
    epos1_body,
    epos1_data,
    epos1_length,
    epos4_frame,
)
from artemis.errors import ProtocolError
from artemis.sim.bus import SimBus
from artemis.sim.epos import SimEpos
from artemis.sim.serial_gateway import Gateway
from artemis.sim.serial_wire import SerialSettings, SerialWire, SimSerialPort
from artemis.sim.world import World


class SerialDrive:
    """The first drive of a world, on a serial line; always a slave: it says nothing by itself."""

    def __init__(self, gateway: Gateway, wire: SerialWire, protocol: SerialProtocol, settings: SerialSettings) -> None:
        self._gateway, self._wire, self._settings = gateway, wire, settings
        self._bytes: asyncio.Queue[int] = asyncio.Queue()
        wire.drive = self._take
        serve = self._serve_epos1 if protocol is SerialProtocol.EPOS1 else self._serve_epos4
        self._task = asyncio.get_running_loop().create_task(serve())

    def close(self) -> None:
        """It hears no more."""
        self._task.cancel()

    def _take(self, data: bytes) -> None:
        if self._gateway.awake:
            for byte in data:
                self._bytes.put_nowait(byte)

    async def _byte(self) -> int:
        async with asyncio.timeout(self._settings.time_limit_s):
            return await self._bytes.get()

    async def _say(self, data: bytes) -> None:
        await asyncio.sleep(self._settings.ready_time_s)
        if self._gateway.awake:
            self._wire.to_host(data)

    async def _serve_epos1(self) -> None:
        """Hand-shake and time limits: communication guide 6.2.2."""
        while True:
            opcode = await self._bytes.get()
            if not self._gateway.knows(opcode):
                await self._say(REFUSED)
                continue
            await self._say(READY)
            try:
                await self._exchange(opcode)
            except TimeoutError:
                continue  # it waits for a command again

    async def _exchange(self, opcode: int) -> None:
        first = await self._byte()
        body = bytes([first, *[await self._byte() for _ in range(epos1_length(first))]])
        try:
            data = epos1_data(opcode, body)
        except ProtocolError:
            await self._say(REFUSED)
            return
        await self._say(READY)
        answer = await self._gateway.perform(opcode, data)
        if answer is None:
            return
        await self._say(bytes((ANSWER,)))
        while await self._byte() != READY[0]:
            pass
        await self._say(epos1_body(ANSWER, answer))
        await self._byte()  # whether it was understood changes nothing

    async def _serve_epos4(self) -> None:
        """A frame, and a frame in answer (EPOS4 communication guide 2.2)."""
        splitter = Epos4Splitter()
        while True:
            try:
                byte = await (self._byte() if splitter.half else self._bytes.get())
                frame = splitter.feed(byte)
            except TimeoutError:
                splitter.reset()
                continue
            except ProtocolError:
                continue  # a damaged frame is not answered
            if frame is not None and self._gateway.knows(frame[0]):
                answer = await self._gateway.perform(*frame)
                await self._say(epos4_frame(ANSWER, answer or b""))


def serial_drive(
    world: World, bitrate: int, protocol: SerialProtocol, settings: SerialSettings
) -> tuple[SerialWire, SerialDrive]:
    """The world's first drive on a serial line, the others behind it on CAN; needs a running loop."""
    first: SimEpos = world.nodes[0]
    bus = SimBus(world, bitrate, asyncio.get_running_loop(), speaker=first)
    wire = SerialWire(settings)
    gateway = Gateway(first, bus, protocol, settings.node_time_s)
    return wire, SerialDrive(gateway, wire, protocol, settings)


def serial_port(world: World, bitrate: int, protocol: SerialProtocol, settings: SerialSettings) -> SimSerialPort:
    """A computer's port on such a line."""
    return SimSerialPort(serial_drive(world, bitrate, protocol, settings)[0])
