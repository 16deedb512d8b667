"""Our drives' driver and bring-up against nodes of the `canopen` package."""

from __future__ import annotations

import asyncio
import math

import pytest
from local_epos import DISABLED, ENABLED, QUICK_STOP
from msgspec.structs import replace
from node_bench import PERIOD, ROBOT, STEERING, Bench, on_virtual_time, refusals

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.plugins.guard import PluginGuard
from artemis.robot import Core, Robot
from artemis.states.mode import ON, STOPPING
from artemis.states.plan import Plan
from artemis.values import (
    JobKind,
    Mode,
    SetPoints,
    Tick,
)


def test_four_nodes_are_secured_configured_referenced_and_disarmed_at_once() -> None:
    async def main() -> None:
        bench = Bench()
        nodes = bench.nodes
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        assert {node.nmt.state for node in nodes.values()} == {"OPERATIONAL"}
        assert {node.value(0x1016, 1) for node in nodes.values()} == {127 << 16 | 200}
        assert [nodes[name].value(0x6060) for name in ROBOT.drives] == [3, 3, -1, -1]
        assert nodes["traction-left"].value(0x6410, 1) == 5000
        assert nodes["steer-left"].value(0x60FB, 3) == 200

        nodes["steer-left"].position = 12_345
        assert refusals(await bench.perform(JobKind.REFERENCE, value=0.1)) == []
        low, high = nodes["steer-left"].value(0x607D, 1), nodes["steer-left"].value(0x607D, 2)
        assert low < 12_345 < high
        assert high - low > 1.5 * 2000 * 946 / math.tau  # 0x607D lets the wheel turn by more than 1.5 rad

        assert refusals(await bench.perform(JobKind.CLEAR_TARGET)) == []
        assert nodes["steer-left"].value(0x2062) == 12_345
        assert nodes["traction-left"].value(0x60FF) == 0

        assert refusals(await bench.perform(JobKind.DISARM)) == []
        assert {node.value(0x1016, 1) for node in nodes.values()} == {0}
        assert {node.nmt.state for node in nodes.values()} == {"PRE-OPERATIONAL"}
        assert bench.states() == {DISABLED}

    on_virtual_time(main())


def test_error_history_is_read_newest_first() -> None:
    async def main() -> None:
        bench = Bench()
        node = bench.nodes["steer-right"]
        node.set_data(0x1003, 0, b"\x02")
        node.set_data(0x1003, 1, (0x00008611).to_bytes(4, "little"))
        node.set_data(0x1003, 2, (0x00013210).to_bytes(4, "little"))
        results = await bench.perform(JobKind.READ_HISTORY)
        assert {result.drive: result.values for result in results if result.values} == {"steer-right": (0x8611, 0x3210)}

    on_virtual_time(main())


def test_a_fault_found_at_start_is_reset() -> None:
    async def main() -> None:
        bench = Bench()
        for node in bench.nodes.values():
            node.status = 0x0108
        assert refusals(await bench.perform(JobKind.SECURE)) == []
        assert bench.states() == {DISABLED}

    on_virtual_time(main())


def test_set_points_are_decoded_by_the_peers_maps() -> None:
    async def main() -> None:
        bench = Bench()
        await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)
        await bench.perform(JobKind.REFERENCE, value=0.0)
        points = SetPoints(speed_left=0.4, speed_right=0.3, steering_left=0.1, steering_right=-0.2)
        await bench.tick(ON, points)
        for name, node in bench.nodes.items():
            first = node.rpdo[1]
            assert (first.cob_id, first.trans_type, len(first)) == (0x200 + ROBOT.drives[name].node_id, 1, 2)
        rpm_per_m_s = 60 / 72 / 2.1276596e-4
        left, right, steer_left, steer_right = (node.rpdo[1] for node in bench.nodes.values())
        assert left[0x6040].raw == 0x0B  # nothing was heard of the drive yet: it shall stand
        assert left[0x60FF].raw == round(0.4 * rpm_per_m_s)
        assert right[0x60FF].raw == -round(0.3 * rpm_per_m_s)  # mounted the other way round
        counts_per_rad = 2000 * 946 / math.tau
        assert steer_left[0x2062].raw == pytest.approx(0.1 * counts_per_rad, abs=1)
        assert steer_right[0x2062].raw == pytest.approx(0.2 * counts_per_rad, abs=1)

        await bench.tick(ON, points, count=3)
        assert bench.states() == {ENABLED}
        assert left[0x6040].raw == 0x0F
        assert [node.value(0x60FF) for node in bench.nodes.values()][:2] == [left[0x60FF].raw, right[0x60FF].raw]

    on_virtual_time(main())


def test_what_the_peers_maps_send_is_decoded() -> None:
    async def main() -> None:
        bench = Bench()
        await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)
        await bench.perform(JobKind.REFERENCE, JobKind.CLEAR_TARGET, value=0.0)
        points = SetPoints(speed_left=0.4, speed_right=0.4, steering_left=0.1, steering_right=0.1)
        await bench.tick(ON, points, count=5)
        before = {drive.name: drive.position for drive in bench.drives.sense(asyncio.get_running_loop().time()).drives}
        await bench.tick(ON, points, count=50)
        now = asyncio.get_running_loop().time()
        for drive in bench.drives.sense(now).drives:
            assert drive.state is DriveState.OPERATION_ENABLE
            assert drive.nmt is Nmt.OPERATIONAL
            assert drive.age is not None
            assert drive.age <= PERIOD + 1e-9
            assert drive.heartbeat_age is not None
            if drive.name.startswith("traction"):
                assert drive.mode == 3
                # whole rpm on the wire: within half of one
                assert drive.position - before[drive.name] == pytest.approx(0.4 * 50 * PERIOD, abs=3e-4)
            else:
                assert drive.mode == -1
                assert drive.position == pytest.approx(0.1, abs=1e-5)
                angle = math.degrees(STEERING[drive.name] + 0.1)
                calibration = ROBOT.potentiometers("left" if drive.name == "steer-left" else "right")
                expected = [z + angle / s for z, s in zip(calibration.zero_v, calibration.slope_deg_per_v, strict=True)]
                assert drive.potentiometers == pytest.approx(expected, abs=6e-4)

    on_virtual_time(main())


def test_a_stop_frame_acts_without_sync() -> None:
    async def main() -> None:
        bench = Bench()
        await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)
        await bench.perform(JobKind.REFERENCE, JobKind.CLEAR_TARGET, value=0.0)
        await bench.tick(ON, SetPoints(), count=4)
        bench.wire.seen.clear()
        bench.drives.stop()
        await asyncio.sleep(0.001)
        assert bench.states() == {QUICK_STOP}
        assert [frame.id for frame in bench.wire.seen] == [0x301, 0x302, 0x303, 0x304]

        await bench.tick(replace(STOPPING, steering=Goal.QUICK_STOPPED), SetPoints(), count=2)
        assert bench.states() == {QUICK_STOP}

    on_virtual_time(main())


def test_a_strange_device_is_refused_by_name() -> None:
    async def main() -> None:
        bench = Bench()
        bench.nodes["traction-right"].set_data(0x1018, 1, (0x1234).to_bytes(4, "little"))
        results = await bench.perform(JobKind.SECURE)
        assert refusals(results) == ["secure traction-right: node 2 is of vendor 0x1234, not maxon (0xFB)"]

    on_virtual_time(main())


def test_what_a_node_refuses_names_object_and_reason() -> None:
    async def main() -> None:
        bench = Bench()
        del bench.nodes["steer-left"].object_dictionary[0x6065]
        await bench.perform(JobKind.SECURE)
        (refused,) = refusals(await bench.perform(JobKind.CONFIGURE))
        assert refused.startswith("configure steer-left: ")
        assert "0x6065" in refused

    on_virtual_time(main())


def test_the_whole_bring_up_reaches_ready_and_ends_in_order() -> None:
    async def main() -> None:
        bench = Bench()
        plan = Plan(robot=ROBOT, steps=())
        ticks: list[Tick] = []
        core = Core(plan, PERIOD)
        robot = Robot(core, bench.drives, PluginGuard({}, asyncio.get_running_loop().time), PERIOD, ticks.append)
        await robot.run()

        modes = list(dict.fromkeys(tick.mode for tick in ticks))
        assert modes == [Mode.INIT, Mode.READY, Mode.END]
        assert not ticks[-1].failed
        assert core._shared.bring_up.aligned
        phases = list(dict.fromkeys(tick.wish.phase for tick in ticks))
        assert "proving the watchdog" in phases
        for name, angle in STEERING.items():  # the wheels stand straight
            node = bench.nodes[name]
            turned = node.position / (2000 * 946) * math.tau * (-1 if node.drive.mirrored else 1)
            assert angle + turned == pytest.approx(0.0, abs=math.radians(0.1))
        assert bench.states() == {DISABLED}
        assert {node.value(0x1016, 1) for node in bench.nodes.values()} == {0}
        assert {node.nmt.state for node in bench.nodes.values()} == {"PRE-OPERATIONAL"}

    on_virtual_time(main())
