"""Proofs that the injections into inputs, followers, operator and computer happen."""

from __future__ import annotations

import asyncio
import errno
import math
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from injection_rig import LEFT, Host, proves
from passing_plugins import Stick, Walker, at

from artemis.errors import DeviceLost
from artemis.plugins.contracts import Following
from artemis.values import DriveCommand, OperatorInput, Request
from artemis_lab.injections.bad_plugins import BadFollower, BadInput
from artemis_lab.injections.failing_disk import FailingDisk
from artemis_lab.injections.stage import Stage
from artemis_lab.injections.table import inject


class Cast:
    """A stage with two sticks and a follower."""

    def __init__(self, host: Host) -> None:
        self.sticks = {name: BadInput(Stick()) for name in ("stick", "pad")}
        self.follower = BadFollower(Walker())
        self.stage: Stage = replace(host.stage, inputs=self.sticks, followers=(self.follower,))

    def inject(self, id: str, **parameters: Any) -> Callable[[], None]:  # noqa: ANN401 (of any row)
        return inject(self.stage, id, **parameters)

    def read(self, now: float = 1.0, name: str = "stick") -> OperatorInput:
        return self.sticks[name].read(now)

    def step(self, now: float = 1.0) -> Following:
        return self.follower.step(at(now))


# ---------------------------------------------------------------------------------------------- inputs


@proves("INP-01")
async def _unplugged(host: Host) -> None:
    cast = Cast(host)
    undo = cast.inject("INP-01", input="stick")
    with pytest.raises(DeviceLost, match="unplugged"):
        cast.read()
    assert cast.read(name="pad") == Stick().read(1.0)
    undo()
    assert cast.read() == Stick().read(1.0)


@proves("INP-03", "INP-04", "INP-05")
async def _frozen(host: Host) -> None:
    for id in ("INP-03", "INP-04", "INP-05"):
        cast = Cast(host)
        cast.inject(id)
        for name in cast.sticks:
            cast.read(1.0, name)
            assert cast.read(1.4, name).age == pytest.approx(0.4)


@proves("INP-06")
async def _bad_value(host: Host) -> None:
    cast = Cast(host)
    cast.inject("INP-06")
    assert math.isnan(cast.read().speed)
    cast.inject("INP-06", value="inf")
    assert math.isinf(cast.read().speed)
    cast.inject("INP-06", value="beyond the stop")
    assert cast.read().axes == (7.0, 0.2)
    cast.inject("INP-06", value="a text as number")
    assert isinstance(cast.read().speed, str)


@proves("INP-07", "INP-12")
async def _wishes(host: Host) -> None:
    cast = Cast(host)
    cast.inject("INP-07", input="pad", speed_m_s=0.1, steering_deg=-10.0)
    sample = cast.read(name="pad")
    assert (sample.speed, sample.neutral) == (0.1, False)
    assert sample.steering == pytest.approx(math.radians(-10.0))
    cast.inject("INP-12", input="pad")
    assert cast.read(name="pad").enabled


@proves("INP-08")
async def _jumps(host: Host) -> None:
    cast = Cast(host)
    cast.inject("INP-08")
    assert [cast.read().axes for _ in range(2)] == [(-1.0, -1.0), (1.0, 1.0)]


@proves("INP-09", "INP-10")
async def _enable_button(host: Host) -> None:
    cast = Cast(host)
    cast.inject("INP-09", duration_s=0.1)
    assert not cast.read().enabled
    await host.tick(0.2)
    assert cast.read().enabled
    cast.inject("INP-10")
    assert (cast.read().enabled, cast.read().neutral) == (True, False)


@proves("INP-11")
async def _stop_button(host: Host) -> None:
    cast = Cast(host)
    cast.inject("INP-11", input="stick")
    assert [cast.read().requests for _ in range(3)] == [(Request.QUICKSTOP,), (), ()]


# ---------------------------------------------------------------------------------------------- plugins


@proves("PLG-02")
async def _raises(host: Host) -> None:
    cast = Cast(host)
    cast.inject("PLG-02", duration_s=0.1)
    with pytest.raises(RuntimeError, match="told to fail"):
        cast.step()
    assert cast.read() == Stick().read(1.0)
    await host.tick(0.2)
    assert cast.step().command.speed == 1.0
    cast.inject("PLG-02", input="stick")
    with pytest.raises(RuntimeError, match="told to fail"):
        cast.read()


@proves("PLG-03", "PLG-04", "PTH-09")
async def _late(host: Host) -> None:
    cast = Cast(host)
    for id, takes in (("PLG-03", 3 * 0.02), ("PTH-09", 3 * 0.02), ("PLG-04", 1.0)):
        cast.inject(id)
        before = host.loop.time()
        for _ in range(5):
            cast.step()
        assert host.loop.time() - before == pytest.approx(takes)
    cast.inject("PLG-03", input="stick", seconds=0.5, times=1)
    before = host.loop.time()
    cast.read()
    assert host.loop.time() - before == pytest.approx(0.5)


@proves("PLG-05")
async def _leaks(host: Host) -> None:
    cast = Cast(host)
    cast.inject("PLG-05", bytes_per_call=10)
    assert cast.step().command.speed == 1.0


@proves("PLG-06")
async def _garbage(host: Host) -> None:
    cast = Cast(host)
    for words, found in (("nothing", None), ("a text", "garbage"), ("a number", 1e300)):
        cast.inject("PLG-06", returns=words)
        cast.inject("PLG-06", returns=words, input="stick")
        answers: list[Any] = [cast.step(), cast.read()]
        assert answers == [found, found]


@proves("RUN-11", "RUN-12")
async def _impossible_commands(host: Host) -> None:
    cast = Cast(host)
    cast.inject("RUN-11")
    assert math.isnan(cast.step().command.speed)
    cast.inject("RUN-11", input="stick", value="inf")
    assert math.isinf(cast.read().speed)
    cast.inject("RUN-12", speed_m_s=4.0, steering_deg=80.0)
    assert cast.step().command == DriveCommand(speed=4.0, steering=math.radians(80.0))


@proves("PTH-08")
async def _beyond_the_end(host: Host) -> None:
    cast = Cast(host)
    cast.inject("PTH-08")
    cast.step(9.9)
    assert (cast.step(12.0).command.speed, cast.step(12.0).finished) == (9.9, False)


# ---------------------------------------------------------------------------------------------- computer and operator


@proves("COM-31", "SYS-01", "SYS-03", "SYS-07")
async def _stall(host: Host) -> None:
    for id, seconds in (("COM-31", 0.12), ("SYS-01", 0.07), ("SYS-03", 1.0), ("SYS-07", 1.0)):
        before = host.loop.time()
        host.inject(id)
        assert host.loop.time() == before, "at once, but never within what runs"
        await asyncio.sleep(0)
        assert host.loop.time() - before == pytest.approx(seconds)
        await host.tick(0.1)
    assert host.emergencies(LEFT) == [0x8130]  # only the long ones; once, as nobody resets it


@proves("SYS-04")
async def _bug(host: Host) -> None:
    failed: list[str] = []
    host.loop.set_exception_handler(lambda loop, context: failed.append(str(context["exception"])))
    host.inject("SYS-04")
    await host.tick(0.02)
    assert failed == ["told to fail"]


@proves("OPR-01", "OPR-02")
async def _operator(host: Host) -> None:
    host.inject("OPR-01")
    assert host.requests == [Request.ACKNOWLEDGE]
    host.inject("OPR-02", times=5)
    await host.tick(1.0)
    assert host.requests == [Request.ACKNOWLEDGE] * 6


@proves("DSK-02", "DSK-05")
async def _bad_disk(host: Host) -> None:
    disk = FailingDisk()
    stage = replace(host.stage, disk=disk)
    with TemporaryDirectory() as folder:
        recording = disk.open(Path(folder) / "recording.mcap", "w")
        journal = disk.open(Path(folder) / "journal.jsonl", "x")
        with recording, journal:
            for id, code in (("DSK-02", errno.ENOSPC), ("DSK-05", errno.EIO)):
                assert recording.write(memoryview(b"good")) == 4
                undo = inject(stage, id)
                with pytest.raises(OSError, match=os.strerror(code)) as caught:
                    recording.write(memoryview(b"bad"))
                assert caught.value.errno == code
                assert journal.write(memoryview(b"good")) == 4
                undo()
            inject(stage, "DSK-02", files="both")
            for file in (recording, journal):
                with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
                    file.write(memoryview(b"bad"))
        assert (Path(folder) / "recording.mcap").read_bytes() == b"goodgood"
    with pytest.raises(ValueError, match="a disk which can fail"):
        host.inject("DSK-02")


@proves("SYS-05")
async def _terminated(host: Host) -> None:
    for name in ("SIGTERM", "SIGINT"):
        got: list[str] = []
        host.loop.add_signal_handler(signal.Signals[name], got.append, name)
        host.inject("SYS-05", signal=name)
        await host.tick(0.2)
        assert got == [name]
        host.loop.remove_signal_handler(signal.Signals[name])
