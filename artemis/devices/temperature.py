"""Temperatures of drives' power stages: no PDO takes them, so they are read by SDO, slowly, beside the ticks."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.canopen import SdoAbort
from artemis.devices.device import Work
from artemis.devices.epos import EposDrive
from artemis.devices.epos_identity import ABSENT
from artemis.errors import DeviceError
from artemis.values import Mode

EVERY = 10.0
"""Time between two readings of a drive [s]: a power stage warms up in minutes."""
VALID = 30.0
"""A reading counts for so long [s]."""
HEARD = 0.1
"""A drive whose newest status is older than this is not asked [s]: nothing may be before what stops it."""


def temperature_readers(nodes: Sequence[EposDrive], wire: BusGateway) -> list[Work]:
    """What reads the temperatures, where a drive measures its own."""
    asked = [node for node in nodes if node.family.temperature is not None]
    return [_read(asked, wire)] if asked else []


async def _read(asked: list[EposDrive], wire: BusGateway) -> None:
    """Ask one drive after the other, while the drives are exchanged with.

    A drive that does not answer has no temperature: what its silence means is judged by its other messages. One that
    has no such object does not measure it, and is not asked again.
    """
    loop = asyncio.get_running_loop()
    while asked:
        for node in tuple(asked):
            await asyncio.sleep(EVERY / len(asked))
            object, now, heard = node.family.temperature, loop.time(), node.status_time
            exchanged = wire.judged or wire.mode is Mode.FAULT
            if object is None or not exchanged or heard is None or now - heard > HEARD:
                continue
            try:
                data = await node.sdo.read(object.index, object.subindex, object.type.size)
                value = int(object.type.decode(data))
            except DeviceError as error:
                if isinstance(error, SdoAbort) and error.code in ABSENT:
                    asked.remove(node)
            else:
                node.temperature = value / node.family.temperature_scale, loop.time() + VALID
