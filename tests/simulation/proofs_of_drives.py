"""Proofs that the injections into drives happen."""

from __future__ import annotations

import pytest
from injection_rig import HEARTBEAT, LEFT, RIGHT, SDO_ANSWER, STEER, Host, proves

from artemis.drive_states import DriveState, Nmt


@proves("DRV-30")
async def _reset(host: Host) -> None:
    host.inject("DRV-30", LEFT)
    await host.tick(0.02)
    assert [frame.data for frame in host.from_drive(0x080, LEFT)] == [bytes(8)]
    assert host.state(LEFT) is DriveState.OPERATION_ENABLE


@proves("DRV-31")
async def _unknown(host: Host) -> None:
    host.inject("DRV-31", LEFT)
    await host.tick(0.02)
    assert host.emergencies(LEFT) == [0x9999]
    assert host.state(LEFT) is DriveState.FAULT


@proves("DRV-32")
async def _damaged(host: Host) -> None:
    host.inject("DRV-32", LEFT, length=3)
    await host.tick(0.02)
    assert [frame.data for frame in host.from_drive(0x080, LEFT)] == [b"\x00\x10\x01"]


@proves("DRV-33")
async def _storm(host: Host) -> None:
    host.inject("DRV-33", STEER, times=30)
    await host.tick(1.0)
    assert host.emergencies(STEER) == [0x2310] * 30
    assert host.state(STEER) is DriveState.FAULT


# ---------------------------------------------------------------------------------------------- states and objects


@proves("COM-01")
async def _silent_fault(host: Host) -> None:
    host.inject("COM-01", STEER)
    await host.tick(0.1)
    assert host.emergencies(STEER) == []
    assert host.statuswords(STEER)[-1] & 0x0008


@proves("COM-02", "RUN-06")
async def _off(host: Host) -> None:
    for id, node in (("COM-02", STEER), ("RUN-06", LEFT)):
        host.inject(id, node)
        await host.tick(0.04)
        assert host.state(node) is DriveState.SWITCH_ON_DISABLED
        assert host.statuswords(node)[-1] & 0x006F == 0x0040
        assert host.emergencies(node) == []


@proves("COM-03")
async def _refuse(host: Host) -> None:
    host.inject("COM-02", LEFT)
    host.inject("COM-03", LEFT, duration_s=0.5)
    for word, state in ((0x0006, DriveState.READY), (0x000F, DriveState.READY)):
        host.words[LEFT] = word
        await host.tick(0.1)
        assert host.state(LEFT) is state
    await host.tick(0.5)
    assert host.state(LEFT) is DriveState.OPERATION_ENABLE


@proves("COM-04")
async def _mode(host: Host) -> None:
    undo = host.inject("COM-04", STEER, mode=3)
    await host.tick(0.1)
    assert {frame.data[6] for frame in host.from_drive(0x280, STEER)[1:]} == {3}
    undo()
    host.take()
    await host.tick(0.1)
    assert {frame.data[6] for frame in host.from_drive(0x280, STEER)[1:]} == {host.steering_mode & 0xFF}


@proves("COM-05")
async def _statusword(host: Host) -> None:
    host.inject("COM-05", LEFT)
    await host.tick(0.1)
    tables = host.robot.drives[LEFT].tables
    assert tables.state(host.statuswords(LEFT)[-1]) is DriveState.UNKNOWN
    assert host.state(LEFT) is DriveState.OPERATION_ENABLE


@proves("COM-06")
async def _stale(host: Host) -> None:
    for node in (LEFT, STEER):
        host.drive(node).power_on(host.loop.time())
        host.inject("COM-06", node, target=-777)
    await host.tick(host.boot)
    for node, index in ((LEFT, 0x60FF), (STEER, host.steered)):
        assert host.drive(node).read(index) == -777


@proves("COM-07")
async def _abort(host: Host) -> None:
    host.inject("COM-07", LEFT, index=0x6085, code=0x06090030, count=2)
    for _ in range(2):
        (answer,) = await host.ask(LEFT, 0x6085)
        assert answer == bytes.fromhex("80 85 60 00 30 00 09 06")
    (answer,) = await host.ask(LEFT, 0x6085)
    assert answer[0] == 0x43


@proves("COM-08")
async def _no_answer(host: Host) -> None:
    host.inject("COM-08", LEFT, duration_s=0.3)
    assert await host.ask(LEFT, 0x1000) == []
    assert len(await host.ask(STEER, 0x1000)) == 1
    assert len(await host.ask(LEFT, 0x1000)) == 1


@proves("COM-09")
async def _late_answer(host: Host) -> None:
    host.inject("COM-09", LEFT, late_s=0.1)
    asked = host.loop.time()
    await host.ask(LEFT, 0x1000)
    (frame,) = host.from_drive(SDO_ANSWER, LEFT)
    assert frame.time - asked == pytest.approx(0.1, abs=0.002)


@proves("COM-10")
async def _ignored_write(host: Host) -> None:
    host.inject("COM-10", LEFT)
    before = host.drive(LEFT).read(0x6085)
    (answer,) = await host.write_u32(LEFT, 0x6085, 0, 123)
    assert answer[0] == 0x60
    assert host.drive(LEFT).read(0x6085) == before


@proves("COM-11")
async def _no_feedback(host: Host) -> None:
    host.inject("COM-11", LEFT, count=6)
    await host.tick(0.2)
    assert len(host.statuswords(LEFT)) == len(host.statuswords(RIGHT)) - 3
    host.take()
    host.inject("COM-11", LEFT)
    await host.tick(0.2)
    assert len(host.statuswords(LEFT)) <= 1  # what was on its way


@proves("COM-19")
async def _twice(host: Host) -> None:
    host.inject("COM-19", LEFT)
    assert len(await host.ask(LEFT, 0x1018, 4)) == 2
    host.drive(LEFT).power_on(host.loop.time())
    host.take()
    await host.tick(host.boot)
    assert host.from_drive(HEARTBEAT, LEFT)[0].data == host.from_drive(HEARTBEAT, LEFT)[1].data == b"\0"


@proves("COM-26")
async def _reboot(host: Host) -> None:
    host.inject("COM-26", LEFT)
    await host.tick(host.boot)
    assert [frame.data for frame in host.from_drive(HEARTBEAT, LEFT)] == [b"\0"]
    assert host.drive(LEFT).read(0x1016, 1) == 0


@proves("COM-27")
async def _nmt(host: Host) -> None:
    host.inject("COM-27", LEFT)
    host.inject("COM-27", RIGHT, state="stopped")
    await host.tick(0.2)
    assert host.drive(LEFT).nmt is Nmt.PRE_OPERATIONAL
    assert host.from_drive(HEARTBEAT, LEFT)[-1].data == b"\x7f"
    assert host.from_drive(HEARTBEAT, RIGHT)[-1].data == b"\x04"


@proves("COM-28")
async def _no_heartbeat(host: Host) -> None:
    host.inject("COM-28", LEFT)
    await host.tick(0.05)
    host.take()
    await host.tick(0.5)
    assert host.from_drive(HEARTBEAT, LEFT) == []
    assert len(host.from_drive(HEARTBEAT, RIGHT)) == 5
    assert len(host.statuswords(LEFT)) == 25


@proves("COM-30")
async def _not_watching(host: Host) -> None:
    host.inject("COM-30", LEFT)
    host.beats = False
    await host.tick(0.5)
    assert host.emergencies(LEFT) == []
    assert host.emergencies(RIGHT) == host.emergencies(STEER) == [0x8130]


@proves("COM-32", "SYS-09")
async def _no_power(host: Host) -> None:
    for id in ("COM-32", "SYS-09"):
        host.inject(id, duration_s=0.2)
        host.take()
        await host.tick(0.2)
        assert host.take() == []
        await host.tick(host.boot)
        assert sorted(frame.id for frame in host.take()) == [0x701, 0x702, 0x703, 0x704]


@proves("COM-33")
async def _wrong_node(host: Host) -> None:
    true = await host.ask(LEFT, 0x1018, 2)
    host.inject("COM-33", LEFT, answers="another product")
    assert await host.ask(LEFT, 0x1018, 2) != true
    host.inject("COM-33", STEER)
    assert await host.ask(STEER, 0x1018, 2) == []


@proves("COM-34")
async def _not_released(host: Host) -> None:
    host.inject("COM-34", LEFT)
    (answer,) = await host.write_u32(LEFT, 0x1016, 1, 0)
    assert answer == bytes.fromhex("80 16 10 01 00 00 00 08")
    assert host.drive(LEFT).read(0x1016, 1) != 0
