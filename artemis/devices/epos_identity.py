"""Who answers at a node: its family, which decides what a controlword means to it, and then which drive it is."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from artemis.devices.canopen import SdoAbort
from artemis.drive_schema import Drive
from artemis.errors import WrongDevice
from artemis.families import GENERATIONS
from artemis.families.family import MAXON
from artemis.families.objects import PRODUCT, SERIAL_NUMBER, VENDOR, Object

NO_SUCH_OBJECT = 0x06020000
ABSENT = (NO_SUCH_OBJECT, 0x06090011)
"""SDO abort codes: no such object, no such subindex (CiA 301 7.2.4.3.17)."""

Read = Callable[[Object], Awaitable[int]]
"""Reads an object of a drive. Raises DeviceError: it is silent, or refuses."""


async def held(read: Read, object: Object) -> int | None:
    """Value of an object; None: the drive has none."""
    try:
        return await read(object)
    except SdoAbort as refused:
        if refused.code in ABSENT:
            return None
        raise


async def check_family(name: str, drive: Drive, read: Read) -> int:
    """Hardware version of the drive, as the robot file's is compared with it, if it is of the family of `drive`.

    Raises:
        WrongDevice: it is of another vendor or family.
        DeviceError: as `read` does.
    """
    family, node = drive.tables, drive.node_id
    vendor = await read(VENDOR)
    try:
        hardware = await read(family.hardware.object) >> family.hardware.shift
    except SdoAbort as refused:
        if refused.code == NO_SUCH_OBJECT and vendor == MAXON:
            await _check_generation(name, drive, await read(PRODUCT) >> 16, read)
        raise
    if vendor != family.vendor:
        whose = "maxon (0xFB)" if family.vendor == MAXON else f"0x{family.vendor:X}"
        raise WrongDevice(name, f"node {node} is of vendor 0x{vendor:X}, not {whose}")
    if vendor == MAXON:
        await _check_generation(name, drive, hardware if family.generation is not None else hardware >> 16, read)
    return hardware


async def _check_generation(name: str, drive: Drive, version: int, read: Read) -> None:
    """A maxon hardware version is of our family; one that tells none, by an object that only our family has."""
    family, node = drive.tables, drive.node_id
    found = GENERATIONS.get(version >> 4 & 0xF)
    if found is None and family.witness is not None and await held(read, family.witness) is None:
        seen = f"is no {family.title}: hardware 0x{version:04X}, without object {family.witness}"
        raise WrongDevice(name, f"node {node} {seen}")
    if found is not None and found is not family and (family.generation or found.mask != family.mask):
        seen = f"is of family {found.name} ({found.title}, hardware 0x{version:04X})"
        raise WrongDevice(name, f"node {node} {seen}, the robot file says {family.name}")


async def check_identity(name: str, drive: Drive, hardware: int, read: Read) -> None:
    """Hardware version (which was read), firmware and serial number of the drive against the robot file.

    Raises:
        WrongDevice: it is another one than `drive` describes.
        DeviceError: as `read` does.
    """
    family, node = drive.tables, drive.node_id
    firmware = await read(family.firmware.object) >> family.firmware.shift
    if (hardware ^ drive.hardware_version) & family.hardware_mask:
        expected = drive.hardware_version
        raise WrongDevice(name, f"node {node} is hardware 0x{hardware:04X}, expected 0x{expected:04X}")
    if firmware < (needed := drive.oldest_firmware):
        raise WrongDevice(name, f"firmware 0x{firmware:04X} is older than 0x{needed:04X}: update the drive")
    if drive.serial_number is not None:
        serial = await read(SERIAL_NUMBER)
        if serial != drive.serial_number:
            raise WrongDevice(name, f"serial number 0x{serial:08X}, expected 0x{drive.serial_number:08X}")
