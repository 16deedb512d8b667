"""Our SDO client against the SDO server of the `canopen` package: frames handed over directly, no bus, no threads."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import canopen
import pytest
from canopen.objectdictionary import ODRecord, ODVariable
from canopen.objectdictionary.datatypes import DOMAIN, INTEGER32, UNSIGNED8, UNSIGNED16, UNSIGNED32, VISIBLE_STRING

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import SdoAbort
from artemis.devices.sdo import SdoClient
from artemis.families.objects import ObjectType

NODE_ID = 3
LONG_TEXT = "a name that needs several segments of seven bytes"


def variable(
    name: str, index: int, data_type: int, value: int | str | None = None, access: str = "rw", sub: int = 0
) -> ODVariable:
    entry = ODVariable(name, index, sub)
    entry.data_type, entry.access_type = data_type, access
    entry.default = value  # type: ignore[assignment]  # declared as a number, holds strings as well
    return entry


def object_dictionary() -> canopen.ObjectDictionary:
    objects: canopen.ObjectDictionary = canopen.ObjectDictionary()  # type: ignore[no-untyped-call]  # not typed
    objects.add_object(variable("device type", 0x1000, UNSIGNED32, 0x00020192, "ro"))
    objects.add_object(variable("device name", 0x1008, VISIBLE_STRING, LONG_TEXT))
    objects.add_object(variable("short name", 0x1009, VISIBLE_STRING, "EPOS"))
    objects.add_object(variable("controlword", 0x6040, UNSIGNED16, 0))
    objects.add_object(variable("target position", 0x607A, INTEGER32, 0))
    objects.add_object(variable("mode", 0x6060, UNSIGNED8, 0))
    objects.add_object(variable("key", 0x2001, UNSIGNED16, 7, "wo"))
    objects.add_object(variable("memory", 0x2002, DOMAIN))
    record = ODRecord("memory", 0x200C)
    record.add_member(variable("zero", 0x200C, UNSIGNED32, 0, sub=1))
    objects.add_object(record)
    return objects


class Peer:
    """A canopen node and our client, each other's wire. `mute` swallows that many answers."""

    def __init__(self) -> None:
        network: Any = canopen.Network()
        network.send_message = self.answer
        self.node: Any = network.add_node(canopen.LocalNode(NODE_ID, object_dictionary()))
        self.network = network
        self.client = SdoClient("peer", NODE_ID, self.ask)
        self.mute = 0

    def ask(self, frame: Frame) -> None:
        self.network.notify(frame.id, bytearray(frame.data), 0.0)

    def answer(self, can_id: int, data: bytes, remote: bool = False) -> None:
        assert can_id == 0x580 + NODE_ID
        if self.mute:
            self.mute -= 1
            return
        asyncio.get_running_loop().call_later(0.0002, self.client.receive, Frame(can_id, bytes(data), remote))


def on_virtual_time(main: Coroutine[None, None, None]) -> None:
    run(main, simulated=True)


@pytest.mark.parametrize(
    ("index", "subindex", "type_", "value"),
    [
        (0x6060, 0, ObjectType.U8, 0xFD),
        (0x6040, 0, ObjectType.U16, 0x000F),
        (0x607A, 0, ObjectType.I32, -123456),
        (0x200C, 1, ObjectType.U32, 0xDEADBEEF),
    ],
)
def test_number_is_written_and_read_back(index: int, subindex: int, type_: ObjectType, value: int) -> None:
    async def main() -> None:
        peer = Peer()
        await peer.client.write(index, subindex, type_.encode(value))
        theirs = peer.node.sdo[index][subindex] if subindex else peer.node.sdo[index]
        assert theirs.raw == value
        assert type_.decode(await peer.client.read(index, subindex)) == value

    on_virtual_time(main())


@pytest.mark.parametrize(("index", "text"), [(0x1008, LONG_TEXT), (0x1009, "EPOS")])
def test_text_is_read(index: int, text: str) -> None:
    async def main() -> None:
        assert ObjectType.STR.decode(await Peer().client.read(index, 0)) == text

    on_virtual_time(main())


@pytest.mark.parametrize("size", [1, 4, 5, 7, 8, 14, 15, 200])
def test_block_of_any_size_is_written_and_read_back(size: int) -> None:
    data = bytes(n % 251 for n in range(size))

    async def main() -> None:
        peer = Peer()
        await peer.client.write(0x2002, 0, data)
        assert bytes(peer.node.data_store[0x2002][0]) == data
        assert await peer.client.read(0x2002, 0) == data

    on_virtual_time(main())


@pytest.mark.parametrize(
    ("index", "subindex", "code"),
    [(0x3000, 0, 0x06020000), (0x200C, 9, 0x06090011), (0x2001, 0, 0x06010001)],
)
def test_refused_read_carries_the_peers_code(index: int, subindex: int, code: int) -> None:
    async def main() -> None:
        with pytest.raises(SdoAbort) as caught:
            await Peer().client.read(index, subindex)
        assert (caught.value.index, caught.value.subindex, caught.value.code) == (index, subindex, code)

    on_virtual_time(main())


@pytest.mark.parametrize(("index", "size", "code"), [(0x3000, 2, 0x06020000), (0x1000, 4, 0x06010002)])
def test_refused_write_carries_the_peers_code(index: int, size: int, code: int) -> None:
    async def main() -> None:
        with pytest.raises(SdoAbort) as caught:
            await Peer().client.write(index, 0, bytes(size))
        assert (caught.value.index, caught.value.code) == (index, code)

    on_virtual_time(main())


@pytest.mark.parametrize("lost", [1, 2])
def test_transfer_survives_lost_answers(lost: int) -> None:
    async def main() -> None:
        peer = Peer()
        peer.mute = lost
        assert ObjectType.STR.decode(await peer.client.read(0x1008, 0)) == LONG_TEXT

    on_virtual_time(main())


def test_peer_hears_our_timeout() -> None:
    async def main() -> None:
        peer = Peer()
        peer.mute = 1
        await peer.client.read(0x1008, 0)
        assert peer.node.sdo.last_received_error == 0x05040000

    on_virtual_time(main())
