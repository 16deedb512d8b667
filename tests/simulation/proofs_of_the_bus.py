"""Proofs that the injections into bus and adapter happen."""

from __future__ import annotations

import itertools

import pytest
from injection_rig import FAULT_STATES, HEARTBEAT, LEFT, RIGHT, ROBOT, RPM_PER_M_S, STEER, Host, proves

from artemis.drive_states import DriveState, Nmt
from artemis.errors import DeviceBusy, DeviceLost


@proves("COM-12", "STE-01")
async def _no_set_points(host: Host) -> None:
    host.inject("COM-12", LEFT)
    host.inject("STE-01", STEER)
    host.forward(0.2)
    host.targets[STEER] = host.targets["steer-right"] = 3000
    await host.tick(1.0)
    assert host.drive(LEFT).axis.velocity == 0.0
    assert abs(host.drive(RIGHT).axis.velocity) == pytest.approx(0.2 * RPM_PER_M_S, rel=0.01)
    assert host.drive(STEER).axis.position == 0.0
    assert host.drive("steer-right").axis.position == pytest.approx(3000, abs=5)


@proves("COM-13")
async def _doubled(host: Host) -> None:
    host.inject("COM-13", LEFT)
    await host.tick(0.2)
    assert len(host.statuswords(LEFT)) == 2 * len(host.statuswords(RIGHT))


@proves("COM-14")
async def _corrupted(host: Host) -> None:
    host.inject("COM-14", LEFT)
    await host.tick(0.2)
    lengths = [len(frame.data) for frame in host.take() if frame.id in (0x181, 0x281)]
    assert lengths[:3] == [3, 3, 3]
    assert 3 not in lengths[3:]
    host.inject("COM-14", LEFT, length=None, bits=1, count=None)
    await host.tick(0.2)
    words = host.statuswords(LEFT)
    assert len({(word, position) for word, position in zip(words, host.positions(LEFT), strict=True)}) > 5


@proves("COM-15")
async def _late(host: Host) -> None:
    host.inject("COM-15", delay_s=0.1, duration_s=0.5)
    await host.tick(0.1)
    host.take()
    await host.tick(0.1)
    now = host.loop.time()
    assert {round(now - frame.time, 2) for frame in host.take() if 0x180 <= frame.id < 0x580} <= {
        0.1,
        0.12,
        0.14,
        0.16,
        0.18,
        0.2,
    }
    await host.tick(1.0)
    assert host.loop.time() - host.heard[-1].time < 0.03


@proves("COM-16")
async def _reordered(host: Host) -> None:
    host.inject("COM-16", LEFT)
    await host.tick(0.2)
    for identifier in (0x181, 0x281):
        times = [frame.time for frame in host.take(identifier)]
        if times != sorted(times):
            return
    pytest.fail("every frame came in its order")


@proves("COM-17")
async def _foreign(host: Host) -> None:
    host.inject("COM-17", LEFT)
    await host.tick(0.02)
    assert [frame.data for frame in host.take(0x301)] == [b"\x06\x00"]
    assert host.state(LEFT) is not DriveState.OPERATION_ENABLE
    host.inject("COM-17", STEER, says="pre-operational")
    await host.tick(0.04)
    assert host.drive(STEER).nmt is Nmt.PRE_OPERATIONAL
    assert [frame.data for frame in host.take(0x000)] == [b"\x80\x03"]


@proves("COM-18")
async def _second_host(host: Host) -> None:
    host.inject("COM-18", duration_s=0.4)
    await host.tick(1.0)
    assert len(host.take(HEARTBEAT + ROBOT.host_node_id)) in (10, 11)


@proves("COM-20")
async def _error_frames(host: Host) -> None:
    host.inject("COM-20", times=50)
    await host.tick(0.2)
    assert 19 <= host.bus.error_frames <= 21
    await host.tick(1.0)
    assert host.bus.error_frames == 50


@proves("COM-21", "COM-22")
async def _lost(host: Host) -> None:
    for id, words in (("COM-21", "bus off"), ("COM-22", "unplugged")):
        host.errors.clear()
        host.inject(id, duration_s=0.5)
        await host.tick(0.4)
        assert {type(error) for error in host.errors} == {DeviceLost}
        assert words in str(host.errors[0])
        host.take()
        await host.tick(0.3)
        assert host.take()
    assert host.state(LEFT) in FAULT_STATES  # they missed the heartbeat


@proves("COM-23")
async def _replugged(host: Host) -> None:
    host.inject("COM-23", off_s=0.1, on_s=0.1, times=3)
    lost = []
    for _ in range(40):
        host.errors.clear()
        await host.tick(0.02)
        lost.append(bool(host.errors))
    assert [gone for gone, _ in itertools.groupby(lost)] == [True, False] * 3
    assert 15 <= sum(lost) <= 18


@proves("COM-24")
async def _unreadable(host: Host) -> None:
    host.inject("COM-24")
    await host.tick(0.1)
    assert [str(error) for error in host.errors] == ["CAN: cannot be read: told to"]
    host.inject("COM-24", times=None)
    await host.tick(0.2)
    assert len(host.errors) == 11


@proves("COM-25")
async def _busy(host: Host) -> None:
    host.inject("COM-25", times=4)
    await host.tick(0.1)
    assert [type(error) for error in host.errors] == [DeviceBusy] * 4
    undo = host.inject("COM-25", times=None)
    await host.tick(0.1)
    assert len(host.errors) == 4 + 5 * 6
    undo()
    await host.tick(0.1)
    assert len(host.errors) == 4 + 5 * 6


@proves("COM-29")
async def _silent(host: Host) -> None:
    host.inject("COM-29", duration_s=0.5)
    host.take()
    await host.tick(0.48)
    assert host.take() == []
    await host.tick(0.1)
    assert host.take()
    assert host.state(LEFT) is DriveState.OPERATION_ENABLE  # they heard us
