"""The numbers that a drive keeps: its calibration and its gains, written, read back, stored for ever."""

from __future__ import annotations

import asyncio

import pytest
from core_builders import ROBOT
from epos_jobs_rig import LEFT, STEER_LEFT, Rig, has, on

from artemis.values import Job, JobKind, JobResult

CALIBRATION = (2_510_000, 2_480_000, 72_000_000, -72_000_000)
NEW_GAINS = (401, 121, 1201, 181, 151, 11, 201)


async def do(rig: Rig, kind: JobKind, *values: int) -> JobResult:
    return await rig.drives.perform(Job(id=1, kind=kind, drive=rig.jobs.name, values=values))


async def lose_power(rig: Rig) -> None:
    rig.node.power_off()
    rig.node.power_on(asyncio.get_running_loop().time())
    await asyncio.sleep(2.0)


@pytest.mark.parametrize("stored", [True, False])
def test_calibration_outlasts_the_power_once_it_is_stored(stored: bool) -> None:
    async def test(rig: Rig) -> None:
        await do(rig, JobKind.SECURE)
        assert (await do(rig, JobKind.READ_CALIBRATION)).values == (0, 0, 0, 0)
        assert (await do(rig, JobKind.WRITE_CALIBRATION, *CALIBRATION)).ok
        if stored:
            assert (await do(rig, JobKind.STORE)).ok
        await lose_power(rig)
        kept = await do(rig, JobKind.READ_CALIBRATION)
        assert kept.values == (CALIBRATION if stored else (0, 0, 0, 0))

    on(STEER_LEFT, test)


def test_gains_are_those_of_the_robot_file_until_others_are_written() -> None:
    async def test(rig: Rig) -> None:
        await do(rig, JobKind.SECURE)
        await do(rig, JobKind.CONFIGURE)
        gains = ROBOT.drives[LEFT].gains
        assert gains is not None
        assert (await do(rig, JobKind.READ_GAINS)).values == (*gains.current, *gains.velocity, *gains.position)
        assert (await do(rig, JobKind.WRITE_GAINS, *NEW_GAINS)).ok
        assert (await do(rig, JobKind.READ_GAINS)).values == NEW_GAINS

    on(LEFT, test)


def test_a_gain_out_of_range_is_refused_by_the_drive() -> None:
    async def test(rig: Rig) -> None:
        await do(rig, JobKind.SECURE)
        result = await do(rig, JobKind.WRITE_GAINS, -1, *NEW_GAINS[1:])
        assert (result.ok, result.fault) == (False, "COM-07")

    on(LEFT, test)


def test_position_limits_are_not_stored_and_hold_on() -> None:
    async def test(rig: Rig) -> None:
        await do(rig, JobKind.SECURE)
        await do(rig, JobKind.CONFIGURE)
        await do(rig, JobKind.REFERENCE)
        limits = [has(rig, 0x607D, number) for number in (1, 2)]
        assert (await do(rig, JobKind.STORE)).ok
        assert [has(rig, 0x607D, number) for number in (1, 2)] == limits != [-0x80000000, 0x7FFFFFFF]
        await lose_power(rig)
        assert [has(rig, 0x607D, number) for number in (1, 2)] == [-0x80000000, 0x7FFFFFFF]

    on(STEER_LEFT, test)
