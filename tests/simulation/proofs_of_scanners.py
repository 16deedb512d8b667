"""Proofs that the injections into laser scanners happen."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

import numpy as np
import pytest
from injection_rig import ROBOT, Host, proves

from artemis.devices.lms1xx.session import Session
from artemis.errors import DeviceError, DeviceLost
from artemis.mounting import Mounting
from artemis.plugins.scanners.lms1xx import Lms1xxConfig
from artemis.scan import Condition, Scan
from artemis.sim.scanners import mount_scanners

PLACE = Mounting(plugin="lms1xx", x_m=0.5, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=0.5)


@dataclass
class Read:
    """A session with a simulated scanner, beside the host."""

    host: Host
    scans: list[Scan] = field(default_factory=list)
    errors: list[DeviceError] = field(default_factory=list)

    async def begin(self) -> None:
        host = self.host
        robot = ROBOT.model_copy(update={"scanners": {"front": PLACE}})
        mount_scanners(robot, host.world, None, None, seed=1, start=host.loop.time())
        session = Session("front", Lms1xxConfig(host="scanner"), host.world.scanners["front"].device.dial)

        async def hold() -> None:
            try:
                await session.hold(host.loop.time, self.scans.append)
            except DeviceError as error:
                self.errors.append(error)

        self.task = asyncio.ensure_future(hold())
        await host.tick(1.0)
        self.take()

    def take(self) -> list[Scan]:
        scans, self.scans[:] = list(self.scans), []
        return scans

    async def over(self, seconds: float) -> list[Scan]:
        self.take()
        await self.host.tick(seconds)
        return self.take()

    def end(self) -> None:
        self.task.cancel()


async def reading(host: Host) -> Read:
    read = Read(host)
    await read.begin()
    return read


@proves("LAS-01")
async def _lost(host: Host) -> None:
    read = await reading(host)
    host.inject("LAS-01", how="silent", duration_s=0.2)
    assert len(await read.over(0.2)) <= 1
    assert len(await read.over(0.2)) >= 9
    host.inject("LAS-01", scanner="front")
    await host.tick(0.1)
    assert [type(error) for error in read.errors] == [DeviceLost]
    read.end()
    with pytest.raises(ValueError, match="needs one of the scanners front, not rear"):
        host.inject("LAS-01", scanner="rear")


@proves("LAS-02")
async def _frozen(host: Host) -> None:
    read = await reading(host)
    host.inject("LAS-02")
    assert len({scan.counter for scan in await read.over(0.3)}) == 1
    read.end()


@proves("LAS-03")
async def _damaged(host: Host) -> None:
    for how in ("rubbish", "cut", "bit"):
        read = await reading(host)
        undo = host.inject("LAS-03", how=how, share=0.5)
        scans = await read.over(1.0)
        assert 10 < len(scans) < 40
        assert sum(scan.garbled for scan in scans) > 8
        undo()
        assert not any(scan.garbled for scan in (await read.over(0.5))[1:])
        read.end()
        await host.tick(0.1)
    read = await reading(host)
    host.inject("LAS-03", how="lost", share=0.5)
    scans = await read.over(1.0)
    assert scans[-1].counter - scans[0].counter > len(scans) + 8
    assert not any(scan.garbled for scan in scans)
    read.end()


@proves("LAS-04")
async def _pieces(host: Host) -> None:
    read = await reading(host)
    host.inject("LAS-04", bytes=1000)
    assert host.world.scanners["front"].device.piece == 1000
    assert len(await read.over(0.3)) >= 14
    read.end()


@proves("LAS-05")
async def _ill(host: Host) -> None:
    read = await reading(host)
    for status, condition in (("dirty", Condition.DIRTY), ("too dirty", Condition.FAULTY), ("error", Condition.FAULTY)):
        undo = host.inject("LAS-05", status=status)
        assert (await read.over(0.1))[-1].condition is condition
        undo()
    assert (await read.over(0.1))[-1].condition is Condition.WELL
    read.end()


@proves("LAS-06")
async def _covered(host: Host) -> None:
    read = await reading(host)
    assert all((await read.over(0.1))[-1].millimetres)
    host.inject("LAS-06", duration_s=0.1)
    assert not any((await read.over(0.1))[-1].millimetres)
    assert all((await read.over(0.1))[-1].millimetres)
    undo = host.inject("LAS-06", sector_deg=[-45, 45], within_s=0.4)
    half = (await read.over(0.2))[-1].millimetres
    assert 60 < np.count_nonzero(half == 0) < 100
    assert not half[190:250].any()
    assert np.count_nonzero((await read.over(0.4))[-1].millimetres == 0) == 181
    undo()
    assert all((await read.over(0.1))[-1].millimetres)
    read.end()


@proves("LAS-07")
async def _late(host: Host) -> None:
    read = await reading(host)
    host.inject("LAS-07", seconds=0.2, within_s=0.4)
    scans = await read.over(0.2)
    assert host.world.scanners["front"].device.delay == pytest.approx(0.1, abs=0.02)
    assert len(scans) > 3
    await host.tick(1.0)
    assert host.world.scanners["front"].device.delay == 0.2
    assert (await read.over(0.1))[-1].time == pytest.approx(host.loop.time() - 0.2, abs=0.05)
    read.end()
