"""The thesis' comparison of RS232 and CAN (4.1): four drives enabled by 32 messages over each, in simulation.

Four times read the statusword, shutdown, switch on, enable operation: 16 requests and 16 answers. On CAN each is one
frame of SDO; over RS232 the computer speaks to the first drive, which is the gateway to the other three.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from artemis import clock
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import (
    SDO_ANSWER,
    SDO_REQUEST,
    Abort,
    Expedited,
    SdoAbort,
    Upload,
    decode_answer,
    encode_request,
)
from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_line import SerialLine
from artemis.sim.bus import SimBus
from artemis.sim.epos_settings import SimSettings
from artemis.sim.serial_drive import serial_drive
from artemis.sim.serial_wire import SerialSettings, SimSerialPort
from artemis.sim.world import World
from artemis.testing.contracts import ROBOT
from artemis_lab.bench.tables import Grid

CONTROLWORD, STATUSWORD = 0x6040, 0x6041
"""Objects of two bytes (CiA 402)."""
SHUTDOWN, SWITCH_ON, ENABLE_OPERATION = 0x06, 0x07, 0x0F
"""Controlwords (EPOS firmware specification 2010, 14.59)."""
SEQUENCE = (None, SHUTDOWN, SWITCH_ON, ENABLE_OPERATION)
"""None: the statusword is read."""
MESSAGES = 2 * len(SEQUENCE) * len(ROBOT.drives)
THESIS_WIRE, THESIS_RATIO = 8.5, 138.0
"""What the thesis has: by the bit rates alone, and measured."""
ANSWER_TIMES = (0.0, 0.0001, 0.0003, 0.001)
BEGIN = 0.2
"""Drives have started, and wait, at this time [s]."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """What is not known of the thesis' robot and computer."""

    baud: int = 115200
    latency_s: float = 0.016
    """Of the USB adapter for RS232: FTDI's default."""
    answer_s: float = 0.0001
    """From the end of a request to a drive's answer, and to each of its confirmations on RS232: fitted to the thesis'
    ratio. A simulated drive takes 0.3 ms elsewhere (`SimSettings.answer_time_s`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BytesPassed:
    """Bytes that reached the drive, or were handed to the computer."""

    to_drive: bool
    time: float
    """When the last of them did [s], from the start of the sequence."""
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """How long the sequence took, and how much of that its own bits were on the wire [s]."""

    total: float
    wire: float
    passages: tuple[BytesPassed, ...] = ()


def over_can(parameters: Parameters) -> Measured:
    """The sequence on CAN at the robot's bit rate: each request once the one before is answered."""
    return clock.run(_over_can(parameters), simulated=True)


def over_serial(parameters: Parameters) -> Measured:
    """The sequence over the serial line of the first drive."""
    return clock.run(_over_serial(parameters), simulated=True)


async def _over_can(parameters: Parameters) -> Measured:
    loop = asyncio.get_running_loop()
    bus = SimBus(_world(parameters), ROBOT.bitrate, loop)
    arrived = asyncio.Event()
    bus.listen(arrived.set)
    await clock.until(BEGIN)
    bus.receive()
    before = bus.busy

    async def transfer(node_id: int, controlword: int | None) -> None:
        if controlword is None:
            request = encode_request(Upload(index=STATUSWORD, subindex=0))
        else:
            data = controlword.to_bytes(2, "little")
            request = encode_request(Expedited(index=CONTROLWORD, subindex=0, data=data))
        bus.send(Frame(SDO_REQUEST + node_id, request))
        while True:
            arrived.clear()
            for frame in bus.receive():
                if frame.id == SDO_ANSWER + node_id:
                    answer = decode_answer(frame.data)
                    if isinstance(answer, Abort):
                        raise SdoAbort(answer.index, answer.subindex, answer.code)
                    return
            await arrived.wait()

    await _sequence(transfer)
    return Measured(total=loop.time() - BEGIN, wire=bus.busy - before)


async def _over_serial(parameters: Parameters) -> Measured:
    loop = asyncio.get_running_loop()
    settings = SerialSettings(baud=parameters.baud, latency_s=parameters.latency_s, ready_time_s=parameters.answer_s)
    wire, drive = serial_drive(_world(parameters), ROBOT.bitrate, SerialProtocol.EPOS1, settings)
    line = SerialLine(SimSerialPort(wire), SerialProtocol.EPOS1)
    passages: list[BytesPassed] = []
    wire.drive = _noted(wire.drive, passages, to_drive=True)
    wire.host = _noted(wire.host, passages, to_drive=False)
    await clock.until(BEGIN)

    async def transfer(node_id: int, controlword: int | None) -> None:
        objects = line.objects("drive", node_id)
        if controlword is None:
            await objects.read(STATUSWORD, 0, 2)
        else:
            await objects.write(CONTROLWORD, 0, controlword.to_bytes(2, "little"))

    await _sequence(transfer)
    total = loop.time() - BEGIN
    drive.close()
    return Measured(total=total, wire=wire.busy, passages=tuple(passages))


async def _sequence(transfer: Callable[[int, int | None], Coroutine[Any, Any, None]]) -> None:
    for drive in ROBOT.drives.values():
        for controlword in SEQUENCE:
            await transfer(drive.node_id, controlword)


def _world(parameters: Parameters) -> World:
    return World(ROBOT, settings=SimSettings(answer_time_s=parameters.answer_s))


def _noted(take: Callable[[bytes], None], passages: list[BytesPassed], *, to_drive: bool) -> Callable[[bytes], None]:
    def note(data: bytes) -> None:
        time = asyncio.get_running_loop().time() - BEGIN
        passages.append(BytesPassed(to_drive=to_drive, time=time, count=len(data)))
        take(data)

    return note


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportTimes:
    """One row: what is taken into account, and how long the sequence takes then [s]."""

    what: str
    short: str
    """The same in two words."""
    can: float
    serial: float
    thesis: float | None = None
    """Its ratio."""

    @property
    def ratio(self) -> float:
        """So many times as long over RS232."""
        return self.serial / self.can


def compared(parameters: Parameters) -> list[TransportTimes]:
    """From the bits on the wires alone to all that is known, each row with one more cause."""
    can, whole = over_can(parameters), over_serial(parameters)
    rows = [
        TransportTimes(what="bits on the wire alone", short="wire", can=can.wire, serial=whole.wire, thesis=THESIS_WIRE)
    ]
    for what, short, latency in (
        ("and the drives' answers, CAN behind the gateway", "+ answers", 0.0),
        ("and a USB adapter that hands bytes over every 1 ms", "+ adapter, 1 ms", 0.001),
    ):
        total = over_serial(replace(parameters, latency_s=latency)).total
        rows.append(TransportTimes(what=what, short=short, can=can.total, serial=total))
    period = f"{1e3 * parameters.latency_s:g} ms"
    rows.append(
        TransportTimes(
            what=f"and one that hands them over every {period}",
            short=f"+ adapter, {period}",
            can=can.total,
            serial=whole.total,
            thesis=THESIS_RATIO,
        )
    )
    return rows


def answer_times(parameters: Parameters) -> list[tuple[float, float, float]]:
    """What the one number does that nobody knows: answer time of the drives, time on CAN and over RS232 [s]."""
    cases = [replace(parameters, answer_s=seconds) for seconds in ANSWER_TIMES]
    return [(case.answer_s, over_can(case).total, over_serial(case).total) for case in cases]


def comparison_grid(rows: list[TransportTimes]) -> Grid:
    """The rows of `compared` as a table."""
    cells = [
        (
            row.what,
            f"{1e3 * row.can:.1f} ms",
            f"{1e3 * row.serial:.1f} ms",
            f"1:{row.ratio:.3g}",
            "" if row.thesis is None else f"1:{row.thesis:g}",
        )
        for row in rows
    ]
    return Grid(title=f"{MESSAGES} messages", head=("what counts", "CAN", "RS232", "ratio", "thesis"), rows=cells)


def answer_grid(found: list[tuple[float, float, float]]) -> Grid:
    """What `answer_times` found as a table."""
    cells = [
        (f"{1e3 * answer:g} ms", f"{1e3 * can:.1f} ms", f"{1e3 * serial:.1f} ms", f"1:{serial / can:.3g}")
        for answer, can, serial in found
    ]
    return Grid(title="by the drives' answer time", head=("a drive answers after", "CAN", "RS232", "ratio"), rows=cells)
