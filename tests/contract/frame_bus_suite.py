"""What every `FrameBus` must do. An implementation enters by one `Link` in `test_frame_bus.py`.

A link opens a bus and a peer: any other station on the same wire, which needs `send` and `receive` only.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Protocol

from msgspec.structs import replace

from artemis.clock import run
from artemis.devices.can_bus import Frame, FrameBus

SPELL = 0.002
"""Time between two looks at a bus [s]."""
PATIENCE = 2.0
"""What does not arrive within this time is lost [s]."""


class Peer(Protocol):
    """Another station on the wire."""

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire."""

    def receive(self) -> list[Frame]:
        """Everything heard since the last call."""


@dataclass(frozen=True)
class Link:
    """How to open an implementation together with a peer, and on which time it runs."""

    open: Callable[[], AbstractAsyncContextManager[tuple[FrameBus, Peer]]]
    simulated: bool


async def arrived(station: Peer, number: int) -> list[Frame]:
    """The first `number` frames that the station hears (fewer after PATIENCE)."""
    frames: list[Frame] = []
    deadline = asyncio.get_running_loop().time() + PATIENCE
    while len(frames) < number and asyncio.get_running_loop().time() < deadline:
        frames += station.receive()
        await asyncio.sleep(SPELL)
    return frames


def bare(frames: list[Frame]) -> list[Frame]:
    return [replace(frame, time=0.0) for frame in frames]


class FrameBusSuite:
    """Give the tests a fixture `link`."""

    def test_frames_arrive_in_order_with_their_data(self, link: Link) -> None:
        sent = [Frame(0x181, bytes(range(length))) for length in range(9)] * 3

        async def main() -> None:
            async with link.open() as (bus, peer):
                for frame in sent:
                    peer.send(frame)
                assert bare(await arrived(bus, len(sent))) == sent
                for frame in sent:
                    bus.send(frame)
                assert bare(await arrived(peer, len(sent))) == sent

        run(main(), simulated=link.simulated)

    def test_own_frames_never_come_back(self, link: Link) -> None:
        own = [Frame(0x601, bytes((number,))) for number in range(5)]
        last = Frame(0x581, b"last")

        async def main() -> None:
            async with link.open() as (bus, peer):
                for frame in own:
                    bus.send(frame)
                assert bare(await arrived(peer, len(own))) == own
                peer.send(last)
                assert bare(await arrived(bus, 1)) == [last]

        run(main(), simulated=link.simulated)

    def test_equal_frame_of_another_station_arrives_once(self, link: Link) -> None:
        same, last = Frame(0x700, b"\x05"), Frame(0x581, b"last")

        async def main() -> None:
            async with link.open() as (bus, peer):
                bus.send(same)
                assert bare(await arrived(peer, 1)) == [same]
                peer.send(same)
                peer.send(last)
                assert bare(await arrived(bus, 2)) == [same, last]

        run(main(), simulated=link.simulated)

    def test_remote_frames_pass(self, link: Link) -> None:
        remote, data = Frame(0x701, rtr=True), Frame(0x701, b"\x7f")

        async def main() -> None:
            async with link.open() as (bus, peer):
                bus.send(remote)
                assert bare(await arrived(peer, 1)) == [remote]
                peer.send(data)
                peer.send(remote)
                assert bare(await arrived(bus, 2)) == [data, remote]

        run(main(), simulated=link.simulated)

    def test_frames_bear_the_time_of_their_arrival(self, link: Link) -> None:
        async def main() -> None:
            async with link.open() as (bus, peer):
                await asyncio.sleep(SPELL)
                before = asyncio.get_running_loop().time()
                peer.send(Frame(0x181, b"\1"))
                (frame,) = await arrived(bus, 1)
                assert before <= frame.time <= asyncio.get_running_loop().time()

        run(main(), simulated=link.simulated)

    def test_receive_never_waits(self, link: Link) -> None:
        async def main() -> None:
            async with link.open() as (bus, _):
                assert bus.receive() == []

        run(main(), simulated=link.simulated)

    def test_urgent_frame_wakes(self, link: Link) -> None:
        async def main() -> None:
            async with link.open() as (bus, peer):
                for urgent in (Frame(0x081, bytes(8)), Frame(0x581, bytes(8)), Frame(0x701, b"\0")):
                    woken = asyncio.Event()
                    bus.listen(woken.set)
                    peer.send(urgent)
                    async with asyncio.timeout(PATIENCE):
                        await woken.wait()
                    assert bare(bus.receive()) == [urgent]

        run(main(), simulated=link.simulated)

    def test_process_data_wakes_nobody(self, link: Link) -> None:
        woken: list[bool] = []

        async def main() -> None:
            async with link.open() as (bus, peer):
                bus.listen(lambda: woken.append(True))
                for identifier in (0x181, 0x281, 0x37F, 0x4FF):
                    peer.send(Frame(identifier, bytes(8)))
                assert len(await arrived(bus, 4)) == 4
                assert woken == []

        run(main(), simulated=link.simulated)

    def test_closing_twice_is_harmless(self, link: Link) -> None:
        async def main() -> None:
            async with link.open() as (bus, _):
                bus.close()
                bus.close()

        run(main(), simulated=link.simulated)
