"""Who is on the bus: asks a robot's drives what they are, and changes nothing."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from artemis.devices.can_bus import FrameBus
from artemis.devices.drive import Drives
from artemis.devices.epos import EposDrive
from artemis.devices.epos_jobs import EposJobs
from artemis.devices.serial_line import SerialLine
from artemis.drive_states import Nmt
from artemis.errors import DeviceError, ProtocolError
from artemis.families.objects import DEVICE_TYPE, PRODUCT, REVISION, SERIAL_NUMBER, VENDOR
from artemis.vehicle import RobotFile

LISTEN = 0.5
"""Heartbeats are waited for so long [s]; those of a configured drive come in a fifth of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeReport:
    """A drive of the robot file, and what it says of itself."""

    name: str
    node_id: int
    problem: str = ""
    """Why it says nothing; then the rest means nothing."""
    device_type: int = 0
    """Object 0x1000."""
    vendor: int = 0
    """This and the following: object 0x1018."""
    product: int = 0
    revision: int = 0
    serial: int = 0
    bitrate: int | None = None
    """What it speaks once it is switched on again [bit/s]; 0: what it hears; None: it does not say, where its family
    should."""
    nmt: Nmt | None = None
    """By its heartbeat; None: none was heard."""
    unheard: str = "sends no heartbeat"
    """Why."""
    history: tuple[int, ...] = ()
    """Error codes of object 0x1003, newest first."""


async def ask_nodes(robot: RobotFile, bus: FrameBus) -> list[NodeReport]:
    """Every drive of the robot file, in its order. Only reads; not while somebody else talks SDO to the drives."""
    drives = Drives(robot, bus)
    drives.wire.listen()
    await asyncio.sleep(LISTEN)
    drives.wire.look()
    serial_line = isinstance(bus, SerialLine)
    return list(await asyncio.gather(*(_ask(drive, serial_line) for drive in drives.nodes)))


async def _ask(drive: EposDrive, serial_line: bool) -> NodeReport:
    nmt = drive.feedback(asyncio.get_running_loop().time()).nmt
    jobs = EposJobs(drive)
    try:
        values = [await jobs.read(object) for object in (DEVICE_TYPE, VENDOR, PRODUCT, REVISION, SERIAL_NUMBER)]
        history = await jobs.read_history()
        bitrate = await _bit_rate(drive, jobs)
    except DeviceError as error:
        return NodeReport(name=drive.name, node_id=drive.node_id, problem=error.problem)
    device_type, vendor, product, revision, serial = values
    return NodeReport(
        name=drive.name,
        node_id=drive.node_id,
        device_type=device_type,
        vendor=vendor,
        product=product,
        revision=revision,
        serial=serial,
        bitrate=bitrate,
        unheard="its heartbeat passes no serial line" if serial_line else "sends no heartbeat",
        nmt=Nmt.PRE_OPERATIONAL if nmt is Nmt.INITIALISING else nmt,  # a boot-up was its last word (CiA 301 7.3.2.2)
        history=history,
    )


async def _bit_rate(drive: EposDrive, jobs: EposJobs) -> int | None:
    """As `NodeReport.bitrate`; None also where the drive is of another family than the robot file says."""
    family = drive.family
    try:
        return family.bit_rates.get(await jobs.read(family.bit_rate)) if family.bit_rate else None
    except ProtocolError:  # no such object, or one of another type
        return None
