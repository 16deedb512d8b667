"""Drives outside of a run: their regulator gains are read, and numbers are stored in them for ever.

Over CAN or a serial line, by the same jobs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from artemis.devices.can_bus import FrameBus
from artemis.devices.canopen import HEARTBEAT
from artemis.devices.drive import Drives
from artemis.devices.epos_jobs import EposJobs
from artemis.devices.epos_objects import observer_of
from artemis.errors import DeviceError
from artemis.families.objects import Setting
from artemis.values import Job, JobKind
from artemis.vehicle import RobotFile

LISTEN = 0.3
"""Seconds of listening before the first frame of ours, as a run does; drives that were just switched on boot in it."""


async def read_gains(robot: RobotFile, bus: FrameBus) -> dict[str, tuple[int, ...] | str]:
    """Gains of every drive of the robot file, by name, in the order of the objects; or why it does not tell them.

    Only reads; not while somebody else talks SDO to the drives.
    """
    jobs = _jobs(_drives(robot, bus))
    await asyncio.sleep(LISTEN)

    async def ask(name: str) -> tuple[int, ...] | str:
        try:
            return await jobs[name].perform(Job(id=0, kind=JobKind.READ_GAINS, drive=name))
        except DeviceError as error:
            return error.problem

    return dict(zip(jobs, await asyncio.gather(*(ask(name) for name in jobs)), strict=True))


async def with_observer(robot: RobotFile, bus: FrameBus) -> frozenset[str]:
    """Drives whose velocity regulator has an observer, by name: their gains are for that one. As `read_gains`."""
    structures = {name: observer_of(drive) for name, drive in robot.drives.items()}
    known = {name: setting for name, setting in structures.items() if setting is not None}
    if not known:
        return frozenset()
    jobs = _jobs(_drives(robot, bus))
    await asyncio.sleep(LISTEN)

    async def has(name: str, observer: Setting) -> bool:
        try:
            present = await jobs[name].read(observer.object)
        except DeviceError:  # why its gains are not known is told of them
            return False
        return observer.over(present) == present

    found = await asyncio.gather(*(has(name, observer) for name, observer in known.items()))
    return frozenset(name for name, is_so in zip(known, found, strict=True) if is_so)


async def store(
    robot: RobotFile, bus: FrameBus, kind: JobKind, wanted: Mapping[str, tuple[int, ...]], told: Callable[[str], None]
) -> None:
    """Have drives keep numbers when their power goes, one after the other; each is stopped and off then.

    Args:
        robot: the robot.
        bus: nobody else may have the drives.
        kind: WRITE_GAINS or WRITE_CALIBRATION.
        wanted: numbers by drive, as in a job of that kind.
        told: is called with the name of each drive that has stored them.

    Raises:
        DeviceError: another master commands the drives; a drive is another one, does not answer, or does not keep a
            value. The next were not asked.
    """
    drives = _drives(robot, bus)
    jobs = _jobs(drives)
    await asyncio.sleep(LISTEN)
    for name, numbers in wanted.items():
        _check_alone(drives, robot, name)
        await jobs[name].perform(Job(id=0, kind=JobKind.SECURE, drive=name))
        await jobs[name].perform(Job(id=0, kind=kind, drive=name, values=numbers))
        await jobs[name].perform(Job(id=0, kind=JobKind.STORE, drive=name))
        told(name)


async def configure(robot: RobotFile, bus: FrameBus, told: Callable[[str], None], *, keep: bool) -> None:
    """Write the robot file's whole configuration into its drives, one after the other; each is stopped and off then.

    None watches the computer afterwards: a run that drives has them do that. `keep`: also when their power goes.
    `told` is called with the name of each drive that is done.

    Raises:
        DeviceError: as `store` does.
    """
    drives = _drives(robot, bus)
    jobs = _jobs(drives)
    await asyncio.sleep(LISTEN)
    kinds = [JobKind.SECURE, JobKind.CONFIGURE, JobKind.DISARM, *([JobKind.STORE] if keep else [])]
    for name in robot.drives:
        _check_alone(drives, robot, name)
        for kind in kinds:
            await jobs[name].perform(Job(id=0, kind=kind, drive=name))
        await drives.wire.sent()
        told(name)


def _check_alone(drives: Drives, robot: RobotFile, name: str) -> None:
    """Nobody else was heard sending what only we may send, since the last time."""
    drives.wire.take_in()
    if foreign := drives.wire.health().foreign:
        who = "another artemis uses this bus (COM-18): end it"
        if HEARTBEAT + robot.host_node_id not in foreign:
            who = f"another CANopen master commands the drives (COM-17): 0x{foreign[0]:03X} was heard"
        raise DeviceError(name, f"was sent nothing: {who}")


def _drives(robot: RobotFile, bus: FrameBus) -> Drives:
    drives = Drives(robot, bus)
    drives.wire.listen()
    return drives


def _jobs(drives: Drives) -> dict[str, EposJobs]:
    return {node.name: EposJobs(node) for node in drives.nodes}
