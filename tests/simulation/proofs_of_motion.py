"""Proofs that the injections into the machine happen."""

from __future__ import annotations

import math

import pytest
from injection_rig import LEFT, RIGHT, ROBOT_4, RPM_PER_M_S, STEER, Host, proves

from artemis.drive_states import DriveState


@proves("RUN-01")
async def _runaway(host: Host) -> None:
    host.forward(0.2)
    await host.tick(1.0)
    host.inject("RUN-01", LEFT)
    host.inject("RUN-01", RIGHT, gain=-1.0)
    await host.tick(0.5)
    left, right = (host.drive(name).axis.velocity for name in (LEFT, RIGHT))
    assert left == pytest.approx(0.4 * RPM_PER_M_S, rel=0.01)
    assert right == pytest.approx(0.2 * RPM_PER_M_S, rel=0.01)  # mirrored: negative would be forward


@proves("RUN-02")
async def _slope(host: Host) -> None:
    undo = host.inject("RUN-02")
    await host.tick(0.5)
    assert host.world.speed == 0.0  # held
    for name in (LEFT, RIGHT):
        host.words[name] = 0x0000
    await host.tick(1.0)
    assert host.world.speed > 0.4
    undo()
    await host.tick(8.0)
    assert host.world.speed == 0.0


@proves("RUN-03")
async def _fade(host: Host) -> None:
    host.forward(0.5)
    await host.tick(2.0)
    host.inject("RUN-03")
    for name in (LEFT, RIGHT):
        host.words[name] = 0x000B
    await host.tick(1.0)
    assert host.state(LEFT) is DriveState.QUICK_STOP_ACTIVE
    assert host.world.speed == pytest.approx(0.4, abs=0.01)


@proves("RUN-04", "PTH-07")
async def _blocked(host: Host) -> None:
    host.forward(0.2)
    undo = host.inject("RUN-04", LEFT)
    await host.tick(0.5)
    assert host.drive(LEFT).axis.velocity == 0.0
    assert host.drive(RIGHT).axis.velocity != 0.0
    assert abs(host.drive(LEFT).axis.current) > 4000
    undo()
    host.inject("PTH-07")
    await host.tick(0.5)
    assert host.world.speed == 0.0


@proves("RUN-05")
async def _spin(host: Host) -> None:
    host.forward(0.2)
    await host.tick(1.0)
    host.inject("RUN-05", LEFT, slip=0.5)
    await host.tick(0.2)
    assert host.drive(LEFT).axis.velocity == pytest.approx(0.4 * RPM_PER_M_S, rel=0.01)
    assert host.world.speed == pytest.approx(0.2, rel=0.02)


@proves("RUN-09")
async def _wrap(host: Host) -> None:
    host.inject("RUN-09", LEFT, before_wrap=100)
    host.forward(0.2)
    await host.tick(2.0)
    positions = host.positions(LEFT)
    assert max(positions) > 2**31 - 100
    assert min(positions) < -(2**31) + 1000


@proves("RUN-10")
async def _jump(host: Host) -> None:
    host.inject("RUN-10", LEFT, bit=18, count=2)
    await host.tick(0.2)
    assert [position for position in host.positions(LEFT) if position] == [1 << 18] * 2


@proves("STE-02", "CAL-01")
async def _steering_blocked(host: Host) -> None:
    for id, node in (("STE-02", STEER), ("CAL-01", "steer-right")):
        host.inject(id, node)
        for step in range(50):
            host.targets[node] = 1000 * step
            await host.tick(0.02)
        assert host.drive(node).axis.position == 0.0
        assert host.emergencies(node) == [0x8611]


@proves("STE-03")
async def _offset(host: Host) -> None:
    undo = host.inject("STE-03", STEER, potentiometer=2, offset_v=0.2, drift_v_s=0.1)
    await host.tick(1.0)
    first, second = host.volts(STEER)[-1]
    assert first == pytest.approx(2510, abs=5)
    assert second == pytest.approx(2780, abs=8)
    undo()
    host.take()
    await host.tick(0.1)
    assert host.volts(STEER)[-1][1] == pytest.approx(2480, abs=5)


@proves("STE-04")
async def _rail(host: Host) -> None:
    host.inject("STE-04", STEER)
    host.inject("STE-04", "steer-right", voltage=0.0, potentiometer=2)
    await host.tick(0.1)
    assert host.volts(STEER)[-1][0] > 4980
    assert host.volts("steer-right")[-1][1] == 0


@proves("STE-05")
async def _coupling(host: Host) -> None:
    host.inject("STE-05", STEER, angle_deg=-7.0)
    await host.tick(0.1)
    assert math.degrees(host.world.wheel_angles[0]) == pytest.approx(-7.0)
    assert host.volts(STEER)[-1][0] == pytest.approx(2510 - 7 / 72 * 1000, abs=5)
    assert host.positions(STEER)[-1] == 0


@proves("STE-06")
async def _detached(host: Host) -> None:
    host.inject("STE-06", STEER)
    host.targets[STEER] = host.targets["steer-right"] = 5000
    await host.tick(0.5)
    assert host.world.wheel_angles[0] == 0.0
    assert host.world.wheel_angles[1] != 0.0
    assert host.positions(STEER)[-1] == pytest.approx(5000, abs=10)


@proves("STE-07")
async def _frozen(host: Host) -> None:
    host.inject("STE-07", STEER)
    await host.tick(0.04)
    host.take()
    for step in range(50):
        host.targets[STEER] = 1500 * step
        await host.tick(0.02)
    assert math.degrees(host.world.wheel_angles[0]) > 10.0
    assert len(set(host.volts(STEER))) == 1


@proves("PTH-06")
async def _kidnapped(host: Host) -> None:
    host.inject("PTH-06", x_m=1.0, y_m=-0.5, heading_deg=20.0)
    assert (host.world.pose.x, host.world.pose.y) == pytest.approx((1.0, -0.5))
    assert math.degrees(host.world.pose.heading) == pytest.approx(20.0)


@proves("SYS-10")
async def _found_turning(host: Host) -> None:
    host.exchanges = False
    for node in (LEFT, RIGHT):
        host.drive(node).power_on(host.loop.time())
    host.inject("SYS-10", LEFT, speed_rpm=400)
    await host.tick(0.5)
    assert host.state(LEFT) is DriveState.OPERATION_ENABLE
    assert host.drive(LEFT).axis.velocity == pytest.approx(400.0)
    assert host.drive(RIGHT).axis.velocity == 0.0


# ---------------------------------------------------------------------------------------------- supply


@proves("PWR-01", "PWR-02", "PWR-03")
async def _supply(host: Host) -> None:
    host.inject("PWR-01")
    await host.tick(1.0)
    assert 22.0 < host.world.supply_voltage < 24.0
    await host.tick(1.2)
    assert host.world.supply_voltage == pytest.approx(21.0, abs=0.1)
    host.inject("PWR-03")
    await host.tick(0.1)
    assert host.world.supply_voltage == pytest.approx(18.0, abs=0.1)
    await host.tick(0.2)
    assert host.world.supply_voltage == pytest.approx(21.0, abs=0.1)
    assert host.emergencies(LEFT) == []
    host.inject("PWR-02", within_s=0.5)
    await host.tick(0.7)
    assert [host.emergencies(name) for name in host.robot.drives] == [[0x3220]] * 4


@proves("EST-01", "EST-03", "EST-04")
async def _emergency_stop(host: Host) -> None:
    host.forward(0.3)
    await host.tick(1.0)
    for id in ("EST-01", "EST-03", "EST-04"):
        release = host.inject(id)
        await host.tick(0.06)
        if host.robot is not ROBOT_4:
            assert host.world.supply_voltage < 1.0
        else:
            assert [host.emergencies(name) for name in host.robot.drives] == [[0x8A88]] * 4 or id != "EST-01"
            assert {host.drive(name).axis.current for name in host.robot.drives} == {0.0}
        assert {host.state(name) for name in host.robot.drives} == {DriveState.FAULT}
        assert host.world.speed > 0.2 or id != "EST-01"  # it coasts
        release()
        await host.tick(0.1)
        assert host.world.supply_voltage > 24.0


@proves("CAL-02")
async def _remembered(host: Host) -> None:
    host.inject("CAL-02", STEER, zero_uv=2_400_000)
    await host.tick(0.1)
    assert host.drive(STEER).read(0x200C if host.first else 0x210C, 1) == 2_400_000
