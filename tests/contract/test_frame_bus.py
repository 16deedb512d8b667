"""The contract of `FrameBus`, held against every implementation."""

from __future__ import annotations

import os
import select
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from typing import Any

import can
import pytest
from frame_bus_suite import FrameBusSuite, Link, Peer

from artemis.devices.can_bus import CanBus, FrameBus
from artemis_lab.injections.fault_bus import FaultBus

PORT = 20000 + os.getpid() % 20000
"""On one host, groups of the same port hear each other: every test process takes a port of its own."""
GROUPS = count(1)


def multicast_problem() -> str:
    """Why multicast does not work on this machine; empty if it does."""
    words: dict[str, Any] = {"channel": "239.74.163.250", "port": PORT, "hop_limit": 0}
    try:
        with can.Bus(interface="udp_multicast", ignore_config=True, **words) as bus:
            bus.send(can.Message(arbitration_id=1, is_extended_id=False))
            return "" if select.select([bus.fileno()], [], [], 1.0)[0] else "multicast: nothing comes back"
    except (can.CanError, OSError) as error:
        return f"no multicast: {error}"


@asynccontextmanager
async def open_virtual() -> AsyncIterator[tuple[FrameBus, Peer]]:
    words = {"interface": "virtual", "channel": f"contract-{next(GROUPS)}"}
    bus, peer = CanBus(words), CanBus(words)
    try:
        yield bus, peer
    finally:
        bus.close()
        peer.close()


@asynccontextmanager
async def open_multicast() -> AsyncIterator[tuple[FrameBus, Peer]]:
    problem = multicast_problem()
    if problem:
        pytest.skip(problem)
    group = f"239.74.163.{next(GROUPS) % 200 + 1}"
    words = {"interface": "udp_multicast", "channel": group, "port": PORT, "hop_limit": 0}
    bus, peer = CanBus(words), CanBus(words)
    try:
        yield bus, peer
    finally:
        bus.close()
        peer.close()


@asynccontextmanager
async def open_wrapped() -> AsyncIterator[tuple[FrameBus, Peer]]:
    async with open_virtual() as (bus, peer):
        yield FaultBus(bus), peer


LINKS = {
    "fault_bus": Link(open=open_wrapped, simulated=False),
    "virtual": Link(open=open_virtual, simulated=False),
    "udp_multicast": Link(open=open_multicast, simulated=False),
}


@pytest.fixture(params=list(LINKS.values()), ids=list(LINKS))
def link(request: pytest.FixtureRequest) -> Link:
    implementation: Link = request.param
    return implementation


class TestFrameBus(FrameBusSuite):
    """Runs the suite on every link."""
