"""The planner of routes as a part of the robot: does jobs of the kind PLAN beside the ticks, and sees what stands."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from math import hypot, inf

import numpy as np

from artemis.devices.device import Readings, Report, Work
from artemis.devices.worker import Worker, WorkerEnded
from artemis.mapping.occupancy import OccupancyMap
from artemis.motion.planned_route import NOT_KEPT, ONLY_CHECKED, PLANNER, unpacked_poses
from artemis.route_planning.floor import CELL, Destination, floor_from
from artemis.route_planning.obstacle_layer import EVERY, KEPT, PlacedScan, placed_scan
from artemis.route_planning.planner import PlannedRoute, RouteRequest, plan_route
from artemis.route_planning.zoned import PlanOrder, ZonesIn, plan_zoned
from artemis.values import Job, JobResult, Pose, Snapshot, Tick
from artemis.vehicle import RobotFile

MODELLED, MODELLED_PER_POSE = 0.05, 10e-6
"""On virtual time a plan takes so long, and so much for each pose that is looked at [s]."""
DRIVEN_SPACING, DRIVEN = 0.05, 40
"""What the robot has driven is noted every so often [m], so many times."""

UNKNOWN_ZONES = "PTH-11"
AGAIN = 0.5
"""A file of zones that is wrong is read again after so long [s]: an editor may be about to replace it."""


class RoutePlanner:
    """`Actuators` without drives of its own, so that ticks and jobs reach it. In real time it plans in a process."""

    drives = (PLANNER,)

    def __init__(
        self, robot: RobotFile, destinations: Mapping[int, Destination], zones_in: ZonesIn, *, virtual: bool
    ) -> None:
        """Plan nothing yet.

        Args:
            robot: its outline and what it can turn.
            destinations: by the numbers of their steps.
            zones_in: reads the content of a file of zones; it goes to another process.
            virtual: a plan takes what it is modelled to take.
        """
        self._robot, self._destinations, self._zones_in = robot, destinations, zones_in
        self._known = {each.made_of.beside: each.made_of.raw for each in destinations.values()}
        """The files of zones, and what was in them when they were read last."""
        self._planned_for = dict(self._known)
        """The same when the newest route was planned."""
        self._pose = Pose()
        self._placed_scans: deque[PlacedScan] = deque()
        self._looked: dict[str, float] = {}
        """When a scan of each scanner was kept last [s of the run]."""
        self._driven: deque[Pose] = deque(maxlen=DRIVEN)
        self._worker, self._virtual = Worker(virtual=virtual), virtual

    def begin(self, start: float, wake: Callable[[], None], report: Report) -> Sequence[Work]:
        """As of a `Device`: the process loads, and compiles, what it will need."""
        return [] if self._virtual else [self._warm()]

    async def _warm(self) -> None:
        with suppress(WorkerEnded):  # the first job reports it
            await self._worker.do(warm_up, self._robot)

    def sense(self, now: float) -> Readings:
        """Nothing: it measures nothing of its own."""
        return Readings()

    def write(self, tick: Tick) -> None:
        """See where the robot is, and what it stands for."""
        snapshot = tick.snapshot
        if snapshot.pose.lost:
            self._driven.clear()
            return
        self._pose = snapshot.pose.pose
        self._note(backward=snapshot.odometry.speed < 0.0)
        self._look(snapshot)

    def _look(self, snapshot: Snapshot) -> None:
        """Keep a scan of each scanner now and then."""
        now = snapshot.time
        for source, scan in {scan.source: scan for scan in snapshot.sensed.scans}.items():
            if now - self._looked.get(source, -inf) < EVERY:
                continue
            self._looked[source] = now
            self._placed_scans.append(placed_scan(snapshot, scan, self._robot.geometry.wheelbase_m))
            while now - self._placed_scans[0].time > KEPT:
                self._placed_scans.popleft()

    def _note(self, *, backward: bool) -> None:
        """Keep where the robot was, as long as it drives forwards."""
        last = self._driven[-1] if self._driven else None
        if last is not None and hypot(self._pose.x - last.x, self._pose.y - last.y) < DRIVEN_SPACING:
            return
        if backward:
            self._driven.clear()
        self._driven.append(self._pose)

    def stop(self) -> None:
        """It moves nothing."""

    async def perform(self, job: Job) -> JobResult:
        """Plan a route for the step that the job names, from where the robot is; or keep the job's, if it is free."""
        order = self._order(job)
        try:
            done = await self._worker.do(plan_zoned, order)
            if done.wrong:
                await asyncio.sleep(AGAIN)
                done = await self._worker.do(plan_zoned, order)
        except WorkerEnded as ended:
            return ended.result(job)
        planned = done.planned
        if self._virtual:
            await asyncio.sleep(MODELLED + MODELLED_PER_POSE * planned.expanded)
        if done.wrong:
            return JobResult(
                id=job.id, kind=job.kind, drive=job.drive, ok=False, detail=done.wrong, fault=UNKNOWN_ZONES
            )
        self._known[order.beside] = done.raw
        if planned.values and planned.values != order.request.keywords["present"]:  # another route
            self._planned_for[order.beside] = done.raw
        ok = planned.arrived or bool(planned.values and not planned.only_present)
        return JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=ok, detail=planned.detail, values=planned.values)

    def _order(self, job: Job) -> PlanOrder:
        destination, present = self._destinations[int(job.value)], job.values
        goal = destination.goal
        if goal is None:
            goal, present = unpacked_poses(present[:3])[0], present[3:]
        keep, seek = present[:1] != (NOT_KEPT,), present[:1] != (ONLY_CHECKED,)
        request = partial(
            RouteRequest,
            robot=self._robot,
            start=self._pose,
            goal=goal,
            speed=destination.speed,
            margin=destination.margin,
            placed_scans=tuple(self._placed_scans),
            known_behind=destination.known_behind,
            driven=tuple(self._driven),
            present=present if keep and seek else present[1:],
            keep=keep,
            seek=seek,
        )
        made_of = destination.made_of
        return PlanOrder(
            content=made_of.content,
            beside=made_of.beside,
            known=self._known[made_of.beside],
            planned_for=self._planned_for[made_of.beside] if present else None,
            zones_in=self._zones_in,
            request=request,
        )

    def close(self) -> None:
        """End the process, and a plan under way."""
        self._worker.close()


def warm_up(robot: RobotFile) -> PlannedRoute:
    """Plan a route over empty ground: this loads, and compiles, all that other plans in this process need."""
    outline = robot.outline
    assert outline is not None
    side = 8.0 * (outline.front_m + outline.rear_m + 2.0 * outline.half_width_m)
    cells = np.zeros((round(side / CELL), round(side / CELL)), np.int8)
    empty = floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))
    start, goal = (Pose(x=share * side, y=0.5 * side) for share in (0.4, 0.6))
    return plan_route(RouteRequest(floor=empty, robot=robot, start=start, goal=goal, speed=0.1, known_behind=0.0))
