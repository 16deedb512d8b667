"""The jobs of a drive over SDO, against the simulated drive on the simulated wire, on virtual time."""

from __future__ import annotations

import asyncio
import itertools
import math
from pathlib import Path

import pytest
from core_builders import ROBOT
from epos_jobs_rig import LEFT, PER_DEGREE, STEER_LEFT, STEER_RIGHT, WATCH, Rig, bring_up, changed, has, on

from artemis.devices.can_bus import Frame
from artemis.devices.epos_jobs import MAX_RESETS
from artemis.devices.epos_objects import Units
from artemis.drive_states import DriveState, Nmt
from artemis.errors import DeviceError, DeviceRestarted, DeviceTimeout, NotKept, WrongDevice
from artemis.families import EPOS1, FAMILIES
from artemis.mission.loading import load_model
from artemis.sim.dictionary import AbortCode, AccessRefused, key_of
from artemis.sim.epos_settings import SimSettings
from artemis.supervision.catalogue import ROWS
from artemis.values import RESETS, Job, JobKind
from artemis.vehicle import RobotFile

# ---------------------------------------------------------------------------------------------- secure


@pytest.mark.parametrize("name", [LEFT, STEER_RIGHT])
def test_secured_drive_is_off_and_watches_nobody(name: str) -> None:
    async def test(rig: Rig) -> None:
        rig.node.poke(0x1016, 1, WATCH)
        await rig.jobs.secure(0.0)
        assert rig.node.state is DriveState.SWITCH_ON_DISABLED
        assert has(rig, 0x1016, 1) == 0
        assert rig.node.nmt is Nmt.PRE_OPERATIONAL

    on(name, test)


def test_moving_drive_is_stopped_before_its_power_is_cut() -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        speeds = rig.watch_power()
        await rig.jobs.secure(0.0)
        assert rig.node.state is DriveState.SWITCH_ON_DISABLED
        assert len(speeds) == 1
        assert speeds[0] < 1.0

    on(LEFT, test)


@pytest.mark.parametrize("kind", [JobKind.HALT, JobKind.KEEP_OFF])
def test_halted_drive_stops_before_its_power_is_cut_and_keeps_its_configuration(kind: JobKind) -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        speeds = rig.watch_power()
        order = Job(id=1, kind=kind, drive=rig.jobs.name)
        assert await rig.jobs.perform(order) == (1,), "it was found on"
        await asyncio.sleep(0.05)
        assert rig.node.state is DriveState.SWITCH_ON_DISABLED
        assert len(speeds) == 1
        assert speeds[0] < 1.0
        assert await rig.jobs.perform(order) == ()
        assert {index for index, _, _ in rig.writes()} == {0x6040}

    on(LEFT, test)


def test_drive_that_does_not_stop_is_an_error() -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        push = -rig.node.axis.load.viscous * 3000 - 2000.0

        def roll(dt: float) -> None:
            rig.node.axis.velocity = 500.0

        rig.node.axis.load_current, rig.node.axis.after_step = push, roll
        with pytest.raises(DeviceError, match=r"found moving and does not stop within 5 s"):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


def test_fault_that_is_found_is_reset() -> None:
    async def test(rig: Rig) -> None:
        rig.node.emergency(0x2310, asyncio.get_running_loop().time())
        await asyncio.sleep(0.02)
        assert has(rig, 0x6041) & 0x417F == 0x0108
        await rig.jobs.secure(0.0)
        assert has(rig, 0x6041) & 0x417F == 0x0140

    on(STEER_LEFT, test)


@pytest.mark.parametrize(("code", "reset"), [(0x8120, 0x82), (0xFF04, 0x81)])
def test_fault_that_needs_an_nmt_reset_and_that_nobody_heard_of_gets_it(code: int, reset: int) -> None:
    async def test(rig: Rig) -> None:
        rig.node.emergency(code, asyncio.get_running_loop().time(), heard=False)
        await asyncio.sleep(0.02)
        rig.drives.wire.take_traffic()
        await rig.jobs.secure(0.0)
        assert has(rig, 0x6041) & 0x417F == 0x0140
        assert nmt_commands(rig) == [0x80, reset, 0x80]
        await rig.jobs.configure()

    on(STEER_LEFT, test)


def test_reset_of_the_whole_node_is_enough_where_two_errors_need_different_ones() -> None:
    async def test(rig: Rig) -> None:
        for code in (0x8120, 0xFF04, 0x8120):
            rig.node.emergency(code, asyncio.get_running_loop().time(), heard=False)
        await asyncio.sleep(0.02)
        rig.drives.wire.take_traffic()
        await rig.jobs.secure(0.0)
        assert nmt_commands(rig) == [0x80, 0x81, 0x80]

    on(LEFT, test)


def test_reset_that_was_asked_for_is_not_repeated() -> None:
    async def test(rig: Rig) -> None:
        stays_in_fault(rig, 0x8120)
        rig.drives.wire.take_traffic()
        tried = r"after NMT Reset Communication, fault reset; error history: 0x8120"
        with pytest.raises(DeviceError, match=tried):
            await rig.jobs.secure(RESETS["communication"])
        assert nmt_commands(rig) == [0x82, 0x80]

    on(LEFT, test)


@pytest.mark.parametrize("code", sorted(EPOS1.resets))
def test_fault_that_remains_is_an_error_with_what_was_tried_and_the_history(code: int) -> None:
    async def test(rig: Rig) -> None:
        stays_in_fault(rig, code)
        reset = {"node": "NMT Reset Node", "communication": "NMT Reset Communication"}[EPOS1.resets[code]]
        told = rf"stays in fault, not switch on disabled after fault reset, {reset}; error history: 0x{code:04X}"
        with pytest.raises(DeviceError, match=told):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


def test_drive_that_no_reset_helps_is_not_reset_for_ever() -> None:
    async def test(rig: Rig) -> None:
        stays_in_fault(rig, 0x6100)
        rig.drives.wire.take_traffic()
        for _ in range(MAX_RESETS + 2):
            with pytest.raises(DeviceError, match="0x6100"):
                await rig.jobs.secure(0.0)
        assert nmt_commands(rig).count(0x81) == MAX_RESETS

    on(LEFT, test)


def test_fault_that_no_reset_is_for_is_an_error_with_the_history() -> None:
    async def test(rig: Rig) -> None:
        rig.node.emergency(0x2310, asyncio.get_running_loop().time())
        rig.node.failures.refuse_states(DriveState.SWITCH_ON_DISABLED)
        await asyncio.sleep(0.01)
        told = r"stays in fault, not switch on disabled after fault reset; error history: 0x2310"
        with pytest.raises(DeviceError, match=told):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


def test_state_that_is_no_fault_and_remains_is_an_error_without_a_reset() -> None:
    async def test(rig: Rig) -> None:
        rig.node.failures.misreport(0x6041, 0, lambda _: 0x0121)
        with pytest.raises(
            DeviceError, match=r"stays in ready to switch on, not switch on disabled; error history: empty"
        ):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


def test_resets_are_those_of_the_fault_table() -> None:
    needed = {code: reset for code, row in EPOS1.errors.items() if (reset := ROWS[row].recovery.reset)}
    assert needed == EPOS1.resets
    for family in FAMILIES.values():
        for code, row in family.errors.items():
            assert RESETS[ROWS[row].recovery.reset] <= RESETS[family.resets.get(code, "")], (family.name, hex(code))


def stays_in_fault(rig: Rig, code: int) -> None:
    """The drive has an error whose cause remains, whatever is reset, and remembers it."""
    rig.node.failures.misreport(0x6041, 0, lambda _: 0x0108)
    rig.node.failures.misreport(0x1003, 0, lambda _: 1)
    rig.node.failures.misreport(0x1003, 1, lambda _: code)


def nmt_commands(rig: Rig) -> list[int]:
    """NMT commands to the drive since the last look."""
    return [frame.data[0] for ours, frame in rig.drives.wire.take_traffic() if ours and frame.id == 0]


def test_silent_drive_is_a_timeout_that_names_it() -> None:
    async def test(rig: Rig) -> None:
        rig.node.power_off()
        with pytest.raises(DeviceTimeout, match=r"steer-left: no answer"):
            await rig.jobs.secure(0.0)

    on(STEER_LEFT, test)


@pytest.mark.parametrize("reset", ["communication", "node"])
def test_drive_that_restarts_by_itself_after_a_reset_is_told_from_the_reset(reset: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(RESETS[reset])
        loop = asyncio.get_running_loop()
        loop.call_later(0.5, lambda: rig.node.power_on(loop.time()))
        with pytest.raises(DeviceRestarted, match=r"traction-left: once more after it was reset"):
            await rig.jobs.secure(RESETS[reset])
        await rig.jobs.secure(RESETS[reset])

    on(LEFT, test)


def test_drive_that_restarts_while_it_is_configured_has_to_be_secured_again() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)
        loop = asyncio.get_running_loop()
        loop.call_later(0.03, lambda: rig.node.power_on(loop.time()))
        with pytest.raises(DeviceRestarted, match=r"traction-left: while it was configured"):
            await rig.jobs.configure()
        await rig.jobs.secure(0.0)
        await rig.jobs.configure()

    on(LEFT, test)


WRONG: list[tuple[dict[str, object], SimSettings | None, str]] = [
    ({"hardware_version": 0x6010}, None, r"node 1 is hardware 0x6210, expected 0x6010"),
    ({}, SimSettings(firmware=0x2031), r"firmware 0x2031 is older than 0x2032"),
    ({"serial_number": 0x12345678}, None, r"serial number 0x00000001, expected 0x12345678"),
]


@pytest.mark.parametrize(("described", "settings", "problem"), WRONG, ids=["hardware", "firmware", "serial"])
def test_wrong_drive_is_refused_and_told_nothing_but_to_stop(
    described: dict[str, object], settings: SimSettings | None, problem: str
) -> None:
    async def test(rig: Rig) -> None:
        with pytest.raises(DeviceError, match=problem):
            await rig.jobs.secure(0.0)
        assert rig.writes() == [(0x6040, 0, b"\0\0")]

    on(LEFT, test, robot=changed(LEFT, **described), settings=settings)


def test_wrong_drive_is_stopped_if_it_moves() -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        with pytest.raises(DeviceError, match="serial number"):
            await rig.jobs.secure(0.0)
        assert rig.node.axis.velocity == 0.0

    on(LEFT, test, robot=changed(LEFT, serial_number=0x12345678))


EPOS4 = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_epos4.yaml", RobotFile)


@pytest.mark.parametrize("kind", [JobKind.SECURE, JobKind.HALT, JobKind.KEEP_OFF, JobKind.DISARM])
def test_drive_of_another_family_is_told_nothing_for_a_controlword_may_mean_something_else_to_it(kind: JobKind) -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        rig.writes()
        with pytest.raises(
            WrongDevice, match=r"is of family epos1 \(EPOS, hardware 0x6210\), the robot file says epos4"
        ):
            await rig.jobs.perform(Job(id=1, kind=kind, drive=LEFT))
        assert rig.writes() == []
        assert rig.node.state is DriveState.OPERATION_ENABLE


def test_drive_of_another_family_is_left_in_the_exchange_of_process_data() -> None:
    async def test(rig: Rig) -> None:
        nmt_commands(rig)
        with pytest.raises(WrongDevice):
            await rig.jobs.secure(0.0)
        assert nmt_commands(rig) == []

    on(LEFT, test, robot=ROBOT.model_copy(update={"drives": {**ROBOT.drives, LEFT: EPOS4.drives[LEFT]}}))

    on(LEFT, test, robot=ROBOT.model_copy(update={"drives": {**ROBOT.drives, LEFT: EPOS4.drives[LEFT]}}))


def test_drive_that_was_replaced_by_one_of_another_family_is_found_when_it_is_secured() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)
        rig.node.poke(0x2003, 2, 0x6150)
        with pytest.raises(WrongDevice, match="is of family epos4"):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


@pytest.mark.parametrize("name", [LEFT, STEER_LEFT])
@pytest.mark.parametrize(("step", "stands"), [(1, True), (2, False)])
def test_drive_whose_counter_trembles_by_one_count_stands(name: str, step: int, stands: bool) -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        looks = itertools.count()
        rig.node._dictionary.getters[key_of(0x6064, 0)] = lambda: -0x80000000 if next(looks) % 2 else 0x80000000 - step
        if stands:
            await rig.jobs.secure(0.0)
        else:
            with pytest.raises(DeviceError, match="does not stop"):
                await rig.jobs.secure(0.0)

    on(name, test)


def test_drive_of_another_maker_is_refused() -> None:
    async def test(rig: Rig) -> None:
        rig.node.poke(0x1018, 1, 0x0000009A)
        with pytest.raises(DeviceError, match=r"node 1 is of vendor 0x9A, not maxon"):
            await rig.jobs.secure(0.0)

    on(LEFT, test)


def test_oldest_firmware_that_is_new_enough_is_accepted() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)

    on(LEFT, test, settings=SimSettings(firmware=0x2032))


def test_last_digit_of_the_hardware_version_does_not_matter() -> None:
    async def test(rig: Rig) -> None:
        rig.node.poke(0x2003, 2, 0x6213)
        await rig.jobs.secure(0.0)

    on(LEFT, test)


# ---------------------------------------------------------------------------------------------- reference


@pytest.mark.parametrize(
    ("name", "turns_with", "lowest", "highest"),
    [
        # 60 degrees of the virtual wheel: the inner wheel stands at 73.3, the outer one at 49.5 degrees; and 3 more.
        (STEER_LEFT, 1, -52.46, 76.32),
        (STEER_RIGHT, -1, -76.32, 52.46),
    ],
)
def test_referenced_drive_knows_its_angle_and_refuses_what_is_out_of_reach(
    name: str, turns_with: int, lowest: float, highest: float
) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.axis.position = 1000.0
        here = has(rig, 0x6064)
        await rig.jobs.reference(math.radians(10.0))
        assert rig.epos.feedback(0.0).position == pytest.approx(math.radians(10.0))
        ends = sorted(here + turns_with * PER_DEGREE * (angle - 10.0) for angle in (lowest, highest))
        assert [has(rig, 0x607D, 1), has(rig, 0x607D, 2)] == pytest.approx(ends, abs=0.02 * PER_DEGREE)

    on(name, test)


@pytest.mark.parametrize("counts", [2**31 - 1000, 1000 - 2**31])
def test_drive_that_may_count_beyond_its_last_number_is_refused(counts: int) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.failures.count_on_from(counts)
        rig.writes()
        with pytest.raises(NotKept, match=rf"counts from {counts} on: too near the end of its counter"):
            await rig.jobs.reference(0.0)
        assert rig.writes() == []

    on(STEER_LEFT, test)


# ---------------------------------------------------------------------------------------------- check target


def test_stale_speed_is_cleared_before_anything_is_enabled() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.poke(0x60FF, 0, 500)
        await rig.jobs.check_target()
        assert has(rig, 0x60FF) == 0

    on(LEFT, test)


def test_stale_angle_is_replaced_by_the_present_one() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.poke(0x2062, 0, 123456)
        await rig.jobs.check_target()
        assert has(rig, 0x2062) == has(rig, 0x6064)

    on(STEER_LEFT, test)


@pytest.mark.parametrize(("name", "index"), [(LEFT, 0x60FF), (STEER_LEFT, 0x2062)])
def test_harmless_target_is_left_alone(name: str, index: int) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.writes()
        await rig.jobs.check_target()
        assert rig.writes() == []

    on(name, test)


def test_target_that_cannot_be_cleared_is_an_error() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.poke(0x60FF, 0, 500)
        values = rig.node._dictionary.values
        rig.node._dictionary.written[key_of(0x60FF, 0)] = lambda _: values.__setitem__(key_of(0x60FF, 0), 500)
        with pytest.raises(DeviceError, match=r"keeps the stale set-point 500 in 0x60FF:0"):
            await rig.jobs.check_target()

    on(LEFT, test)


# ---------------------------------------------------------------------------------------------- history, disarm


def test_history_is_read_newest_first_and_no_longer_than_it_is() -> None:
    async def test(rig: Rig) -> None:
        assert await rig.jobs.read_history() == ()
        for code in (0x2310, 0x3210):
            rig.node.emergency(code, asyncio.get_running_loop().time())
        assert await rig.jobs.read_history() == (0x3210, 0x2310)
        for code in (0x1000, 0x4210, 0x5113, 0x6100):
            rig.node.emergency(code, asyncio.get_running_loop().time())
        assert await rig.jobs.read_history() == (0x6100, 0x5113, 0x4210, 0x1000, 0x3210)

    on(LEFT, test)


@pytest.mark.parametrize("name", [LEFT, STEER_RIGHT])
def test_disarmed_drive_rests_without_a_fault_when_our_heartbeat_ends(name: str) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        for _ in range(10):
            rig.bus.send(Frame(0x77F, b"\x05"))
            await asyncio.sleep(0.02)
        await rig.jobs.disarm()
        await asyncio.sleep(1.0)
        assert has(rig, 0x1016, 1) == 0
        assert rig.node.nmt is Nmt.PRE_OPERATIONAL
        assert rig.node.state is DriveState.SWITCH_ON_DISABLED
        assert await rig.jobs.read_history() == ()

    on(name, test)


def test_configured_drive_does_watch_our_heartbeat() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.bus.send(Frame(0x77F, b"\x05"))
        await asyncio.sleep(0.5)
        assert rig.node.state is DriveState.FAULT
        assert await rig.jobs.read_history() == (0x8130,)

    on(LEFT, test)


def test_disarming_stops_a_moving_drive_before_its_power_is_cut() -> None:
    async def test(rig: Rig) -> None:
        await rig.spin(1500)
        speeds = rig.watch_power()
        await rig.jobs.disarm()
        assert len(speeds) == 1
        assert speeds[0] < 1.0

    on(LEFT, test)


def test_drive_that_cannot_be_switched_off_goes_on_watching_us_and_takes_stop_frames() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node._dictionary.checks[key_of(0x6040, 0)] = _refuse
        with pytest.raises(DeviceError, match=r"0x6040"):
            await rig.jobs.disarm()
        await asyncio.sleep(0.001)
        assert has(rig, 0x1016, 1) == WATCH
        assert rig.node.nmt is Nmt.OPERATIONAL

    on(LEFT, test)


def test_drive_that_is_off_and_cannot_stop_watching_leaves_the_exchange_all_the_same() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node._dictionary.checks[key_of(0x1016, 1)] = _refuse
        with pytest.raises(DeviceError, match=r"0x1016"):
            await rig.jobs.disarm()
        await asyncio.sleep(0.001)
        assert rig.node.nmt is Nmt.PRE_OPERATIONAL

    on(LEFT, test)


def _refuse(value: int) -> None:
    raise AccessRefused(AbortCode.DEVICE_STATE)


def test_disarming_a_drive_in_fault_leaves_it_without() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        rig.node.emergency(0x2310, asyncio.get_running_loop().time())
        await asyncio.sleep(0.01)
        await rig.jobs.disarm()
        await asyncio.sleep(0.01)
        assert rig.node.state is DriveState.SWITCH_ON_DISABLED

    on(LEFT, test)


# ---------------------------------------------------------------------------------------------- as jobs


def test_every_kind_of_job_is_done_by_its_name() -> None:
    async def test(rig: Rig) -> None:
        numbers = {JobKind.WRITE_CALIBRATION: (1, 2, 3, 4), JobKind.WRITE_GAINS: (1, 2, 3, 4, 5, 6, 7)}
        for kind in JobKind:
            given = numbers.get(kind, ())
            result = await rig.drives.perform(Job(id=1, kind=kind, drive=STEER_LEFT, value=0.1, values=given))
            assert result.ok, result.detail
        assert rig.epos.feedback(0.0).position == pytest.approx(0.1)

    on(STEER_LEFT, test)


def test_job_that_fails_is_a_result_with_the_reason_and_without_the_name_twice() -> None:
    async def test(rig: Rig) -> None:
        result = await rig.drives.perform(Job(id=3, kind=JobKind.SECURE, drive=LEFT))
        assert (result.id, result.ok) == (3, False)
        assert result.detail.startswith("firmware 0x2031")

    on(LEFT, test, settings=SimSettings(firmware=0x2031))


def test_history_is_the_value_of_its_job() -> None:
    async def test(rig: Rig) -> None:
        rig.node.emergency(0x2310, asyncio.get_running_loop().time())
        result = await rig.drives.perform(Job(id=1, kind=JobKind.READ_HISTORY, drive=LEFT))
        assert (result.ok, result.values) == (True, (0x2310,))

    on(LEFT, test)


def test_jobs_of_one_drive_are_done_one_after_the_other() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)
        async with asyncio.TaskGroup() as tasks:
            for number, kind in enumerate((JobKind.CONFIGURE, JobKind.DISARM)):
                tasks.create_task(rig.drives.perform(Job(id=number, kind=kind, drive=LEFT)))
        await asyncio.sleep(0.01)
        assert has(rig, 0x1016, 1) == 0, "the end overtook the configuration, which armed the drive again"
        assert rig.node.nmt is Nmt.PRE_OPERATIONAL

    on(LEFT, test)


def test_jobs_of_four_drives_overlap() -> None:
    async def test(rig: Rig) -> None:
        loop = asyncio.get_running_loop()
        jobs = [Job(id=number, kind=JobKind.SECURE, drive=name) for number, name in enumerate(ROBOT.drives)]
        begun = loop.time()
        await rig.drives.perform(jobs[0])
        alone, begun = loop.time() - begun, loop.time()
        async with asyncio.TaskGroup() as tasks:
            for job in jobs:
                tasks.create_task(rig.drives.perform(job))
        assert loop.time() - begun < 1.5 * alone

    on(LEFT, test, settings=SimSettings(answer_time_s=0.005))


@pytest.mark.parametrize("name", ROBOT.drives)
def test_units_are_those_of_the_machine(name: str) -> None:
    drive = ROBOT.drives[name]
    units = Units(ROBOT, drive)
    sign = -1 if drive.mirrored else 1
    expected = 4700.0 if drive.role == "traction" else math.degrees(PER_DEGREE)
    assert units.counts == pytest.approx(sign * expected)
    assert units.rpm == pytest.approx(sign * expected * 60 / drive.sensor.counts_per_turn)
