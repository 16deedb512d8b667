"""Regulator gains of drives outside of a run: read as they are found, and stored for ever."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress

from artemis.devices.can_bus import FrameBus
from artemis.devices.drive import Drives
from artemis.devices.epos_jobs import EposJobs
from artemis.errors import DeviceError, DeviceLost
from artemis.values import Job, JobKind
from artemis.vehicle import Robot


async def read_gains(robot: Robot, bus: FrameBus) -> dict[str, tuple[int, ...] | str]:
    """Gains of every drive of the robot file, by name, in the order of the objects; or why it does not tell them.

    Only reads; not while somebody else talks SDO to the drives.
    """
    jobs = _jobs(robot, bus)

    async def ask(name: str) -> tuple[int, ...] | str:
        try:
            return await jobs[name].perform(Job(id=0, kind=JobKind.READ_GAINS, drive=name))
        except DeviceError as error:
            return error.problem

    return dict(zip(jobs, await asyncio.gather(*(ask(name) for name in jobs)), strict=True))


async def store_gains(
    robot: Robot, bus: FrameBus, wanted: Mapping[str, tuple[int, ...]], told: Callable[[str], None]
) -> None:
    """Have drives keep gains when their power goes, one after the other; each is stopped and off then.

    Args:
        robot: the robot.
        bus: nobody else may talk SDO on it.
        wanted: gains by drive, in the order of the objects.
        told: is called with the name of each drive that has stored them.

    Raises:
        DeviceError: a drive is another one, does not answer, or does not keep a value; the next were not asked.
    """
    jobs = _jobs(robot, bus)
    for name, numbers in wanted.items():
        await jobs[name].perform(Job(id=0, kind=JobKind.SECURE, drive=name))
        await jobs[name].perform(Job(id=0, kind=JobKind.WRITE_GAINS, drive=name, values=numbers))
        await jobs[name].perform(Job(id=0, kind=JobKind.STORE, drive=name))
        told(name)


def _jobs(robot: Robot, bus: FrameBus) -> dict[str, EposJobs]:
    drives = Drives(robot, bus)

    def receive() -> None:
        with suppress(DeviceLost):  # then no drive answers, which is told
            drives.receive()

    drives.wire.listen(receive)
    return {node.name: EposJobs(node) for node in drives.nodes}
