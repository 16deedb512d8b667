"""Makes a path of what was recorded in the run, beside the ticks: does jobs of the kind FIT."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

from msgspec import Struct

from artemis.devices.device import Readings, Report, Work
from artemis.devices.worker import Worker, WorkerEnded
from artemis.errors import ConfigError
from artemis.motion.fitting import with_reserve
from artemis.motion.planned_route import FITTER, packed_route, unpacked_poses
from artemis.motion.track import Track
from artemis.values import Job, JobResult, Pose, Tick
from artemis.vehicle import RobotFile

MODELLED = 0.05
"""On virtual time it takes so long [s]."""
UNFIT = "PTH-01"


class TrackUse(Struct, frozen=True, kw_only=True):
    """How a step wants what was recorded: as of `Track.route`."""

    speed: float | None
    close_within: float
    round_corners: float
    allow_slowdown: bool
    reserve: bool
    """Its follower wants it `with_reserve`."""


class TrackFitter:
    """`Actuators` without drives of its own, so that jobs reach it. In real time it works in a process."""

    drives = (FITTER,)

    def __init__(self, robot: RobotFile, uses: Mapping[int, TrackUse], *, virtual: bool) -> None:
        """Fit nothing yet.

        Args:
            robot: that is to drive there.
            uses: by the numbers of their steps.
            virtual: it takes what it is modelled to take.
        """
        self._robot, self._uses = robot, uses
        self._worker, self._virtual = Worker(virtual=virtual), virtual

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """As of a `Device`: the process loads what it will need."""
        return [] if self._virtual else [self._warm()]

    async def _warm(self) -> None:
        line = [Pose(x=0.1 * number) for number in range(11)]
        with suppress(WorkerEnded):  # the first job says so
            await self._worker.do(fitted_track, self._robot, next(iter(self._uses.values())), line)

    def sense(self, now: float) -> Readings:
        """Nothing: it measures nothing."""
        return Readings()

    def write(self, tick: Tick) -> None:
        """It follows from no tick."""

    def stop(self) -> None:
        """It moves nothing."""

    async def perform(self, job: Job) -> JobResult:
        """Fit a path through the job's poses, as the step that it names wants it."""
        poses = unpacked_poses(job.values)
        try:
            found = await self._worker.do(fitted_track, self._robot, self._uses[int(job.value)], poses)
        except WorkerEnded as ended:
            return ended.result(job)
        if self._virtual:
            await asyncio.sleep(MODELLED)
        if isinstance(found, str):
            return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail=found, fault=UNFIT)
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, values=found)

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._worker.close()


def fitted_track(robot: RobotFile, use: TrackUse, poses: list[Pose]) -> tuple[int, ...] | str:
    """What was driven as a packed route; or why nothing can be followed."""
    try:
        route = Track(poses=poses).route(robot, use.speed, use.close_within, use.round_corners, use.allow_slowdown)
        route = with_reserve(route, robot) if use.reserve else route
    except ConfigError as error:
        return "; ".join(error.problems)
    return packed_route(route)
