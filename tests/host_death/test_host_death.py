"""The host dies while the robot drives: cases of `make host-death`; or the simulated drives are held up."""

from __future__ import annotations

import asyncio
import itertools
import signal
import socket

import can
import pytest

from artemis import clock
from artemis.devices.can_bus import CanBus, Frame
from artemis_lab.bench.ports import free_port

from .cases import GROUP, MISSIONS, PATIENCE, WATCH, Case, Process, draw, play_one, words

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(1200)]

CASES, SEED = 20, 7
ROBOT = MISSIONS / "robots" / "artemis.yaml"
TICK = 0.02
NODES = (1, 2, 3, 4)
HEARTBEAT = Frame(0x77F, b"\x05")


@pytest.fixture(scope="module", autouse=True)
def _multicast() -> None:
    bus = words(free_port(socket.SOCK_DGRAM))
    try:
        with can.Bus(**bus) as one, can.Bus(**bus) as other:  # type: ignore[arg-type]
            one.send(can.Message(arbitration_id=0x123, is_extended_id=False))
            works = other.recv(2.0) is not None
    except (can.CanError, OSError):
        works = False
    if not works:
        pytest.skip(f"no UDP multicast ({GROUP}) between processes here")


@pytest.mark.sampled(4)  # each of the five ways to die once
@pytest.mark.parametrize("case", draw(CASES, SEED), ids=str)
def test_every_drive_stops_in_time_when_the_host_dies(case: Case) -> None:
    outcome = play_one(case)
    if outcome.undecided:
        pytest.skip(f"this machine is too busy for real time: {outcome.replaced}")
    assert outcome.problems == [], str(outcome.case)
    assert len(outcome.trips) == len(NODES)


def test_simulated_drives_that_were_stopped_themselves_miss_no_heartbeat() -> None:
    async def main() -> None:
        port = free_port(socket.SOCK_DGRAM)
        drives = await Process.start("sim", ROBOT, *_options(port))
        bus = CanBus(words(port))
        try:
            booted: set[int] = set()
            async with asyncio.timeout(PATIENCE):
                while len(booted) < len(NODES):
                    await asyncio.sleep(TICK)
                    booted |= {frame.id for frame in bus.receive() if frame.data == b"\0"}
            for node in NODES:  # 0x1016:1: heartbeats of node 127 within 200 ms
                bus.send(Frame(0x600 + node, bytes.fromhex("23 16 10 01 C8 00 7F 00")))
            sent = await beat(bus, 0.5)
            drives.send(signal.SIGSTOP)
            sent += await beat(bus, 1.0)
            drives.send(signal.SIGCONT)
            sent += await beat(bus, 0.5)
            if max(after - before for before, after in itertools.pairwise(sent)) > 0.9 * WATCH:
                pytest.skip("this machine is too busy for real time: heartbeats were not sent")
            assert reports(bus) == []
            reported: list[int] = []
            async with asyncio.timeout(PATIENCE):
                while len(reported) < len(NODES):
                    await asyncio.sleep(TICK)
                    reported += reports(bus)
            assert sorted(reported) == [0x080 + node for node in NODES]
        finally:
            await drives.end()
            bus.close()

    clock.run(main(), simulated=False)


async def beat(bus: CanBus, seconds: float) -> list[float]:
    """Send heartbeats; when [s]."""
    loop = asyncio.get_running_loop()
    end, sent = loop.time() + seconds, []
    while (now := loop.time()) < end:
        bus.send(HEARTBEAT)
        sent.append(now)
        await asyncio.sleep(TICK)
    return sent


def reports(bus: CanBus) -> list[int]:
    """Identifiers of the waiting frames that report a lost heartbeat."""
    return [frame.id for frame in bus.receive() if frame.id < 0x100 and frame.data[:2] == b"\x30\x81"]


def _options(port: int) -> list[str]:
    return [
        *("--interface", "udp_multicast", "--channel", GROUP),
        *("--option", "hop_limit=0", "--option", f"port={port}"),
    ]
